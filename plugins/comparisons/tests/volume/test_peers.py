import builtins

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at, orbit
from resample.measuring.quality import psnr
from resample.painting.choices import Projection
from resample.types import Samples
from resample_comparisons.volume.peers import Peer, VtkRenderer
from resample_comparisons.volume.raycasting import cast_rays
from resample_volume.classification.transfer import extinction, from_points
from resample_volume.files.generated import vessel_tree
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light
from resample_volume.voxels.visible import lattice_of

SIZE = {"height": 60, "width": 80}
FAINT = from_points([(0, (0.5, 0.5, 0.5), 0), (200, (1, 0.5, 0.2), 0.02)], opacity_unit=1.0)
WARM = from_points(
    [(0, (0.2, 0.2, 0.9), 0), (60, (0.5, 0.1, 0.1), 0), (255, (1, 0.8, 0.5), 0.4)], opacity_unit=1.0
)
WHITE = from_points([(0, (1, 1, 1), 0.1), (255, (1, 1, 1), 0.1)], opacity_unit=1.0)


def a_box():
    """Values of 200 in a box of 10 × 10 × 16 voxels that are no cubes, not around the origin."""
    values = np.zeros((24, 20, 16), np.uint8)
    values[4:20, 5:15, 3:13] = 200
    spacing, origin = np.array([1.0, 1.2, 0.9]), np.array([3.0, -2.0, 5.0])
    return Volume(values, spacing, origin, np.eye(3), "box")


def cube(values):
    return Volume(values, np.ones(3), np.zeros(3), np.eye(3), "cube")


def middle(volume):
    return volume.origin + volume.spacing * (np.array(volume.values.shape[::-1]) - 1) / 2


def vtk(volume, transfer, camera, size=SIZE, **look):
    """A picture by VTK; skipped where it is not installed or cannot make one."""
    pytest.importorskip("vtkmodules.vtkRenderingVolumeOpenGL2", exc_type=ImportError)
    pytest.importorskip("vtkmodules.vtkRenderingOpenGL2", exc_type=ImportError)
    picture = VtkRenderer(volume, transfer, **size, look=Peer(**look)).render(camera)
    if not picture.any():
        pytest.skip("VTK draws nothing without a display here")
    return picture


def samples_of(volume, transfer):
    """The volume as samples that have its colors, unlit."""
    z, y, x = np.meshgrid(*map(np.arange, volume.values.shape), indexing="ij")
    node = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    color, opacity = transfer(volume.values.ravel().astype(float), (0, 255))
    return Samples(
        (node * volume.spacing + volume.origin).astype(np.float32),
        color.astype(np.float32),
        extinction(opacity, transfer.opacity_unit).astype(np.float32),
        lattice_of(volume),
    )


def centroid(alpha):
    """Mean place of opacity, px."""
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]] + 0.5
    return np.array([(alpha * x).sum(), (alpha * y).sum()]) / alpha.sum()


def trilinear(volume, transfer, camera, rays, step, size):
    """The obvious ray caster: linear between 8 voxels, the midpoint rule, classified last."""
    from scipy.ndimage import map_coordinates

    y, x = (np.mgrid[: size * rays, : size * rays] + 0.5) / rays
    pose = camera.world_to_camera
    way = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, x * 0 + 1], axis=-1)
    way = way / np.linalg.norm(way, axis=-1, keepdims=True) @ pose[:3, :3]
    eye = -pose[:3, :3].T @ pose[:3, 3]
    rgba, passed = np.zeros((*x.shape, 4)), np.ones(x.shape)
    last = np.array(volume.values.shape) - 1
    reach = np.linalg.norm(eye - middle(volume)) + np.linalg.norm(last) / 2 * np.array([-1, 1])
    for distance in np.arange(*reach, step) + step / 2:
        place = (eye + distance * way)[..., ::-1]
        value = map_coordinates(
            volume.values.astype(float), np.moveaxis(place, -1, 0), order=1, cval=0.0
        )
        inside = ((place >= 0) & (place <= last)).all(axis=-1)
        color, opacity = transfer(value.ravel(), (0, 255))
        alpha = inside * (1 - (1 - opacity.reshape(x.shape)) ** step)
        light = np.append(color.reshape(*x.shape, 3), np.ones((*x.shape, 1)), axis=-1)
        rgba += (passed * alpha)[..., None] * light
        passed *= 1 - alpha
    return rgba.reshape(size, rays, size, rays, 4).mean(axis=(1, 3))


BOX = middle(a_box())


def beside(*offset):
    """A place at (x, y, z) from the box's middle."""
    return BOX + np.array(offset)


def seen_at(place, focal, eye, target):
    """Camera that looks past the box and has its middle at a place on the screen."""
    pose = look_at(eye, target, (0.4, 0.2, 1))
    x, y, z = pose[:3, :3] @ BOX + pose[:3, 3]
    return Camera.from_intrinsics(
        focal, focal, place[0] - focal * x / z, place[1] - focal * y / z, pose
    )


VIEWS = {
    "front": Camera.from_intrinsics(100, 100, 40, 30, look_at(beside(0, -60, 0), BOX)),
    "oblique": Camera.from_intrinsics(100, 100, 40, 30, orbit(BOX, 60, 33, 27)),
    "from the side": seen_at((33.3, 27.2), 100, beside(10, -60, 9), beside(3, 0, 2)),
    "window off its center": seen_at((52.1, 20.4), 100, beside(10, -60, 9), BOX),
    "zoomed, off axis": seen_at((40.2, 31.1), 160, beside(40, -70, 9), beside(-25, 0, 12)),
    "parallel": Orthographic(1.5, 1.5, 40.3, 33.2, orbit(BOX, 60, 120, -40)),
    "parallel, from above": Orthographic(1.3, 1.3, 20.3, 38.2, orbit(BOX, 60, 120, 90)),
}


# Our ray caster is a rival too, whose kernel is compiled for it alone.
OURS = pytest.mark.sweep


@OURS
@pytest.mark.parametrize("view", VIEWS)
def test_the_cameras_are_the_same(view, record):
    # Where nothing is opaque, no kernel moves the opacity's centroid.
    theirs = vtk(a_box(), FAINT, VIEWS[view])[..., 3]
    ours = cast_rays(samples_of(a_box(), FAINT), VIEWS[view], **SIZE).rgba[..., 3]
    assert ours[[0, -1]].max() == ours[:, [0, -1]].max() == 0  # all of the box is in the picture
    record.error("centroid", np.abs(centroid(theirs) - centroid(ours)).max())
    # Opacities 15 bits, those of the last sample on a ray missing.
    assert theirs.sum(dtype=np.float64) == pytest.approx(ours.sum(dtype=np.float64), rel=0.01)


@OURS
def test_a_near_plane_cuts_both():
    camera = Camera.from_intrinsics(100, 100, 40, 30, orbit(BOX, 60, 0, 0), near=60.0)
    theirs = vtk(a_box(), FAINT, camera, step=0.25)[..., 3]
    ours = cast_rays(samples_of(a_box(), FAINT), camera, **SIZE).rgba[..., 3]
    # VTK's first sample may lie half a step behind the plane; kernels blur what it cuts off.
    assert theirs.sum() == pytest.approx(ours.sum(), rel=0.04)
    whole = cast_rays(samples_of(a_box(), FAINT), VIEWS["front"], **SIZE).rgba[..., 3]
    assert ours.sum() < 0.6 * whole.sum()


@pytest.mark.parametrize(("unit", "opacity"), [(1.0, 0.05), (2.0, 0.05), (1.0, 0.2)])
def test_an_even_block_has_the_opacity_of_its_thickness(unit, opacity):
    tint = (0.9, 0.6, 0.3)
    transfer = from_points([(0, tint, opacity), (255, tint, opacity)], opacity_unit=unit)
    camera = Orthographic(1, 1, 10, 10, look_at([9.5, -30, 9.5], [9.5, 9.5, 9.5]))
    size = {"height": 20, "width": 20}
    seen = vtk(cube(np.full((20, 20, 20), 100, np.uint8)), transfer, camera, size)[10, 10]
    # VTK's block is 19 voxels thick, from center to center, and its rays may lack one sample.
    most, least = (1 - (1 - opacity) ** (n / unit) for n in (19, 18))
    assert least - 1 / 255 <= seen[3] <= most + 1 / 255
    linear = transfer.colors(np.array([100.0]), (0, 255))[0]
    np.testing.assert_allclose(seen[:3] / seen[3], linear, atol=1 / 255)


@pytest.mark.sweep
def test_pictures_agree_with_an_obvious_trilinear_ray_caster(record):
    volume = vessel_tree(32)
    camera = Camera.from_fov(
        30, height=60, width=60, world_to_camera=orbit(middle(volume), 74, 30, 20)
    )
    theirs = vtk(volume, WARM, camera, {"height": 60, "width": 60}, step=0.25, rays=2)
    truth = trilinear(volume, WARM, camera, 2, 0.25, 60)
    record.quality("picture", psnr(theirs, truth, mask=truth[..., 3] > 0.01))


@pytest.mark.parametrize(
    ("light", "elevation", "expected"),
    [
        (Light(None, 0.2, 0.5, 0.0), 0, 0.7),
        (Light(None, 0.2, 0.5, 0.0), 60, 0.45),
        (Light(None, 0.2, 0.5, 0.5, 10), 30, 0.2 + 0.5 * 0.75**0.5 + 0.5 * 0.75**5),
        (
            Light((np.sin(0.8), -np.cos(0.8), 0), 0.2, 0.5, 0.5, 10),
            0,
            0.2 + 0.5 * np.cos(0.8) + 0.5 * np.cos(0.4) ** 10,
        ),
    ],
)
def test_a_slope_is_lit_as_ours_are(light, elevation, expected):
    ramp = np.broadcast_to((10 * np.arange(16, dtype=np.uint8))[:, None], (16, 16, 16))
    camera = Orthographic(1, 1, 15.5, 15.5, orbit([7.5, 7.5, 7.5], 30, 0, elevation))
    seen = vtk(cube(ramp), WHITE, camera, {"height": 31, "width": 31}, light=light)[15, 15]
    assert seen[0] / seen[3] == pytest.approx(expected, abs=0.01)  # VTK encodes normals


@pytest.mark.sweep
def test_pixels_are_means_of_their_rays():
    camera = VIEWS["oblique"]
    fine = Camera.from_intrinsics(300, 300, 120, 90, camera.world_to_camera)
    rays = vtk(a_box(), WARM, fine, {"height": 180, "width": 240})
    means = rays.reshape(60, 3, 80, 3, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(vtk(a_box(), WARM, camera, rays=3), means, atol=1e-6)


def test_a_window_is_used_for_many_frames():
    single = vtk(a_box(), WARM, VIEWS["oblique"])
    window = VtkRenderer(a_box(), WARM, **SIZE)
    away = Camera.from_intrinsics(100, 100, 40, 30, look_at(beside(0, -60, 0), beside(0, -120, 0)))
    assert window.render(VIEWS["front"]).any()
    assert not window.render(away).any()  # and nothing is left of the frame before
    assert np.array_equal(window.render(VIEWS["oblique"]), single)


def test_whole_numbers_of_few_values_keep_steps_of_the_transfer_function():
    step = from_points([(0, (1, 1, 1), 0), (70, (1, 1, 1), 0), (71, (1, 1, 1), 0.5)])
    values = np.full((8, 8, 8), 70, np.uint8)
    values[0, 0, 0], values[4:, :, :] = 0, 71
    camera = Orthographic(2, 2, 8, 8, look_at([3.5, -30, 3.5], [3.5, 3.5, 3.5]))
    alpha = vtk(cube(values), step, camera, {"height": 16, "width": 16})[..., 3]
    assert alpha[:7, 8].max() > 0.9  # z is up
    assert alpha[10:, 8].max() == 0


# Input that is refused


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"step": 0}, "a sample distance of 0 voxels; it must be above 0"),
        ({"rays": 65}, "65 rays per side of a pixel; 1 to 64"),
        ({"threads": 0}, "0 threads; give 1 or more"),
    ],
)
def test_choices_outside_their_range_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        Peer(**wrong)


def test_volumes_that_vtk_would_draw_wrongly_are_refused():
    box = a_box()
    turned = box._replace(direction=np.diag([1.0, -1.0, 1.0]))
    with pytest.raises(ValueError, match="rotated or mirrored, which VTK's CPU ray caster ignores"):
        VtkRenderer(turned, WARM, **SIZE)
    unknown = box._replace(values=np.full((4, 4, 4), np.nan))
    with pytest.raises(ValueError, match="missing values, which VTK draws as opaque"):
        VtkRenderer(unknown, WARM, **SIZE)
    with pytest.raises(ValueError, match="VTK needs 2 voxels along each axis"):
        VtkRenderer(cube(np.zeros((4, 1, 4), np.uint8)), WARM, **SIZE)


def test_pixels_that_are_not_square_are_refused():
    with pytest.raises(ValueError, match="VTK's are square"):
        vtk(a_box(), WARM, Camera.from_intrinsics(100, 120, 40, 30, VIEWS["front"].world_to_camera))


@pytest.mark.parametrize(("height", "rays"), [(0, 1), (5000, 4)])
def test_windows_of_no_size_or_too_large_are_refused(height, rays):
    with pytest.raises(ValueError, match="both sides times the rays must be 1 to 16384"):
        VtkRenderer(a_box(), WARM, height=height, width=8, look=Peer(rays=rays))


def test_without_vtk_one_line_says_what_to_install(monkeypatch):
    load = builtins.__import__

    def without(name, *rest, **more):
        if name.startswith("vtkmodules"):
            raise ImportError("No module named 'vtkmodules'")
        return load(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ValueError, match=r"pip install 'hybrid-resample\[peers\]'"):
        VtkRenderer(a_box(), WARM, **SIZE)


@pytest.mark.parametrize("projection", [Projection.MAXIMUM, Projection.MINIMUM])
def test_extremes_have_the_colors_of_their_values(projection):
    values = np.full((8, 8, 8), 100, np.uint8)
    values[3], values[5] = 200, 40
    gray = from_points([(0, (0, 0, 0), 1), (255, (1, 1, 1), 1)])
    camera = Orthographic(4, 4, 20, 20, look_at([3.5, -30, 3.5], [3.5, 3.5, 3.5]))
    values = np.moveaxis(values, 0, 1)  # layers across the way of rays
    size = {"height": 40, "width": 40}
    picture = vtk(cube(values), gray, camera, size, projection=projection)
    value = 200 if projection is Projection.MAXIMUM else 40
    light = gray.colors(np.array([value]), (0, 255))[0, 0]
    assert picture[20, 20, 0] == pytest.approx(light, abs=0.01)


def test_projections_that_vtk_lacks_are_refused():
    with pytest.raises(ValueError, match="no projection average; it has composite, maximum, min"):
        Peer(projection=Projection.AVERAGE)
