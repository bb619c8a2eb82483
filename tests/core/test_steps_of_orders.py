"""Sheets, slabs, points, mixtures and fields that come part by part give the bits of the whole."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resample import Footprint, Opacity, Primitive
from resample.painting.choices import Projection
from resample.painting.scenes.plans import MIXTURE, POINTS, SPLATS
from resample.profiles.filters import Gaussian
from resample.profiles.orders import EverySample, ImageSheets
from resample.types import Classifier, Field
from resample_comparisons.volume.painting import AxisSheets
from tests.core.test_steps import AROUND, EVEN, UNEVEN, Parts, planned
from tests.core.test_windows import HEIGHT, PICTURE, WIDTH, assert_same, camera, cloud, some_of
from tests.samples import DARK, painter

LOOK = Classifier(
    np.random.default_rng(4).uniform(0, 1, (4, 16, 4)).astype(np.float32) ** 3,
    0.0,
    1.0,
    1.0,
    DARK,
    0.0,
    1.0,
    0.0,
)
FAR = 60.0  # where samples of a cloud are points
WINDOWS = [(0, 0, WIDTH, HEIGHT), (9, 3, 40, 41), (69, 49, 70, 50)]
MORE = pytest.mark.sweep
REACH = 16  # px, more than points and models reach beyond exact footprints


def field(near):
    """A field, much of which is seen through."""
    samples = cloud(1500, near)
    gradient = (samples.color - 0.5).astype(np.float32)
    return Field(samples.position, samples.extinction, gradient, samples.lattice, LOOK)


def in_parts(paint, samples, side, step, reach=REACH):
    parts, outward = Parts(samples, paint, side, step), np.array([-1, -1, 1, 1])
    bounds = parts.source.bounds + reach * outward
    bounds = np.where(np.isfinite(bounds), bounds, 1e6 * outward).astype(np.float32)
    look = samples.classifier if isinstance(samples, Field) else None
    parts.source = parts.source._replace(bounds=bounds, classifier=look)
    return parts


def check(paint, samples, side, step, window, threads=None):
    """Any parts in any steps; gives the plan."""
    whole, plan = paint(samples, camera(), **PICTURE), planned(paint, samples, 3)
    parts = in_parts(paint, samples, side, step)
    part = paint.paint_nearest_first(parts.source, camera(), plan, window, threads=threads)
    assert_same(part, whole, window)
    if whole.value is not None:
        x0, y0, x1, y1 = window
        assert part.value.tobytes() == whole.value[y0:y1, x0:x1].tobytes()
    assert len(set(parts.loaded)) == len(parts.loaded)
    return plan


ORDERS = [AxisSheets(), ImageSheets(), ImageSheets(0.4)]
steps = (
    st.sampled_from([1.0, 30.0]),
    st.sampled_from([2.0, 5.0, 40.0]),
    st.sampled_from([1, 60, 400, 5000]),
    st.sampled_from(WINDOWS),
    st.integers(1, 2),
)


@pytest.mark.sweep
@settings(max_examples=5, derandomize=True, deadline=None)
@given(st.sampled_from(ORDERS), st.sampled_from([EVEN, UNEVEN, AROUND]), *steps)
def test_sheets_and_slabs(order, near, dense, side, step, window, threads):
    check_sheets(order, near, dense, side, step, window, threads)


@pytest.mark.sweep
@settings(max_examples=25, derandomize=True, deadline=None)
@given(st.sampled_from(ORDERS), st.sampled_from([EVEN, UNEVEN, AROUND]), *steps)
def test_more_sheets_and_slabs(order, near, dense, side, step, window, threads):
    check_sheets(order, near, dense, side, step, window, threads)


def check_sheets(order, near, dense, side, step, window, threads):
    samples = cloud(1500, near)
    samples = samples._replace(extinction=samples.extinction * np.float32(dense))
    plan = check(painter(order=order), samples, side, step, window, threads)
    assert plan.painter == SPLATS


@pytest.mark.sweep
@pytest.mark.slow
@settings(max_examples=5, derandomize=True, deadline=None)
@given(st.sampled_from(["depth", "distance"]), st.sampled_from([UNEVEN, FAR]), *steps)
def test_points(key, near, dense, side, step, window, threads):
    check_points(key, near, dense, side, step, window, threads)


@pytest.mark.sweep
@settings(max_examples=15, derandomize=True, deadline=None)
@given(st.sampled_from(["depth", "distance"]), st.sampled_from([UNEVEN, FAR]), *steps)
def test_more_points(key, near, dense, side, step, window, threads):
    check_points(key, near, dense, side, step, window, threads)


def check_points(key, near, dense, side, step, window, threads):
    samples = cloud(1500, near)
    samples = samples._replace(extinction=samples.extinction * np.float32(dense))
    paint = painter(primitive=Primitive.POINTS, order=EverySample(key=key))
    plan = check(paint, samples, side, step, window, threads)
    assert plan.painter == POINTS


MIXED = [
    painter(threshold=1.5),
    painter(threshold=1.5, pixel_filter=Gaussian(0.5, 1.5)),
    painter(primitive=Primitive.EWA),
    painter(primitive=Primitive.INFLATE),
    painter(footprint=Footprint.AFFINE, opacity=Opacity.LINEAR),
    painter(footprint=Footprint.CORRECTED, splat_color=(1, 0, 0)),
]


@pytest.mark.sweep
@settings(max_examples=25, derandomize=True, deadline=None)
@given(st.sampled_from(MIXED), st.sampled_from([14.0, UNEVEN, FAR, AROUND]), *steps)
def test_mixtures(paint, near, dense, side, step, window, threads):
    samples = cloud(1500, near)
    samples = samples._replace(extinction=samples.extinction * np.float32(dense))
    plan = check(paint, samples, side, step, window, threads)
    assert plan.painter in {SPLATS, MIXTURE, POINTS}


@pytest.mark.sweep
@settings(max_examples=25, derandomize=True, deadline=None)
@given(
    st.sampled_from(ORDERS),
    st.sampled_from([Primitive.POINTS, Primitive.EWA]),
    st.sampled_from([14.0, UNEVEN, FAR, AROUND]),
    *steps[:-1],
)
def test_sheets_and_slabs_of_mixtures(order, primitive, near, dense, side, step, window):
    samples = cloud(1500, near)
    samples = samples._replace(extinction=samples.extinction * np.float32(dense))
    paint = painter(primitive=primitive, order=order)
    plan = check(paint, samples, side, step, window)
    assert plan.painter == MIXTURE


SHOWN = [Projection.COMPOSITE, Projection.MAXIMUM, Projection.AVERAGE, Projection.FIRST_HIT]


@pytest.mark.sweep
@settings(max_examples=25, derandomize=True, deadline=None)
@given(st.sampled_from(SHOWN), st.sampled_from([EVEN, UNEVEN, AROUND]), *steps[1:])
def test_fields(projection, near, side, step, window, threads):
    samples = field(near)
    iso = 0.5 * (samples.classifier.low + samples.classifier.high)
    is_hit = projection is Projection.FIRST_HIT
    paint = painter(order=ImageSheets(), projection=projection, iso=iso if is_hit else None)
    check(paint, samples, side, step, window, threads)


@pytest.mark.sweep
def test_samples_of_a_size_each():
    samples = cloud(900, 46.0)
    scale = np.random.default_rng(2).uniform(0.3, 2.0, 900).astype(np.float32)
    scaled = samples._replace(scale=scale)
    paint = painter()
    whole, plan = paint(scaled, camera(), **PICTURE), planned(paint, scaled)
    parts = in_parts(paint, samples, 3.0, 60)
    source = parts.source._replace(load=lambda part: some_of(scaled, np.isin(parts.part, part)))
    for window in WINDOWS:
        assert_same(paint.paint_nearest_first(source, camera(), plan, window), whole, window)


@pytest.mark.some(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    "paint",
    [
        painter(order=AxisSheets()),
        painter(order=ImageSheets()),
        painter(primitive=Primitive.POINTS),
    ],
)
def test_parts_behind_what_is_opaque_are_not_loaded(paint):
    samples = cloud(14**3, 30.0)
    samples = samples._replace(extinction=np.full_like(samples.extinction, 50.0))
    whole, plan = paint(samples, camera(), **PICTURE), planned(paint, samples)
    parts, window = in_parts(paint, samples, 2.0, 100, reach=1), WINDOWS[0]
    assert_same(paint.paint_nearest_first(parts.source, camera(), plan, window), whole, window)
    assert len(parts.loaded) < 0.85 * len(parts.source.sizes)


def test_what_takes_all_of_a_picture_together_is_refused():
    samples = field(EVEN)
    paint = painter(order=ImageSheets(), projection=Projection.ADDITIVE)
    parts = in_parts(painter(order=ImageSheets()), samples, 5.0, 100)
    plan = painter(order=ImageSheets()).plan(samples, camera(), **PICTURE)
    with pytest.raises(ValueError, match="additive cannot be painted window by window"):
        paint.paint_nearest_first(parts.source, camera(), plan, WINDOWS[0])
