import math

import numpy as np
import pytest

from resample_warp3d.depth.preparation import prepare
from resample_warp3d.methods.paper import Paper, Point, Splat
from resample_warp3d.types import DepthImage, Equation, Source
from tests.bits import assert_threads_change_nothing

NOWHERE = np.empty((0, 0, 2))
STAY = Equation(np.eye(3), np.zeros(3))
METHODS = Paper(), Splat(), Point()


def wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A smooth picture of places (...), (..., 3)."""
    parts = np.sin(0.23 * x), np.cos(0.19 * y), np.sin(0.11 * (x + y))
    return (0.5 + 0.3 * np.stack(parts, axis=-1)).astype(np.float32)


def centers(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return x, y


def wall(height: int = 40, width: int = 50, nearness: float = 0.5) -> Source:
    """A plane parallel to the picture, with a wave on it."""
    depth = np.full((height, width), nearness, np.float32)
    return prepare(DepthImage(wave(*centers(height, width)), depth, NOWHERE), noise=0.0)


def shift(x: float, y: float) -> Equation:
    """Px that a wall of nearness 0.5 moves by."""
    return Equation(np.eye(3), 2.0 * np.array([x, y, 0.0]))


def zoom(factor: float, center: tuple[float, float] = (25.0, 20.0)) -> Equation:
    """Move along the axis of view: a wall of nearness 0.5 grows by a factor."""
    x, y = center
    toward = 2.0 * (1.0 / factor - 1.0)
    return Equation(np.eye(3), toward * np.array([x, y, 1.0]))


def random_source(channels: int = 3) -> Source:
    """Slanted, stepped and unknown depth."""
    rng = np.random.default_rng(5)
    x, y = centers(20, 24)
    nearness = 0.4 + 0.004 * x - 0.003 * y + 0.0005 * (x - 9) ** 2
    nearness[6:13, 8:17] += 0.25
    nearness[rng.random(nearness.shape) < 0.06] = 0.0
    color = rng.random((20, 24, channels), np.float32)
    return prepare(DepthImage(color, nearness.astype(np.float32), NOWHERE), noise=0.0)


MOVED = Equation(
    np.array([[1.02, 0.05, -0.7], [-0.04, 0.97, 0.6], [0.001, -0.0005, 1.0]]),
    np.array([-2.5, 0.8, -0.3]),
)
NEARER = Equation(MOVED.matrix, np.array([-12.0, -9.0, -1.0]))
FARTHER = Equation(MOVED.matrix, np.array([13.0, 9.0, 1.2]))


def difference(image: np.ndarray, truth: np.ndarray, margin: int = 4) -> float:
    inner = slice(margin, -margin), slice(margin, -margin)
    return float(np.abs(image[inner] - truth[inner]).max())


@pytest.mark.parametrize("method", METHODS, ids=lambda method: type(method).__name__)
def test_the_count_of_threads_does_not_change_a_bit(method):
    source = random_source()
    assert_threads_change_nothing(lambda: method(source, NEARER, (130, 90)))


def test_a_pixel_does_not_depend_on_where_its_tile_begins():
    down = Equation(np.array([[1.0, 0, 0], [0, 1, 7], [0, 0, 1]]), np.zeros(3))
    source = wall(70, 20)
    here, lower = Paper()(source, STAY, (70, 20)), Paper()(source, down, (77, 20))
    np.testing.assert_array_equal(lower.image[7:], here.image)


def test_a_warp_that_stays_is_close_to_the_source(record):
    source = wall()
    rendered = Paper()(source, STAY, (40, 50))
    # A Gaussian of 0.45 px takes (0.23 × 0.45)² / 2 = 0.5 % of the fastest wave.
    record.error("largest", difference(rendered.image, source.color))
    assert rendered.coverage.min() == 1.0


@pytest.mark.parametrize("move", [(3.0, -2.0), (0.37, 0.81)])
def test_a_wall_that_moves_sideways_takes_its_picture_along(move, record):
    rendered = Paper()(wall(), shift(*move), (40, 50))
    x, y = centers(40, 50)
    # Where Gaussians of 0.45 px meet halfway they ripple by a few percent of the change per px.
    record.error("largest", difference(rendered.image, wave(x - move[0], y - move[1]), 5))


@pytest.mark.parametrize("factor", [0.31, 0.7, 1.6, 3.7])
def test_a_wall_that_comes_nearer_grows(factor, record):
    rendered = Paper()(wall(), zoom(factor), (40, 50))
    x, y = centers(40, 50)
    truth = wave((x - 25) / factor + 25, (y - 20) / factor + 20)
    wide = math.ceil(max(4, 25 - factor * 20)), math.ceil(max(4, 20 - factor * 15))
    inner = slice(wide[1], -wide[1]), slice(wide[0], -wide[0])
    # Minified, a pixel's mean over 3 samples differs from its center by (0.23 × 0.29 × 3)² / 2.
    record.error("largest", np.abs(rendered.image[inner] - truth[inner]).max())


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.5])
def test_nearness_and_magnification_of_a_wall_follow_from_its_size(factor):
    rendered = Paper()(wall(), zoom(factor), (40, 50))
    inner = slice(16, 24), slice(18, 32)
    np.testing.assert_allclose(rendered.nearness[inner], 0.5 * factor, rtol=1e-5)  # float32
    np.testing.assert_allclose(rendered.magnification[inner], factor**2, rtol=1e-4)


def test_a_slanted_plane_is_as_near_as_its_equation_says():
    x, y = centers(40, 50)
    depth = (0.5 + 0.004 * x - 0.002 * y).astype(np.float32)
    source = prepare(DepthImage(wave(x, y), depth, NOWHERE), noise=0.0)
    rendered = Paper()(source, MOVED, (40, 50))
    homography = MOVED.matrix + np.outer(MOVED.epipole, [0.004, -0.002, 0.5])
    seen = np.stack([x, y, np.ones_like(x)], axis=2) @ np.linalg.inv(homography).T
    truth = seen @ [0.004, -0.002, 0.5]
    np.testing.assert_allclose(rendered.nearness[6:-6, 6:-6], truth[6:-6, 6:-6], rtol=1e-4)


def test_a_pure_rotation_does_not_depend_on_depth():
    turned = Equation(MOVED.matrix, np.zeros(3))
    source = wall()
    ramp = (0.3 + 0.01 * centers(40, 50)[0]).astype(np.float32)
    other = prepare(DepthImage(source.color, ramp, NOWHERE), noise=0.0)
    near, far = Paper()(source, turned, (40, 50)), Paper()(other, turned, (40, 50))
    inner = slice(5, -5), slice(5, -5)  # cells at the frame's rim are not the others'
    np.testing.assert_allclose(near.image[inner], far.image[inner], atol=1e-6)


@pytest.mark.parametrize("factor", [0.4, 1.0, 2.3])
def test_a_hidden_wall_does_not_shine_through(factor):
    depth = np.full((40, 50), 0.2, np.float32)
    depth[10:30, 10:40] = 0.5
    color = np.where(depth[..., None] > 0.3, [0.0, 1.0], [1.0, 0.0]).astype(np.float32)
    source = prepare(DepthImage(color, depth, NOWHERE), noise=0.0)
    rendered = Paper()(source, zoom(factor), (40, 50))
    half = 10 * min(factor, 1.9) - 1  # of the front wall's picture, less the rim of a pixel
    rows, columns = centers(40, 50)[1] - 20, centers(40, 50)[0] - 25
    inside = (abs(rows) < half) & (abs(columns) < half)
    assert rendered.image[inside, 0].max() == 0.0
    assert rendered.image[inside, 1].min() == pytest.approx(1.0)


def test_surfaces_closer_than_the_tolerance_are_one():
    depth = np.full((40, 50), 0.5, np.float32)
    color = np.zeros((40, 50, 1), np.float32)
    color[:, ::2], depth[:, ::2] = 1.0, 0.502
    source = prepare(DepthImage(color, depth, NOWHERE), noise=0.0)
    assert 0.3 < Paper()(source, zoom(0.3), (40, 50)).image[20, 25, 0] < 0.7
    assert Paper(tolerance=1e-4)(source, zoom(0.3), (40, 50)).image[20, 25, 0] > 0.9


def ball(count: int = 64) -> DepthImage:
    """A ball of radius 1 that is 3 away, and nothing else."""
    x, y = (v / (1.2 * count) - 0.5 / 1.2 for v in centers(count, count))
    a, discriminant = x * x + y * y + 1, 9 - 8 * (x * x + y * y + 1)
    z = (3 - np.sqrt(np.maximum(discriminant, 0))) / a
    depth = np.where(discriminant > 0, 1 / z, 0)
    return DepthImage(np.ones((count, count, 1), np.float32), depth.astype(np.float32), NOWHERE)


def around(angle: float, count: int = 64) -> Equation:
    """Equation of a camera that has walked around the ball."""
    matrix = np.array([[1.2 * count, 0, count / 2], [0, 1.2 * count, count / 2], [0, 0, 1]])
    turn = np.array(
        [[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]]
    )
    center = np.array([0, 0, 3.0])
    return Equation(matrix @ turn @ np.linalg.inv(matrix), matrix @ (center - turn @ center))


@pytest.mark.parametrize("method", METHODS, ids=lambda method: type(method).__name__)
def test_a_ball_seen_from_behind_does_not_show_its_inside(method):
    rendered = method(prepare(ball(), noise=0.0), around(math.pi), (64, 64))
    assert not rendered.coverage.any()


def test_from_beside_a_ball_shows_the_half_that_the_source_saw():
    rendered = Paper()(prepare(ball(), noise=0.0), around(math.pi / 2), (64, 64))
    seen = rendered.coverage > 0
    left, right = seen[:, :32].mean(), seen[:, 32:].mean()
    assert max(left, right) > 0.3
    assert min(left, right) < 0.01


def test_unknown_depth_leaves_a_hole():
    source = wall()
    source.nearness[15:25, 20:30] = 0.0
    holes = Paper()(source, STAY, (40, 50)).coverage == 0
    assert holes[17:23, 22:28].all()  # splats reach one px into it
    assert not holes[:14].any()


def test_where_nothing_is_all_is_nothing():
    rendered = Paper()(wall(), shift(20.0, 0.0), (40, 50))
    assert not any(part[:, :18].any() for part in rendered)


def test_points_leave_holes_where_splats_do_not():
    point, splat = (method(wall(), zoom(4.0), (40, 50)) for method in (Point(), Splat()))
    assert point.coverage.mean() < 0.5
    assert splat.coverage.all()


def test_points_leave_no_holes_where_they_are_dense():
    rendered = Point()(wall(), zoom(0.6), (40, 50))
    assert rendered.coverage[12:28, 14:36].all()


def test_paper_filters_a_checker_that_splats_alone_alias():
    x, y = centers(80, 100)
    checker = ((x.astype(int) + y.astype(int)) % 2).astype(np.float32)[..., None]
    depth = np.full((80, 100), 0.5, np.float32)
    source = prepare(DepthImage(checker, depth, NOWHERE), noise=0.0)
    small = zoom(0.55, (50.0, 40.0))
    paper, splat = (method(source, small, (80, 100)) for method in (Paper(), Splat()))
    inner = slice(34, 46), slice(42, 58)
    assert paper.image[inner].std() < 0.1 * splat.image[inner].std()


def test_a_gap_between_linked_samples_is_marked_as_bridged():
    source = wall()
    source.links[:, 24] &= ~np.uint8(1)
    source.links[:, 25] &= ~np.uint8(4)
    source.nearness[:, 25:] *= 1.02
    rendered = Paper()(source, shift(-30.0, 0.0), (40, 50))
    assert rendered.bridged.any()
    assert not rendered.bridged[rendered.coverage == 0].any()
    assert (rendered.nearness[rendered.bridged] > 0).all()


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 7])
def test_a_channel_does_not_depend_on_the_others(channels):
    source = random_source(channels)
    together = Paper()(source, NEARER, (22, 26))
    last = source._replace(color=np.ascontiguousarray(source.color[..., -1:]))
    np.testing.assert_array_equal(
        Paper()(last, NEARER, (22, 26)).image[..., 0], together.image[..., -1]
    )


def test_given_places_that_are_the_grid_change_nothing():
    source = random_source()
    grid = source._replace(place=np.stack(centers(20, 24), axis=2))
    for given, expected in zip(
        Paper()(grid, MOVED, (22, 26)), Paper()(source, MOVED, (22, 26)), strict=True
    ):
        np.testing.assert_allclose(given, expected, atol=1e-5)  # rounding of the differences


def test_given_places_say_where_samples_are():
    source = wall()
    x, y = centers(40, 50)
    placed = source._replace(place=np.stack([2.0 * x + 0.3 * y, 0.2 * x + 1.5 * y], axis=2))
    affine = np.array([[2.0, 0.3, 0], [0.2, 1.5, 0], [0, 0, 1]])
    same = Equation(MOVED.matrix @ affine, MOVED.epipole)
    for given, expected in zip(
        Paper()(placed, MOVED, (80, 120)), Paper()(source, same, (80, 120)), strict=True
    ):
        np.testing.assert_allclose(given, expected, atol=1e-4)  # rounding of the differences


def test_samples_before_the_eye_neither_take_long_nor_leave_numbers_that_are_none():
    x, y = centers(60, 80)
    depth = (0.5 + 0.02 * x).astype(np.float32)
    source = prepare(DepthImage(wave(x, y), depth, NOWHERE), noise=0.0)
    into = Equation(np.eye(3), np.array([40.0, 30.0, 1.0]) * -1.0)  # to the depth of the middle
    rendered = Paper()(source, into, (60, 80))
    assert all(np.isfinite(part).all() for part in rendered)


def test_a_sample_reaches_64_px_at_most():
    source = wall(1, 1)
    rendered = Splat()(source, zoom(4000.0, (0.5, 0.5)), (3, 200))
    assert 50 < rendered.coverage[0].sum() < 70


def test_one_pixel_stays_itself():
    source = wall(1, 1)
    np.testing.assert_allclose(Paper()(source, STAY, (1, 1)).image, source.color, rtol=1e-6)


def test_a_singular_equation_is_refused():
    with pytest.raises(ValueError, match="singular; check both cameras"):
        Paper()(wall(), Equation(np.zeros((3, 3)), np.zeros(3)), (4, 4))


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"sigma": 0.0}, r"sigma lies between 0.1 and 2 px, not at 0.0"),
        ({"filter_sigma": 3.0}, r"filter_sigma lies between 0.1 and 2 px, not at 3.0"),
        ({"tolerance": -0.1}, r"part of the nearness, 0 to 1, not -0.1"),
        ({"core": math.nan}, r"core lies between 0.1 and 2 px, not at nan"),
    ],
)
def test_choices_out_of_range_are_refused(choices, message):
    with pytest.raises(ValueError, match=message):
        Paper(**choices)
