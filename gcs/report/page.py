"""The report as one page that needs nothing but itself: no script, no request, readable in print and on a phone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Final

from gcs.config import Config
from gcs.report import page_parts as parts
from gcs.report.charts import curves, latency, link, map_from_above
from gcs.report.figures import Report
from gcs.report.html import Html, note, section, text
from gcs.report.moments import follows_and_losses
from gcs.report.pictures import Shot
from gcs.report.tally import Tally

_POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"  # whatever is in it runs nothing
_NAMES: Final = (
    ("timeline", "Timeline"), ("above", "From above"), ("curves", "Over time"), ("moments", "Losses"),
    ("limits", "Limits"), ("latency", "Latency"), ("link", "Link"), ("operator", "Operator"),
    ("parameters", "Parameters"), ("record", "Record"),
)  # fmt: skip


def page_of(report: Report, tally: Tally, pictures: Mapping[str, Sequence[Shot]], config: Config | None) -> str:
    """The whole page. pictures: as `pictures_of` gives them; config: None where it is not known."""
    body = "".join(_body(report, tally, pictures, config))
    style = resources.files("gcs.report").joinpath("page.css").read_text(encoding="utf-8")
    title = text(f"Flight {Path(report.folder).name}, {report.began}")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{style}</style></head>\n<body>{body}</body></html>\n"
    )


def _body(
    report: Report, tally: Tally, pictures: Mapping[str, Sequence[Shot]], config: Config | None
) -> Iterator[Html]:
    yield parts.head(report)
    yield Html("<nav>" + " ".join(f'<a href="#{name}">{title}</a>' for name, title in _NAMES) + "</nav>")
    yield parts.summary(report)
    yield section("timeline", "Timeline", parts.band(report), parts.timeline(report))
    yield section("above", "From above", map_from_above(report, tally, config))
    yield section("curves", "Over time", curves(report, tally, config))
    yield section("moments", "What was followed, lost and found", follows_and_losses(report, pictures))
    yield section("limits", "Limits that clipped", parts.limits(report))
    yield section("latency", "Latency, from light to command", latency(report, tally, config))
    yield section("link", "Link and video", parts.link_figures(report), link(report, tally))
    yield section("operator", "The operator", parts.operator(report))
    yield section("parameters", "The vehicle's parameters", parts.parameters(report))
    yield section("record", "Record", parts.record(report))
    yield note("Made by `gcs report`. Times are minutes and seconds since the first message of the record.")
