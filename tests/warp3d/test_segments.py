import numpy as np
import pytest

from resample.engine.jit import kernel
from resample_warp3d.sheet.kernels import screen, segments
from resample_warp3d.sheet.kernels.segments import BEGIN, END, PIXEL, WAY, BandFrame, write_colors
from resample_warp3d.sheet.sheets import sheet_of
from resample_warp3d.types import DOWN, LEFT, MARGIN, RIGHT, UP
from tests.warp3d.naive_warp import random_source
from tests.warp3d.test_sheets import torn_source

SIZE = segments.SEGMENT
WIDTH = 24


def frame_of(size=64, *, is_label=False):
    return BandFrame(0, size, size, np.float32(1), np.float32(1), is_label)


def row_of(numbers, row):
    return numbers[int(row) : int(row) + WIDTH]


@kernel
def colored(color, links, row, numbers):
    """Colors of a row of cells."""
    write_colors(color, links, 0, row, 0, 0, WIDTH, numbers)


@kernel
def measured_cells(screen, torn, index, row, frame, numbers, places):
    """How many runs a row of cells has."""
    return segments.measure(screen, torn, index, row, 0, frame, numbers, places)


@kernel
def add_masses(begin, end, numbers, places, total):
    """Add what fragments of one slot have."""
    for n in range(begin, end):
        m = np.uint64(n)
        if places[PIXEL + m] >= 0:
            total[n] += numbers[segments.MASS + m]


@kernel
def masses(begin, end, frame, numbers, places, total):
    """Add what cells of a run have in their fragments, slot by slot."""
    if places[WAY + np.uint64(begin)] == segments.UPRIGHT:
        rows, columns = segments.set_boxes(begin, end, frame, numbers, places)
        for i in range(columns):
            for j in range(rows):
                segments.fill_from_boxes(begin, end, i, j, frame, numbers, places)
                add_masses(begin, end, numbers, places, total)
        return
    segments.count_parts(begin, end, frame, numbers, places)
    segments.set_parts(begin, end, 0, 0, True, frame, numbers, places)
    for slot in range(4):
        segments.fill_from_parts(
            begin, end, slot % 2, slot // 2, True, frame, numbers, places
        )  # fmt: skip
        add_masses(begin, end, numbers, places, total)


def measured(sheet, row, frame=None):
    """Numbers, places and runs of a row of cells that stay where they are."""
    height, width = sheet.torn.shape
    vertex = np.empty((3, height + 1, width + 1), np.float32)
    torn = np.empty_like(sheet.corner)
    matrix, epipole = np.eye(3), np.zeros(3)
    screen.project_vertices(sheet.vertex, sheet.place, matrix, epipole, vertex)
    screen.project_corners(sheet.corner, matrix, epipole, torn)
    numbers = np.zeros(segments.NUMBERS, np.float32)
    places = np.zeros(segments.PLACES, np.int32)
    frame = frame or frame_of()
    count = measured_cells(vertex, torn, sheet.torn, row, frame, numbers, places)
    return numbers, places, count


def naive_bend(values, is_linked):
    """Slope and curvature of the middle of five, by values at its pixel's sides."""
    z, a, here, b, c = (float(value) for value in values)
    far_back, back, ahead, far_ahead = is_linked
    if back and ahead:
        first = z if far_back else 2 * a - here
        last = c if far_ahead else 2 * b - here
        low, high = (7 * (a + here) - first - b) / 12, (7 * (here + b) - a - last) / 12
        return high - low, 3 * (low + high) - 6 * here
    if ahead or back:
        return (b - here if ahead else here - a) / 2, 0.0
    return 0.0, 0.0


@pytest.mark.sweep
def test_colors_keep_to_the_samples_own_surface(rng):
    sheet = sheet_of(torn_source(rng))
    padded, links = sheet.color[0], sheet.links
    numbers = np.zeros(segments.NUMBERS, np.float32)
    for row in range(sheet.torn.shape[0]):
        colored(sheet.color, links, row, numbers)
        for channel in range(3):
            for column in range(WIDTH):
                r, k = row + MARGIN, column + MARGIN
                at = channel * int(segments.CHANNEL) + column
                bits = links[r, k]
                across = naive_bend(
                    padded[channel, r, k - 2 : k + 3],
                    (links[r, k - 1] & LEFT, bits & LEFT, bits & RIGHT, links[r, k + 1] & RIGHT),
                )
                down = naive_bend(
                    padded[channel, r - 2 : r + 3, k],
                    (links[r - 1, k] & UP, bits & UP, bits & DOWN, links[r + 1, k] & DOWN),
                )
                rows = segments.SLOPE_U, segments.BEND_U, segments.SLOPE_V, segments.BEND_V
                given = [numbers[int(each) + at] for each in rows]
                np.testing.assert_allclose(given, (*across, *down), atol=3e-6)  # float32


@pytest.mark.sweep
def test_runs_hold_all_cells_that_are_seen_once_and_of_one_way_each(rng):
    sheet = sheet_of(torn_source(rng))
    for row in range(sheet.torn.shape[0]):
        _, places, count = measured(sheet, row)
        held = np.zeros(WIDTH, int)
        for k in range(count):
            begin, end = row_of(places, BEGIN)[k], row_of(places, END)[k]
            held[begin:end] += 1
            assert len(set(row_of(places, WAY)[begin:end])) == 1
        np.testing.assert_array_equal(held, row_of(places, WAY) != segments.HIDDEN)


@pytest.mark.sweep
@pytest.mark.parametrize("is_label", [False, True])
def test_fragments_of_a_cell_hold_its_area(is_label):
    frame = frame_of(is_label=is_label)
    numbers, places, count = measured(sheet_of(random_source(20, WIDTH)), 10, frame)
    total = np.zeros(WIDTH)
    for k in range(count):
        begin, end = row_of(places, BEGIN)[k], row_of(places, END)[k]
        masses(begin, end, frame, numbers, places, total)
    is_inside = np.s_[1:-1]  # others reach beyond the frame
    area = np.where(row_of(places, WAY) > 0, row_of(numbers, segments.AREA), 0)
    np.testing.assert_allclose(total[is_inside], area[is_inside], atol=1e-5)  # SLIGHT


def test_bounds_of_segments_hold_all_their_corners():
    sheet = sheet_of(random_source(20, 150))
    vertex = np.empty((3, 21, 151), np.float32)
    torn = np.empty_like(sheet.corner)
    matrix, epipole = np.diag([1.3, 0.8, 1.0]), np.array([2.0, -1.0, 0.3])
    screen.project_vertices(sheet.vertex, sheet.place, matrix, epipole, vertex)
    screen.project_corners(sheet.corner, matrix, epipole, torn)
    bounds = np.empty((20, screen.segment_count(150), 4), np.int32)
    screen.bound_segments(vertex, torn, sheet.torn, bounds)
    for row in range(20):
        for segment in range(bounds.shape[1]):
            start, end = segment * SIZE, min(150, (segment + 1) * SIZE)
            own = sheet.torn[row, start:end]
            shared = vertex[:, row : row + 2, start : end + 1].reshape(3, -1).T
            corners = np.concatenate([shared, torn[own[own >= 0]].reshape(-1, 3)])
            place = np.floor(corners[corners[:, 2] > 0, :2])
            expected = (*place.min(axis=0), *(place.max(axis=0) + 1))
            np.testing.assert_array_equal(bounds[row, segment], expected)
