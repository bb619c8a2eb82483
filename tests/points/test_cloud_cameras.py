"""Clouds seen by parallel, panoramic, fisheye and lens cameras: discs lie where each shows them."""

import numpy as np
import pytest

from resample import registry
from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import (
    Equirectangular,
    directions,
    pixel_centers,
    rays_at,
    undistorted_places,
)
from resample.cameras.poses import look_at
from resample.cameras.viewpoints import Orbit
from resample_points import Cloud, CloudScene, CloudStyle, prepare_cloud, render_cloud
from resample_points.geometry.framing import ball_around
from resample_points.painting.bending import ProjectedCamera
from resample_points.scenes import camera_of, cameras_of

NONE = np.empty((0, 3))
POSE = look_at((0.3, -0.2, 0.1), (2.0, 1.0, 0.4))
LENS = Camera.from_fov(70, 48, 64, POSE).with_lens([-0.2, 0.05, 0.001, -0.002])


def ball(count=20_000, radius=3.0):
    """Points of a sphere around 0, colored by their direction."""
    n = np.arange(count) + 0.5
    z, turn = 1 - 2 * n / count, np.pi * (1 + 5**0.5) * n
    flat = np.sqrt(1 - z * z)
    place = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    return Cloud(radius * place, NONE, (0.5 + 0.5 * place).astype(np.float32), np.empty(0))


def around(camera, shape):
    """Directions (H, W, 3) in the scene and lengths per depth of a camera's pixels."""
    place = pixel_centers(shape)
    if isinstance(camera, Equirectangular):
        ray = rays_at(place, shape)
    elif isinstance(camera, ProjectedCamera):
        ray = camera.projection.rays(place, shape, 0)
        ray = ray / np.linalg.norm(ray, axis=2, keepdims=True)
    else:
        flat = directions(camera, undistorted_places(camera, place))
        ray = np.concatenate([flat, np.ones((*shape, 1))], axis=2)
    return ray @ camera.world_to_camera[:3, :3]


def on_ball(camera, ray, radius=3.0):
    """Depth (H, W) of the sphere, and the color there."""
    eye = -camera.world_to_camera[:3, :3].T @ camera.world_to_camera[:3, 3]
    square = (ray * ray).sum(axis=2)
    along = (ray @ eye) / square
    depth = -along + np.sqrt(along**2 - (eye @ eye - radius**2) / square)
    return depth, 0.5 + 0.5 * (eye + depth[..., None] * ray) / radius


def fisheye(spec):
    return ProjectedCamera(registry.build("projections", spec), POSE)


SURROUNDED = {
    "equirectangular": (Equirectangular(POSE), (48, 96)),
    "lens": (LENS, (48, 64)),
    "fisheye": (fisheye("fisheye:fov=200"), (64, 64)),
    "stereographic": (fisheye("stereographic:fov=240"), (48, 64)),
    "cylindrical": (fisheye("cylindrical:fov=300"), (40, 96)),
    "perspective": (fisheye("perspective:fov=90"), (48, 64)),
}
SURFELS = prepare_cloud(ball())


@pytest.mark.some(3)
@pytest.mark.parametrize("kind", [None, "gaussian:sigma=0.5"])
@pytest.mark.parametrize("name", SURROUNDED)
def test_a_ball_around_the_camera_fills_its_picture(name, kind):
    camera, shape = SURROUNDED[name]
    ray = around(camera, shape)
    depth, color = on_ball(camera, ray)
    frame = render_cloud(SURFELS, camera, size=shape[::-1], filter=kind)
    seen = np.isfinite(depth)
    seen[[0, -1]], seen[:, [0, -1]] = False, False  # pixels partly beside a circle
    if name == "fisheye":
        y, x = np.mgrid[:64, :64] - 31.5
        seen &= np.hypot(x, y) < 30
    assert frame.coverage[seen].min() > 0.99
    np.testing.assert_allclose(frame.depth[seen], depth[seen], rtol=0.01)
    np.testing.assert_allclose(frame.rgba[seen][:, :3], color[seen], atol=0.03)


@pytest.mark.sweep
def test_a_panorama_has_no_seam_and_hardly_a_hole_at_its_poles():
    frame = render_cloud(SURFELS, Equirectangular(POSE), size=(96, 48))
    assert frame.coverage.min() > 0.7  # of pixels at the poles themselves
    assert frame.coverage[1:-1].min() > 0.99
    steps = np.abs(np.diff(frame.rgba[2:-2, :, :3], axis=1)).max()
    assert np.abs(frame.rgba[2:-2, 0, :3] - frame.rgba[2:-2, -1, :3]).max() <= steps
    with pytest.raises(ValueError, match="twice as wide as high"):
        render_cloud(SURFELS, Equirectangular(POSE), size=(96, 50))


def grid(pitch=0.1, depth=5.0):
    x, y = np.meshgrid(np.arange(-10, 10) * pitch, np.arange(-10, 10) * pitch)
    return np.stack([x, y, np.full_like(x, depth)], axis=2).reshape(-1, 3)


@pytest.mark.parametrize("depth", [5.0, -5.0, 500.0])
def test_a_parallel_camera_shows_all_depths_at_one_scale(depth):
    lower = grid(depth=9.0)
    lower[:, 1] += 1.5
    place = np.concatenate([grid(), lower])
    place[:, 2] += depth - 5
    color = np.repeat(np.eye(3)[:2], 400, axis=0)
    camera = Orthographic(10, 10, 32.5, 24.5, near=-1000)
    frame = render_cloud(Cloud(place, NONE, color, np.empty(0)), camera, size=(64, 48))
    covered = frame.coverage > 0.6
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    # Squares of 20 px, and outlines that reach 0.15 px beyond; one is 15 px lower.
    assert (rows[0], rows[-1]) == (14, 47)
    assert (columns[0], columns[-1]) == (22, 41)
    np.testing.assert_allclose(frame.depth[16:30, 24:40], depth, rtol=1e-5)
    np.testing.assert_allclose(frame.depth[36:46, 24:40], depth + 4, rtol=1e-5)
    np.testing.assert_allclose(frame.rgba[16:30, 24:40, 0], 1, atol=1e-6)


def test_a_parallel_camera_shades_and_culls_by_its_axis():
    x = np.linspace(-1, 1, 60)
    place = np.stack([*np.meshgrid(x, x), 0 * np.add.outer(x, x)], axis=2).reshape(-1, 3)
    angle = np.radians(50)
    turn = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    normal = np.tile(turn @ [0, 0, -1], (len(place), 1))
    camera = Orthographic(20, 20, 16, 16, near=-9)
    cloud = Cloud(place @ turn.T, normal, NONE, np.empty(0))
    frame = render_cloud(cloud, camera, size=(32, 32))
    shown = frame.coverage > 0.999
    assert shown.sum() > 200
    np.testing.assert_allclose(frame.rgba[shown][:, 0], 0.8 * np.cos(angle), rtol=1e-4)
    away = cloud._replace(normal=-normal)
    for given, share in ((cloud, 1.0), (away, 0.0)):
        culled = render_cloud(given, camera, size=(32, 32), style=CloudStyle(cull=True))
        assert (culled.coverage[shown] > 0.9).mean() == share


def test_cameras_without_pixels_of_one_part_are_refused():
    cube = ProjectedCamera(registry.build("projections", "cubemap"))
    with pytest.raises(ValueError, match="projections of one part"):
        render_cloud(SURFELS, cube, size=(60, 10))
    with pytest.raises(ValueError, match="not by object"):
        render_cloud(SURFELS, object(), size=(60, 10))


@pytest.mark.some(1)
@pytest.mark.parametrize("name", SURROUNDED)
def test_what_is_picked_lies_on_the_surface_under_any_camera(name):
    camera, shape = SURROUNDED[name]
    found = CloudScene(SURFELS).pick(
        shape[1] / 2 + 5.5, shape[0] / 2 - 3.5, camera, size=shape[::-1]
    )
    assert np.linalg.norm(found.position) == pytest.approx(3, abs=0.01)
    preview = CloudScene(SURFELS).render(camera, size=shape[::-1], quality="preview")
    assert preview.coverage[4:-4, 20:-20].min() > 0.9


@pytest.mark.sweep
def test_what_is_picked_in_a_parallel_view_lies_there():
    scene = CloudScene(SURFELS)
    camera = Orthographic(8, 8, 32, 24, look_at((9, 0, 0), (0, 0, 0)))
    place = scene.pick(40.5, 20.5, camera, size=(64, 48)).position
    expected = np.sqrt(9 - (8.5 / 8) ** 2 - (3.5 / 8) ** 2), 8.5 / 8, 3.5 / 8
    np.testing.assert_allclose(place, expected, atol=0.02)
    parallel = scene.camera(Orbit(20, 10, fov=0), (64, 48))
    frame = scene.render(parallel, size=(64, 48))
    rows = np.flatnonzero((frame.coverage > 0.5).any(axis=1))
    assert len(rows) == pytest.approx(0.95 * 48, abs=1)
    half = scene.render(Orbit(20, 10, 0.5, fov=0), size=(64, 48))
    assert half.coverage.sum() == pytest.approx(frame.coverage.sum() / 4, rel=0.02)


def test_frames_of_a_film_have_the_fields_of_view_and_zooms_of_their_orbits(rng):
    """At one distance, from which the first field of view shows the whole cloud."""
    place, nothing = rng.normal(size=(50, 3)), np.empty((0, 3), np.float32)
    cloud = Cloud(place, nothing, nothing, np.empty(0, np.float32))
    fields, zooms = (40.0, 40.0, 25.0, 70.0), (1.0, 2.0, 1.0, 0.7)
    turn = [
        Orbit(azimuth=90 * n, elevation=20, fov=fov, zoom=zoom, up="z")
        for n, (fov, zoom) in enumerate(zip(fields, zooms, strict=True))
    ]
    found = cameras_of(cloud, turn, (36, 48))
    focal = [
        zoom * 18.0 / np.tan(np.radians(fov) / 2) for fov, zoom in zip(fields, zooms, strict=True)
    ]
    np.testing.assert_allclose([camera.fx for camera in found], focal)
    np.testing.assert_allclose([camera.fy for camera in found], focal)
    middle = (place.min(axis=0) + place.max(axis=0)) / 2
    eyes = [-camera.world_to_camera[:3, :3].T @ camera.world_to_camera[:3, 3] for camera in found]
    away = np.linalg.norm(np.array(eyes) - middle, axis=1)
    np.testing.assert_allclose(away, away[0], rtol=1e-6)


@pytest.mark.parametrize("fov", [0.0, 40.0])
@pytest.mark.parametrize("pan", [(0.1, 0.3), (-0.2, 0.0), (0.0, -0.4)])
def test_content_is_panned_right_and_up_by_shares_of_the_shorter_side(rng, fov, pan):
    nothing = np.empty((0, 3), np.float32)
    cloud = Cloud(rng.normal(size=(50, 3)), nothing, nothing, np.empty(0, np.float32))
    middle, seen = ball_around(cloud)[0], []
    for given in ((0.0, 0.0), pan):
        orbit = Orbit(azimuth=40, elevation=20, fov=fov, zoom=1.5, up="z", pan=given)
        view = camera_of(cloud, (36, 48), orbit).view()
        place = view.rotation @ middle + view.translation
        flat = place[:2] / place[2] if fov else place[:2]
        seen.append(view.focal * flat + view.principal)
    np.testing.assert_allclose(seen[1] - seen[0], [36 * pan[0], -36 * pan[1]], atol=1e-9)
