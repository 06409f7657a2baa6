"""Pieces of the page. Whatever comes from the flight is text and is escaped here; only `Html` goes in as it is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from gcs.report.words import clock


class Html(str):
    """Markup of our own making."""

    __slots__ = ()


def text(value: object) -> Html:
    """Escaped, unless it is markup of our own."""
    return value if isinstance(value, Html) else Html(escape(str(value)))


def table(head: Sequence[object], rows: Iterable[Sequence[object]], css: str = "") -> Html:
    """Empty where there are no rows. A table that is too wide or too long for the screen scrolls in its own place."""
    body = "".join("<tr>" + "".join(f"<td>{text(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    if not body:
        return Html("")
    top = "<tr>" + "".join(f"<th>{text(cell)}</th>" for cell in head) + "</tr>"
    return Html(f'<div class="scroll {css}"><table><thead>{top}</thead><tbody>{body}</tbody></table></div>')


def pairs(rows: Iterable[tuple[object, object]]) -> Html:
    """Names and values; what has no value is left out."""
    body = "".join(f"<dt>{text(name)}</dt><dd>{text(value)}</dd>" for name, value in rows if str(value) != "")
    return Html(f"<dl>{body}</dl>" if body else "")


def note(said: object) -> Html:
    """A line below a chart or in place of one."""
    return Html(f'<p class="note">{text(said)}</p>')


def figure(title: object, chart: str, caption: object = "") -> Html:
    """A chart with its title; empty where there is no chart."""
    if not chart:
        return Html("")
    below = note(caption) if str(caption) else ""
    return Html(f"<figure><figcaption>{text(title)}</figcaption>{chart}{below}</figure>")


def section(name: str, title: str, *parts: str) -> Html:
    """name: what links to it end in; what is missing is said."""
    body = "".join(parts) or note("Nothing of this is in the record.")
    return Html(f'<section id="{name}"><h2>{text(title)}</h2>{body}</section>')


def moment(t_s: float, href: str = "") -> Html:
    """A time in the flight, which may lead to where it is told."""
    said = clock(t_s)
    return Html(f'<a href="{escape(href)}">{said}</a>' if href else said)


def legend(names: Iterable[tuple[str, str]]) -> Html:
    """(css class, name) of each colour."""
    items = "".join(f'<span class="key"><i class="{css}"></i>{text(name)}</span>' for css, name in names)
    return Html(f'<p class="legend">{items}</p>' if items else "")


@dataclass(frozen=True, slots=True)
class Bar:
    """A stretch of a lane, s."""

    start_s: float
    end_s: float
    css: str
    title: str
    href: str = ""


def lanes(named: Iterable[tuple[str, Iterable[Bar]]], span_s: float) -> Html:
    """Bars over the flight's time, a row for each name; without a name the row is as wide as the page."""
    rows = []
    for name, bars in named:
        label = f'<span class="lane-name">{text(name)}</span>' if name else ""
        drawn = "".join(_bar(bar, max(span_s, 1e-3)) for bar in bars)
        rows.append(f'<div class="lane">{label}<span class="track">{drawn}</span></div>')
    ends = (
        f'<span class="track ends"><span>0:00</span><span>{clock(span_s / 2)}</span><span>{clock(span_s)}</span></span>'
    )
    label = '<span class="lane-name"></span>' if rows and "lane-name" in rows[0] else ""
    return Html("".join(rows) + f'<div class="lane">{label}{ends}</div>' if rows else "")


def _bar(bar: Bar, span_s: float) -> str:
    left, width = (100 * value / span_s for value in (bar.start_s, bar.end_s - bar.start_s))
    place = f'style="left:{max(left, 0):.3f}%;width:{min(max(width, 0.15), 100):.3f}%"'
    title = f'title="{escape(bar.title)}"'
    if bar.href:
        return f'<a class="{bar.css}" href="{escape(bar.href)}" {title} {place} aria-label="{escape(bar.title)}"></a>'
    return f'<i class="{bar.css}" {title} {place}></i>'
