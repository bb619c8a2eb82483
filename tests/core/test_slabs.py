"""Image-sheets: slabs parallel to the screen, against kernels cut by quadrature."""

import math
import sys

import numpy as np
import pytest
from scipy.special import erf

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.painting.choices import Footprint, Opacity, Primitive, footprints_of
from resample.profiles.orders import EverySample
from resample.profiles.reconstruction import (
    BSplineKernel,
    GaussianKernel,
    footprint_table,
    partial_table,
)
from resample.types import Samples
from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from tests import naive
from tests.bits import assert_same
from tests.samples import POSE, block, cloud, painter, shuffled

SIDE = 18  # px
CAMERAS = {
    "narrow": Camera.from_fov(35.0, height=SIDE, width=SIDE, world_to_camera=POSE),
    "wide": Camera.from_fov(
        110.0, height=SIDE, width=SIDE, world_to_camera=look_at((2.6, -3, 2), (0, 0, 0))
    ),
    "inside": Camera.from_fov(
        90.0, height=SIDE, width=SIDE, world_to_camera=look_at((0.3, -0.2, 0.1), (3, 2, 1))
    ),
    "near plane": Camera.from_fov(35.0, height=SIDE, width=SIDE, world_to_camera=POSE, near=8.6),
    "parallel": Orthographic(2.7, 3.1, 9.2, 8.9, POSE, near=-50.0),
    "parallel from inside": Orthographic(2.7, 3.1, 9.2, 8.9, POSE, near=8.6),
}
turn = np.radians(35)
TURN = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
LATTICES = {
    "even": np.eye(3),
    "stretched": np.diag([0.7, 1.0, 1.5]),
    "turned": look_at((1, 2, 3), (0, 0, 0))[:3, :3] @ np.diag([0.7, 1, 1.4]),
    "sheared": np.array([[1, 0.4, 0.2], [0, 1.1, -0.3], [0, 0, 0.8]]),
    "mirrored": TURN @ np.diag([1, -1.2, 0.8]),
}


def draw(samples, camera, thickness=1.0, *, side=SIDE, **choices):
    choices = {"primitive": Primitive.SPLATS, "order": ImageSheets(thickness), **choices}
    return painter(**choices)(samples, camera, height=side, width=side)


def by_hand(samples, camera, thickness=1.0, reconstruction=None):
    kernel = reconstruction or GaussianKernel()
    return naive.image_sheets(samples, camera, kernel, thickness, height=SIDE, width=SIDE)


# The table.


def test_the_partial_table_of_a_gaussian_is_a_difference_of_error_functions():
    """The Gaussian is lowered by its rim, which takes a constant off every length."""
    kernel = GaussianKernel()
    table = partial_table(kernel).astype(float)
    squared = np.linspace(0, 1, table.shape[0])[:, None]
    half = np.sqrt(1 - squared)
    place = np.clip(np.linspace(-1, 1, table.shape[1]), -half, half)
    width = kernel.sigma / kernel.radius
    scale = width * math.sqrt(math.pi / 2) * np.exp(-squared / (2 * width**2))
    gaussian = scale * (erf(place / (width * math.sqrt(2))) + erf(half / (width * math.sqrt(2))))
    rim = math.exp(-0.5 / width**2)
    mass = naive.kernel_mass(kernel) / kernel.radius**3
    exact = (gaussian - rim * (place + half)) / mass
    np.testing.assert_allclose(table, exact, atol=2e-6 * exact.max())  # a kink inside a step


@pytest.mark.parametrize("kernel", [GaussianKernel(), BSplineKernel(), GaussianKernel(0.9, 3.0)])
def test_the_partial_table_ends_with_the_whole_footprint(kernel):
    whole = footprint_table(kernel).values[::4].astype(float)
    last = partial_table(kernel)[:, -1]
    np.testing.assert_allclose(last, whole, atol=3e-6 * whole.max())  # a kink inside a step


def test_the_partial_table_of_a_b_spline_is_its_integral():
    kernel = BSplineKernel()
    table = partial_table(kernel).astype(float)
    for row, column in [(0, 40), (0, 128), (13, 100), (64, 200), (150, 130), (250, 140)]:
        squared, end = row / 256, column / 128 - 1
        place = np.linspace(-1, end, 20001)
        density = kernel(np.sqrt(squared + place**2) * kernel.radius)
        exact = np.trapezoid(density, place) * kernel.radius**3 / naive.kernel_mass(kernel)
        assert table[row, column] == pytest.approx(exact, abs=1e-6 * table.max())


# Pictures.


@pytest.mark.sweep
@pytest.mark.parametrize("lattice", LATTICES.values(), ids=LATTICES)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_slabs_hold_what_quadrature_finds_between_their_planes(camera, lattice, rng):
    samples = cloud(rng, lattice=lattice)
    truth = by_hand(samples, camera)
    assert truth[..., 3].max() > 0.3
    # Table of 256 × 256 steps (2e-5 of the peak, for which colors may change hands), and opaque
    # from 1e-4 on.
    np.testing.assert_allclose(draw(samples, camera).rgba, truth, atol=1e-4)


@pytest.mark.sweep
@pytest.mark.parametrize("thickness", [0.3, 2.0, 1000.0])
@pytest.mark.parametrize("camera", ["narrow", "inside", "parallel"])
def test_slabs_may_be_of_any_thickness(camera, thickness, rng):
    samples = cloud(rng)
    truth = by_hand(samples, CAMERAS[camera], thickness)
    drawn = draw(samples, CAMERAS[camera], thickness).rgba
    np.testing.assert_allclose(drawn, truth, atol=1e-4)  # as above


@pytest.mark.sweep
def test_slabs_hold_what_quadrature_finds_of_a_b_spline(rng):
    samples, kernel = cloud(rng), BSplineKernel()
    truth = by_hand(samples, CAMERAS["narrow"], reconstruction=kernel)
    drawn = draw(samples, CAMERAS["narrow"], reconstruction=kernel).rgba
    np.testing.assert_allclose(drawn, truth, atol=1e-4)  # as above


# A model that finds rays nearer to the center than they are makes chords longer than they are, and
# their ends lie in no slab. Otherwise: table of 256 × 256 steps.
LOST = {Footprint.CORRECTED: 1e-3, Footprint.SMALL_ANGLE: 1e-2}


@pytest.mark.some(1)
@pytest.mark.parametrize("footprint", footprints_of(Primitive.SPLATS))
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_the_whole_transmittance_is_that_of_every_sample(camera, footprint, rng):
    samples = cloud(rng)
    whole = draw(samples, camera, order=EverySample(), footprint=footprint).rgba[..., 3]
    for order in (AxisSheets(), ImageSheets(0.2), ImageSheets(1.0), ImageSheets(7.0)):
        parts = draw(samples, camera, order=order, footprint=footprint).rgba[..., 3]
        np.testing.assert_allclose(parts, whole, atol=LOST.get(footprint, 5e-5))


def test_one_color_stays_that_color_whatever_the_slabs(rng):
    samples = cloud(rng)._replace(color=np.tile(np.float32([0.8, 0.3, 0.1]), (30, 1)))
    rgba = draw(samples, CAMERAS["narrow"], 0.4).rgba
    np.testing.assert_allclose(rgba[..., :3], rgba[..., 3:] * [0.8, 0.3, 0.1], atol=1e-6)


@pytest.mark.sweep
def test_slabs_add_up_classic_opacities_too(rng):
    """α F summed over the parts of a slab."""
    samples, camera = cloud(rng, 12), CAMERAS["narrow"]
    alpha = 1 - np.exp(-samples.extinction.astype(float))
    truth = np.ones((SIDE, SIDE))
    for slab in naive.slabs(samples, camera, GaussianKernel(), 1.0, height=SIDE, width=SIDE):
        truth *= 1 - np.minimum(np.einsum("nhw,n->hw", slab.integral, alpha), 1.0)
    drawn = draw(samples, camera, opacity=Opacity.LINEAR).rgba[..., 3]
    np.testing.assert_allclose(1 - drawn, truth, atol=1e-4)  # opaque from 1e-4 on


def errors_of_thickness(rng, thickness):
    """RMS difference from the light of the continuous field, for every thickness."""
    samples, camera = cloud(rng, 24, extinction=3.0), CAMERAS["narrow"]
    truth = naive.ray_integral(samples, camera, GaussianKernel(), 1500, height=SIDE, width=SIDE)
    assert truth[..., 3].max() > 0.9
    pictures = [draw(samples, camera, t).rgba for t in thickness]
    return [float(np.sqrt(np.mean((picture - truth)[..., :3] ** 2))) for picture in pictures]


@pytest.mark.sweep
@pytest.mark.slow
def test_thinner_slabs_come_nearer_to_the_ray_integral_by_the_square(rng, record):
    thickness = [2.0, 1.0, 0.5, 0.25, 0.125]
    error = errors_of_thickness(rng, thickness)
    sys.stdout.write(f"\nthickness {thickness}: rms {[f'{e:.2e}' for e in error]}\n")
    order = np.log2(np.array(error[:-1]) / error[1:])
    assert (order[:3] > 1.5).all()
    record.error("thinnest", error[-1])


@pytest.mark.sweep
def test_every_sample_is_farther_from_the_ray_integral_than_slabs(rng):
    samples, camera = cloud(rng, 24, extinction=3.0), CAMERAS["narrow"]
    truth = naive.ray_integral(samples, camera, GaussianKernel(), 300, height=SIDE, width=SIDE)
    error = [
        np.sqrt(np.mean((draw(samples, camera, order=order).rgba - truth) ** 2))
        for order in (EverySample(), ImageSheets(1.0))
    ]
    sys.stdout.write(f"\nrms of every-sample {error[0]:.2e}, of slabs {error[1]:.2e}\n")
    assert error[1] < 0.5 * error[0]


# Depth and coverage.


@pytest.mark.sweep
def test_depth_is_the_mean_depth_of_the_samples_seen(rng):
    samples, camera = cloud(rng), CAMERAS["narrow"]
    place = naive.in_camera(camera, samples.position)[:, 2].astype(np.float32)
    in_depth = samples._replace(color=np.repeat(place[:, None], 3, axis=1))
    truth = by_hand(in_depth, camera)
    frame = draw(samples, camera)
    seen = truth[..., 3] > 0.02
    np.testing.assert_allclose(
        frame.depth[seen], truth[seen][:, 0] / truth[seen][:, 3], rtol=2e-4
    )  # table of 256 × 256 steps


@pytest.mark.parametrize("thickness", [0.25, 1.0, 3.0])
def test_coverage_is_one_inside_a_block_and_never_more(thickness):
    frame = draw(block(extinction=0.01), CAMERAS["narrow"], thickness)
    assert frame.coverage.max() <= 1.0
    assert frame.coverage[8:10, 8:10].min() == pytest.approx(1.0, abs=1e-6)


# Points.


def far(scale, azimuth_axis=(0, -1, 0)):
    """Parallel camera with `scale` px per scene unit."""
    pose = look_at(40 * np.asarray(azimuth_axis, float), (0, 0, 0))
    return Orthographic(scale, scale, 8.13, 8.21, pose)


def test_a_sure_point_lies_wholly_in_the_slab_of_its_center():
    """Two points in one slab share the light by area; in two slabs the nearer one hides."""
    camera = far(0.1)
    color = np.eye(3, dtype=np.float32)[:2]
    extinction = np.full(2, 50.0, np.float32)

    def pair(depths):
        # The camera stands at y = -40 and looks along +y; a depth of 40 lies at y = 0.
        place = np.array([(0.0, depth - 40.0, 0.0) for depth in depths], np.float32)
        return draw(
            Samples(place, color, extinction, np.eye(3)),
            camera,
            side=16,
            primitive=Primitive.POINTS,
        )

    together, apart = pair([40.1, 40.9]), pair([40.9, 41.1])
    shared = together.rgba.sum(axis=(0, 1))
    assert shared[0] == pytest.approx(shared[1], rel=1e-5)
    split = apart.rgba.sum(axis=(0, 1))
    assert split[0] > 1.001 * split[1]


@pytest.mark.some(1)
@pytest.mark.parametrize("thickness", [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("scale", [0.3, 0.15])
def test_points_in_slabs_have_the_transmittance_of_the_block(scale, thickness):
    """Seen along the lattice, where a slab holds a whole layer of voxels or none."""
    samples, through = block(21, extinction=0.05), 21 * 0.05
    frame = draw(samples, far(scale), thickness, side=16, primitive=Primitive.POINTS)
    middle = 1 - frame.rgba[7:9, 7:9, 3].mean()
    assert middle == pytest.approx(np.exp(-through), rel=0.02)  # ripple, and slabs half full


@pytest.mark.parametrize("azimuth", [0, 30])
def test_dense_points_in_slabs_of_a_voxel_have_the_transmittance_of_the_block(azimuth):
    wide = block(21, extinction=0.6)
    samples = Samples(*(array[abs(wide.position[:, 1]) < 2] for array in wide[:3]), np.eye(3))
    around = np.radians(azimuth)
    camera = far(0.3, (np.sin(around), -np.cos(around), 0))
    frame = draw(samples, camera, side=16, primitive=Primitive.POINTS)
    middle = 1 - frame.rgba[7:9, 7:9, 3].mean()
    through = 3 * 0.6 / np.cos(around)
    # Opacities of layers that lie askew are summed where they share a slab.
    assert middle == pytest.approx(np.exp(-through), rel=0.12 if azimuth else 0.01)


# Bits.


@pytest.mark.some(2)
@pytest.mark.parametrize("primitive", [form for form in Primitive if form is not Primitive.PAPER])
@pytest.mark.parametrize("camera", ["narrow", "inside", "parallel"])
def test_neither_threads_nor_the_order_of_samples_change_a_bit(camera, primitive, rng):
    samples = cloud(rng, 300, lattice=0.5 * np.eye(3))
    other = shuffled(samples, rng)
    resample = painter(primitive=primitive, order=ImageSheets(0.7))
    first = resample(samples, CAMERAS[camera], height=40, width=40, threads=1)
    second = resample(other, CAMERAS[camera], height=40, width=40, threads=2)
    assert_same(first, second)


@pytest.mark.parametrize("thickness", [0.0, -1.0, math.nan, math.inf])
def test_a_slab_must_have_a_thickness(thickness):
    with pytest.raises(ValueError, match="thickness must be above 0 voxels, not"):
        ImageSheets(thickness)


@pytest.mark.parametrize("order", [EverySample(), AxisSheets(), ImageSheets()])
def test_splats_have_their_marking_color_in_every_order(order):
    red = (1.0, 0.0, 0.0)
    rgba = draw(block(3), CAMERAS["narrow"], order=order, splat_color=red).rgba
    assert rgba[..., 0].max() > 0.1
    assert not rgba[..., 1:3].any()
