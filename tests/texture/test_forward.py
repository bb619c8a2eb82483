import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from resample import registry
from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP
from resample.profiles.filters import Area, Box, Gaussian, Mitchell, Tent
from resample.profiles.interpolation import (
    AreaSpline,
    Bilinear,
    InterpolatingCatmullRom,
    InterpolatingGaussian,
    Nearest,
    Spline,
)
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Homography
from resample_texture.texels.forward import CellGrid, blocks_of, project
from resample_texture.texels.kernels.blocks import CUT, FIRST, LAST, LENGTH, START
from resample_texture.types import Edge
from tests.bits import assert_threads_change_nothing
from tests.texture import naive_forward

MAGNIFIED = Homography([[2.3, 0.4, -1.0], [-0.3, 1.9, 2.0], [0.002, 0.003, 1.0]])
MINIFIED = Homography([[0.63, 0.04, 3.0], [-0.03, 0.69, 2.0], [0.002, 0.003, 1.0]])
TINY = Homography([[0.123, 0.004, 3.0], [-0.003, 0.119, 2.0], [0.0002, 0.0003, 1.0]])
UNEVEN = Homography([[3.0, 0.0, 3.0], [0.3, 0.05, 8.0], [0.0002, 0.0003, 1.0]])
HORIZON = Homography([[1.0, 0.1, -3.0], [0.1, 0.5, 2.0], [0.02, -0.12, 1.0]])
FRAME = (14, 16)
# Half of 1/2048 px, the step of a filter's table, times the steepest slope of filters here, 1.2,
# along x and along y.
TABLE = 6e-4
CONTINUED = [Edge.CLAMP, Edge.WRAP, Edge.MIRROR]
PADDINGS = {Edge.CLAMP: "edge", Edge.WRAP: "wrap", Edge.MIRROR: "symmetric"}


def noise(height=10, width=12, channels=2):
    return np.random.default_rng(7).random((height, width, channels), np.float32)


def smooth(height, width):
    """A picture without detail finer than 12 texels."""
    y, x = np.mgrid[:height, :width] * (2 * np.pi / 12)
    return (0.5 + 0.2 * np.sin(x + 0.3 * y) + 0.2 * np.cos(0.8 * y))[..., None].astype(np.float32)


def bent(height=10, width=12):
    """A map that turns, magnifies and bends."""
    v, u = np.mgrid[:height, :width] + 0.5
    return ForwardMap(
        1.2 * u + 0.2 * v + 0.5 * np.sin(v) - 0.9, 1.3 * v - 0.1 * u + 0.4 * np.cos(0.7 * u)
    )


def shift(x, y):
    return Homography([[1, 0, x], [0, 1, y], [0, 0, 1]])


def scaling(x, y):
    return Homography(np.diag([x, y, 1.0]))


def check_obvious(source, geometry, edge, cells, tolerance):
    image, coverage = naive_forward.projected(source, geometry, FRAME, edge, cells)
    warped = project(source, geometry, FRAME, edge, cells)
    np.testing.assert_allclose(warped.coverage, coverage, rtol=0, atol=tolerance)
    np.testing.assert_allclose(warped.image, image, rtol=0, atol=tolerance * max(1, image.max()))


@pytest.mark.some(1)
@pytest.mark.parametrize("is_sum", [False, True])
@pytest.mark.parametrize("geometry", [MAGNIFIED, MINIFIED, TINY, UNEVEN, HORIZON, bent()])
def test_areas_are_those_of_the_obvious_loops(geometry, is_sum):
    # Boxes are 1e-5 px wider than they should be, so that none is empty.
    check_obvious(noise(), geometry, Edge.TRANSPARENT, CellGrid(is_sum=is_sum), 1.5e-5)


@pytest.mark.sweep
@pytest.mark.parametrize("edge", CONTINUED)
@pytest.mark.parametrize("geometry", [MAGNIFIED, MINIFIED, UNEVEN])
def test_what_continues_a_source_is_that_of_the_obvious_loops(geometry, edge):
    check_obvious(noise(), geometry, edge, CellGrid(), 1.5e-5)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "interpolation", [Nearest(), Bilinear(), Spline(), InterpolatingGaussian()], ids=str
)
@pytest.mark.parametrize("geometry", [MAGNIFIED, UNEVEN])
@pytest.mark.parametrize("edge", Edge)
def test_interpolations_are_those_of_the_obvious_loops(geometry, interpolation, edge):
    check_obvious(noise(), geometry, edge, CellGrid(interpolation=interpolation), 1.5e-5)


@pytest.mark.some(1)
@pytest.mark.parametrize("pixel_filter", [Tent(), Gaussian(), Mitchell(), Tent(2.7)], ids=str)
@pytest.mark.parametrize("geometry", [MAGNIFIED, MINIFIED, UNEVEN, bent()])
def test_filters_are_those_of_the_obvious_loops(geometry, pixel_filter):
    check_obvious(noise(), geometry, Edge.TRANSPARENT, CellGrid(pixel_filter), TABLE)


@pytest.mark.sweep
def test_a_box_is_that_of_the_obvious_loops():
    check_obvious(noise(), MAGNIFIED, Edge.CLAMP, CellGrid(Box()), 1e-6)


@pytest.mark.some(1)
@pytest.mark.parametrize("quality", [1.0, 3.0])
def test_finer_cells_are_those_of_the_obvious_loops(quality):
    check_obvious(noise(), MINIFIED, Edge.TRANSPARENT, CellGrid(quality=quality), 2e-5)


def test_whole_texels_are_those_of_the_obvious_loops():
    check_obvious(noise(), MAGNIFIED, Edge.TRANSPARENT, CellGrid(cut=False), 1e-5)


@pytest.mark.parametrize("name", registry.names("filters"))
@pytest.mark.parametrize("geometry", [MAGNIFIED, MINIFIED])
def test_white_stays_white(name, geometry):
    cells = CellGrid(registry.build("filters", name))
    warped = project(np.ones((30, 40, 3), np.float32), geometry, FRAME, Edge.TRANSPARENT, cells)
    inside = warped.coverage == 1
    assert inside.sum() > 20
    np.testing.assert_allclose(warped.image[inside], 1, atol=1e-6)


@pytest.mark.parametrize("name", registry.names("filters"))
def test_coverage_is_exactly_one_where_nothing_but_the_source_is_seen(name):
    cells = CellGrid(registry.build("filters", name))
    warped = project(noise(60, 60), MAGNIFIED, FRAME, Edge.MIRROR, cells)
    assert (warped.coverage == 1).all()


@pytest.mark.parametrize("name", registry.names("filters"))
@pytest.mark.parametrize("scale", [0.13, 0.9, 3.1])
def test_a_sum_is_kept(name, scale):
    cells = CellGrid(registry.build("filters", name), is_sum=True)
    source = noise(9, 11)
    geometry = Homography([[scale, 0.1 * scale, 8], [-0.2 * scale, scale, 9], [0.001, 0, 1]])
    image = project(source, geometry, (50, 60), Edge.TRANSPARENT, cells).image
    np.testing.assert_allclose(image.sum(axis=(0, 1), dtype=float), source.sum((0, 1)), rtol=1e-6)


def test_a_map_keeps_a_sum():
    v, u = np.mgrid[:10, :12] + 0.5
    geometry = ForwardMap(1.2 * u + 5 + np.sin(v), 1.1 * v + 5 + np.cos(u))
    source = noise()
    image = project(source, geometry, (30, 30), Edge.TRANSPARENT, CellGrid(is_sum=True)).image
    np.testing.assert_allclose(image.sum(axis=(0, 1), dtype=float), source.sum((0, 1)), rtol=1e-6)


def test_the_identity_changes_no_bit():
    source = noise(30, 40, 3)
    warped = project(source, shift(0, 0), (30, 40), Edge.TRANSPARENT, CellGrid(quality=1.0))
    assert (warped.image == source).all()


def test_two_whole_shifts_are_one():
    source, cells = noise(20, 24), CellGrid(quality=1.0)

    def moved(picture, x, y):
        return project(picture, shift(x, y), (30, 30), Edge.TRANSPARENT, cells).image

    twice = moved(moved(source, 2, 3), 3, -1)
    assert (twice == moved(source, 5, 2)).all()


def test_the_inverse_brings_a_picture_back(record):
    source = smooth(60, 70)
    there = Homography([[1.3, 0.2, 9.0], [-0.1, 1.2, 12.0], [0.0008, 0.0005, 1.0]])
    cells = CellGrid(quality=3.0)
    picture = project(source, there, (110, 110), Edge.TRANSPARENT, cells).image
    back = project(picture, Homography(there.inverse()), (60, 70), Edge.TRANSPARENT, cells).image
    error = (back - source)[4:-4, 4:-4]
    record.quality("picture", -10 * np.log10((error**2).mean()))


@pytest.mark.parametrize("geometry", [MAGNIFIED, MINIFIED, TINY])
def test_half_a_turn_of_everything_turns_the_picture(geometry):
    # Each is one block: a source is split from its first texel on, and so otherwise once turned.
    source = noise()
    turn = np.array([[-1.0, 0, 12], [0, -1, 10], [0, 0, 1]])
    turn_back = np.array([[-1.0, 0, FRAME[1]], [0, -1, FRAME[0]], [0, 0, 1]])
    picture = project(source, geometry, FRAME, Edge.TRANSPARENT, CellGrid())
    turned = project(
        np.ascontiguousarray(source[::-1, ::-1]),
        Homography(turn_back @ geometry.matrix @ turn),
        FRAME,
        Edge.TRANSPARENT,
        CellGrid(),
    )
    np.testing.assert_allclose(turned.image[::-1, ::-1], picture.image, atol=1e-5)


@pytest.mark.some(1)
@pytest.mark.parametrize("quality", [1.0, 8.0])
def test_a_magnified_pixel_is_the_mean_of_interpolation_over_its_cells(quality):
    source, factor = noise(8, 9, 1), 5
    cells = CellGrid(quality=quality)
    image = project(source, scaling(factor, factor), (40, 45), Edge.TRANSPARENT, cells).image
    fine = factor * int(quality)

    def weights(size):
        at = (np.arange(size * fine) + 0.5) / fine
        rows = [
            naive_forward.interpolated(u, size, Edge.TRANSPARENT, AreaSpline(), 1 / fine)
            for u in at
        ]
        return np.mean(np.reshape(rows, (size * factor, int(quality), size)), axis=1)

    expected = weights(8) @ source[..., 0] @ weights(9).T
    # Boxes are 1e-5 px wider than they should be, and 1/8 px wide.
    np.testing.assert_allclose(image[1:-1, 1:-1, 0], expected[1:-1, 1:-1], atol=2e-5)


def test_magnified_lines_are_those_of_opencv():
    source = noise(8, 9, 3)
    cells = CellGrid(quality=1.0, interpolation=Bilinear())
    image = project(source, scaling(4, 4), (32, 36), Edge.CLAMP, cells).image
    expected = cv2.resize(source, (36, 32), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(image, expected, atol=1e-6)


@pytest.mark.some(1)
@pytest.mark.parametrize("pixel_filter", [Area(), Mitchell()], ids=str)
@pytest.mark.parametrize("edge", [Edge.TRANSPARENT, Edge.WRAP])
def test_threads_change_no_bit(pixel_filter, edge):
    source, cells = noise(200, 230, 3), CellGrid(pixel_filter)
    assert_threads_change_nothing(lambda: project(source, HORIZON, (90, 80), edge, cells))


number = st.floats(-3, 3, allow_subnormal=False)
tilt = st.floats(-0.3, 0.3, allow_subnormal=False)
matrices = st.tuples(
    number, number, st.floats(-20, 20), number, number, st.floats(-20, 20), tilt, tilt
).map(lambda n: np.array([*n, 1.0]).reshape(3, 3))


@pytest.mark.sweep
@settings(max_examples=40, deadline=None)
@given(
    matrix=matrices,
    edge=st.sampled_from(Edge),
    pixel_filter=st.sampled_from([Area(), Tent(), Gaussian()]),
    interpolation=st.sampled_from([Nearest(), Bilinear()]),
)
def test_a_picture_stays_within_the_range_of_its_source(matrix, edge, pixel_filter, interpolation):
    assume(np.linalg.cond(matrix) < 1e4)
    source = noise(9, 11) + np.float32(1)
    cells = CellGrid(pixel_filter, interpolation)
    warped = project(source, Homography(matrix), FRAME, edge, cells)
    assert ((warped.coverage >= 0) & (warped.coverage <= 1)).all()
    least = warped.coverage[..., None] * source.min()
    most = warped.coverage[..., None] * source.max()
    assert (warped.image >= least - 1e-5).all()
    assert (warped.image <= most + 1e-5).all()


@pytest.mark.sweep
@settings(max_examples=30, deadline=None)
@given(matrix=matrices, edge=st.sampled_from(Edge), name=st.sampled_from(registry.names("filters")))
def test_a_picture_is_finite(matrix, edge, name):
    assume(np.linalg.cond(matrix) < 1e7)
    cells = CellGrid(registry.build("filters", name))
    warped = project(noise(9, 11), Homography(matrix), FRAME, edge, cells)
    assert np.isfinite(warped.image).all()


def test_what_is_behind_the_eye_is_not_drawn():
    # Rows of the source from 5 on are behind; they would show above the horizon, at y < 10.
    geometry = Homography([[4.0, -1.6, 0], [0, -2, 20], [0, -0.2, 1]], is_signed=True)
    source, cells = noise(), CellGrid(interpolation=Nearest())
    other = source.copy()
    other[5:] = 100
    seen = project(source, geometry, (30, 30), Edge.TRANSPARENT, cells)
    assert seen.coverage.sum() > 20
    assert (seen.coverage[:8] == 0).all()
    image = project(other, geometry, (30, 30), Edge.TRANSPARENT, cells).image
    assert (image == seen.image).all()


def floor(height):
    """A floor that starts below the eye and reaches the horizon at y = 10, rows v from 1 on."""
    return Homography([[20.0, 8.0, 0.0], [0.0, 10.0, height], [0.0, 1.0, 0.0]], is_signed=True)


def test_a_floor_that_never_ends_comes_to_its_mean():
    source = noise(16, 16)
    warped = project(source, floor(100.0), (40, 16), Edge.WRAP, CellGrid())
    assert np.isfinite(warped.image).all()
    assert (warped.coverage[:9] == 0).all()
    # 0.5 px below the horizon a pixel sees some hundred rows of the floor.
    np.testing.assert_allclose(warped.image[10], np.broadcast_to(source.mean((0, 1)), (16, 2)),
                               atol=0.02)  # fmt: skip


@pytest.mark.parametrize("edge", CONTINUED)
@pytest.mark.parametrize(
    "interpolation", [Bilinear(), InterpolatingCatmullRom(), Spline()], ids=str
)
@pytest.mark.parametrize("scale", [0.6, 1.7])
def test_an_edge_continues_as_if_padded_by_hand(edge, interpolation, scale):
    source, pad = noise(), 40
    padded = np.pad(source, ((pad, pad), (pad, pad), (0, 0)), mode=PADDINGS[edge])
    matrix = np.array([[scale, 0.2, 4.0], [-0.1, scale, 6.0], [0, 0, 1]])
    cells = CellGrid(interpolation=interpolation, joined=0.0)
    given_edge = project(source, Homography(matrix), FRAME, edge, cells)
    by_hand = project(
        padded, Homography(matrix @ shift(-pad, -pad).matrix), FRAME, Edge.TRANSPARENT, cells
    )
    assert (by_hand.coverage == 1).all()
    np.testing.assert_allclose(given_edge.image, by_hand.image, atol=1e-5)


@pytest.mark.some(5)
@pytest.mark.parametrize("edge", CONTINUED)
@pytest.mark.parametrize("interpolation", [InterpolatingCatmullRom(), Spline()], ids=str)
def test_joined_texels_beyond_an_edge_are_as_if_padded_by_hand(edge, interpolation):
    source, pad = noise(16, 16), 64  # a multiple of all that is joined
    padded = np.pad(source, ((pad, pad), (pad, pad), (0, 0)), mode=PADDINGS[edge])
    matrix = np.diag([2.2, 0.1, 1.0])
    cells = CellGrid(interpolation=interpolation)
    shape = (6, 60)
    given_edge = project(source, Homography(matrix), shape, edge, cells)
    moved = Homography(matrix @ shift(-pad, -pad).matrix)
    by_hand = project(padded, moved, shape, Edge.TRANSPARENT, cells)
    # Cells of several texels need not be the same ones in both.
    np.testing.assert_allclose(given_edge.image[:, 4:-4], by_hand.image[:, 4:-4], atol=0.05)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 40)])
@pytest.mark.parametrize("edge", Edge)
def test_a_constant_source_of_any_shape_stays_constant(shape, edge):
    source = np.full((*shape, 3), 0.25, np.float32)
    warped = project(source, MAGNIFIED, (60, 70), edge, CellGrid())
    np.testing.assert_allclose(
        warped.image, np.broadcast_to(0.25 * warped.coverage[..., None], warped.image.shape),
        atol=1e-6,
    )  # fmt: skip
    assert warped.coverage.sum() > 2


@pytest.mark.some(1)
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1)])
@pytest.mark.parametrize("edge", Edge)
def test_thin_sources_are_those_of_the_obvious_loops(shape, edge):
    check_obvious(noise(*shape), MAGNIFIED, edge, CellGrid(interpolation=Spline()), 1.5e-5)


@pytest.mark.sweep
@settings(max_examples=60, deadline=None)
@given(
    height=st.integers(1, 300),
    width=st.integers(1, 300),
    scale=st.floats(0.001, 5),
    tilt=st.floats(-0.9, 0.9),
)
def test_blocks_tile_a_source_that_is_all_in_view(height, width, scale, tilt):
    matrix = np.array([[scale, 0.1 * scale, 0], [0, scale, 0], [tilt / (2 * width), 0, 1]])
    corners = matrix @ np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]]).T
    frame = tuple(int((corners[n] / corners[2]).max()) + 3 for n in (1, 0))
    axes = blocks_of(Homography(matrix), (height, width), frame, Edge.TRANSPARENT, CellGrid()).axes
    seen = np.zeros((height, width))
    for u, v in axes:
        share = [(n[LAST] - n[FIRST]) / n[CUT] if n[LENGTH] == 1 else 1.0 for n in (u, v)]
        rows = slice(v[START], v[START] + v[LENGTH])
        seen[rows, u[START] : u[START] + u[LENGTH]] += share[0] * share[1]
    np.testing.assert_allclose(seen, 1, rtol=1e-12)


def test_part_of_one_texel_can_fill_a_frame():
    source = noise(20, 20, 3)
    geometry = Homography([[1e4, 0, -7.5e4], [0, 1e4, -9.5e4], [0, 0, 1]])
    warped = project(
        source, geometry, (50, 60), Edge.TRANSPARENT, CellGrid(interpolation=Nearest())
    )
    np.testing.assert_allclose(warped.image, np.broadcast_to(source[9, 7], (50, 60, 3)), rtol=1e-6)


def test_a_texel_far_larger_than_a_frame_is_cut_only_where_it_is_seen():
    geometry = Homography([[1e4, 0, -7.5e4], [0, 1e4, -9.5e4], [0, 0, 1]])
    axes = blocks_of(geometry, (20, 20), (50, 60), Edge.TRANSPARENT, CellGrid()).axes
    cells = np.prod(axes[:, :, LAST] - axes[:, :, FIRST], axis=1).sum()
    assert cells < 20 * 50 * 60


def test_a_texel_magnified_ten_thousand_times_is_interpolated():
    source = noise(20, 20, 1)
    geometry = Homography([[1e4, 0, -7.5e4], [0, 1e4, -9.5e4], [0, 0, 1]])
    image = project(source, geometry, (50, 60), Edge.TRANSPARENT, CellGrid()).image
    u, v = (np.arange(60) + 0.5) / 1e4 + 7.5, (np.arange(50) + 0.5) / 1e4 + 9.5
    along_u, along_v = (
        np.array([naive_forward.interpolated(n, 20, Edge.TRANSPARENT, AreaSpline()) for n in at])
        for at in (u, v)
    )
    # Taps are tabulated for 4096 places per texel: half a step, 1.2e-4 texels.
    np.testing.assert_allclose(image[..., 0], along_v @ source[..., 0] @ along_u.T, atol=3e-4)


@pytest.mark.sweep
def test_a_large_source_comes_down_to_the_means_of_its_blocks():
    source = np.random.default_rng(7).random((4096, 4096, 1), np.float32)
    image = project(source, scaling(1 / 512, 1 / 512), (8, 8), Edge.TRANSPARENT, CellGrid()).image
    means = source.reshape(8, 512, 8, 512).mean(axis=(1, 3), dtype=np.float64)
    np.testing.assert_allclose(image[..., 0], means, atol=1e-5)


@pytest.mark.parametrize("shear", [1e-20, -1e-20])
def test_a_matrix_that_is_all_but_diagonal_is_as_good_as_diagonal(shear):
    matrix = np.array([[1, 0, 4.0], [shear, 1, 5.5], [0, 0, 1]])
    coverage = project(noise(), Homography(matrix), (20, 20), Edge.TRANSPARENT, CellGrid()).coverage
    straight = project(noise(), shift(4.0, 5.5), (20, 20), Edge.TRANSPARENT, CellGrid()).coverage
    assert (coverage == straight).all()


@pytest.mark.parametrize("angle", [90, 180, 270])
def test_coverage_is_exactly_one_inside_a_magnified_quarter_turn(angle):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    middle = shift(2000, 2000).matrix @ np.diag([400.0, 400, 1]) @ turn @ shift(-5, -5).matrix
    frame = shift(-1990, -1990).matrix @ middle
    warped = project(noise(10, 10), Homography(frame), (20, 20), Edge.TRANSPARENT, CellGrid())
    assert (warped.coverage == 1).all()


def test_every_block_has_room_for_the_pixels_that_a_cell_meets():
    blocks = blocks_of(shift(0, 0), (512, 512), (255, 255), Edge.TRANSPARENT, CellGrid())
    assert (blocks.bounds[:, RIGHT] - blocks.bounds[:, LEFT]).min() >= 2
    assert (blocks.bounds[:, BOTTOM] - blocks.bounds[:, TOP]).min() >= 2


@pytest.mark.parametrize("name", registry.names("filters"))
def test_the_frame_changes_no_pixel(name):
    cells = CellGrid(registry.build("filters", name))
    source = noise(40, 40)
    whole = project(source, shift(0.3, 0.4), (40, 40), Edge.TRANSPARENT, cells).image
    part = project(source, shift(-9.7, -9.6), (20, 20), Edge.TRANSPARENT, cells).image
    np.testing.assert_allclose(part, whole[10:30, 10:30], atol=1e-5)


def test_texels_of_a_map_that_go_nowhere_leave_nothing():
    v, u = np.mgrid[:10, :12] + 0.5
    x = np.where((u > 3) & (u < 6), np.nan, u)
    warped = project(noise(), ForwardMap(x, v), (10, 12), Edge.TRANSPARENT, CellGrid())
    assert np.isfinite(warped.image).all()
    assert (warped.coverage[:, 4:5] == 0).all()


@pytest.mark.parametrize("pixel_filter", [Area(), Tent(), Mitchell()], ids=str)
def test_a_map_just_short_of_whole_pixels_is_as_good_as_one_of_whole_pixels(pixel_filter):
    v, u = np.mgrid[:10, :12] + 0.5
    source, cells = noise(), CellGrid(pixel_filter, quality=1.0)
    short = project(source, ForwardMap(u - 1e-9, v - 1e-9), FRAME, Edge.TRANSPARENT, cells)
    whole = project(source, ForwardMap(u, v), FRAME, Edge.TRANSPARENT, cells)
    np.testing.assert_allclose(short.image, whole.image, atol=TABLE)


def test_a_map_as_a_matrix_would_make_it_gives_the_same_picture():
    v, u = np.mgrid[:10, :12] + 0.5
    matrix = np.array([[1.3, 0.2, 0.5], [-0.2, 1.1, 3.0], [0, 0, 1]])
    geometry = ForwardMap(1.3 * u + 0.2 * v + 0.5, -0.2 * u + 1.1 * v + 3.0)
    by_map = project(noise(), geometry, FRAME, Edge.TRANSPARENT, CellGrid()).image
    by_matrix = project(noise(), Homography(matrix), FRAME, Edge.TRANSPARENT, CellGrid())
    inside = by_matrix.coverage == 1
    np.testing.assert_allclose(by_map[inside], by_matrix.image[inside], atol=1e-5)


def test_a_map_of_another_shape_is_refused():
    with pytest.raises(ValueError, match="does not fit a source"):
        project(noise(), bent(5, 5), FRAME, Edge.TRANSPARENT, CellGrid())


def test_a_backward_map_is_refused():
    geometry = BackwardMap(np.zeros(FRAME), np.zeros(FRAME))
    with pytest.raises(ValueError, match="backward"):
        project(noise(), geometry, FRAME, Edge.TRANSPARENT, CellGrid())


def test_channels_do_not_mix():
    source = noise(channels=5)
    whole = project(source, MAGNIFIED, FRAME, Edge.TRANSPARENT, CellGrid()).image
    for c in range(5):
        alone = np.ascontiguousarray(source[..., c : c + 1])
        image = project(alone, MAGNIFIED, FRAME, Edge.TRANSPARENT, CellGrid()).image
        np.testing.assert_allclose(whole[..., c], image[..., 0], atol=1e-6)


def test_a_map_with_a_place_absurdly_far_away_is_refused():
    x, y = np.meshgrid(np.arange(4) + 0.5, np.arange(3) + 0.5)
    x[1, 1] = np.inf  # goes nowhere
    project(np.ones((3, 4, 1), np.float32), ForwardMap(x, y), (3, 4), Edge.TRANSPARENT, CellGrid())
    x[1, 1] = 1e13
    with pytest.raises(ValueError, match=r"moves neighbours 1e\+13 px apart"):
        project(
            np.ones((3, 4, 1), np.float32), ForwardMap(x, y), (3, 4), Edge.TRANSPARENT, CellGrid()
        )


@pytest.mark.some(1)
@pytest.mark.parametrize("edge", ["clamp", "wrap", "mirror", "transparent"])
def test_a_matrix_whose_blocks_have_no_end_is_refused(edge):
    matrix = np.array([[98.05, -2.5e-23, 6e-5], [1.6e-42, 1.8e-5, 2e-35], [2e33, 4e-17, 2e-5]])
    frame = (20, 24)
    if edge == "transparent":
        blocks_of(Homography(matrix), (12, 14), frame, Edge(edge), CellGrid())
        return
    with pytest.raises(ValueError, match="the matrix stretches texels without limit"):
        blocks_of(Homography(matrix), (12, 14), frame, Edge(edge), CellGrid())
