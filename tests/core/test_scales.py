"""Samples of a size each beside line integrals through each of them, composited one by one."""

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.painting.choices import Primitive, footprints_of
from resample.profiles.orders import EverySample
from resample.profiles.reconstruction import BSplineKernel, GaussianKernel
from resample.types import Samples
from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from tests import naive, sheared
from tests.bits import assert_same
from tests.samples import painter, reordered, shuffled

SIZE = {"height": 23, "width": 29}
EYE = look_at((4, -14, 5), (0, 0, 0))
CAMERAS = {
    "close": Camera.from_intrinsics(26.0, 24.0, 14.0, 11.3, EYE),
    "inside": Camera.from_intrinsics(9.0, 9.0, 14.0, 11.3, look_at((1, -1, 1), (0, 0, 0))),
    "near plane": Camera.from_intrinsics(26.0, 24.0, 14.0, 11.3, EYE, 13.6),
    "parallel": Orthographic(1.9, 1.7, 14.0, 11.3, EYE, -60.0),
    "parallel, near plane": Orthographic(1.9, 1.7, 14.0, 11.3, EYE, 15.0),
}
SPLATS = painter(primitive=Primitive.SPLATS)
LATTICE = 0.4 * sheared.LATTICE
PLANES = [[0.3, 1.0, 0.2, 0.5], [-1.0, 0.2, 0.3, 3.0]]
TOLERANCE = 2e-4  # painters stop at a transmittance of 1e-4


def crowd(rng, count=80, low=-1.5, high=1.4):
    """Samples of sizes between exp(low) and exp(high), on a lattice that is no cube's."""
    scale = np.exp(rng.uniform(low, high, count))
    return Samples(
        rng.uniform(-5, 5, (count, 3)).astype(np.float32),
        rng.uniform(0, 1, (count, 3)).astype(np.float32),
        (rng.uniform(0.5, 12, count) / scale).astype(np.float32),
        LATTICE,
        scale.astype(np.float32),
    )


def opacities(samples, camera, kernel=None, *, height, width, clip=None):
    """Opacity (N, height, width) of every sample by its own line integrals."""
    size = {"height": height, "width": width}
    between = None if clip is None else naive.kept_by(camera, clip, **size)
    given = zip(naive.in_camera(camera, samples.position), samples.scale.astype(float), strict=True)
    integral = [
        naive.line_integrals(
            camera, center, scale * samples.lattice, kernel or GaussianKernel(),
            between=between, **size,
        )
        for center, scale in given
    ]  # fmt: skip
    return 1 - np.exp(-np.array(integral) * samples.extinction.astype(float)[:, None, None])


def dust(rng, count=400):
    """Samples of which some are points and some are splats, a few of these large and in front."""
    scale = np.exp(rng.uniform(-5, 0.7, count)).astype(np.float32)
    return Samples(
        rng.uniform(-4, 4, (count, 3)).astype(np.float32),
        rng.uniform(0, 1, (count, 3)).astype(np.float32),
        (rng.uniform(3, 30, count) / scale).astype(np.float32),
        0.2 * np.eye(3),
        scale,
    )


def finer(camera, times):
    """A camera whose pixels are so many times smaller."""
    f = times * 26.0
    if isinstance(camera, Orthographic):
        return Orthographic(times * 1.9, times * 1.7, times * 14.0, times * 11.3, EYE, -60.0)
    return Camera.from_intrinsics(f, times * 24.0, times * 14.0, times * 11.3, EYE)


@pytest.mark.some(1)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("clip", [None, PLANES], ids=["whole", "clipped"])
def test_splats_are_line_integrals_in_the_order_of_their_depths(rng, camera, clip):
    samples = crowd(rng)
    alpha = opacities(samples, camera, clip=clip, **SIZE)
    depth = naive.in_camera(camera, samples.position)[:, 2]
    truth = naive.composite(alpha, samples.color, depth)
    assert truth[..., 3].max() > 0.7
    frame = SPLATS(samples, camera, clip=clip, **SIZE)
    np.testing.assert_allclose(frame.rgba, truth, atol=TOLERANCE)
    # Of each, the depth at which the ray passes nearest to its center, of what is left of the ray.
    nearest = naive.nearest_depths(samples, camera, **SIZE)
    low, high = camera.view().near, np.inf
    if clip is not None:
        low, high = naive.kept_by(camera, clip, **SIZE)
        low = np.maximum(low, camera.view().near)
    far = naive.layered(alpha, np.clip(nearest, low, high), depth)
    seen = truth[..., 3] > 0
    product = np.where(np.isfinite(frame.depth), frame.depth, 0) * frame.rgba[..., 3]
    np.testing.assert_allclose(product[seen], far[seen], atol=20 * TOLERANCE)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "kernel", [GaussianKernel(), pytest.param(BSplineKernel(), marks=pytest.mark.sweep)]
)
@pytest.mark.parametrize("order", [EverySample(), EverySample(key="distance")])
def test_other_kernels_and_orders_by_distance(rng, kernel, order):
    samples, camera = crowd(rng), CAMERAS["inside"]
    center = naive.in_camera(camera, samples.position)
    key = np.linalg.norm(center, axis=1) if order.key == "distance" else center[:, 2]
    truth = naive.composite(opacities(samples, camera, kernel, **SIZE), samples.color, key)
    resampler = painter(primitive=Primitive.SPLATS, reconstruction=kernel, order=order)
    np.testing.assert_allclose(resampler(samples, camera, **SIZE).rgba, truth, atol=TOLERANCE)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_scale_of_one_changes_no_bit(rng, camera):
    samples = crowd(rng)._replace(scale=None)
    ones = samples._replace(scale=np.ones(len(samples.extinction), np.float32))
    for clip in (None, PLANES):
        assert_same(
            SPLATS(samples, camera, clip=clip, **SIZE), SPLATS(ones, camera, clip=clip, **SIZE)
        )


@pytest.mark.parametrize("camera", [CAMERAS["close"], CAMERAS["parallel"]])
def test_a_larger_scale_is_a_larger_lattice(rng, camera):
    samples = crowd(rng)
    twice = samples._replace(scale=np.full(len(samples.extinction), 2, np.float32))
    wide = samples._replace(scale=None, lattice=2 * samples.lattice)
    frame, other = SPLATS(twice, camera, **SIZE), SPLATS(wide, camera, **SIZE)
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=TOLERANCE)
    np.testing.assert_allclose(frame.coverage, other.coverage, atol=TOLERANCE)


@pytest.mark.sweep
@pytest.mark.parametrize("camera", [CAMERAS["close"], CAMERAS["parallel"]])
def test_points_and_splats_are_those_of_64_by_64_rays_per_pixel(rng, camera):
    samples, n = dust(rng), 64
    frame = painter()(samples, camera, **SIZE)
    rays = SPLATS(samples, finer(camera, n), **{name: n * size for name, size in SIZE.items()})
    truth = rays.rgba.reshape(SIZE["height"], n, SIZE["width"], n, 4).mean(axis=(1, 3))
    assert truth[..., 3].max() > 0.5
    np.testing.assert_allclose(frame.rgba, truth, atol=8e-4)  # 16 by 16 rays: 1.5e-3
    np.testing.assert_allclose(frame.rgba.mean(axis=(0, 1)), truth.mean(axis=(0, 1)), rtol=1e-3)


@pytest.mark.sweep
@pytest.mark.parametrize("opacity", [0.05, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("camera", [CAMERAS["close"], CAMERAS["parallel"]])
def test_points_take_the_light_that_their_line_integrals_say(rng, camera, opacity):
    samples, kernel = dust(rng, 150), GaussianKernel()
    scale = samples.scale / 64  # so small that none is a splat, and none hides another
    ahead = Camera.from_intrinsics(1.0, 1.0, 0.5, 0.5)
    through = naive.line_integrals(
        ahead, np.array([0, 0, 9.0]), samples.lattice, kernel, height=1, width=1
    )
    extinction = -np.log1p(-opacity) / (through * scale)
    samples = samples._replace(extinction=extinction.ravel().astype(np.float32), scale=scale)
    # Of one of them, over its disc
    radius = kernel.radius * samples.lattice[0, 0]
    around = Orthographic(64 / radius, 64 / radius, 70, 70)
    integral = naive.line_integrals(
        around, np.array([0, 0, 9.0]), samples.lattice, kernel, height=140, width=140
    )
    area = -np.expm1(np.log1p(-opacity) * integral / through).sum() * (radius / 64) ** 2
    x, y, z = naive.in_camera(camera, samples.position).T
    view = camera.view()
    squared = z**2 / np.sqrt(1 + (x**2 + y**2) / z**2) if view.perspective else np.ones_like(z)
    at = np.stack([x, y], axis=1) / (z[:, None] if view.perspective else 1)
    at = at * view.focal + view.principal
    inside = ((at > 1) & (at < (SIZE["width"] - 1, SIZE["height"] - 1))).all(axis=1)
    frame = painter()(reordered(samples, np.flatnonzero(inside)), camera, **SIZE)
    assert frame.statistics.points == inside.sum()
    expected = (area * scale.astype(float) ** 2 * view.focal.prod() / squared)[inside].sum()
    assert frame.rgba[..., 3].sum(dtype=float) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(
    "primitive", [Primitive.SPLATS, pytest.param(Primitive.HYBRID, marks=pytest.mark.sweep)]
)
def test_neither_order_nor_threads_change_a_bit(rng, primitive):
    samples, camera = dust(rng), CAMERAS["close"]
    other = shuffled(samples, rng)
    resampler = painter(primitive=primitive)
    for clip in (None, PLANES):
        one = resampler(samples, camera, threads=1, clip=clip, **SIZE)
        assert_same(one, resampler(other, camera, threads=2, clip=clip, **SIZE))


@pytest.mark.sweep
@pytest.mark.parametrize("camera", [CAMERAS["close"], CAMERAS["parallel"]])
def test_a_point_between_splats_is_dimmed_by_the_one_in_front_only(camera):
    colors = np.eye(3, dtype=np.float32)
    direction = -EYE[2, :3]
    position = np.stack([4 * direction, 0 * direction, -4 * direction])  # front, middle, behind
    scale, extinction = np.array([[18, 0.05, 18], [0.5, 9e2, 0.5]], np.float32)
    samples = Samples(position, colors, extinction, 0.2 * np.eye(3), scale)
    resampler = painter(subpixels=16)
    frame = resampler(samples, camera, **SIZE)
    assert (frame.statistics.points, frame.statistics.splats) == (1, 2)
    point, front, splats = (
        resampler(reordered(samples, some), camera, **SIZE).rgba for some in ([1], [0], [0, 2])
    )
    at = np.unravel_index(point[..., 3].argmax(), point.shape[:2])
    left = 1 - front[at][3]
    assert left < 0.9
    assert frame.rgba[..., 1].sum() == pytest.approx(left * point[..., 1].sum(), rel=1e-2)
    np.testing.assert_allclose(frame.rgba[..., 0], splats[..., 0], atol=1e-7)
    lost = (splats[..., 2] - frame.rgba[..., 2]).sum(dtype=float)  # of the splat behind
    assert lost == pytest.approx(splats[at][2] * point[..., 3].sum(), rel=3e-2)


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        ([1.0, np.nan], "a finite number above 0"),
        ([1.0, np.inf], "a finite number above 0"),
        ([1.0, 1e300], "a finite number above 0"),
        ([1.0, 0.0], "a finite number above 0"),
        ([1.0, -2.0], "a finite number above 0"),
        ([1.0], r"scales \(1,\) do not fit 2 samples"),
        (2.0, r"scales \(\) do not fit 2 samples"),
        ([[1.0, 2.0]], r"scales \(1, 2\) do not fit 2 samples"),
        ([1.0, 3e38], "scale times its extinction"),
    ],
)
def test_scales_that_are_none_are_refused_in_one_line(rng, scale, message):
    samples = reordered(crowd(rng), [0, 1])._replace(scale=scale)
    samples = samples._replace(extinction=np.array([10, 10], np.float32))
    with pytest.raises(ValueError, match=message) as refused:
        SPLATS(samples, CAMERAS["close"], **SIZE)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"order": ImageSheets()}, "need the order every-sample"),
        ({"order": AxisSheets()}, "need the order every-sample"),
        *(
            ({"footprint": model}, f"not hybrid of {model}")
            for model in footprints_of(Primitive.SPLATS)
            if model != "exact"
        ),
        *(
            ({"primitive": name}, f"not {name} of")
            for name in ("points", "paper", "inflate", "ewa")
        ),
    ],
)
def test_choices_that_know_no_sizes_are_refused_in_one_line(rng, choices, message):
    with pytest.raises(ValueError, match=message) as refused:
        painter(**choices)(crowd(rng), CAMERAS["close"], **SIZE)
    assert "\n" not in str(refused.value)


def test_records_know_no_sizes(rng):
    with pytest.raises(ValueError, match="no records of samples that have a scale"):
        SPLATS.footprints(crowd(rng), CAMERAS["close"], **SIZE)
