"""Rendered clouds: no holes where discs grow, means where they shrink, and surfaces that hide."""

import math
from dataclasses import replace

import numpy as np
import pytest

from conftest import real
from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.cameras.viewpoints import Orbit
from resample.engine.jit import workers
from resample.types import Frame
from resample_points.files.readers import Cloud, read_cloud
from resample_points.geometry import spacing
from resample_points.geometry.framing import framed, framed_together
from resample_points.geometry.spacing import prepare_cloud
from resample_points.kernels.discs import AMPLE, REACH
from resample_points.painting.rendering import TOLERANCE, CloudStyle, Shading, render_cloud
from resample_points.scenes import cameras_of
from tests.bits import assert_threads_change_nothing

SIZE = (48, 64)
SMALL = (24, 32)


def _cloud(position, color=None, normal=None, radius=None) -> Cloud:
    nothing = np.zeros((0, 3), np.float32)
    return Cloud(
        np.asarray(position),
        nothing if normal is None else np.asarray(normal, np.float32),
        nothing if color is None else np.asarray(color, np.float32),
        np.zeros(0, np.float32) if radius is None else np.asarray(radius, np.float32),
    )


def _grid(count: int, depth: float = 0.0, spacing: float = 1.0) -> np.ndarray:
    """Points (count², 3) of a square about the origin."""
    line = (np.arange(count) - 0.5 * (count - 1)) * spacing
    x, y = np.meshgrid(line, line)
    return np.stack([x.ravel(), y.ravel(), np.full(count * count, depth)], axis=1)


def _camera(scale: float, *, eye=(0.0, 0.0, -100.0), size=SIZE) -> Camera:
    """Camera that sees the origin at `scale` px per scene unit."""
    focal = scale * float(np.linalg.norm(eye))
    matrix = np.array([[focal, 0, size[1] / 2], [0, focal, size[0] / 2], [0, 0, 1.0]])
    return Camera(matrix, look_at(eye, (0, 0, 0), (0, -1, 0)))


def _render(cloud, camera, size=SIZE, **style) -> Frame:
    return render_cloud(cloud, camera, size=size[::-1], style=CloudStyle(**style))


def _ball(count: int) -> np.ndarray:
    """Points (count, 3) spread evenly over the unit sphere."""
    n = np.arange(count) + 0.5
    z, angle = 1 - 2 * n / count, math.pi * (1 + math.sqrt(5)) * n
    around = np.sqrt(1 - z * z)
    return np.stack([around * np.cos(angle), around * np.sin(angle), z], axis=1)


@pytest.mark.sweep
@pytest.mark.parametrize("scale", [0.2, 0.45, 0.7, 1.0, 1.6, 3.0, 8.0])
@pytest.mark.parametrize("eye", [(0, 0, -100), (600, 200, -600)], ids=["front", "aside"])
def test_a_plane_has_no_holes_at_any_magnification(scale, eye):
    count = 400 if scale < 1 else 140
    cloud = _cloud(_grid(count), np.full((count * count, 3), (0.2, 0.5, 0.8)))
    frame = _render(cloud, _camera(scale, eye=eye, size=SMALL), SMALL)
    np.testing.assert_allclose(frame.rgba, np.full((*SMALL, 4), (0.2, 0.5, 0.8, 1)), rtol=1e-5)


@pytest.mark.sweep
@pytest.mark.parametrize("scale", [0.3, 1.0, 4.0])
def test_irregular_points_leave_no_holes(rng, scale):
    count = 30000 if scale < 1 else 6000
    side = math.sqrt(count)
    cloud = _cloud(np.c_[(rng.random((count, 2)) - 0.5) * side, np.zeros(count)])
    frame = _render(cloud, _camera(scale, size=SMALL), SMALL)
    assert frame.coverage.min() > 0.99


@pytest.mark.sweep
@pytest.mark.parametrize("distance", [3.0, 12.0, 60.0])
def test_the_outline_of_a_ball_encloses_its_area(distance):
    size = (96, 96)
    camera = _camera(110.0 / distance, eye=(0, -distance, 0), size=size)
    frame = _render(_cloud(_ball(20000)), camera, size)
    radius = camera.matrix[0, 0] / math.sqrt(distance**2 - 1)
    # Discs at the rim reach beyond it by up to a sub-pixel, 1/4 px.
    outline = math.pi * radius**2
    assert outline < frame.coverage.sum() < math.pi * (radius + 0.25) ** 2


def test_a_ball_of_few_points_keeps_its_outline():
    size = (96, 96)
    frame = _render(_cloud(_ball(2000)), _camera(30.0, eye=(0, -4.0, 0), size=size), size)
    outline = math.pi * (120.0 / math.sqrt(15)) ** 2
    assert frame.coverage.sum() == pytest.approx(outline, rel=0.02)  # 0.6 % measured


def _naive(cloud: Cloud, camera: Camera, subpixels: int) -> np.ndarray:
    """Picture (H, W, 4) of splats by shooting a ray through every sub-pixel at every disc."""
    pose, inverse = camera.world_to_camera, np.linalg.inv(camera.matrix)
    surfels = prepare_cloud(cloud)
    centers = (surfels.position + surfels.origin) @ pose[:3, :3].T + pose[:3, 3]
    axes = surfels.axes.astype(np.float64) @ pose[:3, :3].T
    normals = np.cross(axes[:, 0], axes[:, 1])
    radius = np.sqrt(np.linalg.norm(normals, axis=1))
    steep = np.linalg.norm(np.cross(normals, centers), axis=1) / np.abs((normals * centers).sum(1))
    assert (steep < 3).all()
    focal = math.sqrt(camera.matrix[0, 0] * camera.matrix[1, 1])
    picture = np.zeros((*SMALL, 4))
    for row in range(SMALL[0] * subpixels):
        for column in range(SMALL[1] * subpixels):
            shift = (row % subpixels + 0.5) / subpixels - 0.5
            place = (column + 0.5 + shift) / subpixels, (row + 0.5) / subpixels, 1.0
            ray = inverse @ place
            z = (normals * centers).sum(1) / (normals @ ray)
            offset = ray * z[:, None] - centers
            u = (offset * axes[:, 0]).sum(1) / (axes[:, 0] ** 2).sum(1)
            v = (offset * axes[:, 1]).sum(1) / (axes[:, 1] ** 2).sum(1)
            index = np.hypot(u, v)
            if not (index <= 1).any():
                continue
            # Tangent between a disc and the screen as nearness changes along px
            forms = normals / (normals * centers).sum(1)[:, None] @ np.linalg.inv(camera.matrix)
            slope = focal * np.hypot(forms[:, 0], forms[:, 1]) * centers[:, 2]
            apart = TOLERANCE * radius / centers[:, 2] + 1 / (focal * subpixels)
            keep = 1 - np.minimum(0.5, apart * np.sqrt(1 + slope**2))
            floor = (keep / z)[index <= 1].max()
            part = (index < REACH) & (1 / z >= floor) & (keep**2 / z <= floor)
            weight = np.where(part, (1 - (index / REACH) ** 2) ** 2, 0)
            color = weight @ surfels.color / weight.sum()
            picture[row // subpixels, column // subpixels] += [*color, 1]
    return picture / subpixels**2


@pytest.mark.sweep
def test_splats_are_what_rays_through_every_subpixel_find(rng):
    count = 30
    position = rng.uniform(-1, 1, (count, 3)) * (1.5, 1.0, 1.0)
    normal = np.array([0, 0, -1.0]) + rng.uniform(-0.5, 0.5, (count, 3))
    radius = rng.uniform(0.2, 0.6, count)
    cloud = _cloud(position, rng.random((count, 3)), normal, radius)
    camera = _camera(7.5, eye=(0.5, 0.3, -3.5), size=SMALL)
    expected = _naive(cloud, camera, 2)
    found = _render(cloud, camera, SMALL, subpixels=2).rgba
    # A sub-pixel on the very rim of a disc may fall on either side in float32.
    assert (np.abs(found - expected).max(axis=2) < 1e-3).mean() > 0.995


@pytest.mark.sweep
@pytest.mark.parametrize("scale", [0.3, 1.0, 5.0])
def test_a_hidden_plane_does_not_shine_through(rng, scale):
    count = 200
    jitter = rng.uniform(-0.3, 0.3, (count * count, 3)) * (1, 1, 0.1)
    front, behind = _grid(count) + jitter, _grid(count, 12.0) + jitter
    color = np.repeat([(1.0, 0, 0), (0, 0, 1.0)], count * count, axis=0)
    frame = _render(
        _cloud(np.concatenate([front, behind]), color), _camera(scale, size=SMALL), SMALL
    )
    np.testing.assert_allclose(frame.rgba, np.full((*SMALL, 4), (1.0, 0, 0, 1)), atol=1e-6)


@pytest.mark.sweep
@pytest.mark.parametrize("scale", [0.3, 1.0, 5.0])
def test_what_is_behind_an_edge_is_seen_beside_it(scale):
    count = 120
    behind = _grid(3 * count, 30.0)
    front = _grid(count)
    front = front[front[:, 0] < 0.3]
    cloud = _cloud(np.concatenate([front, behind]), np.ones((len(front) + len(behind), 3)))
    frame = _render(cloud, _camera(scale, size=SMALL), SMALL)
    np.testing.assert_allclose(frame.rgba, np.ones((*SMALL, 4)), atol=2e-3)  # FULL leaves 1e-3


@pytest.mark.sweep
def test_a_minified_checker_is_its_mean():
    count = 256
    line = np.arange(count) % 2
    checker = (line[:, None] ^ line[None, :]).ravel().astype(np.float32)
    cloud = _cloud(_grid(count), np.repeat(checker[:, None], 3, axis=1))
    for scale in (0.25, 0.21, 0.13):
        frame = _render(cloud, _camera(scale, size=SMALL), SMALL)
        # A pixel has 16 to 59 points; those at its border belong to two.
        np.testing.assert_allclose(frame.rgba[..., 0], 0.5, atol=0.04)


@pytest.mark.sweep
def test_a_pixel_is_a_mean_over_area_not_over_points(rng):
    stripe, size = 4.0, (12, 12)  # half a pixel
    x = np.concatenate([rng.random(5000), rng.random(20000)]) * 48
    is_sparse = np.arange(x.size) < 5000
    x = (x // stripe) * 2 * stripe + x % stripe + np.where(is_sparse, 0, stripe) - 48
    position = np.c_[x, rng.uniform(-48, 48, x.size), np.zeros(x.size)]
    color = np.repeat(is_sparse[:, None], 3, axis=1)
    frame = _render(_cloud(position, color), _camera(1 / 8, size=size), size)
    # By points it would be 0.2; the sub-pixels at the stripes' borders have points of both.
    assert frame.rgba[..., 0].mean() == pytest.approx(0.5, abs=0.08)


def _scene(rng) -> tuple[Cloud, Camera]:
    """Surfaces one behind the other with points that coincide, near and far."""
    ball = _ball(3000)
    position = np.concatenate([ball, ball[:500], _grid(60, 2.0, 0.1), rng.normal(size=(200, 3))])
    color = rng.random((len(position), 3))
    return _cloud(position, color), _camera(16.0, eye=(0.5, 0.5, -3.0))


@pytest.mark.sweep
def test_pictures_do_not_depend_on_the_order_of_points(rng):
    cloud, camera = _scene(rng)
    mixed = rng.permutation(len(cloud.position))
    other = _cloud(cloud.position[mixed], cloud.color[mixed])
    one, two = _render(cloud, camera), _render(other, camera)
    for first, second in zip(one[:4], two[:4], strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.sweep
def test_pictures_do_not_depend_on_the_number_of_threads(rng):
    cloud, camera = _scene(rng)
    assert_threads_change_nothing(lambda: _render(cloud, camera)[:4])


@pytest.mark.sweep
def test_huge_coordinates_change_nothing(rng):
    cloud, camera = _scene(rng)
    cloud = cloud._replace(position=cloud.position.astype(np.float32).astype(np.float64))
    moved = cloud._replace(position=cloud.position + 2.0**21)
    pose = camera.world_to_camera.copy()
    pose[:3, 3] -= pose[:3, :3] @ np.full(3, 2.0**21)
    frame = _render(cloud, camera)
    other = _render(moved, Camera(camera.matrix, pose))
    # The pose itself is rounded at 2e6: by 4e-10, which moves a rim over a few sub-pixels.
    assert (np.abs(frame.rgba - other.rgba).max(axis=2) < 1e-4).mean() > 0.99


def test_depth_is_that_of_the_plane():
    camera = _camera(4.0, eye=(30, 0, -40))
    frame = _render(_cloud(_grid(120)), camera)
    rows, columns = np.indices(SIZE) + 0.5
    ray = np.stack([columns, rows, np.ones(SIZE)], axis=2) @ np.linalg.inv(camera.matrix).T
    pose = camera.world_to_camera
    normal = pose[:3, 2]
    expected = normal @ pose[:3, 3] / (ray @ normal)
    np.testing.assert_allclose(frame.depth, expected, rtol=1e-4)
    assert (frame.first_depth <= frame.depth * (1 + 1e-6)).all()


@pytest.mark.sweep
def test_light_falls_off_with_the_angle():
    cloud = _cloud(_grid(100))
    front = _render(cloud, _camera(3.0))
    aside = _render(cloud, _camera(3.0, eye=(80, 0, -60)))
    assert front.rgba[24, 32, 0] == pytest.approx(0.8, rel=1e-4)
    assert aside.rgba[24, 32, 0] == pytest.approx(0.8 * 0.6, rel=1e-2)  # the pixel's own angle


@pytest.mark.sweep
def test_scanned_colors_are_shown_unlit_unless_asked_for():
    cloud = _cloud(_grid(100), np.full((10000, 3), 0.5))
    aside = _camera(3.0, eye=(80, 0, -60))
    assert _render(cloud, aside).rgba[24, 32, 0] == pytest.approx(0.5, rel=1e-5)
    lit = _render(cloud, aside, light=Shading.HEADLIGHT)
    named = _render(cloud, aside, light="headlight")
    np.testing.assert_array_equal(lit.rgba, named.rgba)
    assert lit.rgba[24, 32, 0] == pytest.approx(0.3, rel=1e-2)


@pytest.mark.sweep
def test_backs_can_be_left_out():
    normal = np.repeat([(0.0, 0, 1)], 10000, axis=0)
    cloud = _cloud(_grid(100), normal=normal)
    assert _render(cloud, _camera(3.0), cull=True).coverage.max() == 0
    assert (
        _render(cloud._replace(normal=-cloud.normal), _camera(3.0), cull=True).coverage.min() == 1
    )


def test_backs_are_not_known_without_normals():
    with pytest.raises(ValueError, match="no normals"):
        _render(_cloud(_grid(4)), _camera(3.0), cull=True)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_a_lone_disc_has_its_area(factor):
    cloud = _cloud([(0.1, 0.2, 0)], normal=[(0, 0, -1)], radius=[1.0])
    frame = _render(cloud, _camera(8.0), point_size=factor)
    assert frame.coverage.sum() == pytest.approx(math.pi * (8 * factor) ** 2, rel=0.01)


@pytest.mark.parametrize("scale", [0.01, 0.05, 0.1])
def test_a_lone_point_fades_with_its_area(scale):
    """So thin things fade with distance and do not flicker."""
    totals = []
    for shift in np.linspace(0, 1, 9):
        cloud = _cloud([(shift / scale, 0.3 / scale, 0)], normal=[(0, 0, -1)], radius=[1.0])
        totals.append(_render(cloud, _camera(scale)).coverage.sum())
    # (1 - i²)² sampled at sub-pixels sums to within 13 % of its area, whose 1.75² / 3 is 1.02.
    np.testing.assert_allclose(totals, AMPLE * math.pi * scale**2, rtol=0.15)


def test_a_single_point_without_a_radius_has_no_size():
    with pytest.raises(ValueError, match="give a radius"):
        _render(_cloud([(0.0, 0, 0), (0, 0, 0)]), _camera(1.0))


def test_a_radius_can_be_given_to_all():
    surfels = prepare_cloud(_cloud([(0.0, 0, 0)]), radius=2.0)
    np.testing.assert_allclose(np.linalg.norm(surfels.axes, axis=2), 2.0, rtol=1e-6)


def test_an_empty_cloud_is_transparent():
    frame = _render(_cloud(np.zeros((0, 3))), _camera(1.0))
    assert not frame.rgba.any()
    assert np.isinf(frame.depth).all()


def test_points_behind_the_eye_are_not_seen():
    frame = _render(_cloud(_grid(50, -150.0)), _camera(1.0))
    assert not frame.rgba.any()


def test_points_before_the_near_plane_are_left_out():
    assert not _render(_cloud(_grid(50)), _camera(1.0), near=101.0).rgba.any()


@pytest.mark.parametrize("pixel_filter", [None, "gaussian"])
def test_points_before_the_cameras_near_plane_are_left_out(pixel_filter):
    cloud, camera = _cloud(_grid(50)), _camera(1.0)
    for near, is_seen in ((99.0, True), (101.0, False)):
        eye = replace(camera, near=near)
        frame = render_cloud(cloud, eye, size=SMALL[::-1], filter=pixel_filter)
        assert frame.rgba.any() == is_seen


def test_points_that_are_no_numbers_are_left_out():
    position = _grid(40)
    bad = position.copy()
    bad[7] = np.nan
    good = np.delete(position, 7, axis=0)
    np.testing.assert_array_equal(
        _render(_cloud(bad), _camera(2.0)).rgba, _render(_cloud(good), _camera(2.0)).rgba
    )


def test_a_stray_point_stays_small():
    cloud = _cloud(np.concatenate([_grid(30), [(0, 0, -60.0)]]))
    size = np.linalg.norm(prepare_cloud(cloud).axes, axis=2).max()
    assert size < 4.0  # its neighbours are 60 away


@pytest.mark.parametrize(("strays", "factor"), [(1, 1.0), (2, 1.0), (3, 1.75)])
def test_strays_are_not_larger_than_what_they_strayed_from(strays, factor):
    away = np.array([(0.0, 0, -9), (6, 1, -9), (-6, 2, -8)])[:strays]
    surfels = prepare_cloud(_cloud(np.concatenate([_grid(40), away])))
    size = np.linalg.norm(surfels.axes, axis=2).max(axis=1)
    is_stray = (surfels.position + surfels.origin)[:, 2] < -4
    assert is_stray.sum() == strays
    assert size[is_stray].max() <= 1.01 * factor * np.median(size)


def test_one_stray_in_a_hundred_hides_little(rng):
    """Strays in empty space have strays around them, and are points all the same."""
    ball, strays = _ball(20_000), rng.uniform(-1.5, 1.5, (200, 3))
    red = np.repeat([[1.0, 1, 1], [1.0, 0, 0]], [len(ball), len(strays)], axis=0)
    size = (120, 160)
    whole = _render(_cloud(np.concatenate([ball, strays]), red), _camera(40.0, size=size), size)
    is_red = (whole.rgba[..., 0] - whole.rgba[..., 1]) > 0.3
    assert 0 < is_red.mean() < 0.03


def test_nothing_behind_shows_through_gaps_of_random_samples(rng):
    """A point in a clump knows how far its surface reaches by neighbours beyond the clump."""
    place = rng.normal(size=(100_000, 3))
    place /= np.linalg.norm(place, axis=1)[:, None]
    camera, size = _camera(220.0, eye=(0, 0, -3.0), size=(480, 640)), (480, 640)
    red = np.where(place[:, 2:] < 0.05, [1.0, 1, 1], [1.0, 0, 0])
    frame = _render(_cloud(place, red), camera, size)
    y, x = np.mgrid[:480, :640] + 0.5
    inside = np.hypot(x - 320, y - 240) < 200
    shows = frame.rgba[..., 0] - frame.rgba[..., 1] > 0.1
    assert np.count_nonzero(shows & inside) <= 3


@pytest.mark.sweep
def test_rings_of_a_scanner_stay_as_closed_as_without_a_limit():
    down, around = np.meshgrid(np.radians(np.linspace(8, 40, 50)), np.arange(900) * np.pi / 450)
    ray = np.stack([np.cos(around), np.sin(around), np.tan(down)], axis=2).reshape(-1, 3)
    cloud = _cloud(1.8 * ray / ray[:, 2:])  # on the ground, farther apart with every ring
    camera = Camera(
        np.array([[40.0, 0, 40], [0, 40, 40], [0, 0, 1]]),
        look_at((0, 0, -10), (0, 0, 1), (0, -1, 0)),
    )
    covered = [
        render_cloud(prepare_cloud(cloud, largest=largest), camera, size=(80, 80)).coverage.mean()
        for largest in (spacing.LARGEST, math.inf)
    ]
    assert covered[0] > 0.97 * covered[1]


def test_strays_keep_their_size_where_no_limit_is_asked_for():
    cloud = _cloud(np.concatenate([_grid(40), [(0, 0, -9.0)]]))
    assert np.linalg.norm(prepare_cloud(cloud, largest=math.inf).axes, axis=2).max() > 4
    with pytest.raises(ValueError, match="discs of at most 0 times"):
        prepare_cloud(cloud, largest=0.0)


def test_a_sparse_surface_beside_a_dense_one_keeps_its_discs():
    sparse, dense = _grid(60, spacing=2.0), _grid(90, spacing=0.5)
    is_right = sparse[:, 0] > 0
    cloud = _cloud(np.concatenate([sparse[is_right], dense - (23.0, 0, 0)]))
    size = (60, 40)
    pose = look_at((12.0, 0, -50), (12.0, 0, 0), (0, -1, 0))
    camera = Camera(np.array([[100.0, 0, 20], [0, 100, 30], [0, 0, 1]]), pose)
    frame = render_cloud(cloud, camera, size=size[::-1])  # from the seam at 0 to the right
    assert frame.coverage[:, 1:].mean() > 0.99


def test_rows_far_apart_get_long_discs():
    x, y = np.meshgrid(np.arange(60) * 0.25, np.arange(20) * 1.0)
    surfels = prepare_cloud(_cloud(np.c_[x.ravel(), y.ravel(), np.zeros(x.size)]))
    length = np.linalg.norm(surfels.axes, axis=2)
    inside = (np.abs(surfels.position[:, 0]) < 5) & (np.abs(surfels.position[:, 1]) < 5)
    assert np.median((length[:, 0] / length[:, 1])[inside]) > 3


def test_a_frame_holds_all_of_a_cloud():
    size = (60, 80)
    cloud = _cloud(_ball(4000) * 3 + (5, 6, 7))
    frame = render_cloud(
        cloud, framed(cloud, size=size[::-1], azimuth=30, elevation=20), size=size[::-1]
    )
    assert frame.coverage[30, 40] == 1
    border = [frame.coverage[[0, -1]].max(), frame.coverage[:, [0, -1]].max()]
    assert max(border) == 0


def _filled(cloud, size, **camera) -> tuple[float, float]:
    """Share of the frame's width and height between the first and the last covered pixel."""
    surfels = prepare_cloud(cloud)
    covered = (
        render_cloud(surfels, framed(surfels, size=size[::-1], **camera), size=size[::-1]).coverage
        > 0.5
    )
    return covered.any(axis=0).mean(), covered.any(axis=1).mean()


@pytest.mark.some(1)
@pytest.mark.parametrize("size", [(60, 80), (80, 60), (50, 200)])
@pytest.mark.parametrize("angles", [(0, 0), (30, 20), (250, -60)])
@pytest.mark.parametrize("stretch", [(1, 1, 1), (5, 1, 1), (1, 3, 0.2)])
def test_a_cloud_fills_its_frame(size, angles, stretch):
    cloud = _cloud(_ball(1500) * stretch + (50, 6, 7))
    width, height = _filled(cloud, size, azimuth=angles[0], elevation=angles[1])
    assert 0.88 < max(width, height) < 0.99  # a pixel is 2 %


@pytest.mark.parametrize("far", [3.0, 30.0, 3000.0])
def test_strays_do_not_make_the_rest_small(far):
    strays = np.array([(far, far, 0), (-far, 0, far), (0, 0, 2 * far)])
    cloud = _cloud(np.concatenate([_ball(3000), strays]))
    assert max(_filled(cloud, (60, 80), azimuth=20, elevation=10)) > 0.88


def test_strays_in_many_clumps_do_not_either(rng):
    middles = np.repeat(rng.normal(size=(20, 3)) * 40, 2, axis=0)
    cloud = _cloud(np.concatenate([_ball(6000), middles + rng.normal(size=middles.shape)]))
    assert max(_filled(cloud, (60, 80))) > 0.88


def test_twelve_strays_in_a_thousand_do_not_make_the_rest_small(rng):
    cloud = _cloud(np.concatenate([_ball(6000), rng.uniform(-100, 100, (72, 3))]))
    assert max(_filled(cloud, (60, 80))) > 0.88
    assert np.linalg.norm(prepare_cloud(cloud).axes, axis=2).max() < 0.2


def test_a_thin_pole_is_no_stray():
    pole = np.c_[np.zeros((30, 2)), np.linspace(1.0, 3.0, 30)]
    camera = framed(_cloud(np.concatenate([_ball(20000), pole])), size=(60, 80))
    top = camera.world_to_camera @ (0, 0, 3.0, 1)
    row = (camera.matrix @ top[:3])[1] / top[2]
    assert 0 < row < 4


def test_few_points_are_all_framed(rng):
    position = rng.normal(size=(60, 3)) * 10
    camera = framed(_cloud(position), size=(80, 60))
    seen = position @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    x, y = (seen @ camera.matrix.T)[:, :2].T / seen[:, 2]
    assert (x > 0).all()
    assert (x < 80).all()
    assert (y > 0).all()
    assert (y < 60).all()


def test_a_lone_disc_fills_its_frame():
    cloud = _cloud([(5.0, 6, 7)], normal=[(0, -1.0, 0)], radius=[2.0])
    _, height = _filled(cloud, (60, 80))
    assert height > 0.9


@pytest.mark.parametrize("fov", [-1.0, 180.0, math.nan])
def test_fields_of_view_that_are_none_are_refused(fov):
    with pytest.raises(ValueError, match="a field of view of"):
        framed(_cloud(_grid(4)), size=SIZE[::-1], fov=fov)


def test_all_cameras_of_an_orbit_see_all_of_a_cloud_from_one_distance():
    size, position = (60, 80), _ball(1500) * (5, 1, 1) + (50, 6, 7)
    angles = [(azimuth, 10.0) for azimuth in range(0, 360, 15)]
    cameras = framed_together(prepare_cloud(_cloud(position)), size=size[::-1], angles=angles)
    filled, away = [], set()
    for camera in cameras:
        seen = position @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
        x, y = (seen @ camera.matrix.T)[:, :2].T / seen[:, 2]
        assert min(x.min(), y.min()) > 0
        filled.append(max(np.ptp(x) / 80, np.ptp(y) / 60))
        middle = np.array([*(0.5 * (position.min(axis=0) + position.max(axis=0))), 1.0])
        away.add(round(float(np.linalg.norm(camera.world_to_camera @ middle)), 3))
    assert len(away) == 1
    assert 0.85 < max(filled) < 1


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"point_size": 0.0}, "point size"),
        ({"subpixels": 0}, "sub-pixels"),
        ({"light": "lamp"}, "none or headlight"),
        ({"near": -1.0}, "near plane"),
    ],
)
def test_choices_out_of_range_are_refused(choice, message):
    with pytest.raises(ValueError, match=message):
        CloudStyle(**choice)


def test_a_picture_has_at_least_one_pixel():
    with pytest.raises(ValueError, match="0 x 4 pixels"):
        render_cloud(_cloud(_grid(4)), _camera(1.0), size=(0, 4))


def test_arrays_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"color of a cloud has the shape \(3, 3\)"):
        prepare_cloud(_cloud(_grid(4), np.zeros((3, 3))))


@pytest.mark.parametrize("name", ["position", "normal", "color", "radius"])
@pytest.mark.parametrize("use", [prepare_cloud, lambda cloud: _render(cloud, _camera(1.0))])
def test_none_is_refused_in_words(name, use):
    cloud = _cloud(_grid(4))._replace(**{name: None})
    with pytest.raises(ValueError, match=f"{name} of a cloud is None; give an array of the shape"):
        use(cloud)


def test_a_frame_of_none_is_refused_in_words():
    with pytest.raises(ValueError, match="position of a cloud is None"):
        framed(_cloud(_grid(4))._replace(position=None), size=SIZE[::-1])


def test_threads_are_limited_by_an_argument(monkeypatch):
    limits = []
    monkeypatch.setattr(spacing, "_measured", lambda *_: limits.append(workers()))
    prepare_cloud(_cloud(_grid(20)), threads=1)
    render_cloud(_cloud(_grid(20)), _camera(1.0), size=SMALL[::-1], threads=1)
    assert limits == [1, 1]


def test_absurd_coordinates_are_refused():
    with pytest.raises(ValueError, match="1e\\+15 is the limit"):
        prepare_cloud(_cloud([(1e200, 0, 0), (0, 0, 0)]))


@pytest.mark.sweep
def test_the_scan_fills_the_frame_from_near_and_not_from_far():
    surfels = prepare_cloud(read_cloud(real("meshes/pointclouds/frag_115.ply")))
    near = framed(surfels, size=SIZE[::-1], up="-y", distance=0.5)
    far = framed(surfels, size=SIZE[::-1], up="-y", distance=30.0)
    assert render_cloud(surfels, near, size=SIZE[::-1]).coverage[:, :40].min() == 1
    assert 0 < render_cloud(surfels, far, size=SIZE[::-1]).coverage.mean() < 0.02


def test_a_film_that_zooms_or_narrows_its_field_enlarges_alike(rng):
    """The eye stays at its distance: focal lengths follow zoom and field of view."""
    position, nothing = rng.standard_normal((50, 3)), np.zeros((0, 3), np.float32)
    ball = Cloud(position, nothing, nothing, np.zeros(0, np.float32))
    every = [Orbit(fov=60), Orbit(fov=60), Orbit(fov=60, zoom=2.0), Orbit(fov=30)]
    first, same, near, slim = cameras_of(ball, every, (40, 50))
    np.testing.assert_array_equal(first.matrix, same.matrix)
    assert near.matrix[0, 0] == pytest.approx(2.0 * first.matrix[0, 0])
    ratio = math.tan(math.radians(30)) / math.tan(math.radians(15))
    for axis in (0, 1):
        assert slim.matrix[axis, axis] == pytest.approx(ratio * first.matrix[axis, axis])
    np.testing.assert_array_equal(slim.matrix[:, 2], first.matrix[:, 2])
    np.testing.assert_array_equal(slim.world_to_camera, first.world_to_camera)
