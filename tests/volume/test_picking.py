"""Which voxel a pixel shows, against a plain loop over all voxels, or along finely sampled rays."""

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from resample import Resampler
from resample.cameras.models import AnyCamera, Camera, Orthographic
from resample.cameras.poses import look_at, orbit
from resample.cameras.viewpoints import Orbit
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample_volume import Appearance, Scene
from resample_volume.classification.transfer import from_points
from resample_volume.rendering import Subject
from resample_volume.types import Volume
from resample_volume.voxels.visible import Voxels
from tests.volume.of_voxels import of_voxels

SIZE = (14, 11)  # px
LOOK = from_points(
    [(0.2, (1.0, 0.2, 0.1), 0.0), (0.6, (0.2, 0.8, 0.1), 0.3), (1.0, (0.1, 0.2, 1.0), 0.7)]
)


def cloud(spacing: tuple[float, float, float] = (1.0, 1.0, 1.0), turn: float = 0.0) -> Volume:
    z, y, x = np.indices((9, 10, 12))
    waves = np.sin(0.9 * x + 0.3 * z) * np.cos(0.7 * y - 0.2 * x) * np.sin(0.8 * z + 1)
    axes = np.array([[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0]])
    direction = np.vstack([axes, [0, 0, 1]])
    values = (0.5 + 0.5 * waves).astype(np.float32)
    return Volume(values, np.array(spacing), np.array([3.0, -2, 5]), direction, "cloud")


def cameras(volume: Volume) -> list[AnyCamera]:
    last = np.array(volume.values.shape[::-1]) - 1.0
    aim = np.asarray(volume.origin + volume.direction @ (volume.spacing * last) / 2)
    near = look_at(aim + np.array([14.3, -19.1, 7.7]), aim)
    above = orbit(aim, 40.0, 33, 62)
    return [Camera.from_fov(50, SIZE[1], SIZE[0], near), Orthographic(0.7, 0.7, 7.0, 5.5, above)]


def rays(camera: AnyCamera) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    """Place at depth 0 and step per depth of each pixel's center, scene units."""
    view, found = camera.view(), []
    for row, column in product(range(SIZE[1]), range(SIZE[0])):
        there = (np.array([column + 0.5, row + 0.5]) - view.principal) / view.focal
        start, ahead = (0 * there, there) if view.perspective else (there, 0 * there)
        eye = view.rotation.T @ (np.append(start, 0.0) - view.translation)
        found.append((eye, view.rotation.T @ np.append(ahead, 1.0)))
    return found


def naive_voxel(
    subject: Subject, volume: Volume, ray: tuple[NDArray[Any], NDArray[Any]], camera: AnyCamera
) -> tuple[int, ...]:
    """Voxel of a loop over all of them, with integrals by many small steps."""
    voxels, kernel = subject.voxels, Resampler().reconstruction
    assert isinstance(voxels, Voxels)
    view, (eye, along) = camera.view(), ray
    to_lattice = np.linalg.inv(volume.direction * volume.spacing)
    step = to_lattice @ along
    steps = np.linspace(-1, 1, 4001)
    radii = np.linspace(0, kernel.radius, 4001)
    mass = np.trapezoid(4 * np.pi * radii**2 * kernel(radii), radii)
    met = []
    positions = voxels.position + subject.middle
    indices = (positions - volume.origin) @ to_lattice.T
    to_eyes = to_lattice @ (eye - volume.origin) - indices
    along_ray = -(to_eyes @ step) / (step @ step)
    distances = np.sum((to_eyes + along_ray[:, None] * step) ** 2, axis=1)
    for n in np.flatnonzero(distances < kernel.radius**2):
        position, index, extinction = positions[n], indices[n], voxels.extinction[n]
        nearest, squared = along_ray[n], float(distances[n])
        if view.perspective and nearest < 0:
            continue
        half = math.sqrt(kernel.radius**2 - squared)
        integral = np.trapezoid(kernel(np.sqrt(squared + (half * steps) ** 2)), half * steps)
        per = np.linalg.norm(along) / np.linalg.norm(step)
        depth = view.rotation[2] @ position + view.translation[2]
        z, y, x = np.rint(index[::-1]).astype(int)
        met.append((round(depth, 9), (z, y, x), extinction * per * integral / mass))
    kept = 1.0
    for _, place, thickness in sorted(met):
        kept *= math.exp(-thickness)
        if 1 - kept > 0.5:
            return place
    return (-1, -1, -1)


@pytest.mark.sweep
@pytest.mark.parametrize("which", [0, 1], ids=["perspective", "parallel"])
@pytest.mark.parametrize(
    "volume", [cloud(), cloud((0.7, 1.1, 2.4), 0.5)], ids=["cubes", "bricks, turned"]
)
def test_samples_are_those_of_a_loop_over_all_voxels(volume: Volume, which: int) -> None:
    camera = cameras(volume)[which]
    found = Scene(volume).sample_ids(of_voxels(LOOK), camera, size=SIZE).reshape(-1, 3)
    subject = Subject.of(volume, of_voxels(LOOK))
    truth = [naive_voxel(subject, volume, ray, camera) for ray in rays(camera)]
    assert 0.1 < np.mean(found[:, 0] >= 0) < 0.95
    np.testing.assert_array_equal(found, truth)


def naive_place(
    volume: Volume, ray: tuple[NDArray[Any], NDArray[Any]], projection: Projection
) -> tuple[int, ...]:
    """Voxel by SciPy's spline in steps of a quarter of a voxel."""
    to_lattice = np.linalg.inv(volume.direction * volume.spacing)
    start, step = to_lattice @ (ray[0] - volume.origin), to_lattice @ ray[1]
    size = np.array(volume.values.shape[::-1])
    with np.errstate(divide="ignore"):
        ends = np.sort([(-0.5 - start) / step, (size - 0.5 - start) / step], axis=0)
    first, last = max(ends[0].max(), 0), ends[1].min()
    if first >= last:
        return (-1, -1, -1)
    length = 0.25 / np.linalg.norm(step)
    depth = first + (np.arange(math.ceil((last - first) / length)) + 0.5) * length
    place = start + np.minimum(depth, last)[:, None] * step
    value = map_coordinates(volume.values, place[:, ::-1].T, order=3, mode="reflect")
    if projection is Projection.COMPOSITE:
        opacity = np.minimum(np.interp(value, LOOK.value, LOOK.opacity), 1 - 1e-6)
        unit = np.cbrt(np.prod(volume.spacing))
        thickness = -np.log1p(-opacity) / unit * length * np.linalg.norm(ray[1])
        past = np.flatnonzero(1 - np.exp(-np.cumsum(thickness)) > 0.5)
    elif projection is Projection.FIRST_HIT:
        past = np.flatnonzero(value >= 0.7)
    else:
        past = np.array([value.argmax() if projection is Projection.MAXIMUM else value.argmin()])
    if not past.size:
        return (-1, -1, -1)
    return tuple(np.clip(np.floor(place[past[0]] + 0.5).astype(int), 0, size - 1)[::-1])


@pytest.mark.sweep
@pytest.mark.parametrize("projection", ["composite", "maximum", "minimum", "first-hit"])
@pytest.mark.parametrize("which", [0, 1], ids=["perspective", "parallel"])
def test_samples_of_a_field_are_those_of_fine_steps(projection: str, which: int) -> None:
    volume, wanted = cloud((0.7, 1.1, 2.4), 0.5), Projection(projection)
    camera = cameras(volume)[which]
    paint = Resampler(
        order=Rays(), projection=wanted, iso=0.7 if wanted is Projection.FIRST_HIT else None
    )
    look = Appearance(LOOK, classification="post")  # type: ignore[arg-type]
    found = Scene(volume).sample_ids(look, camera, size=SIZE, resampler=paint).reshape(-1, 3)
    truth = np.array([naive_place(volume, ray, wanted) for ray in rays(camera)])
    assert np.mean(found[:, 0] >= 0) > 0.15
    # Where the level is met between two voxels, or two maxima are alike, rounding decides.
    assert np.mean((found == truth).all(axis=1)) > 0.97
    away = np.abs(found - truth).max(axis=1)
    assert (away[wanted not in (Projection.MAXIMUM, Projection.MINIMUM) and slice(None)] <= 1).all()


def test_what_is_picked_is_seen() -> None:
    values = np.zeros((20, 24, 28), np.uint8)
    values[12:16, 8:14, 5:11] = 200
    values[:, :, 20] = 90  # that the look does not show
    volume = Volume(values, np.array([0.5, 0.5, 1.0]), np.array([100.0, 0, -50]), np.eye(3), "box")
    solid = from_points([(120.0, (1.0, 1.0, 1.0), 0.0), (160.0, (1.0, 1.0, 1.0), 0.9)])
    scene, look = Scene(volume), Appearance(solid)
    for camera in ((90, 10), (30, 20), Orbit(-90, 0, fov=0)):
        ids = scene.sample_ids(look, camera, size=(60, 50))
        shown = ids[ids[..., 0] >= 0]
        assert len(shown) > 20
        assert (values[tuple(shown.T)] == 200).all()
        row, column = np.argwhere(ids[..., 0] >= 0)[len(shown) // 2]
        picked = scene.pick(column + 0.5, row + 0.5, look, camera, size=(60, 50))
        assert picked is not None
        assert picked.voxel == tuple(ids[row, column])
        assert picked.value == 200
        expected = volume.origin + volume.spacing * picked.voxel[::-1]
        np.testing.assert_allclose(picked.position, expected)
    assert scene.pick(0.5, 0.5, look, size=(60, 50)) is None


@pytest.mark.sweep
def test_faint_things_can_be_picked_and_cuts_are_kept() -> None:
    values = np.zeros((24, 24, 24), np.float32)
    values[6:18, 6:18, 6:18] = 1.0
    faint = from_points([(0.5, (1.0, 1.0, 1.0), 0.0), (0.6, (1.0, 1.0, 1.0), 0.005)])
    scene, look = Scene(values), Appearance(faint)
    assert (scene.sample_ids(look, "front", size=(40, 40)) == -1).all()
    whole = scene.pick(20.5, 20.5, look, "front", size=(40, 40))
    assert whole is not None
    assert 10 <= whole.voxel[1] <= 13
    for classification in ("pre", "post"):
        cut = Appearance("gray", clip=("0/1/0",), classification=classification)  # type: ignore[arg-type]
        seen = scene.pick(20.5, 20.5, cut, "front", size=(40, 40))
        assert seen is not None
        assert 11 <= seen.voxel[1] <= 14


def test_means_have_no_one_voxel() -> None:
    mean = Resampler(order=Rays(), projection=Projection.AVERAGE)
    with pytest.raises(ValueError, match="shows no single voxel; take composite, maximum"):
        Scene(cloud()).sample_ids(size=(4, 4), resampler=mean)
