"""Outlines of meshes: how much of a pixel is covered."""

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.engine.jit import threads
from resample.profiles.filters import Gaussian
from resample_meshes.rendering import Mesh
from tests.texture.mesh_shapes import (
    FALLING,
    SQUARE,
    areas,
    cube,
    even,
    from_above,
    noise,
    oblique,
    picture,
    square,
)

SIZE = 40


def on_screen(position, camera):
    view = camera.view()
    place = position @ view.rotation.T + view.translation
    scale = place[:, 2:] if view.perspective else 1.0
    return place[:, :2] * view.focal / scale + view.principal


def error(coverage, truth):
    """Root mean square where the truth is neither nothing nor all."""
    at_rim = (truth > 0) & (truth < 1)
    assert at_rim.sum() > 40
    return np.sqrt(np.mean((coverage[at_rim] - truth[at_rim]) ** 2))


@pytest.mark.sweep
@pytest.mark.parametrize("turn", [0.0, 0.02, 0.1, 0.4, np.pi / 4, 1.3])
def test_a_square_s_outline_is_exact_to_three_thousandths(turn, record):
    camera = from_above(23.45, SIZE, turn)
    frame = picture(square(even(1, 1, 1)), camera, SIZE)
    record.error("rim", error(frame.coverage, areas(on_screen(SQUARE, camera), SIZE)))


@pytest.mark.sweep
@pytest.mark.parametrize("samples", [2, 4, 8])
def test_finer_samples_make_finer_outlines(samples, record):
    camera = oblique(0.9, SIZE)
    frame = picture(square(even(1, 1, 1)), camera, SIZE, samples=samples)
    truth = areas(on_screen(SQUARE, camera), SIZE)
    record.error("rim", error(frame.coverage, truth))


def fan(count, height):
    """A disc of thin triangles, raised in the middle."""
    angle = np.arange(count) / count * 2 * np.pi
    rim = np.stack([0.5 + 0.5 * np.cos(angle), 0.5 + 0.5 * np.sin(angle), 0 * angle], axis=1)
    position = np.concatenate([rim, [[0.5, 0.5, height]]])
    corner = np.arange(count)
    triangle = np.stack([corner, (corner + 1) % count, np.full(count, count)], axis=1)
    return rim, Mesh(position, triangle, color=np.ones((count + 1, 3)))


@pytest.mark.sweep
@pytest.mark.parametrize("count", [7, 100, pytest.param(1000, marks=pytest.mark.sweep)])
@pytest.mark.parametrize("height", [0.0, 0.1])
def test_triangles_that_share_an_outline_share_its_pixels(count, height, record):
    rim, mesh = fan(count, height)
    camera = from_above(31.7, SIZE, 0.3)
    frame = picture(mesh, camera, SIZE)
    record.error("rim", error(frame.coverage, areas(on_screen(rim, camera), SIZE)))


@pytest.mark.sweep
def test_what_is_thinner_than_a_sample_is_seen_as_far_as_it_covers(record):
    thread = SQUARE * [1, 0.003, 1] + np.array([0, 0.5, 0])  # 0.1 px
    camera = from_above(33.0, SIZE, 0.2)
    frame = picture(square(even(1, 1, 1), corners=thread), camera, SIZE)
    truth = areas(on_screen(thread, camera), SIZE)
    np.testing.assert_allclose(frame.coverage.sum(), truth.sum(), rtol=0.02)
    record.error("thread", np.sqrt(np.mean((frame.coverage - truth)[truth > 0] ** 2)))


def test_the_inside_is_covered_wholly_whoever_covers_it():
    mesh, camera = fan(1000, 0.1)[1], from_above(31.7, SIZE, 0.3)
    frame = picture(mesh, camera, SIZE)
    row, column = np.mgrid[0:SIZE, 0:SIZE] + 0.5
    inside = np.hypot(row - SIZE / 2, column - SIZE / 2) < 31.7 / 2 - 1.0
    np.testing.assert_array_equal(frame.coverage[inside], 1)


@pytest.mark.sweep
def test_a_cut_at_the_near_plane_is_an_outline_as_well(record):
    pose = look_at((0.5, 0.5, 1.0), (0.5, 0.5, 0.0), (0, 1, 0))
    tilted = SQUARE + (SQUARE[:, 1:2] - 0.5) * [0, 0, 1]
    near = 0.93
    camera = Camera.from_fov(60, height=SIZE, width=SIZE, world_to_camera=pose, near=near)
    rest = tilted.copy()
    rest[2:] = tilted[[1, 0]] + (1.5 - near) * (tilted[2:] - tilted[[1, 0]])
    frame = picture(square(even(1, 1, 1), corners=tilted), camera, SIZE)
    record.error("rim", error(frame.coverage, areas(on_screen(rest, camera), SIZE)))


def test_colors_at_an_outline_are_those_of_the_surface():
    texture, camera = even(0.2, 0.4, 0.6), from_above(23.45, SIZE, 0.4)
    frame = picture(square(texture), camera, SIZE)
    expected = frame.coverage[..., None] * np.float32([0.2, 0.4, 0.6])
    np.testing.assert_allclose(frame.rgba[..., :3], expected, atol=1e-6)
    np.testing.assert_array_equal(np.isfinite(frame.depth), frame.coverage > 0)


@pytest.mark.parametrize("chosen", [None, Gaussian(0.7)])
def test_outlines_do_not_depend_on_threads_or_the_tile_they_lie_in(chosen):
    style = {} if chosen is None else {"pixel_filter": chosen}
    mesh, camera = cube(noise(32)), oblique(3.0, 100)
    many = picture(mesh, camera, 100, **style)
    with threads(1):
        one = picture(mesh, camera, 100, **style)
    np.testing.assert_array_equal(many.rgba, one.rgba)


@pytest.mark.sweep
def test_an_outline_that_runs_along_a_tile_is_no_other():
    # tiles are 32 px: the right edge lies just beyond one, a sixteenth of a pixel in the next
    corners = SQUARE * [20.0625, 20, 1]
    camera = from_above(1.0, 64)
    place = on_screen(corners, camera)
    shift = np.array([32.0625, 40.0]) - place.max(axis=0)
    moved = corners + np.array([shift[0], -shift[1], 0.0])
    mesh = Mesh(moved, FALLING, color=np.ones((4, 3)))
    truth = areas(on_screen(mesh.position, camera), 64)
    np.testing.assert_allclose(picture(mesh, camera, 64).coverage, truth, atol=0.003)
