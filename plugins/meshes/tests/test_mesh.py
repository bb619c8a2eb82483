"""Textured meshes seen by a camera."""

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.engine.jit import threads
from resample_meshes.rendering import Mesh
from tests.texture.mesh_shapes import (
    FALLING,
    RISING,
    SQUARE,
    cube,
    decibels,
    even,
    finely_cut,
    fitted_camera,
    from_above,
    naive,
    naive_mesh,
    noise,
    oblique,
    picture,
    square,
)


@pytest.mark.some(1)
@pytest.mark.parametrize("distance", [0.4, 2.0, 8.0])
def test_a_square_is_what_rays_see(distance, record):
    # 0.4: 3 px per texel and cut off by the frame; 8: 3 texels per px
    texture = noise(64)
    camera = oblique(distance, 48)
    frame = picture(square(texture), camera, 48)
    truth = naive(texture, camera, 48)
    record.quality("picture", decibels(frame.rgba, truth))


@pytest.mark.sweep
def test_inside_a_minified_square_the_texture_is_averaged(record):
    texture = noise(256)
    camera = from_above(40.0, 48)  # 6 texels per px
    truth = naive(texture, camera, 48, rays=16)
    inside = truth[..., 3] == 1
    frame = picture(square(texture), camera, 48)
    record.quality("inside", decibels(frame.rgba[inside], truth[inside]))


@pytest.mark.parametrize("scale", [5.3, 40.7])
def test_white_stays_white(scale):
    frame = picture(square(even(1, 1, 1)), from_above(scale, 64, 0.3), 64)
    np.testing.assert_allclose(frame.rgba[..., 0], frame.coverage, atol=2e-6)  # float32 sums


def test_coverage_sums_to_the_area():
    frame = picture(square(even(1, 1, 1)), from_above(37.3, 64, 0.4), 64)
    assert frame.coverage.sum() == pytest.approx(37.3**2, rel=2e-3)  # samples on its outline


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("along", "width"),
    [
        (4.0, 0.0001),
        *(
            pytest.param(*each, marks=pytest.mark.sweep)
            for each in [(0.6, 0.0001), (0.6, 0.002), (4.0, 0.002)]
        ),
    ],
)
def test_a_triangle_that_is_a_sliver_of_its_texture_is_what_rays_see(along, width, record):
    # u and v run along the same line but for a little: 0.8 and 5 texels per px
    uv = 0.1 + SQUARE[:, :2] @ np.array([[along, along], [width, -width]])
    mesh = Mesh(SQUARE, FALLING, uv, (noise(64),))
    camera = from_above(48.0, 48, 0.3)
    frame = picture(mesh, camera, 48)
    truth = naive_mesh(mesh, camera, 48, rays=16)
    inside = truth[..., 3] == 1
    record.quality("inside", decibels(frame.rgba[inside], truth[inside]))


def test_a_square_s_halves_meet_without_a_seam(record):
    texture, camera = noise(64), oblique(1.0, 48)
    one = picture(square(texture, triangle=FALLING), camera, 48)
    other = picture(square(texture, triangle=RISING), camera, 48)
    # points at the diagonal are spread over other sub-pixels, and may be cut otherwise
    record.quality("picture", decibels(one.rgba, other.rgba))


@pytest.mark.parametrize("count", [16, 64])
def test_a_finely_cut_square_is_the_same_picture(count, record):
    # of 64 texels: at 16 and 64 cuts they lie on texels' edges and centers
    texture, camera = noise(64), oblique(2.0, 48)
    whole = picture(square(texture), camera, 48)
    cut = picture(finely_cut(texture, count), camera, 48)
    record.quality("picture", decibels(cut.rgba, whole.rgba))  # levels are chosen for each triangle


def test_a_cell_at_a_corner_belongs_to_one_triangle():
    # texels' centers are the corners of squares, and each texel is one cell
    texture, camera = noise(16), from_above(16.0, 16)
    mesh = finely_cut(texture, 32)
    assert picture(mesh, camera, 16, samples=1).statistics.points == 256


def test_halves_cover_an_edge_s_samples_exactly_once():
    # corners at whole pixels: samples of the regular kind would lie on the diagonal
    one = picture(square(even(1, 1, 1)), from_above(32.0, 40), 40, samples=1)
    np.testing.assert_array_equal(one.coverage[4:36, 4:36], 1)
    assert one.coverage.sum() == 32**2


def test_the_texture_s_upper_row_is_where_v_is_1():
    texture = even(0, 0, 0)
    texture[0] = 1.0
    frame = picture(square(texture), from_above(16.0, 16), 16)
    assert frame.rgba[1, 8, 0] > 0.9
    assert frame.rgba[14, 8, 0] < 0.1  # the kernel reaches around the texture


def test_textures_repeat_beyond_their_edges():
    texture, camera = noise(32), oblique(1.0, 32)
    mesh = square(texture)
    moved = Mesh(mesh.position, mesh.triangle, uv=mesh.uv + np.array([3, -2]), textures=(texture,))
    found = picture(moved, camera, 32).rgba
    np.testing.assert_allclose(found, picture(mesh, camera, 32).rgba, atol=1e-3)  # points at rims


def two_squares(first, second, first_color, second_color):
    triangle = np.concatenate([FALLING, FALLING + 4])
    return Mesh(
        np.concatenate([first, second]),
        triangle,
        uv=np.tile(SQUARE[:, :2], (2, 1)),
        textures=(even(*first_color), even(*second_color)),
        texture=np.array([0, 0, 1, 1]),
    )


@pytest.mark.parametrize("height", [0.5, -0.5])
def test_what_is_near_hides_what_is_far(height):
    mesh = two_squares(SQUARE, SQUARE + np.array([0, 0, height]), (1, 0, 0), (0, 1, 0))
    frame = picture(mesh, from_above(16.0, 16), 16)
    nearer = [0, 1, 0, 1] if height > 0 else [1, 0, 0, 1]
    np.testing.assert_allclose(frame.rgba[2:14, 2:14], np.broadcast_to(nearer, (12, 12, 4)))
    assert frame.depth[8, 8] == pytest.approx(5 - max(height, 0))


def test_squares_that_pass_through_each_other_share_the_picture():
    tilt = np.array([0, 0, 1.0])
    first, second = SQUARE + SQUARE[:, :1] * tilt, SQUARE + (1 - SQUARE[:, :1]) * tilt
    frame = picture(two_squares(first, second, (1, 0, 0), (0, 1, 0)), from_above(16.0, 16), 16)
    np.testing.assert_allclose(frame.rgba[8, 1:7, 1], 1)
    np.testing.assert_allclose(frame.rgba[8, 9:15, 0], 1)


def test_a_hidden_texture_does_not_shine_through_a_seam():
    texture, camera = even(1, 1, 1), from_above(13.7, 16, 0.2)
    alone = picture(square(texture), camera, 16)
    behind = two_squares(SQUARE, SQUARE - np.array([0, 0, 0.5]), (1, 1, 1), (0, 0, 0))
    np.testing.assert_array_equal(picture(behind, camera, 16).rgba, alone.rgba)


def test_a_floor_under_the_eye_ends_at_the_horizon():
    wide = (SQUARE - 0.5) * [2000, 2000, 1]
    pose = look_at((0, 0, 1), (0, 1, 1))
    camera = Camera.from_fov(90, height=32, width=32, world_to_camera=pose)
    frame = picture(square(even(1, 1, 1), corners=wide), camera, 32)
    np.testing.assert_array_equal(frame.coverage[:16], 0)
    np.testing.assert_array_equal(frame.coverage[17:], 1)


@pytest.mark.sweep
def test_a_texture_that_crosses_the_eye_s_plane_is_where_rays_see_it(record):
    texture = noise(64)
    pose = look_at((0.5, 0.2, 0.1), (0.5, 0.8, 0.0))
    camera = Camera.from_fov(60, height=48, width=48, world_to_camera=pose)
    truth = naive(texture, camera, 48)
    inside = truth[..., 3] == 1
    frame = picture(square(texture), camera, 48)
    record.quality("inside", decibels(frame.rgba[inside], truth[inside]))


def test_what_lies_before_the_near_plane_is_not_seen():
    pose = look_at((0.5, 0.5, 5.0), (0.5, 0.5, 0.0), (0, 1, 0))
    camera = Camera.from_fov(20, height=16, width=16, world_to_camera=pose, near=5.5)
    assert picture(square(even(1, 1, 1)), camera, 16).coverage.sum() == 0


@pytest.mark.parametrize("azimuth", [0, 13, 45, 77])
def test_a_closed_cube_has_no_holes(azimuth):
    mesh = cube(even(1, 1, 1))
    camera = fitted_camera(mesh, azimuth, 29, fov=0, size=(64, 64))
    row, column = np.mgrid[0:64, 0:64] + 0.5
    ball = np.hypot(row - 32, column - 32) < 32 / np.sqrt(3) - 1  # the largest inside the cube
    frame = picture(mesh, camera, 64)
    np.testing.assert_allclose(frame.rgba[ball], 1, atol=1e-6)


def test_from_inside_a_cube_is_everywhere():
    camera = Camera.from_fov(
        100, height=32, width=32, world_to_camera=look_at((0.2, 0.1, 0), (1, 0.4, 0.3))
    )
    frame = picture(cube(noise(32)), camera, 32)
    np.testing.assert_array_equal(frame.coverage, 1)


def test_a_fitted_camera_holds_the_whole_mesh():
    mesh = cube(even(1, 1, 1))
    frame = picture(mesh, fitted_camera(mesh, 30, 20, size=(40, 40)), 40)
    rim = np.concatenate([frame.coverage[[0, -1]].ravel(), frame.coverage[:, [0, -1]].ravel()])
    assert rim.sum() == 0
    assert frame.coverage.sum() > 300


def test_pixels_do_not_depend_on_the_number_of_threads():
    mesh = cube(noise(64))
    camera = fitted_camera(mesh, size=(96, 96))
    many = picture(mesh, camera, 96)
    with threads(1):
        one = picture(mesh, camera, 96)
    np.testing.assert_array_equal(many.rgba, one.rgba)
    np.testing.assert_array_equal(many.depth, one.depth)


def test_vertex_colors_run_from_corner_to_corner():
    color = np.repeat(SQUARE[:, :1], 3, axis=1)
    mesh = Mesh(SQUARE, FALLING, color=color)
    frame = picture(mesh, from_above(16.0, 16), 16)
    expected = np.broadcast_to((np.arange(16) + 0.5) / 16, (16, 16))
    np.testing.assert_allclose(frame.rgba[..., 0], expected, atol=1e-6)


def test_a_texture_without_extent_gives_its_color():
    mesh = Mesh(SQUARE, FALLING, uv=np.zeros((4, 2)), textures=(even(0.2, 0.4, 0.6),))
    frame = picture(mesh, from_above(16.0, 16), 16)
    np.testing.assert_allclose(frame.rgba[8, 8], [0.2, 0.4, 0.6, 1], rtol=1e-6)


def test_shading_darkens_by_the_cosine():
    tilted = SQUARE * [1, 1, 0] + SQUARE[:, :1] * [0, 0, np.sqrt(3)]  # by 60 degrees
    frame = picture(square(even(1, 1, 1), corners=tilted), from_above(16.0, 16), 16, shading=True)
    np.testing.assert_allclose(frame.rgba[8, 8], [0.5, 0.5, 0.5, 1], rtol=1e-6)


def test_culling_leaves_out_what_faces_away():
    mesh, camera = square(even(1, 1, 1)), from_above(16.0, 16)
    away = square(even(1, 1, 1), triangle=FALLING[:, ::-1])
    assert picture(mesh, camera, 16, cull=True).coverage.sum() == 256
    assert picture(away, camera, 16, cull=True).coverage.sum() == 0
    assert picture(away, camera, 16).coverage.sum() == 256


def test_points_reach_almost_every_sub_pixel():
    mesh = cube(noise(64))
    frame = picture(mesh, fitted_camera(mesh, size=(64, 64)), 64)
    assert frame.statistics.covered > 10000
    assert frame.statistics.sampled < 1e-3 * frame.statistics.covered
