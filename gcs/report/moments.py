"""Each follow and each loss as a card, with the pictures of its moments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from gcs.report.figures import Report
from gcs.report.html import Html, note, text
from gcs.report.pictures import Shot, key_of
from gcs.report.words import clock

_MOST_CARDS = 60


def follows_and_losses(report: Report, pictures: Mapping[str, Sequence[Shot]]) -> Html:
    """In order of time: a follow, then what was lost during it."""
    cards = sorted([*_follows(report, pictures), *_losses(report, pictures)], key=lambda card: card[0])
    if not cards:
        return note("Nothing was followed.")
    said = []
    if pictures:
        said.append("Box: the tracker's. Corners: where the filter expected the target.")
    elif report.losses:
        said.append("There are no pictures: the flight has no film that can be read.")
    if len(cards) > _MOST_CARDS:
        said.append(f"{len(cards) - _MOST_CARDS} more follows and losses are left out here; --json has them.")
    return Html("".join([note(" ".join(said)) if said else "", *(card for _, card in cards[:_MOST_CARDS])]))


def _follows(report: Report, pictures: Mapping[str, Sequence[Shot]]) -> Iterator[tuple[float, Html]]:
    for number, one in enumerate(report.follows):
        how = one.mode if one.standoff_m is None else f"{one.mode}, standoff {one.standoff_m:.1f} m"
        title = f"{clock(one.start_s)} followed for {clock(one.end_s - one.start_s)}" + (f" ({how})" if how else "")
        yield one.start_s, _card(key_of("follow", number), title, f"It ended {one.ended}.", pictures)


def _losses(report: Report, pictures: Mapping[str, Sequence[Shot]]) -> Iterator[tuple[float, Html]]:
    for number, one in enumerate(report.losses):
        end = "found again by itself" if one.found else "not found again"
        title = f"{clock(one.start_s)} lost for {one.end_s - one.start_s:.1f} s, {end}"
        yield one.start_s, _card(key_of("loss", number), title, "", pictures)


def _card(key: str, title: str, said: str, pictures: Mapping[str, Sequence[Shot]]) -> Html:
    shots = "".join(_shot(shot) for shot in pictures.get(key, ()))
    body = (note(said) if said else "") + (f'<div class="shots">{shots}</div>' if shots else "")
    return Html(f'<div class="card" id="{key}"><h3>{text(title)}</h3>{body}</div>')


def _shot(shot: Shot) -> str:
    said = text(f"{shot.name}, {clock(shot.t_s)}")
    return (
        f'<figure><img src="{shot.uri}" width="{shot.width_px}" height="{shot.height_px}" alt="{said}">'
        f"<figcaption>{said}</figcaption></figure>"
    )
