"""Where round surfaces turn away from the source, and from the target."""

from itertools import pairwise

import numpy as np
import pytest

from resample import registry
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.sheet.kernels.corners import INSET_PX
from resample_warp3d.sheet.sheets import sheet_of
from resample_warp3d.types import RIGHT, TURNS
from tests.warp3d.naive_sheet import (
    ball,
    camera_at,
    depth_image,
    flat,
    pattern,
    plane,
    see,
)  # fmt: skip

SIZE, FOCAL = 96, 96.0
CENTER, RADIUS = np.array([0.05, -0.02, 3.0]), 1.0
THINGS = [ball(CENTER, RADIUS, pattern(size=0.1)), plane((0, 0, 1), 9.0, flat(0.5, 0.5, 0.5))]
ASIDE = camera_at((-1.9, 0.0, 0.6), yaw=0.62, focal=FOCAL, shape=(SIZE, SIZE))


@pytest.fixture(scope="module")
def source():
    camera = camera_at(focal=FOCAL, shape=(SIZE, SIZE))
    return prepare(depth_image(THINGS, camera, (SIZE, SIZE), rays=4), noise=0.0, step=0.0)


@pytest.mark.sweep
def test_ends_lie_on_the_horizon(source):
    sheet = sheet_of(source)
    end = sheet.corner[sheet.ends[:, 0], sheet.ends[:, 1]]
    # How far places (N, 2) lie within the ball's outline, px, and how near it is there
    place = end[:, :2].astype(float)
    ray = np.column_stack([(place - SIZE / 2) / FOCAL, np.ones(len(place))])
    square = CENTER @ CENTER - RADIUS**2
    angle = np.arccos((ray @ CENTER) / np.linalg.norm(ray, axis=1) / np.linalg.norm(CENTER))
    within, nearness = (
        FOCAL * (np.arcsin(RADIUS / np.linalg.norm(CENTER)) - angle),
        (ray @ CENTER) / square,
    )
    assert len(end) > 300
    # A ball of 34 px taken for a parabola: 0.14 px; a few samples lie beyond that. In nearness a
    # tenth of what it falls by over the last sample, which is 20 %.
    assert np.quantile(np.abs(within), 0.95) < 0.15
    assert np.abs(within).max() < 0.5
    np.testing.assert_allclose(end[:, 2], nearness, rtol=0.025)


def test_a_surface_that_turns_away_is_marked_on_that_side(source):
    sheet = sheet_of(source)
    marked = sheet.links[2:-2, 2:-2] // TURNS
    row, column = np.nonzero(marked & RIGHT)
    assert len(row) > 20
    assert (column > SIZE / 2).all()
    assert (source.nearness[row, column] > source.nearness[row, column + 1]).all()
    np.testing.assert_array_equal(sheet.links[2:-2, 2:-2] % TURNS, source.links)


@pytest.mark.sweep
def test_the_border_of_a_ball_seen_from_the_side_has_no_teeth(source, record):
    alone = source._replace(nearness=np.where(source.nearness > 0.2, source.nearness, 0.05))
    equation = between(camera_at(focal=FOCAL, shape=(SIZE, SIZE)), ASIDE)
    rendered = registry.build("warps", "hybrid")(alone, equation, (SIZE, SIZE))
    is_ball = (rendered.coverage > 0.5) & (rendered.nearness > 0.15)
    truth = see(THINGS, ASIDE, (SIZE, SIZE), rays=4)
    rows = np.flatnonzero((truth.share[..., 0] > 0.5).sum(axis=1) > 30)[4:-4]
    picture = is_ball.astype(float)
    first = np.array([np.flatnonzero(picture[row] > 0.5)[0] for row in rows])
    steps = np.array([b - a for a, b in pairwise(first)])
    bend = np.abs(np.diff(steps))
    # From row to row the border moves evenly: by rounding alone it changes by one px.
    record.error("bends", bend > 1)


@pytest.mark.sweep
def test_what_turns_away_from_the_target_ends_where_the_target_sees_it_turn(source, record):
    # Toward the right the target sees less of the ball than the source: its own outline.
    eye = (-0.5, 0.0, 0.0)
    target = camera_at(eye, focal=FOCAL, shape=(SIZE, SIZE))
    equation = between(camera_at(focal=FOCAL, shape=(SIZE, SIZE)), target)
    rendered = registry.build("warps", "hybrid")(source, equation, (SIZE, SIZE))
    is_ball = rendered.nearness > 0.2
    truth = see(THINGS, target, (SIZE, SIZE), rays=8).share[..., 0]
    half = np.arange(SIZE) > SIZE / 2 + FOCAL * 0.55 / 3  # its right half
    record.error(
        "pixels at the outline", np.abs(is_ball[:, half].astype(float) - truth[:, half]).sum()
    )  # 60 rows


def test_an_end_is_inset_by_no_more_than_half_a_pixel():
    from resample_warp3d.sheet.kernels.corners import project_ends

    matrix, epipole = np.eye(3), np.array([200.0, 0.0, 0.0])
    corner = np.array([[[10.0, 5.0, 0.3]] * 4], np.float32)
    which, roundness = np.array([[0, 0]], np.int32), np.array([[-0.01, 0.0]], np.float32)
    screen = np.zeros((1, 4, 3), np.float32)
    project_ends(corner, which, roundness, matrix, epipole, screen)
    # Nearness moves it to the right by 200 px per unit, as does what lies more inward.
    assert screen[0, 0, 0] - 70.0 == pytest.approx(INSET_PX, abs=0.01)


@pytest.mark.sweep
def test_no_gap_opens_beside_a_ball_that_is_seen_from_where_the_source_stands(source):
    camera = camera_at(focal=FOCAL, shape=(SIZE, SIZE))
    target = camera_at(yaw=0.2, focal=FOCAL, shape=(SIZE, SIZE))
    rendered = registry.build("warps", "hybrid")(source, between(camera, target), (SIZE, SIZE))
    seen = see(THINGS, target, (SIZE, SIZE), rays=4, other=camera, other_shape=(SIZE, SIZE))
    # All around the outline: 0.25 px² as cells are cut to boxes; gaps of an inset are 0.8 more.
    assert (1 - rendered.coverage[seen.shown > 0.999]).sum() < 0.5
