from __future__ import annotations

import pytest

from gcs.errors import SelectionError
from gcs.selection import BoxDrawing, check_box, draw_box, parse_box
from tests.gcs.clips import picture
from tracker.box import Box


def test_a_typed_box_is_its_top_left_corner_and_size() -> None:
    assert parse_box("10,20,30,40") == Box(25.0, 40.0, 30.0, 40.0)


@pytest.mark.parametrize("text", ["", "1,2,3", "1,2,3,4,5", "a,b,c,d", "1;2;3;4", "nan,2,30,40", "1,2,inf,40"])
def test_what_is_no_box(text: str) -> None:
    with pytest.raises(SelectionError, match="--box"):
        parse_box(text)


@pytest.mark.parametrize(
    ("xywh", "why"),
    [
        ((10, 10, 9.9, 50), "under 10 px"),
        ((10, 10, 50, -20), "under 10 px"),
        ((300, 10, 30, 30), "outside the frame of 320x240 px"),
        ((-5, 10, 30, 30), "outside the frame"),
        ((10, 220, 30, 30), "outside the frame"),
        ((1e9, 1e9, 30, 30), "outside the frame"),
    ],
)
def test_a_box_that_cannot_be_tracked_is_refused_with_its_figures(
    xywh: tuple[float, float, float, float], why: str
) -> None:
    with pytest.raises(SelectionError, match=why):
        check_box(Box.from_xywh(*xywh), 320, 240)


def test_edges_are_clipped_within_a_small_slack() -> None:
    assert check_box(Box.from_xywh(-1, 0, 31, 20), 320, 240).xywh == (0, 0, 30, 20)
    assert check_box(Box.from_xywh(290, 210, 31, 31), 320, 240).xywh == (290, 210, 30, 30)
    assert check_box(Box.from_xywh(0, 0, 10, 10), 320, 240).xywh == (0, 0, 10, 10)


def test_select_without_a_display_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(SelectionError, match="needs a display"):
        draw_box(picture(0))


def test_a_drag_of_the_mouse_becomes_a_box_in_picture_pixels() -> None:
    from matplotlib.backend_bases import MouseButton, MouseEvent
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2, 2.4), dpi=100)
    canvas = FigureCanvasAgg(figure)
    drawing = BoxDrawing(figure, picture(0))
    canvas.draw()
    assert drawing.box is None
    to_screen = figure.axes[0].transData.transform
    events = (
        ("button_press_event", (60, 90)),
        ("motion_notify_event", (100, 130)),
        ("button_release_event", (100, 130)),
    )
    for name, at in events:
        held = [MouseButton.LEFT] if name == "motion_notify_event" else None
        canvas.callbacks.process(name, MouseEvent(name, canvas, *to_screen(at), MouseButton.LEFT, buttons=held))
    assert drawing.box is not None
    assert drawing.box.xywh == pytest.approx((60, 90, 40, 40), abs=0.5)
