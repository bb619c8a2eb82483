"""Samples that come part by part give the bits of the whole; what is hidden is never asked for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resample import Orthographic
from resample.painting.scenes.plans import SamplesInParts
from resample.profiles.filters import Gaussian
from resample.profiles.orders import EverySample
from tests.core.test_windows import (
    HEIGHT,
    PICTURE,
    WIDTH,
    assert_same,
    camera,
    cloud,
    some_of,
)
from tests.samples import painter

EVEN, UNEVEN, AROUND = 20.0, 46.0, -4.0  # where the cloud begins; the last one is around the eye
KEYS = ("depth", "distance")


class Parts:
    """Samples in boxes of so many units per side, which counts those that are loaded."""

    def __init__(self, samples, paint, side, step=9):
        at = (samples.position // side).astype(int)
        at -= at.min(axis=0)
        box, self.part = np.unique(
            np.ravel_multi_index(at.T, at.max(axis=0) + 1), return_inverse=True
        )
        self.samples, self.loaded = samples, []
        records = paint.footprints(samples, camera(), **PICTURE)
        center, radius, bounds = [], [], []
        for n in range(len(box)):
            place = samples.position[self.part == n].astype(float)
            middle = 0.5 * (place.min(axis=0) + place.max(axis=0))
            center.append(middle)
            radius.append(np.linalg.norm(place - middle, axis=1).max())
            record = records[self.part == n]
            ends = [record[side].min() for side in ("left", "top")]
            bounds.append([*ends, *(record[side].max() for side in ("right", "bottom"))])
        own = np.array(center), np.array(radius), np.array(bounds, np.float32)
        self.source = SamplesInParts(*own, np.bincount(self.part), samples.lattice, self.load, step)

    def load(self, parts):
        self.loaded += parts.tolist()
        return some_of(self.samples, np.isin(self.part, parts))


def planned(paint, samples, parts=1):
    plan = paint.plan(samples, camera(), **PICTURE)
    for n in range(parts):
        plan = paint.with_spacing(plan, some_of(samples, slice(n, None, parts)), camera())
    return plan


ANY = given(
    st.sampled_from([EVEN, UNEVEN, AROUND]),
    st.sampled_from([1.0, 30.0]),
    st.sampled_from([2.0, 5.0, 40.0]),
    st.sampled_from([1, 60, 400, 5000]),
    st.sampled_from([(0, 0, WIDTH, HEIGHT), (9, 3, 40, 41), (69, 49, 70, 50)]),
    st.sampled_from([(key, seen) for key in KEYS for seen in (None, Gaussian(0.5, 1.5))]),
    st.integers(1, 2),
)


def check(near, dense, side, step, window, choice, threads):
    """Parts in steps give the bits of the whole."""
    samples = cloud(1500, near)
    paint = painter(order=EverySample(key=choice[0]), pixel_filter=choice[1])
    samples = samples._replace(extinction=samples.extinction * np.float32(dense))
    whole, parts = paint(samples, camera(), **PICTURE), Parts(samples, paint, side, step)
    plan = planned(paint, samples, 3)
    assert paint.is_even(plan) == (near != UNEVEN)
    part = paint.paint_nearest_first(parts.source, camera(), plan, window, threads=threads)
    assert_same(part, whole, window)
    assert len(set(parts.loaded)) == len(parts.loaded)
    blind = paint.plan_of_parts(parts.source, camera(), **PICTURE)
    assert blind is None or near == EVEN
    if blind is not None:
        again = paint.paint_nearest_first(parts.source, camera(), blind, window)
        assert_same(again, whole, window)


@pytest.mark.sweep
@settings(max_examples=6, derandomize=True, deadline=None)
@ANY
def test_parts_in_steps_give_the_bits_of_the_whole(
    near, dense, side, step, window, choice, threads
):
    check(near, dense, side, step, window, choice, threads)


@pytest.mark.sweep
@settings(max_examples=25, derandomize=True, deadline=None)
@ANY
def test_any_parts_in_any_steps_give_the_bits_of_the_whole(
    near, dense, side, step, window, choice, threads
):
    check(near, dense, side, step, window, choice, threads)


@pytest.mark.some(5)
@pytest.mark.parametrize("is_parallel", [False, True])
@pytest.mark.parametrize("near", [EVEN, 35.0, UNEVEN, 60.0, AROUND])
def test_what_places_of_parts_say_of_spacings_holds(near, is_parallel):
    samples, paint, eye = cloud(1500, near), painter(), camera()
    if is_parallel:
        eye = Orthographic(1.3, 1.2, 0.5 * WIDTH, 0.5 * HEIGHT)
    plan, parts = paint.plan(samples, eye, **PICTURE), Parts(samples, paint, 3.0)
    blind = paint.plan_of_parts(parts.source, eye, **PICTURE)
    if blind is None:
        assert near in {UNEVEN, AROUND}
        return
    spacing = paint.footprints(samples, eye, **PICTURE)["spacing"]
    assert blind.least <= spacing.min() <= spacing.max() <= blind.most
    assert (blind.tile, blind.margin, blind.layers) == (plan.tile, plan.margin, plan.layers)


def test_parts_behind_what_is_opaque_and_beside_the_window_are_not_loaded():
    samples, paint = cloud(14**3, EVEN), painter()
    samples = samples._replace(extinction=np.full_like(samples.extinction, 50.0))
    parts, told = Parts(samples, paint, 2.0, 100), []
    plan, window = planned(paint, samples), (30, 20, 40, 30)  # in the middle of it
    whole = paint(samples, camera(), **PICTURE)
    by = {"progress": told.append}
    assert_same(
        paint.paint_nearest_first(parts.source, camera(), plan, window, **by), whole, window
    )
    depth = parts.source.center[parts.loaded, 2]
    assert depth.max() < EVEN + 6  # of 14
    assert 0 < len(parts.loaded) < 0.25 * len(parts.source.sizes)
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_tiles_of_which_nobody_knows_how_fine_they_are_are_refused():
    samples = cloud(200, UNEVEN)
    parts = Parts(samples, painter(), 5.0)
    uneven = painter().plan(samples, camera(), **PICTURE)
    with pytest.raises(ValueError, match="give that of `with_spacing`"):
        painter().paint_nearest_first(parts.source, camera(), uneven, (0, 0, 4, 4))


def test_no_more_samples_wait_than_is_said():
    samples, paint = cloud(1500, EVEN), painter()
    parts, waited = Parts(samples, paint, 3.0), [0]
    plan, window = planned(paint, samples), (0, 0, WIDTH, HEIGHT)
    kept, most = paint.kept_between_steps(parts.source, camera(), plan, window)
    assert kept == 28 * HEIGHT * WIDTH
    near = parts.source.center[:, 2] - parts.source.radius
    far = parts.source.center[:, 2] + parts.source.radius
    for limit in near:
        waited.append(parts.source.sizes[(near < limit) & (far >= limit)].sum())
    assert max(waited) <= most < 1.1 * max(waited) + 50
