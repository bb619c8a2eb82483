"""Orders that sum sheets of whole samples, and the order of samples by distance."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at, orbit
from resample.measuring.quality import psnr
from resample.painting.choices import Primitive
from resample.profiles.orders import EverySample, Summing, layers_of, sheets_of
from resample.profiles.reconstruction import GaussianKernel
from resample.types import Samples
from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from tests import naive
from tests.bits import assert_same
from tests.samples import painter, shuffled

SIDE = 18  # px
TURN = look_at((1, 2, 3), (0, 0, 0))[:3, :3]
LATTICES = {
    "even": np.eye(3),
    "stretched": np.diag([0.7, 1.0, 1.5]),
    "turned": TURN @ np.diag([0.7, 1, 1.4]),
    "sheared": np.array([[1, 0.3, 0.2], [0, 1.1, -0.3], [0, 0, 0.8]]),
    "mirrored": TURN @ np.diag([1, -1.2, 0.8]),
}
CAMERAS = {
    "near": Camera.from_fov(
        50.0, height=SIDE, width=SIDE, world_to_camera=look_at((6, -5, 4), (0, 0, 0))
    ),
    "behind": Camera.from_fov(
        50.0, height=SIDE, width=SIDE, world_to_camera=look_at((-5, 4, -7), (0, 0, 0))
    ),
    "inside": Camera.from_fov(
        80.0, height=SIDE, width=SIDE, world_to_camera=look_at((0.31, -0.23, 0.14), (3, 2, 4))
    ),
    "parallel": Orthographic(2.7, 3.1, 9.2, 8.9, look_at((6, -5, 4), (0, 0, 0)), near=-50.0),
    "parallel from behind": Orthographic(
        2.7, 3.1, 9.2, 8.9, look_at((-5, 4, -7), (0, 0, 0)), near=-50.0
    ),
}
ORDERS = [EverySample(), EverySample(key="distance"), AxisSheets(), ImageSheets(0.7)]


def lattice_block(rng, lattice, *, start=(0.0, 0.0, 0.0), side=4):
    """A block of samples of any color that begins anywhere between whole numbers."""
    index = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)
    place = (index - (side - 1) / 2 + np.asarray(start)) @ lattice.T
    return Samples(
        place.astype(np.float32),
        rng.uniform(0, 1, (len(place), 3)).astype(np.float32),
        rng.uniform(0, 1, len(place)).astype(np.float32),
        lattice,
    )


def draw(samples, camera, order, *, side=SIDE, **choices):
    choices = {"primitive": Primitive.SPLATS, **choices}
    return painter(order=order, **choices)(samples, camera, height=side, width=side)


# Sheets along an axis of the lattice.


@pytest.mark.parametrize("lattice", LATTICES.values(), ids=LATTICES)
@pytest.mark.parametrize("name", ["parallel", "parallel from behind"])
def test_sheets_along_the_nearest_axis_are_summed_and_composited(name, lattice, rng):
    """Where rays are parallel, ellipses of the paper are exact."""
    samples, camera = lattice_block(rng, lattice), CAMERAS[name]
    truth = naive.axis_sheets(samples, camera, GaussianKernel(), height=SIDE, width=SIDE)
    assert truth[..., 3].max() > 0.6
    drawn = draw(samples, camera, AxisSheets()).rgba
    np.testing.assert_allclose(drawn, truth, atol=3e-4)  # tables of 1024 steps


def test_every_layer_of_a_lattice_is_a_sheet_of_its_own():
    """Places in the lattice are rounded numbers: 15.000000000000002, and 32 without the rest."""
    spacing = float(np.float32(13) * np.float32(0.0173))
    place = np.zeros((40, 3), np.float32)
    place[:, 2] = np.arange(15, 55) * np.float32(spacing)
    for forward in (1.0, -1.0):
        pose = look_at((0, 0, 10 - 30 * forward), (0, 0, 10), (0, 1, 0))
        view = Orthographic(1.0, 1.0, 8.0, 8.0, pose).view()
        layers = layers_of(AxisSheets(), place, view, spacing * np.eye(3))
        sheets = sheets_of(layers, Summing.SHEETS, place, view)
        assert np.unique(sheets.sheet).size == 40
        assert np.unique(sheets.key).size == 40


def test_colors_of_a_sheet_do_not_bleed_into_one_another(record):
    """Two halves of a wall a voxel thick, red and green: a pixel's color is their mean."""
    place = np.stack(np.meshgrid(np.arange(-4.0, 4), [0.0], np.arange(-4.0, 4)), axis=-1)
    place = place.reshape(-1, 3) + np.array([0.5, 0.0, 0.5])
    color = np.where(place[:, :1] < 0, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    extinction = np.full(len(place), 40.0, np.float32)
    wall = Samples(place.astype(np.float32), color.astype(np.float32), extinction, np.eye(3))
    pose = look_at((3, -40, 0), (0, 0, 0))
    camera = Camera.from_intrinsics(160.0, 160.0, 9.0, 9.0, pose)
    sheets = draw(wall, camera, AxisSheets()).rgba[9, 8:10, :2]
    whole = draw(wall, camera, EverySample()).rgba[9, 8:10, :2]
    unfair = [float(np.abs(both.sum(axis=0) / 2 - 0.5).max()) for both in (sheets, whole)]
    record.error("unfairness", unfair[0])
    assert unfair[1] > 2 * unfair[0]


# Every sample, by distance.


def test_samples_are_ordered_by_depth_or_by_distance():
    """Off the axis the one with more depth may be nearer to the eye."""
    place = np.array([(4.0, 0.0, 4.0), (3.0, 0.0, 4.4)], np.float32)
    assert place[0, 2] < place[1, 2]
    assert np.linalg.norm(place[0]) > np.linalg.norm(place[1])
    samples = Samples(
        place, np.eye(3, dtype=np.float32)[:2], np.full(2, 3.0, np.float32), np.eye(3)
    )
    camera = Camera.from_intrinsics(10.0, 10.0, 9.0 - 7.0, 9.0)
    integral = naive.all_line_integrals(samples, camera, GaussianKernel(), height=SIDE, width=SIDE)
    alpha = 1 - np.exp(-3.0 * integral)
    for key, nearness in (("depth", place[:, 2]), ("distance", np.linalg.norm(place, axis=1))):
        truth = naive.composite(alpha, samples.color, nearness)
        drawn = draw(samples, camera, EverySample(key=key)).rgba
        np.testing.assert_allclose(drawn, truth, atol=1e-5)  # tables of 1024 steps


def test_distance_is_depth_where_rays_are_parallel(rng):
    samples = lattice_block(rng, LATTICES["turned"])
    first, second = (
        draw(samples, CAMERAS["parallel"], EverySample(key=key)) for key in ("depth", "distance")
    )
    assert first.rgba.tobytes() == second.rgba.tobytes()


def test_an_unknown_key_names_the_known_ones():
    with pytest.raises(ValueError, match="ordered by depth or distance, not by 'size'"):
        EverySample(key="size")


# Popping.


def checker(side=24, cell=6, alpha=0.3):
    """Box of voxels in cells of two colors."""
    z, y, x = np.indices((side, side, side)).reshape(3, -1)
    even = (x // cell + y // cell + z // cell) % 2 == 1
    color = np.where(even[:, None], [0.9, 0.2, 0.1], [0.1, 0.3, 0.9])
    position = np.stack([x, y, z], axis=1) - (side - 1) / 2
    extinction = np.full(x.size, -np.log1p(-alpha))
    return Samples(
        position.astype(np.float32),
        color.astype(np.float32),
        extinction.astype(np.float32),
        np.eye(3),
    )


def popping(order, azimuths, *, scale=1.5, elevation=0.0):
    """Second differences, rms over all pixels, of the frames of a rotation."""
    samples, side = checker(), int(44 * scale)
    frames = []
    for azimuth in azimuths:
        pose = orbit((0, 0, 0), 200, azimuth, elevation)
        camera = Camera.from_intrinsics(
            200 * scale, 200 * scale, side / 2 + 0.137, side / 2 + 0.21, pose
        )
        frames.append(draw(samples, camera, order, side=side).rgba)
    second = np.diff(np.array(frames), n=2, axis=0)
    return np.sqrt((second**2).mean(axis=(1, 2, 3)))


@pytest.fixture(scope="module")
def largest():
    """Largest second difference of every order while the box turns across 45 degrees."""
    azimuths = np.arange(44.5, 45.51, 0.1) + 0.02
    orders = [EverySample(), EverySample(key="distance"), AxisSheets(), ImageSheets()]
    found = {str(order): float(popping(order, azimuths, elevation=25).max()) for order in orders}
    sys.stdout.write(f"\nlargest second difference: {found}\n")
    return dict(zip(("depth", "distance", "axis", "image"), found.values(), strict=True))


@pytest.mark.sweep
@pytest.mark.slow
def test_axis_sheets_pop_at_45_degrees_and_slabs_do_not(largest):
    assert largest["axis"] > 200 * largest["image"]  # measured 500


@pytest.mark.sweep
@pytest.mark.slow
def test_every_sample_by_distance_hardly_pops(largest):
    assert largest["axis"] > 20 * largest["distance"]  # measured 50


@pytest.mark.slow
def test_every_sample_by_depth_pops_where_the_lattice_does(largest):
    """At 45 degrees all pairs of diagonal neighbours change places at once."""
    assert largest["axis"] > 5 * largest["depth"]  # measured 9
    assert largest["depth"] > 20 * largest["image"]


def block_shot(scale):
    side = int(60 * scale) + 6
    pose = orbit((0, 0, 0), 100, 30, 25)
    return Camera.from_intrinsics(
        100 * scale, 100 * scale, side / 2 + 0.137, side / 2 + 0.21, pose
    ), side


@pytest.mark.some(2)
@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.4, 0.125, 0.035])
@pytest.mark.parametrize("order", ORDERS[:2], ids=str)
def test_minified_hybrid_comes_near_supersampled_splats_of_the_same_order(order, scale, record):
    samples, (camera, side) = checker(alpha=0.5), block_shot(scale)
    truth = draw(samples, camera, order, side=side, subpixels=16).rgba
    seen = truth[..., 3] > 1e-4
    hybrid = draw(samples, camera, order, side=side, primitive=Primitive.HYBRID)
    plain = draw(samples, camera, order, side=side)
    quality = {
        "hybrid": psnr(hybrid.rgba, truth, mask=seen),
        "splats": psnr(plain.rgba, truth, mask=seen),
    }
    sys.stdout.write(f"\n{order}, {scale} px: {quality}\n")
    record.quality("hybrid", quality["hybrid"])
    assert quality["hybrid"] > quality["splats"]


# Bits.


@pytest.mark.each_value
@pytest.mark.parametrize("primitive", [Primitive.HYBRID, Primitive.SPLATS])
@pytest.mark.parametrize("camera", ["near", "inside", "parallel"])
@pytest.mark.parametrize("order", ORDERS[1:3], ids=str)
def test_neither_threads_nor_the_order_of_samples_change_a_bit(order, camera, primitive, rng):
    samples = lattice_block(rng, 0.5 * np.eye(3), side=7)
    other = shuffled(samples, rng)
    resample = painter(primitive=primitive, order=order)
    first = resample(samples, CAMERAS[camera], height=40, width=40, threads=1)
    second = resample(other, CAMERAS[camera], height=40, width=40, threads=2)
    assert_same(first, second)


@pytest.mark.parametrize("order", ORDERS, ids=str)
def test_sheets_are_those_of_the_scene_not_of_the_window(order, rng):
    """A part of the picture is what the whole shows there."""
    samples, camera = lattice_block(rng, LATTICES["turned"]), CAMERAS["near"]
    whole = draw(samples, camera, order).rgba
    shifted = camera.matrix - np.array([[0, 0, 5], [0, 0, 4], [0, 0, 0]])
    part = draw(samples, replace(camera, matrix=shifted), order, side=9).rgba
    np.testing.assert_allclose(part, whole[4:13, 5:14], atol=2e-5)  # float32 places on screen
