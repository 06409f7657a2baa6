"""The fence itself: what it may be, and that its walls keep every piece of it out."""

import math
import random

import pytest

from control.fence import Fence, walls

L_SHAPE = ((0.0, 0.0), (60.0, 0.0), (60.0, 20.0), (20.0, 20.0), (20.0, 60.0), (0.0, 60.0))
U_SHAPE = ((0.0, 0.0), (50.0, 0.0), (50.0, 60.0), (35.0, 60.0), (35.0, 15.0), (15.0, 15.0), (15.0, 60.0), (0.0, 60.0))
ARROW = ((0.0, 0.0), (60.0, 30.0), (0.0, 60.0), (20.0, 30.0))
SQUARE = ((0.0, 0.0), (0.0, 40.0), (40.0, 40.0), (40.0, 0.0))


def star(rng):
    """A polygon with notches: corners all round a centre, near and far."""
    corners = rng.randrange(3, 20)
    angles = ((k + rng.uniform(0, 0.4)) * 2 * math.pi / corners for k in range(corners))
    places = ((rng.uniform(15, 100), angle) for angle in angles)
    return tuple((far * math.cos(angle), far * math.sin(angle)) for far, angle in places)


def polygon_walls(corners, north, east):
    return walls(Fence(polygon_m=corners), north, east)[64:]


def winding(corners, north, east):
    """Inside or not, told another way than the fence does: by the angle the corners are passed under."""
    angles = [math.atan2(e - east, n - north) for n, e in corners]
    turns = ((b - a + math.pi) % (2 * math.pi) - math.pi for a, b in zip(angles, angles[1:] + angles[:1], strict=True))
    return abs(sum(turns)) > math.pi


SHAPES = [L_SHAPE, U_SHAPE, ARROW, SQUARE, SQUARE[::-1], *(star(random.Random(seed)) for seed in range(30))]


@pytest.mark.parametrize("corners", SHAPES)
def test_walls_keep_each_side_of_a_polygon_out(corners):
    rng = random.Random(1)
    inside = outside = 0
    for _ in range(500):
        north, east = rng.uniform(-110, 110), rng.uniform(-110, 110)
        found = polygon_walls(corners, north, east)
        assert len(found) == len(corners)
        if not winding(corners, north, east):
            assert all(distance <= 0 for _, _, distance in found)
            outside += 1
            continue
        inside += 1
        for (n, e, distance), (a, b) in zip(found, zip(corners, corners[1:] + corners[:1], strict=True), strict=True):
            assert math.hypot(n, e) == pytest.approx(1.0)
            for k in range(21):
                point = a[0] + (b[0] - a[0]) * k / 20 - north, a[1] + (b[1] - a[1]) * k / 20 - east
                assert n * point[0] + e * point[1] >= distance - 1e-9
                assert math.hypot(*point) >= distance - 1e-9
    assert min(inside, outside) > 5


@pytest.mark.parametrize("corners", [L_SHAPE, U_SHAPE, ARROW, SQUARE, star(random.Random(5))])
def test_what_stops_before_every_wall_is_inside(corners):
    rng = random.Random(2)
    reached = 0
    for _ in range(300):
        here = rng.uniform(0, 60), rng.uniform(0, 60)
        if not winding(corners, *here):
            continue
        found = polygon_walls(corners, *here)
        for _ in range(50):
            move = rng.gauss(0, 15), rng.gauss(0, 15)
            if all(n * move[0] + e * move[1] < distance for n, e, distance in found):
                reached += 1
                assert winding(corners, here[0] + move[0], here[1] + move[1])
    assert reached > 100


def test_the_wall_of_a_side_stands_at_its_nearest_point():
    found = polygon_walls(SQUARE, 10.0, 15.0)
    assert found == [(-1.0, 0.0, 10.0), (0.0, 1.0, 25.0), (1.0, 0.0, 30.0), (0.0, -1.0, 15.0)]
    beyond = polygon_walls(SQUARE, 50.0, 50.0)[1]
    assert beyond == pytest.approx((-math.sqrt(0.5), -math.sqrt(0.5), -math.sqrt(200)))


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.0, 20.0), (40.0, 40.0)])
def test_on_a_side_there_is_no_room(place):
    assert 0.0 in [distance for _, _, distance in polygon_walls(SQUARE, *place)]
    assert all(math.hypot(n, e) == pytest.approx(1.0) for n, e, _ in polygon_walls(SQUARE, *place))


@pytest.mark.parametrize("place", [(30.0, 0.0), (-18.0, 32.0), (0.0, 0.0)])
def test_a_circle_is_kept_from_within(place):
    fence = Fence(north_m=10.0, east_m=-5.0, radius_m=50.0)
    found = walls(fence, *place)
    assert len(found) == 64
    out_m = math.hypot(place[0] - 10.0, place[1] + 5.0)
    assert 50.0 * math.cos(math.pi / 64) - out_m <= min(d for _, _, d in found) <= 50.0 - out_m
    for angle in range(0, 360, 3):
        ray = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        run_m = min(d / (n * ray[0] + e * ray[1]) for n, e, d in found if n * ray[0] + e * ray[1] > 1e-9)
        end = place[0] + run_m * ray[0] - 10.0, place[1] + run_m * ray[1] + 5.0
        assert 49.9 < math.hypot(*end) <= 50.0 + 1e-9


def test_the_operators_circle_counts_only_when_asked_for():
    fence = Fence(operator_distance_m=50.0, operator_north_m=20.0, operator_east_m=-10.0)
    assert len(walls(Fence(operator_north_m=20.0), 0.0, 0.0)) == 64
    found = walls(fence, 20.0, -10.0)
    assert len(found) == 128
    assert [d for _, _, d in found[64:]] == pytest.approx([50.0 * math.cos(math.pi / 64)] * 64)


def test_degrees_become_metres_around_home():
    fence = Fence(polygon_deg=((47.001, 8.0), (47.0, 8.002), (46.999, 8.0), (47.0, 7.998)))
    assert walls(fence, 0.0, 0.0)[-1][2] < -1000
    placed = fence.placed(47.0, 8.0)
    assert (placed.polygon_deg, len(placed.polygon_m)) == ((), 4)
    degree_m = math.pi / 180 * 6_371_000.0
    assert placed.polygon_m[0] == pytest.approx((0.001 * degree_m, 0.0), abs=1e-6)
    assert placed.polygon_m[1] == pytest.approx((0.0, 0.002 * degree_m * math.cos(math.radians(47.0))), abs=1e-6)
    assert min(d for _, _, d in walls(placed, 0.0, 0.0)) == pytest.approx(89.6, abs=1.0)
    assert Fence(polygon_m=SQUARE).placed(47.0, 8.0) == Fence(polygon_m=SQUARE)


def test_a_polygon_across_the_date_line():
    placed = Fence(polygon_deg=((0.001, 179.999), (0.0, -179.999), (-0.001, 179.999))).placed(0.0, 180.0)
    assert [round(east) for _, east in placed.polygon_m] == [-111, 111, -111]


def test_a_home_far_from_the_polygon_is_said():
    fence = Fence(polygon_deg=((47.0, 8.0), (47.001, 8.0), (47.0, 8.001)))
    with pytest.raises(ValueError, match=r"^polygon_m: corner 1 must be within 20000 and 20000: "):
        fence.placed(48.0, 8.0)


@pytest.mark.parametrize(
    ("field", "corners", "message"),
    [
        ("polygon_m", SQUARE[:2], "polygon_m must have 3 to 64 corners, not 2"),
        ("polygon_m", ((0.0, 0.0),) * 65, "polygon_m must have 3 to 64 corners, not 65"),
        ("polygon_m", [*SQUARE, SQUARE[0]], "polygon_m must have 3 to 64 corners, not 5"),
        ("polygon_m", 7, "polygon_m must have 3 to 64 corners, not 7"),
        ("polygon_m", None, "polygon_m must have 3 to 64 corners, not None"),
        ("polygon_m", (*SQUARE[:3], 7), "polygon_m: corner 4 must be two finite numbers, not 7"),
        ("polygon_m", (*SQUARE[:3], (1.0,)), "polygon_m: corner 4 must be two finite numbers, not (1.0,)"),
        ("polygon_m", ((math.nan, 0.0), *SQUARE), "polygon_m: corner 1 must be two finite numbers, not (nan, 0.0)"),
        ("polygon_m", (*SQUARE[:2], (True, 0.0)), "polygon_m: corner 3 must be two finite numbers, not (True, 0.0)"),
        ("polygon_m", ((0.0, 20_001.0), *SQUARE[:2]), "polygon_m: corner 1 must be within 20000 and 20000: (0.0, 2"),
        ("polygon_m", ((-20_001.0, 0.0), *SQUARE[:2]), "polygon_m: corner 1 must be within 20000 and 20000: "),
        ("polygon_m", (*SQUARE, (40.05, 0.0)), "polygon_m: corner 4 and the next are the same place"),
        ("polygon_m", (*SQUARE, SQUARE[0]), "polygon_m: corner 5 and the next are the same place"),
        ("polygon_m", (SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]), "the sides from corner 1 and from corner 3 cross"),
        ("polygon_m", ((0.0, 0.0), (40.0, 0.0), (20.0, 0.0)), "polygon_m: corner 3 lies on the side from corner 1"),
        ("polygon_m", (*SQUARE, (20.0, 40.05)), "polygon_m: corner 5 lies on the side from corner 2"),
        ("polygon_deg", SQUARE[:2], "polygon_deg must have 3 to 64 corners, not 2"),
        ("polygon_deg", ((86.0, 8.0), *SQUARE), "polygon_deg: corner 1 must be within 85 and 180: (86.0, 8.0)"),
        ("polygon_deg", ((47.0, 181.0), *SQUARE), "polygon_deg: corner 1 must be within 85 and 180: (47.0, 181.0)"),
        ("polygon_deg", ((84.8, 0.0), (84.9, 0.0), (84.8, 2.01)), "polygon_deg: corner 3 is more than 20 km"),
        ("polygon_deg", SQUARE, "polygon_deg: corner 2 is more than 20 km from corner 1"),
        ("polygon_deg", ((47.0, 8.0), (47.0, 8.0), (47.1, 8.0)), "polygon_deg: corner 1 and the next are the same"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_polygon_is_said_in_one_line(field, corners, message):
    with pytest.raises(ValueError, match="corner") as caught:
        Fence(**{field: corners})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_polygon_is_given_once():
    with pytest.raises(ValueError, match=r"^polygon_m and polygon_deg are two ways to say the same: give one of them$"):
        Fence(polygon_m=SQUARE, polygon_deg=((47.0, 8.0), (47.001, 8.0), (47.0, 8.001)))


AROUND = tuple((300 * math.cos(a * math.pi / 32), 300 * math.sin(a * math.pi / 32)) for a in range(64))
FINE = [
    SQUARE[:3], star(random.Random(1)), AROUND,
    ((20_000.0, 0.0), (19_000.0, 0), (20_000, -20.0)), ((0.0, 20_000.0), (0.0, 19_000.0), (20.0, -20_000.0 + 39_000.0)),
    ((20_000.0, 0.0), (0.0, 0.0), (10.0, 10.0)),  # 20 km, and no more
    ((0.0, 0.0), (0.0, 0.1), (50.0, 50.0), (50.0, -50.0)), ((0.0, 0.0), (0.0, 40.0), (0.1, 20.0)),  # 0.1 m, and no less
    tuple((north / 50, east / 50) for north, east in L_SHAPE),
]  # fmt: skip


@pytest.mark.parametrize("corners", FINE)
def test_polygons_that_are_fine(corners):
    assert Fence(polygon_m=corners).polygon_m == corners


def test_degrees_reach_to_the_date_line():
    corners = ((85.0, 180.0), (85.0, 179.99), (84.99, 180.0))
    assert Fence(polygon_deg=corners).polygon_deg == corners
