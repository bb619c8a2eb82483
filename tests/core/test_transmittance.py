"""Truth 2: the transmittance of a picture is that of the field, in whatever order samples come."""

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.painting.choices import Opacity, Primitive, footprints_of
from resample.profiles.filters import Gaussian
from resample.profiles.reconstruction import GaussianKernel
from resample.types import Samples
from tests import naive
from tests.bits import assert_same
from tests.samples import cloud as samples_in_a_cube
from tests.samples import painter, reordered, shuffled

SIDE = 32  # px
CAMERA = Camera.from_fov(
    40.0, height=SIDE, width=SIDE, world_to_camera=look_at((9, -7, 5), (0, 0, 0))
)
SPACING = 0.5  # scene units


def cloud(rng, count=200, *, extinction=0.5):
    return samples_in_a_cube(rng, count, SPACING * np.eye(3), extinction=extinction)


def block(spacing=SPACING):
    """A cube of 9 × 9 × 9 samples on its lattice, all alike."""
    place = np.stack(np.meshgrid(*[np.arange(-4, 5.0)] * 3), axis=-1).reshape(-1, 3) * spacing
    count = len(place)
    return Samples(
        place.astype(np.float32),
        np.full((count, 3), (0.8, 0.4, 0.2), np.float32),
        np.full(count, 4.0, np.float32),
        spacing * np.eye(3),
    )


def draw(samples, camera=CAMERA, *, side=SIDE, **choices):
    return painter(**choices)(samples, camera, height=side, width=side)


# Values.


@pytest.mark.sweep
def test_the_transmittance_of_a_cloud_is_the_exponential_of_its_optical_depth(rng):
    samples = cloud(rng, extinction=2.0)
    frame = draw(samples, primitive=Primitive.SPLATS)
    integral = naive.all_line_integrals(samples, CAMERA, GaussianKernel(), height=SIDE, width=SIDE)
    truth = np.exp(-(integral * samples.extinction[:, None, None]).sum(axis=0))
    assert truth.min() < 0.3
    # Opaque from 1e-4 on; tables of 1024 steps.
    np.testing.assert_allclose(1 - frame.rgba[..., 3], truth, atol=1e-4)


def few(rng, *, extinction):
    """Three splats that overlap in the middle of the picture, in three colors."""
    position = [(0.3, 0, 0.1), (-0.2, 0.3, -0.3), (0, -0.4, 0.2)]
    return Samples(
        np.array(position, np.float32),
        np.array([(1, 0, 0.2), (0.1, 0.9, 0), (0, 0.3, 1)], np.float32),
        np.asarray(extinction, np.float32) * rng.uniform(0.9, 1.0, 3).astype(np.float32),
        np.eye(3),
    )


def naive_picture(samples, *, linear):
    integral = naive.all_line_integrals(samples, CAMERA, GaussianKernel(), height=SIDE, width=SIDE)
    extinction = samples.extinction.astype(float)[:, None, None]
    if linear:
        voxel = abs(np.linalg.det(samples.lattice)) ** (1 / 3)
        alpha = np.minimum(1.0, (1 - np.exp(-extinction * voxel)) * integral / voxel)
    else:
        alpha = 1 - np.exp(-extinction * integral)
    depth = naive.in_camera(CAMERA, samples.position)[:, 2]
    return alpha, depth, naive.composite(alpha, samples.color, depth)


# For linear opacities the painter is compiled once more.
LINEAR = pytest.mark.sweep


@pytest.mark.parametrize(
    "opacity",
    [pytest.param(each, marks=LINEAR) if each is Opacity.LINEAR else each for each in Opacity],
)
def test_splats_are_composited_front_to_back(opacity, rng):
    samples = few(rng, extinction=2.0)
    frame = draw(samples, primitive=Primitive.SPLATS, opacity=opacity)
    _, _, truth = naive_picture(samples, linear=opacity is Opacity.LINEAR)
    assert truth[..., 3].max() > 0.5
    np.testing.assert_allclose(frame.rgba, truth, atol=1e-5)  # float32, tables of 1024 steps


@LINEAR
def test_linear_opacity_stays_below_one_where_the_kernel_exceeds_one(rng):
    samples = few(rng, extinction=50.0)._replace(lattice=0.4 * np.eye(3))
    crowded = reordered(samples, [0, 1, 2, 0, 1, 2])
    frame = draw(crowded, primitive=Primitive.SPLATS, opacity=Opacity.LINEAR)
    assert frame.rgba[..., 3].max() <= 1.0
    assert np.isfinite(frame.rgba).all()


@pytest.mark.parametrize("spacing", [0.25, 1.0, 3.0])
def test_a_denser_lattice_of_the_same_field_looks_the_same(spacing):
    """A plane wave of extinction is drawn the same from its samples at spacing 1 and 1/2."""
    axis = np.arange(-4, 4, 0.5) + 0.25
    fine = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    axis = np.arange(-4, 4, 1.0) + 0.5
    coarse = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    camera = Camera.from_intrinsics(40.0, 40.0, 4.0, 4.0, look_at((0, -20 * spacing, 0), (0, 0, 0)))
    middle = []
    for place, step in ((fine, 0.5), (coarse, 1.0)):
        samples = Samples(
            (spacing * place).astype(np.float32),
            np.ones_like(place, np.float32),
            np.full(len(place), 0.1 / spacing, np.float32),
            spacing * step * np.eye(3),
        )
        frame = draw(samples, camera, side=8, primitive=Primitive.SPLATS)
        middle.append(frame.rgba[3:5, 3:5, 3].mean())
    through = 8 * 0.1  # optical depth of the block along the axis
    assert middle == pytest.approx([1 - np.exp(-through)] * 2, abs=4e-3)  # ripple of 0.76 %


@pytest.mark.parametrize("extinction", [1e-7, 1e-6])
@pytest.mark.parametrize("primitive", [Primitive.SPLATS, Primitive.POINTS])
def test_a_thousand_thin_samples_are_as_dense_as_one_thick_one(primitive, extinction):
    """1 − exp(−x) keeps its digits where x is small: exp(−x) is not rounded to float32 first."""
    focal = 20.0 if primitive is Primitive.SPLATS else 2.0
    camera = Camera.from_intrinsics(focal, focal, 8.0, 8.0)
    energy = []
    for count in (1, 1000):
        samples = Samples(
            np.full((count, 3), (0, 0, 10), np.float32),
            np.ones((count, 3), np.float32),
            np.full(count, 1000 / count * extinction, np.float32),
            np.eye(3),
        )
        energy.append(draw(samples, camera, side=16, primitive=primitive).rgba[..., 0].sum())
    assert energy[1] == pytest.approx(energy[0], rel=1e-3)  # of 1e-3, half is hidden by the rest


# Depth and coverage.


def test_depth_is_the_mean_depth_of_what_is_seen(rng):
    samples = few(rng, extinction=2.0)
    frame = draw(samples, primitive=Primitive.SPLATS)
    alpha, depth, _ = naive_picture(samples, linear=False)
    nearest = naive.nearest_depths(samples, CAMERA, height=SIDE, width=SIDE)
    share = naive.layered(alpha, np.ones_like(alpha), depth)
    seen = share > 1e-4  # below it float32's 1 − transmittance has few digits
    expected = naive.layered(alpha, nearest, depth)[seen] / share[seen]
    np.testing.assert_allclose(frame.depth[seen], expected, rtol=2e-3)
    clear = share[seen] > 0.05
    np.testing.assert_allclose(frame.depth[seen][clear], expected[clear], rtol=1e-5)


def test_first_depth_is_that_of_the_sample_at_which_something_is_seen(rng):
    samples = few(rng, extinction=2.0)
    frame = draw(samples, primitive=Primitive.SPLATS)
    alpha, depth, _ = naive_picture(samples, linear=False)
    order = np.argsort(depth)
    opacity = 1 - np.cumprod(1 - alpha[order], axis=0)
    borderline = (np.abs(opacity - 1 / 255) < 1e-5).any(axis=0)  # tables of 1024 steps
    visible = opacity > 1 / 255
    nearest = naive.nearest_depths(samples, CAMERA, height=SIDE, width=SIDE)[order]
    first = np.take_along_axis(nearest, visible.argmax(axis=0)[None], axis=0)[0]
    expected = np.where(visible.any(axis=0), first, np.inf)
    np.testing.assert_allclose(frame.first_depth[~borderline], expected[~borderline], rtol=1e-6)


@pytest.mark.parametrize("primitive", list(Primitive))
def test_nothing_is_infinitely_far(primitive):
    samples = block()._replace(lattice=SPACING * np.eye(3))
    frame = draw(samples, primitive=primitive)
    empty = frame.rgba[..., 3] == 0
    assert empty[0, 0]
    assert np.isinf(frame.depth[empty]).all()
    assert np.isinf(frame.first_depth[empty]).all()
    assert not frame.coverage[empty].any()
    assert not frame.rgba[empty].any()
    assert np.isfinite(frame.depth[frame.rgba[..., 3] > 0.01]).all()


@pytest.mark.parametrize("scale", [1.0, 0.4, 0.05], ids=lambda scale: f"{scale}x")
@pytest.mark.parametrize("primitive", list(Primitive))
def test_coverage_is_one_inside_a_block_and_never_more(primitive, scale):
    samples = block()
    if primitive is Primitive.SPLATS and scale < 1:
        pytest.skip("one ray per pixel meets some samples only")
    if primitive in (Primitive.POINTS, Primitive.PAPER) and scale == 1:
        pytest.skip("points are for samples closer than a pixel")
    camera = Camera.from_intrinsics(
        40 * scale, 40 * scale, 16.0, 16.0, look_at((9, -7, 5), (0, 0, 0))
    )
    frame = draw(
        samples._replace(extinction=samples.extinction * 1e-2), camera, primitive=primitive
    )
    assert frame.coverage.min() >= 0.0
    assert frame.coverage.max() <= 1.0
    if scale > 0.1:
        assert frame.coverage[14:18, 14:18].min() == pytest.approx(1.0, abs=1e-6)


# Order.


def ties(rng):
    """Many samples at equal depth and many exact duplicates, seen along an axis."""
    axis = np.arange(-3, 4.0) * 0.5
    place = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    color = rng.choice([0.1, 0.5, 0.9], (len(place), 3))
    once = Samples(
        place.astype(np.float32),
        color.astype(np.float32),
        rng.choice([0.3, 0.7], len(place)).astype(np.float32),
        0.5 * np.eye(3),
    )
    return reordered(once, rng.integers(0, len(place), 3 * len(place)))


FAR = Camera.from_intrinsics(30.0, 30.0, 16.2, 15.9, look_at((0, -40, 0), (0, 0, 0)))
CLOSE = Camera.from_intrinsics(30.0, 30.0, 16.2, 15.9, look_at((0, -9, 0), (0, 0, 0)))
INSIDE = Camera.from_intrinsics(20.0, 20.0, 16.2, 15.9, look_at((0, -1.25, 0), (0, 5, 0)))
VIEWS = {"far": FAR, "close": CLOSE, "inside": INSIDE}


@pytest.mark.each_value
@pytest.mark.parametrize("camera", VIEWS.values(), ids=VIEWS)
@pytest.mark.parametrize("primitive", list(Primitive))
@pytest.mark.parametrize("make", [cloud, ties])
def test_the_order_of_samples_does_not_change_a_bit(make, primitive, camera, rng):
    samples = make(rng)
    first = draw(samples, camera, primitive=primitive)
    assert first.rgba[..., 3].max() > 0.05
    for _ in range(2):
        again = shuffled(samples, rng)
        assert_same(first, draw(again, camera, primitive=primitive))


@pytest.mark.parametrize("model", footprints_of(Primitive.SPLATS))
def test_no_footprint_depends_on_the_order_of_samples(model, rng):
    samples = ties(rng)
    first = draw(samples, CLOSE, footprint=model)
    again = shuffled(samples, rng)
    assert_same(first, draw(again, CLOSE, footprint=model))


@pytest.mark.sweep
def test_samples_that_look_alike_but_are_not_do_not_change_a_bit_when_swapped(rng):
    """Around the eye all records share one place on screen; their forms must tell them apart."""
    count = 60
    place = rng.uniform(-1, 1, (count, 3))
    place[:, 1] = 0.25  # the same depth
    samples = Samples(
        place.astype(np.float32),
        np.ones((count, 3), np.float32),
        np.full(count, 0.3, np.float32),
        0.5 * np.eye(3),
    )
    camera = Camera.from_intrinsics(20.0, 20.0, 16.2, 15.9, look_at((0, 0, 0), (0, 5, 0)))
    first = draw(samples, camera, primitive=Primitive.SPLATS)
    for _ in range(5):
        again = shuffled(samples, rng)
        assert_same(first, draw(again, camera, primitive=Primitive.SPLATS))


def test_what_lies_behind_an_opaque_block_is_not_seen():
    samples = block()
    wall = samples._replace(extinction=np.full_like(samples.extinction, 100.0))
    behind = wall._replace(
        position=wall.position + np.array([-6, 4.67, -3.33], np.float32),
        color=np.zeros_like(wall.color),
    )
    both = Samples(
        *(np.concatenate([behind[n], wall[n]]) for n in range(3)), lattice=samples.lattice
    )
    alone, hidden = (draw(seen, primitive=Primitive.SPLATS) for seen in (wall, both))
    inside = alone.rgba[..., 3] > 0.9999
    assert inside.sum() > 50
    np.testing.assert_allclose(hidden.rgba[inside], alone.rgba[inside], atol=2e-4)  # opaque: 1e-4


WINDOWS = [(9, 8), (12, 5), (13, 16)]


@pytest.mark.each_value
@pytest.mark.parametrize("primitive", list(Primitive))
@pytest.mark.parametrize("focal", [6.0, 30.0])
@pytest.mark.parametrize(("left", "top"), WINDOWS)
def test_a_window_shows_what_the_whole_picture_shows_there(primitive, focal, left, top, rng):
    """Samples whose centers are off the screen matter where they reach into it."""
    samples = cloud(rng, 300)
    pose = look_at((0, -9, 0), (0, 0, 0))
    whole = Camera.from_intrinsics(focal, focal, 16.0, 16.0, pose)
    part = Camera.from_intrinsics(focal, focal, 16.0 - left, 16.0 - top, pose)
    subpixels = None if primitive is Primitive.PAPER else 2  # which has none
    chosen = {"primitive": primitive, "subpixels": subpixels, "pixel_filter": Gaussian(0.6)}
    picture, window = draw(samples, whole, **chosen), draw(samples, part, side=12, **chosen)
    expected = picture.rgba[top : top + 12, left : left + 12]
    assert expected.max() > 0.01
    # Places on screen are float32, as those of the paper's points are, under a filter of 1.2 px.
    atol = 5e-5 if primitive is Primitive.PAPER else 2e-5
    np.testing.assert_allclose(window.rgba, expected, atol=atol)
