"""Fields classified after their reconstruction, against a loop over slabs."""

import math

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.painting.choices import Primitive, Projection
from resample.profiles.orders import EverySample
from resample.profiles.reconstruction import GaussianKernel
from resample.resampler import Resampler
from resample.types import Classifier, Lamp, Samples
from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from tests import naive
from tests.bits import ARRAYS, assert_same
from tests.samples import CAMERAS as SEEN
from tests.samples import DARK, HIGH, LOW, POSE, SIDE, field_block, field_cloud, painter, shuffled

CAMERAS = {
    **SEEN,
    "near plane": Camera.from_fov(40.0, height=SIDE, width=SIDE, world_to_camera=POSE, near=8.6),
}
LATTICES = {
    "even": np.eye(3),
    "mirrored": look_at((1, 2, 3), (0, 0, 0))[:3, :3] @ np.diag([1, -1.2, 0.8]),
}
LAMPS = {
    "none": DARK,
    "far away": Lamp(np.array([0.6, 0.0, 0.8]), np.array([6.0, -5, 4, 1]), 0.2, 0.7, 0.3, 8.0, 0.1),
    "at the viewer": Lamp(np.zeros(3), np.array([6.0, -5, 4, 1]), 0.2, 0.7, 0.3, 8.0, 0.1),
}


def classifier(rng, rows=1, columns=8, lamp=DARK, **depth_cue):
    """Random colors and extinctions of values from -1 to 3, for gradients up to 2."""
    table = rng.uniform(0, 1, (rows, columns, 4)).astype(np.float32)
    cue = {"near": 0.0, "far": 1.0, "dimmed": 0.0, **depth_cue}
    return Classifier(table, LOW, HIGH, 2.0, lamp, **cue)


def draw(field, camera, thickness=1.0, *, side=SIDE, **choices):
    choices = {"primitive": Primitive.SPLATS, "order": ImageSheets(thickness), **choices}
    return painter(**choices)(field, camera, height=side, width=side)


def looked_up(look, value, slope):
    """Color and extinction (H, W, 4) between the table's entries."""
    rows, columns = look.table.shape[:2]
    row = np.clip(slope / look.steep, 0, 1) * (rows - 1)
    column = np.clip((value - look.low) / (look.high - look.low), 0, 1) * (columns - 1)
    r, c = np.minimum(row.astype(int), rows - 1), np.minimum(column.astype(int), columns - 1)
    r1, c1 = np.minimum(r + 1, rows - 1), np.minimum(c + 1, columns - 1)
    down, right = (row - r)[..., None], (column - c)[..., None]
    table = look.table.astype(float)
    upper = (1 - right) * table[r, c] + right * table[r, c1]
    lower = (1 - right) * table[r1, c] + right * table[r1, c1]
    return (1 - down) * upper + down * lower


def unit(v):
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0, length, 1)


def lit(color, slope, place, lamp):
    """Blinn and Phong, both sides alike."""
    eye = unit(lamp.viewer[:3] - lamp.viewer[3] * place)
    light = eye if not lamp.toward.any() else np.broadcast_to(lamp.toward, eye.shape)
    normal, halfway = unit(slope), unit(eye + light)
    own = lamp.ambient + lamp.diffuse * np.abs((normal * light).sum(axis=-1))
    shine = lamp.specular * np.abs((normal * halfway).sum(axis=-1)) ** lamp.shininess
    flat = np.linalg.norm(slope, axis=-1) <= lamp.flat
    own = np.where(flat, lamp.ambient + lamp.diffuse, own)
    return own[..., None] * color + np.where(flat, 0, shine)[..., None]


def by_hand(field, camera, thickness=1.0):
    look, view = field.classifier, camera.view()
    origin, direction = naive.rays(camera, SIDE, SIDE)
    picture = np.zeros((SIDE, SIDE, 4))
    for slab in naive.field_slabs(
        field, camera, GaussianKernel(), thickness, height=SIDE, width=SIDE
    ):
        found = looked_up(look, slab.mean, np.linalg.norm(slab.gradient, axis=-1))
        place = origin + slab.middle[..., None] * direction
        place = (place - view.translation) @ view.rotation
        light = lit(found[..., :3], slab.gradient, place, look.lamp)
        far = np.clip((slab.middle - look.near) / (look.far - look.near), 0, 1)
        light *= (1 - look.dimmed * far)[..., None]
        naive.put_behind(picture, 1 - np.exp(-found[..., 3] * slab.density), light)
    return picture


# Against the loop.


@pytest.mark.sweep
@pytest.mark.parametrize("lattice", LATTICES.values(), ids=LATTICES)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_slabs_are_classified_by_their_mean_value(camera, lattice, rng):
    field = field_cloud(rng, classifier(rng), lattice=lattice)
    truth = by_hand(field, camera)
    assert truth[..., 3].max() > 0.4
    # Table of 256 × 256 steps of which means are quotients; float32.
    np.testing.assert_allclose(draw(field, camera).rgba, truth, atol=2e-4)


@pytest.mark.sweep
@pytest.mark.parametrize("thickness", [0.3, 2.0])
def test_slabs_of_any_thickness_are_classified(thickness, rng):
    field, camera = field_cloud(rng, classifier(rng)), CAMERAS["narrow"]
    truth = by_hand(field, camera, thickness)
    np.testing.assert_allclose(draw(field, camera, thickness).rgba, truth, atol=5e-4)


@pytest.mark.sweep
def test_a_second_dimension_of_the_table_is_the_gradient(rng):
    field, camera = field_cloud(rng, classifier(rng, rows=5)), CAMERAS["narrow"]
    truth = by_hand(field, camera)
    flat = by_hand(field._replace(gradient=0 * field.gradient), camera)
    assert np.abs(truth - flat).max() > 0.05
    np.testing.assert_allclose(draw(field, camera).rgba, truth, atol=3e-4)


@pytest.mark.sweep
@pytest.mark.parametrize("lamp", LAMPS.values(), ids=LAMPS)
@pytest.mark.parametrize("camera", ["narrow", "parallel"])
def test_slabs_are_lit_at_their_mean_gradient(camera, lamp, rng):
    field, camera = field_cloud(rng, classifier(rng, lamp=lamp)), CAMERAS[camera]
    truth = by_hand(field, camera)
    np.testing.assert_allclose(draw(field, camera).rgba, truth, atol=4e-4)


@pytest.mark.sweep
def test_depth_cueing_dims_by_depth(rng):
    field = field_cloud(rng, classifier(rng, near=7.5, far=9.5, dimmed=0.8))
    camera = CAMERAS["narrow"]
    truth = by_hand(field, camera)
    plain = by_hand(field._replace(classifier=field.classifier._replace(dimmed=0.0)), camera)
    assert truth[..., :3].sum() < 0.9 * plain[..., :3].sum()
    np.testing.assert_allclose(draw(field, camera).rgba, truth, atol=2e-4)


@pytest.mark.sweep
def test_a_field_without_gradients_is_one_of_zero_gradients(rng):
    field, camera = field_cloud(rng, classifier(rng, lamp=LAMPS["far away"])), CAMERAS["narrow"]
    without = draw(field._replace(gradient=np.zeros((0, 3), np.float32)), camera)
    zero = draw(field._replace(gradient=np.zeros((40, 3), np.float32)), camera)
    assert without.rgba.tobytes() == zero.rgba.tobytes()


# What it is for.


def test_a_constant_field_has_one_color_and_its_transmittance():
    table = np.zeros((1, 9, 4), np.float32)
    table[0, 4:] = (0.8, 0.3, 0.1, 0.2)  # black below, of which nothing is to be seen
    look = Classifier(table, 0.0, 1.0, 1.0, DARK, 0.0, 1.0, 0.0)
    field = field_block(lambda _: 0.75, look)
    camera = Orthographic(2.0, 2.0, 8.0, 8.0, look_at((0, -20, 0), (0, 0, 0)))
    rgba = draw(field, camera, 0.5).rgba[6:10, 6:10]
    np.testing.assert_allclose(rgba[..., :3], rgba[..., 3:] * [0.8, 0.3, 0.1], rtol=1e-4)
    depth = -np.log(1 - rgba[..., 3].astype(float))
    assert depth == pytest.approx(9 * 0.2, rel=0.01)  # the kernels' ripple


def mixed(rgba):
    """Pixels of a row that are neither red nor blue."""
    color = rgba[..., :3] / rgba[..., 3:]
    return int((np.minimum(color[..., 0], color[..., 2]) > 0.05).sum())


def test_two_materials_keep_their_colors_after_reconstruction_and_mix_before():
    table = np.zeros((1, 256, 4), np.float32)
    table[0, :128, 0], table[0, 128:, 2], table[0, :, 3] = 1.0, 1.0, 4.0
    look = Classifier(table, 0.0, 1.0, 1.0, DARK, 0.0, 1.0, 0.0)
    field = field_block(lambda place: np.where(place[:, 0] < 0, 0.2, 0.8), look)
    before = Samples(
        field.position,
        np.where(field.position[:, :1] < 0, (1, 0, 0), (0, 0, 1)).astype(np.float32),
        np.full(len(field.value), 4.0, np.float32),
        np.eye(3),
    )
    # From the middle of the block on: values also fall where it ends.
    pose = look_at((-0.5, -20, 0), (-0.5, 0, 0))
    camera = Orthographic(8.0, 8.0, 8.1, 8.0, pose, near=20.0)
    post, pre = draw(field, camera, 0.5).rgba[8], draw(before, camera).rgba[8]
    assert mixed(post) <= 1
    assert mixed(pre) >= 6


def test_values_beyond_the_table_look_like_its_ends():
    table = np.float32([[[1, 0, 0, 1], [0, 0, 1, 1]]])
    look = Classifier(table, 0.0, 1.0, 1.0, DARK, 0.0, 1.0, 0.0)
    camera = CAMERAS["narrow"]
    high = draw(field_block(lambda _: 50.0, look), camera).rgba[8, 8]
    np.testing.assert_allclose(high[:3], high[3] * np.array([0, 0, 1]), atol=0.02)
    low = draw(field_block(lambda _: -50.0, look), camera).rgba[8, 8]
    np.testing.assert_allclose(low[:3], low[3] * np.array([1, 0, 0]), atol=1e-6)


# Of fields, points have the painter of slabs compiled once more.
POINTS = "test_a_minified_field_comes_near_its_supersampled_splats"
WIDER = "tests/core/test_slabs.py::test_neither_threads_nor_the_order_of_samples_change_a_bit"


@pytest.mark.sweep
@pytest.mark.parametrize("scale", [0.4, 0.15, pytest.param(0.035, marks=pytest.mark.sweep)])
def test_a_minified_field_comes_near_its_supersampled_splats(scale, rng, record):
    look = classifier(rng, columns=4)
    field = field_block(lambda place: 1 + 2 * np.sin(place @ [0.7, 0.4, 0.3]), look, 21)
    camera = Camera.from_intrinsics(
        60 * scale, 60 * scale, 8.13, 8.21, look_at((45, -33, 20), (0, 0, 0))
    )
    truth = draw(field, camera, subpixels=16).rgba
    hybrid = draw(field, camera, primitive=Primitive.HYBRID)
    assert (hybrid.statistics.points > 0) == (scale < 0.0375)
    error = np.sqrt(np.mean((hybrid.rgba - truth)[truth[..., 3] > 1e-4] ** 2))
    plain = np.sqrt(np.mean((draw(field, camera).rgba - truth)[truth[..., 3] > 1e-4] ** 2))
    record.error("rms", error)
    assert error < 0.25 * plain


@pytest.mark.some(1)
@pytest.mark.parametrize("projection", [one for one in Projection if one != Projection.MINIMUM])
@pytest.mark.parametrize(
    "primitive",
    [
        Primitive.HYBRID,
        Primitive.SPLATS,
        pytest.param(Primitive.EWA, marks=pytest.mark.sweep),
    ],
)
def test_neither_threads_nor_the_order_of_samples_change_a_bit(projection, primitive, rng):
    field = field_cloud(rng, classifier(rng, rows=3, lamp=LAMPS["far away"]), 150, 0.5 * np.eye(3))
    other = shuffled(field, rng)
    resample = Resampler(
        primitive=primitive,
        order=ImageSheets(0.7),
        projection=projection,
        iso=1.0 if projection is Projection.FIRST_HIT else None,
    )
    for camera in (
        CAMERAS["narrow"],
        CAMERAS["inside"],
        Camera.from_intrinsics(3.0, 3.0, 20, 20, POSE),
    ):
        first = resample(field, camera, height=24, width=24, threads=1)
        second = resample(other, camera, height=24, width=24, threads=2)
        assert_same(first, second, (*ARRAYS, "value"))


# What is refused.


@pytest.mark.parametrize("order", [EverySample(), AxisSheets()])
def test_an_order_that_composites_colors_refuses_a_field(order, rng):
    field = field_cloud(rng, classifier(rng))
    with pytest.raises(ValueError, match="image-sheets can"):
        draw(field, CAMERAS["narrow"], order=order)


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_values_must_be_finite(wrong, rng):
    field = field_cloud(rng, classifier(rng))
    value = field.value.copy()
    value[3] = wrong
    with pytest.raises(ValueError, match="value is not finite; leave such samples out"):
        draw(field._replace(value=value), CAMERAS["narrow"])


def test_gradients_must_be_finite(rng):
    field = field_cloud(rng, classifier(rng))
    gradient = field.gradient.copy()
    gradient[3, 1] = np.nan
    with pytest.raises(ValueError, match="gradient is not finite"):
        draw(field._replace(gradient=gradient), CAMERAS["narrow"])


@pytest.mark.parametrize(
    "wrong",
    [
        {"value": np.zeros(39, np.float32)},
        {"value": np.zeros((40, 1), np.float32)},
        {"gradient": np.zeros((39, 3), np.float32)},
        {"position": np.zeros((40, 2), np.float32)},
    ],
    ids=lambda wrong: "".join(f"{name} {array.shape}" for name, array in wrong.items()),
)
def test_arrays_of_a_field_must_fit_together(wrong, rng):
    with pytest.raises(ValueError, match="do not fit"):
        draw(field_cloud(rng, classifier(rng))._replace(**wrong), CAMERAS["narrow"])


@pytest.mark.parametrize(
    "wrong",
    [
        {"table": np.zeros((8, 4), np.float32)},
        {"table": np.zeros((1, 8, 3), np.float32)},
        {"table": np.zeros((1, 0, 4), np.float32)},
        {"table": np.zeros((1, 8, 4), np.float64)},
        {"table": np.full((1, 8, 4), np.nan, np.float32)},
        {"table": np.full((1, 8, 4), -1, np.float32)},
        {"low": 3.0},
        {"low": math.nan},
        {"high": math.inf},
        {"steep": 0.0},
        {"far": 0.0},
        {"dimmed": math.nan},
    ],
    ids=lambda wrong: "".join(
        f"{name} {np.shape(given) or given}" for name, given in wrong.items()
    ),
)
def test_a_classifier_that_is_none_is_refused(wrong, rng):
    look = classifier(rng)._replace(**wrong)
    with pytest.raises(ValueError, match="classifier"):
        draw(field_cloud(rng, look), CAMERAS["narrow"])
