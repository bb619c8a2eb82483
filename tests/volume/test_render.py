import subprocess
import sys

import numpy as np
import pytest

import resample
import resample_volume
from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.cameras.viewpoints import Orbit
from resample.painting.choices import Primitive
from resample.resampler import Resampler
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.classification.presets import PRESETS, load_transfer
from resample_volume.classification.transfer import from_points
from resample_volume.files.generated import checker_box, vessel_tree
from resample_volume.inputs import as_volume
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light

SIZE = {"height": 48, "width": 48}
SQUARE = (48, 48)
BIG = (96, 96)
TREE = vessel_tree(24)
LIT = Appearance(load_transfer("gray"))
PLAIN = Appearance(load_transfer("gray"), light=None)
PRIMITIVES = list(Primitive)


def picture(*arguments, primitive=Primitive.HYBRID, size=SQUARE):
    return render(*arguments, resampler=Resampler(primitive), size=size)


# As a library


def test_arrays_go_in_and_arrays_come_out():
    from resample import Resampler
    from resample_volume import Appearance, Light, Orbit, render

    z, y, x = np.mgrid[-1:1:24j, -1:1:24j, -1:1:24j]
    ball = np.clip(12 * (0.8 - np.sqrt(x**2 + y**2 + z**2)), 0, 1)
    frame = render(
        ball,
        Appearance("bone", light=Light(specular=0.4)),
        Orbit(azimuth=30, elevation=20, zoom=1.2),
        size=(60, 40),
        resampler=Resampler(),
    )
    assert frame.rgba.shape == (40, 60, 4)
    assert frame.depth.shape == frame.first_depth.shape == frame.coverage.shape == (40, 60)
    assert frame.rgba.dtype == frame.depth.dtype == np.float32
    assert frame.rgba[20, 30, 3] > 0.99
    assert frame.rgba[0, 0].tolist() == [0, 0, 0, 0]
    assert np.isinf(frame.depth[0, 0])
    assert frame.statistics.points + frame.statistics.splats == frame.statistics.samples


@pytest.mark.parametrize("package", [resample, resample_volume])
def test_every_name_can_be_imported(package):
    for name in package.__all__:
        assert getattr(package, name).__name__.removesuffix("_volume") == name.removesuffix(
            "_volume"
        )
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        package.nonsense  # noqa: B018


@pytest.mark.parametrize("package", ["resample", "resample_volume"])
def test_importing_a_package_is_quick(package):
    code = f"import sys, {package}; print(*sys.modules)"
    imported = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert {"numpy", "numba", "cv2", "pydantic", "cyclopts"} & set(imported) == set()


@pytest.mark.sweep
def test_rendering_loads_no_forms_of_files_that_are_not_read():
    code = "import sys, resample_volume.rendering; print(*sys.modules)"
    imported = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    unused = {
        "pydantic",
        "numba",
        "resample.files.animations",
        "resample_volume.classification.files",
    }
    assert unused & set(imported) == set()


def test_a_name_stands_for_a_transfer_function_and_nothing_for_the_defaults():
    by_default = render(TREE, camera=(30, 20), resampler=Resampler(), size=SQUARE)
    assert np.array_equal(by_default.rgba, picture(TREE, Appearance(), Orbit()).rgba)
    by_name = picture(TREE, "vessels").rgba
    assert np.array_equal(by_name, picture(TREE, Appearance(load_transfer("vessels"))).rgba)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_renders(name):
    values = np.linspace(0, 255, 12**3, dtype=np.uint8).reshape(12, 12, 12)
    frame = picture(as_volume(values), name)
    assert np.isfinite(frame.rgba).all()
    assert frame.rgba[..., 3].max() > 0.02


@pytest.mark.parametrize("shape", [(4, 4), (4,), (4, 4, 4, 2), (0, 4, 4), (0, 4, 4, 3)])
def test_what_is_no_volume_is_refused(shape):
    with pytest.raises(ValueError, match=r"a volume is an array \(Z, Y, X\) with voxels in it"):
        render(np.zeros(shape), size=SQUARE)


def test_a_size_that_is_none_is_refused():
    with pytest.raises(ValueError, match="both sides must be at least 1"):
        render(TREE, camera=Camera.from_intrinsics(9, 9, 5, 5), size=(10, 0))


def test_progress_is_told_to_the_end_and_may_stop_the_work():
    shares = []
    render(TREE, progress=shares.append, size=SQUARE)
    assert shares[-1] == 1
    assert shares == sorted(shares)

    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(TREE, progress=stop, size=SQUARE)


# Values that are missing


def half_missing(missing):
    values = TREE.values.astype(np.float32)
    values[:, :, 12:] = missing
    return TREE._replace(values=values)


def look_from(azimuth, center=(11.5, 11.5, 11.5), distance=70.0):
    a = np.radians(azimuth)
    eye = np.array(center) + distance * np.array([np.sin(a), -np.cos(a), 0.3])
    return Camera.from_fov(30, **SIZE, world_to_camera=look_at(eye, center))


DATA_UNITS = from_points([(0, (0, 0, 0), 0), (255, (1, 0.5, 0.2), 0.6)])


@pytest.mark.parametrize("primitive", PRIMITIVES)
def test_missing_values_are_transparent_and_do_not_bleed(primitive):
    look = Appearance(DATA_UNITS, light=None)
    camera = look_from(30)
    absent = picture(half_missing(np.nan), look, camera, primitive=primitive).rgba
    zero = picture(half_missing(0), look, camera, primitive=primitive).rgba
    assert absent[..., 3].max() > 0.1
    assert np.array_equal(absent, zero)


@pytest.mark.parametrize("gradient", ["central", "sobel"])
def test_missing_values_are_no_neighbours_to_the_light(gradient):
    look = Appearance(DATA_UNITS, gradient=gradient)
    cut = TREE._replace(values=np.ascontiguousarray(half_missing(0).values[:, :, :12]))
    camera = look_from(30)
    absent, alone = (picture(volume, look, camera).rgba for volume in (half_missing(np.nan), cut))
    assert np.array_equal(absent, alone)


# Where voxels lie in the scene


@pytest.mark.each_value
@pytest.mark.parametrize("primitive", PRIMITIVES)
@pytest.mark.parametrize("look", [LIT, PLAIN])
def test_a_turned_volume_looks_the_same_to_a_camera_turned_with_it(primitive, look, rng):
    volume = TREE._replace(spacing=np.array([1, 1.2, 0.8]), origin=np.array([3.0, -5.0, 2.0]))
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation = q * np.sign(np.linalg.det(q))
    camera = look_from(30, (14.5, 7.5, 11.5))
    pose = camera.world_to_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ rotation.T
    moved = Camera.from_intrinsics(camera.fx, camera.fy, camera.cx, camera.cy, pose)
    straight = picture(volume, look, camera, primitive=primitive).rgba
    other = picture(
        volume._replace(
            direction=rotation @ volume.direction, origin=rotation @ np.asarray(volume.origin)
        ),
        look,
        moved,
        primitive=primitive,
    ).rgba
    assert straight[..., 3].max() > 0.3
    assert np.sqrt(np.mean((straight - other) ** 2)) < 1e-4  # float32 positions
    assert np.abs(straight - other).max() < 2e-2  # a pair of samples may change its order


@pytest.mark.each_value
@pytest.mark.parametrize("primitive", PRIMITIVES)
@pytest.mark.parametrize("look", [LIT, PLAIN])
def test_a_mirrored_volume_gives_the_mirrored_picture(primitive, look):
    mirrored = TREE._replace(direction=np.diag([-1.0, 1.0, 1.0]))
    there = picture(TREE, look, Orbit(30, 20), primitive=primitive).rgba
    back = picture(mirrored, look, Orbit(-30, 20), primitive=primitive).rgba
    assert np.abs(there - there[:, ::-1]).max() > 0.1
    assert np.sqrt(np.mean((there - back[:, ::-1]) ** 2)) < 1e-4
    assert np.abs(there - back[:, ::-1]).max() < 2e-2


def test_x_goes_right_and_z_goes_up():
    values = np.zeros((9, 9, 9), np.uint8)
    values[4, 4, 0] = values[0, 4, 4] = 1  # hardly seen; keep the middle in the middle
    values[4, 4, 8] = values[8, 4, 4] = 255
    alpha = picture(as_volume(values), PLAIN, Orbit(0, 0, fov=0)).rgba[..., 3]
    ends = np.argwhere(alpha > 0.7 * alpha.max())
    assert ends[:, 1].max() > 34  # +x
    assert ends[:, 0].min() < 14  # +z
    assert ends[:, 1].min() > 14
    assert ends[:, 0].max() < 34


def test_the_origin_moves_the_volume_and_an_orbit_follows():
    moved = TREE._replace(origin=np.array([100.0, -40.0, 7.0]))
    assert np.abs(picture(TREE, LIT).rgba - picture(moved, LIT).rgba).max() < 2e-2
    assert not picture(moved, LIT, look_from(0)).rgba.any()


def ball(spacing, radius=20.0):
    """A ball of a radius in scene units, sampled on a lattice of that spacing."""
    reach = [np.arange(-np.ceil(radius / step) - 2, np.ceil(radius / step) + 3) for step in spacing]
    x, y, z = (axis * step for axis, step in zip(reach, spacing, strict=True))
    distance = np.sqrt(x**2 + y[:, None] ** 2 + z[:, None, None] ** 2)
    values = np.clip(radius + 0.5 - distance, 0, 1).astype(np.float32)
    origin = np.array([x[0], y[0], z[0]])
    return Volume(values, np.array(spacing, float), origin, np.eye(3), "ball")


GLASS = Appearance(from_points([(0, (1, 1, 1), 0), (1, (1, 1, 1), 0.001)]), light=None)


@pytest.mark.each_value
@pytest.mark.parametrize("spacing", [(1, 1, 1.4), (1.58, 1, 1)])
@pytest.mark.parametrize("primitive", [Primitive.HYBRID, Primitive.POINTS, Primitive.SPLATS])
@pytest.mark.parametrize("direction", [(0, -1, 0), (1, 0, 0), (0, 0, 1), (1, -2, 1.5)])
def test_a_ball_is_round_whatever_the_spacing(spacing, primitive, direction):
    eye = 100 * np.array(direction) / np.linalg.norm(direction)
    camera = Orthographic(1.5, 1.5, 48, 48, look_at(eye, (0, 0, 0)))
    frame = picture(ball(spacing), GLASS, camera, primitive=primitive, size=BIG)
    alpha = frame.rgba[..., 3].astype(np.float64)
    row, column = np.indices(alpha.shape) + 0.5
    offset = np.stack([row - 48, column - 48])
    covariance = np.einsum("ahw,bhw,hw->ab", offset, offset, alpha) / alpha.sum()
    smallest, largest = np.sqrt(np.linalg.eigvalsh(covariance))
    assert largest / smallest < 1.01
    assert np.sqrt(5 * smallest * largest) == pytest.approx(1.5 * 20, rel=0.02)


# From where


@pytest.mark.sweep
@pytest.mark.parametrize("primitive", PRIMITIVES)
def test_a_camera_within_or_beside_the_volume_sees_something_finite(primitive):
    box = as_volume(np.full((8, 8, 8), 1, np.uint8))
    look = Appearance(from_points([(0, (1, 1, 1), 0.3)]), light=None)
    for eye in ((3.5, 3.5, 3.5), (3.5, -0.5, 3.5), (3.0, 3.0, 3.0)):
        camera = Camera.from_fov(90, **SIZE, world_to_camera=look_at(eye, (3.5, 9.0, 3.6)))
        frame = picture(box, look, camera, primitive=primitive)
        assert np.isfinite(frame.rgba).all()
        # The paper has no splats of voxels whose tangents meet the plane of the eye.
        assert frame.rgba[24, 24, 3] > (0.2 if primitive is Primitive.PAPER else 0.5)
        assert frame.rgba[..., 3].max() <= 1 + 1e-6


@pytest.mark.parametrize("primitive", PRIMITIVES)
def test_a_camera_that_looks_away_sees_nothing(primitive):
    camera = Camera.from_fov(30, **SIZE, world_to_camera=look_at((11, -90, 11), (11, -100, 11)))
    frame = picture(TREE, LIT, camera, primitive=primitive)
    assert not frame.rgba.any()
    assert np.isinf(frame.depth).all()


def test_an_invisible_volume_is_an_empty_picture():
    with pytest.warns(UserWarning, match="is visible: .* hides all of its values, 0 to "):
        frame = render(TREE, Appearance(from_points([(0, (1, 1, 1), 0)])), size=SQUARE)
    assert not frame.rgba.any()
    assert frame.statistics.rays == 0


def test_parallel_and_perspective_light_agree_from_afar(record):
    near_parallel = picture(TREE, LIT, Orbit(fov=0.5)).rgba
    parallel = picture(TREE, LIT, Orbit(fov=0)).rgba
    record.error("largest", np.abs(near_parallel - parallel).max())
    record.error("rms", np.sqrt(np.mean((near_parallel - parallel) ** 2)))


def test_light_reaches_the_surfaces_that_face_it():
    opaque = from_points([(0.4, (1, 1, 1), 0), (0.6, (1, 1, 1), 1)])
    volume = ball((1, 1, 1), 10.0)
    middle, sides = (24, 24), ([24, 24], [12, 35])
    for direction, brighter in ((None, middle), ((1.0, 0.0, 0.0), sides)):
        look = Appearance(opaque, Light(direction, specular=0))
        green = picture(volume, look, Orbit(0, 0)).rgba[..., 1]
        darker = sides if brighter is middle else middle
        assert green[brighter].min() > 1.1 * green[darker].max()


def test_a_volume_far_from_the_origin_looks_as_it_does_near_it():
    """At 5,000,000 m, float32 positions of voxels 0.5 m apart would coincide."""
    near = checker_box(16)._replace(spacing=np.full(3, 0.5))
    far = near._replace(origin=np.array([5e6, -4e6, 3e3]))
    here, there = (render(volume, "checker", size=(32, 32)) for volume in (near, far))
    np.testing.assert_allclose(there.rgba, here.rgba, atol=1e-4)  # the middle is float64 at 5e6
    eye, target = np.array([-20.0, -20, 12]), np.array([4.0, 4, 4])
    here, there = (
        render(
            volume,
            "checker",
            Camera.from_intrinsics(
                40, 40, 16, 16, look_at(volume.origin + eye, volume.origin + target)
            ),
            size=(32, 32),
        )
        for volume in (near, far)
    )
    assert there.rgba[..., 3].max() > 0.9
    np.testing.assert_allclose(there.rgba, here.rgba, atol=1e-4)
