"""Projections of a field: maximum, average, sum and first hit, against a loop and formulas."""

import math
import sys

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.painting.choices import (
    MEASURING,
    OF_RAYS,
    SUMS,
    Footprint,
    Primitive,
    Projection,
    footprints_of,
)
from resample.profiles.orders import EverySample
from resample.profiles.reconstruction import GaussianKernel, variance
from resample.resampler import Resampler
from resample.types import Classifier, Field, Lamp, Samples
from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from tests import naive
from tests.samples import CAMERAS, DARK, HIGH, LOW, POSE, SIDE, field_block, field_cloud, painter

OF_SLABS = [one for one in Projection if one not in OF_RAYS]
SUMMED = [one for one in MEASURING if one not in OF_RAYS]


def gray(low=LOW, high=HIGH, lamp=DARK):
    """Classifier that shows values as opaque gray, from black at `low` to white at `high`."""
    table = np.float32([[[0, 0, 0, 50], [1, 1, 1, 50]]])
    return Classifier(table, low, high, 1.0, lamp, 0.0, 1.0, 0.0)


def cloud(rng):
    """A field of samples anywhere in a cube, shown in gray."""
    return field_cloud(rng, gray())


def draw(field, camera, projection, thickness=1.0, *, side=SIDE, clip=None, **choices):
    choices = {"primitive": Primitive.SPLATS, "order": ImageSheets(thickness), **choices}
    resample = painter(projection=projection, **choices)
    return resample(field, camera, height=side, width=side, clip=clip)


def sums(field, camera):
    """Line integrals of the density and of values above low, (H, W) each."""
    integral = naive.all_line_integrals(field, camera, GaussianKernel(), height=SIDE, width=SIDE)
    return integral.sum(axis=0), np.einsum("nhw,n->hw", integral, field.value.astype(float))


# Maximum, average, sum.


@pytest.mark.sweep
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("thickness", [0.5, 1.0])
def test_the_maximum_is_the_largest_mean_of_a_slab(camera, thickness, rng):
    field = cloud(rng)
    truth = np.full((SIDE, SIDE), -np.inf)
    for slab in naive.field_slabs(
        field, camera, GaussianKernel(), thickness, height=SIDE, width=SIDE
    ):
        truth = np.where(slab.density > 0, np.maximum(truth, slab.value), truth)
    value = draw(field, camera, Projection.MAXIMUM, thickness).value
    seen = np.isfinite(value)
    np.testing.assert_array_equal(seen, np.isfinite(truth))
    # Means are quotients of differences in a table of 256 × 256 steps.
    np.testing.assert_allclose(value[seen], truth[seen], atol=5e-3 * (HIGH - LOW))


@pytest.mark.some(1)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_the_average_is_the_integral_of_values_over_that_of_the_density(camera, rng):
    field = cloud(rng)
    density, total = sums(field, camera)
    value = draw(field, camera, Projection.AVERAGE).value
    clear = density > 0.01
    np.testing.assert_allclose(value[clear], (total / density.clip(1e-9))[clear], atol=2e-3)
    assert np.isnan(value[density == 0]).all()


@pytest.mark.some(1)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_the_sum_is_the_integral_of_the_values(camera, rng):
    field = cloud(rng)
    _, total = sums(field, camera)
    # Where rays are parallel, splats are scaled to their mass: by about 1e-2 at 3 px per voxel.
    atol = 0.05 if camera is CAMERAS["parallel"] else 3e-4
    value = draw(field, camera, Projection.ADDITIVE).value
    np.testing.assert_allclose(np.nan_to_num(value), total, atol=atol)


@pytest.mark.parametrize("scale", [4.0, 1.0, 0.45, 0.2, 0.06])
@pytest.mark.parametrize(
    "primitive",
    [
        Primitive.HYBRID,
        # Of fields, points have the painter of slabs compiled once more.
        pytest.param(Primitive.POINTS, marks=pytest.mark.sweep),
    ],
)
def test_an_x_ray_conserves_mass(scale, primitive, rng):
    lattice = look_at((1, 2, 3), (0, 0, 0))[:3, :3] @ np.diag([0.7, 1, -1.3])
    field = field_block(lambda place: rng.uniform(LOW, HIGH, len(place)), gray(), 7, lattice)
    side = int(24 * scale) + 8
    camera = Orthographic(scale, 1.3 * scale, side / 2 + 0.2, side / 2 - 0.1, POSE)
    if primitive is Primitive.POINTS and scale > 1:
        pytest.skip("points are for samples closer than a pixel")
    value = draw(field, camera, Projection.ADDITIVE, side=side, primitive=primitive).value
    mass = field.value.astype(float).sum() * abs(np.linalg.det(lattice))
    assert np.nansum(value.astype(float)) / (1.3 * scale**2) == pytest.approx(mass, rel=1e-6)


@pytest.mark.some(1)
@pytest.mark.parametrize("projection", SUMMED)
@pytest.mark.parametrize("scale", [0.4, 0.15])
def test_a_minified_projection_comes_near_its_supersampled_splats(projection, scale, record):
    field = field_block(lambda place: 1 + 2 * np.sin(place @ [0.7, 0.4, 0.3]), gray(), 21)
    camera = Camera.from_intrinsics(
        60 * scale, 60 * scale, 8.13, 8.21, look_at((45, -33, 20), (0, 0, 0))
    )
    truth = draw(field, camera, projection, subpixels=8)
    hybrid = draw(field, camera, projection, primitive=Primitive.HYBRID)
    inside = truth.rgba[..., 3] > 0.99
    assert inside.sum() > 5
    error = np.abs(hybrid.value - truth.value)[inside]
    record.error("largest", error.max())


@pytest.mark.parametrize("projection", [Projection.MAXIMUM, Projection.AVERAGE])
@pytest.mark.parametrize("scale", [3.0, 0.3])
def test_the_value_is_not_a_number_just_where_nothing_is(projection, scale):
    field = field_block(lambda _: 1.0, gray(), 5)
    camera = Orthographic(scale, scale, 20.2, 19.9, POSE)
    frame = draw(field, camera, projection, side=40, primitive=Primitive.HYBRID)
    np.testing.assert_array_equal(np.isfinite(frame.value), frame.coverage > 0)
    assert not frame.rgba[frame.coverage == 0].any()
    assert np.isnan(frame.value[0, 0])


@pytest.mark.parametrize("scale", [3.0, 0.3])
def test_the_sum_is_0_where_nothing_is_and_its_picture_opaque(scale):
    field = field_block(lambda _: 1.0, gray(), 5)
    camera = Orthographic(scale, scale, 20.2, 19.9, POSE)
    frame = draw(field, camera, Projection.ADDITIVE, side=40, primitive=Primitive.HYBRID)
    assert not frame.value[frame.coverage == 0].any()
    assert (frame.value[frame.coverage > 0] > 0).all()
    assert (frame.rgba[..., 3] == 1).all()


@pytest.mark.parametrize("projection", SUMMED)
def test_a_field_without_samples_has_no_value_anywhere(projection):
    nothing = np.zeros((0, 3), np.float32)
    field = Field(nothing, np.zeros(0, np.float32), nothing, np.eye(3), gray())
    frame = draw(field, CAMERAS["narrow"], projection)
    assert frame.value is not None
    assert frame.value.shape == (SIDE, SIDE)
    nothing = 0.0 if projection in SUMS else np.nan
    np.testing.assert_array_equal(frame.value, nothing)


@pytest.mark.parametrize("projection", [Projection.COMPOSITE, Projection.FIRST_HIT])
def test_light_has_no_value(projection, rng):
    iso = 1.0 if projection is Projection.FIRST_HIT else None
    assert draw(cloud(rng), CAMERAS["narrow"], projection, iso=iso).value is None


@pytest.mark.parametrize("projection", SUMMED)
def test_a_constant_field_measures_that_constant(projection):
    field = field_block(lambda _: 2.0, gray())
    camera = Orthographic(2.0, 2.0, 8.0, 8.0, look_at((0, -20, 0), (0, 0, 0)))
    frame = draw(field, camera, projection, 0.5)
    expected = 2.0 * (9 if projection in SUMS else 1)
    assert frame.value[6:10, 6:10] == pytest.approx(expected, rel=0.005)  # ripple of sums
    if projection not in SUMS:
        gray_level = (2.0 - LOW) / (HIGH - LOW)
        np.testing.assert_allclose(frame.rgba[6:10, 6:10, :3], gray_level, atol=1e-3)
        np.testing.assert_allclose(frame.rgba[6:10, 6:10, 3], 1.0, atol=1e-6)


@pytest.mark.parametrize("projection", [Projection.MAXIMUM, Projection.AVERAGE])
@pytest.mark.parametrize("spacing", [0.5, 2.0])
def test_what_is_measured_is_as_opaque_as_a_voxel_of_it(projection, spacing):
    look = gray()._replace(table=np.float32([[[0, 0, 0, 0.7], [1, 1, 1, 0.7]]]))
    field = field_block(lambda _: 2.0, look, lattice=spacing * np.eye(3))
    pose = look_at((0, -40, 0), (0, 0, 0))
    camera = Orthographic(2.0 / spacing, 2.0 / spacing, 8.0, 8.0, pose)
    alpha = draw(field, camera, projection).rgba[6:10, 6:10, 3]
    np.testing.assert_allclose(alpha, 1 - np.exp(-0.7 * spacing), atol=1e-5)


@pytest.mark.parametrize("projection", OF_SLABS)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_planes_that_remove_nothing_change_no_projection(projection, camera, rng):
    iso = 1.0 if projection is Projection.FIRST_HIT else None
    field = cloud(rng)
    box = [(*axis, 9.0) for sign in (-1, 1) for axis in sign * np.eye(3)]
    whole, clipped = (draw(field, camera, projection, iso=iso, clip=clip) for clip in (None, box))
    np.testing.assert_array_equal(whole.rgba, clipped.rgba)
    if whole.value is not None:
        np.testing.assert_array_equal(whole.value, clipped.value)


@pytest.mark.parametrize("projection", [Projection.AVERAGE, Projection.ADDITIVE])
def test_sums_end_at_clipping_planes(projection, rng):
    field, camera, planes = cloud(rng), CAMERAS["narrow"], [(0.3, 0.8, -0.2, 0.1)]
    between = naive.kept_by(camera, planes, height=SIDE, width=SIDE)
    integral = naive.all_line_integrals(
        field, camera, GaussianKernel(), height=SIDE, width=SIDE, between=between
    )
    density = integral.sum(axis=0)
    truth = np.einsum("nhw,n->hw", integral, field.value.astype(float))
    if projection is Projection.AVERAGE:
        truth = truth / density.clip(1e-9)
    value = draw(field, camera, projection, clip=planes).value
    clear = density > 0.01
    assert clear.sum() > 40
    np.testing.assert_allclose(value[clear], truth[clear], atol=5e-3)  # quotients, as above


# First hit.


def hit(field, camera, iso, thickness=0.5, **choices):
    return draw(field, camera, Projection.FIRST_HIT, thickness, iso=iso, **choices)


@pytest.mark.parametrize("thickness", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("iso", [-1.7, 0.0, 1.43])
def test_a_ramp_is_hit_where_it_has_the_value(iso, thickness):
    """Linear fields stay linear under any kernel but for its ripple."""
    field = field_block(lambda place: place[:, 1], gray(-20.0, 20.0), 11)
    camera = Orthographic(2.0, 2.0, 8.0, 8.0, look_at((0, -20, 0), (0, 0, 0)))
    depth = hit(field, camera, iso, thickness).depth[6:10, 6:10]
    sys.stdout.write(f"\nramp, slabs of {thickness}: {np.abs(depth - 20 - iso).max():.4f} voxels\n")
    np.testing.assert_allclose(depth, 20 + iso, atol=0.02)  # ripple of 0.76 % per voxel


@pytest.mark.parametrize("camera", ["parallel", "perspective"])
def test_a_sphere_is_hit_on_its_surface(camera, record):
    """Any kernel lowers a paraboloid by the same everywhere: three of its variances."""
    radius, side = 5.0, 24
    field = field_block(lambda place: -(place**2).sum(axis=1), gray(-400.0, 0.0), 17)
    pose = look_at((11, -13, 9), (0, 0, 0))
    shot = Orthographic(1.6, 1.6, 12.0, 12.0, pose, near=-50)
    if camera == "perspective":
        shot = Camera.from_fov(36.0, height=side, width=side, world_to_camera=pose)
    iso = -(radius**2) - 3 * variance(GaussianKernel())
    frame = hit(field, shot, iso, 0.5, side=side)
    origin, direction = naive.rays(shot, side, side)
    origin = origin - naive.in_camera(shot, np.zeros((1, 3)))[0]
    a, b = (direction**2).sum(axis=-1), (origin * direction).sum(axis=-1)
    root = b**2 - a * ((origin**2).sum(axis=-1) - radius**2)
    inside = root > a * 3.0  # not where the ray grazes the sphere
    assert inside.sum() > 80
    exact = (-b - np.sqrt(root.clip(0))) / a
    error = np.abs(frame.depth - exact)[inside]
    sys.stdout.write(f"\nsphere, {camera}: largest {error.max():.4f}, mean {error.mean():.4f}\n")
    record.error("largest depth", error.max())  # ripple of 0.76 % and chords of half a voxel
    record.error("mean depth", error.mean())
    assert (frame.rgba[inside][:, 3] == 1).all()
    assert not frame.rgba[root < -3.0 * a].any()


def test_a_clipping_plane_caps_what_lies_inside_at_the_plane():
    field = field_block(lambda place: -(place**2).sum(axis=1), gray(-400.0, 0.0), 17)
    camera = Orthographic(1.6, 1.6, 8.0, 8.0, look_at((0, -20, 0), (0, 0, 0)))
    plane = (0.0, 1.0, 0.0, 1.3)  # y of at least -1.3, a depth of 18.7
    frame = hit(field, camera, -25.0, clip=[plane])
    x, z = (np.mgrid[0:SIDE, 0:SIDE] + 0.5 - 8) / 1.6
    cap = x**2 + z**2 < 20
    np.testing.assert_allclose(frame.depth[cap], 18.7, atol=1e-5)
    np.testing.assert_allclose(frame.first_depth[cap], 18.7, atol=1e-5)


def test_a_hit_is_lit_at_its_gradient():
    """Facing the viewer it is bright, askew it is darker: the cosine, with a light at the eye."""
    lamp = Lamp(np.zeros(3), np.array([0.0, -1, 0, 0]), 0.0, 1.0, 0.0, 1.0, 0.01)
    look = Classifier(np.ones((1, 2, 4), np.float32), -400.0, 0.0, 1.0, lamp, 0.0, 1.0, 0.0)
    field = field_block(lambda place: -(place**2).sum(axis=1), look, 17)
    field = field._replace(gradient=-2 * field.position)
    camera = Orthographic(1.6, 1.6, 8.0, 8.0, look_at((0, -20, 0), (0, 0, 0)))
    frame = hit(field, camera, -36.0 - 3 * variance(GaussianKernel()))
    x, z = (np.mgrid[0:SIDE, 0:SIDE] + 0.5 - 8) / 1.6
    inside = x**2 + z**2 < 25
    cosine = np.sqrt((36 - x**2 - z**2).clip(0)) / 6
    np.testing.assert_allclose(frame.rgba[inside][:, 0], cosine[inside], atol=0.01)


def test_a_value_that_is_nowhere_is_not_hit(rng):
    for iso in (HIGH + 5, LOW):
        assert not hit(cloud(rng), CAMERAS["narrow"], iso).rgba.any()


def test_a_hollow_in_front_of_a_surface_is_looked_through():
    """Between two layers of samples there is nothing: the second is hit only beside the first."""
    field = field_block(lambda _: 1.0, gray(0.0, 1.0), 11)
    kept = (abs(field.position[:, 1]) > 3) & (
        (field.position[:, 1] > 0) | (field.position[:, 0] > 0)
    )
    field = field._replace(position=field.position[kept], value=field.value[kept])
    camera = Orthographic(1.5, 1.5, 8.0, 8.0, look_at((0, -20, 0), (0, 0, 0)))
    depth = hit(field, camera, 0.5).depth[8]
    # A density of 1 / 4 gives half the value, that much before the layers' first samples.
    assert depth[11] == pytest.approx(15 - 0.75, abs=0.25)
    assert depth[4] == pytest.approx(24 - 0.75, abs=0.25)


# What is refused.


@pytest.mark.parametrize("projection", [*Projection][1:])
def test_a_projection_needs_slabs_or_rays(projection):
    for order in (EverySample(), AxisSheets()):
        with pytest.raises(ValueError, match="needs the order rays or image-sheets"):
            Resampler(projection=projection, iso=0.5, order=order)


@pytest.mark.parametrize("projection", SUMMED)
def test_a_projection_needs_a_field(projection, rng):
    field = cloud(rng)
    samples = Samples(field.position, field.gradient, np.ones(40, np.float32), np.eye(3))
    with pytest.raises(ValueError, match="needs a field"):
        draw(samples, CAMERAS["narrow"], projection)


def test_slabs_have_no_minimum():
    with pytest.raises(ValueError, match="the projection minimum needs the order rays, not Image"):
        Resampler(projection=Projection.MINIMUM, order=ImageSheets())


@pytest.mark.parametrize("iso", [None, math.nan, math.inf])
def test_a_first_hit_needs_a_finite_value(iso):
    with pytest.raises(ValueError, match="iso value"):
        Resampler(projection=Projection.FIRST_HIT, order=ImageSheets(), iso=iso)


def test_an_iso_value_is_for_first_hits():
    with pytest.raises(ValueError, match="no other projection has one"):
        Resampler(projection=Projection.MAXIMUM, order=ImageSheets(), iso=1.0)


@pytest.mark.parametrize(
    "footprint",
    [
        pytest.param(
            footprint,
            marks=pytest.mark.sweep
            if footprint is not Footprint.EXACT  # for which the painter is compiled once more
            else (),
        )
        for footprint in footprints_of(Primitive.SPLATS)
    ],
)
@pytest.mark.parametrize("projection", OF_SLABS)
def test_every_footprint_goes_with_every_projection(footprint, projection, rng):
    iso = 1.0 if projection is Projection.FIRST_HIT else None
    field, camera = cloud(rng), CAMERAS["narrow"]
    exact = draw(field, camera, projection, iso=iso)
    frame = draw(field, camera, projection, iso=iso, footprint=footprint)
    assert np.isfinite(frame.rgba).all()
    np.testing.assert_allclose(frame.rgba.mean(), exact.rgba.mean(), rtol=0.1)
