"""Splats that tiles project for themselves are those that are painted from records."""

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.engine.ellipsoids import run_bounds
from resample.engine.ellipsoids.work_queue import prefetch
from resample.engine.jit import kernel
from resample.engine.subpixels import grid_of
from resample.painting import splats as deferred
from resample.painting.choices import Primitive
from resample.painting.preparing import style_of
from resample.painting.runs import dealt, plan_of, planned
from resample.painting.scenes.plans import MIXTURE
from resample.painting.scenes.scene import dealt_to_tiles
from resample.profiles.filters import Gaussian
from resample.profiles.orders import EverySample
from resample.profiles.reconstruction import BSplineKernel, GaussianKernel, footprint_profile
from resample.types import MOST_COLUMNS, Samples, Screen
from tests.bits import assert_same
from tests.records import from_records
from tests.samples import painter, shuffled
from tests.sheared import CAMERAS, CLOSE, PLANE, SIZE, box

# Line integrals are within 3e-6 of the peak by either way; so a sub-pixel may count as opaque, at a
# transmittance of 1e-4, one splat sooner.
TOLERANCE = 1e-4


@pytest.mark.sweep
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("extinction", [0.02, 0.4, 6.0])
def test_pictures_are_those_painted_from_records(rng, camera, extinction):
    samples = box(rng, extinction)
    frame, other = painter()(samples, camera, **SIZE), from_records(samples, camera, **SIZE)
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=TOLERANCE)
    np.testing.assert_allclose(frame.coverage, other.coverage, atol=TOLERANCE)
    np.testing.assert_array_equal(np.isfinite(frame.depth), np.isfinite(other.depth))
    assert frame.statistics.splats == other.statistics.splats
    assert frame.statistics.subpixels == other.statistics.subpixels


@pytest.mark.sweep
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_plane_cuts_as_it_cuts_records(rng, camera):
    samples = box(rng)
    frame = painter()(samples, camera, clip=PLANE, **SIZE)
    other = from_records(samples, camera, clip=PLANE, **SIZE)
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=TOLERANCE)
    assert frame.statistics.splats == other.statistics.splats


@pytest.mark.some(2)
@pytest.mark.parametrize("longest", [1, 7, 256])
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_runs_change_no_bit(rng, monkeypatch, camera, longest):
    samples = box(rng)
    frame = painter()(samples, camera, **SIZE)
    monkeypatch.setattr(deferred, "LONGEST_RUN", longest)
    assert_same(frame, painter()(samples, camera, **SIZE))


@pytest.mark.some(1)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_asking_boxes_of_runs_changes_no_bit(rng, monkeypatch, camera):
    samples = box(rng)
    frame = painter()(samples, camera, **SIZE)
    monkeypatch.setattr(deferred, "_is_vague", lambda *_, **__: True)
    other = painter()(samples, camera, **SIZE)
    assert_same(frame, other)
    assert frame.statistics.splats == other.statistics.splats


@pytest.mark.some(1)
@pytest.mark.parametrize("order", [EverySample(), EverySample(key="distance")])
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_boxes_bound_what_is_known_of_runs(rng, monkeypatch, camera, order):
    samples, found = box(rng), []
    outline = run_bounds.outline_runs

    def spy(runs, *rest):
        outline(runs, *rest)
        found.append(runs.copy())

    monkeypatch.setattr(run_bounds, "outline_runs", spy)
    monkeypatch.setattr(deferred, "_is_vague", lambda *_, **__: True)
    painter(order=order)(samples, camera, **SIZE)
    bound, exact = found
    np.testing.assert_array_equal(bound["seen"], exact["seen"])
    for name in ("left", "top", "key", "least_spacing"):
        assert (bound[name] <= exact[name]).all(), name
    for name in ("right", "bottom", "most_spacing"):
        assert (bound[name] >= exact[name]).all(), name


def test_tiles_are_as_fine_as_their_closest_samples_ask_for(rng):
    """Of a plane that leads away to the right, where its samples lie closer together."""
    place, depth = rng.uniform(-25.0, 25.0, (2, 400)), np.linspace(3.0, 30.0, 400)
    place[0] = np.linspace(-25.0, 30.0, 400)
    position = np.column_stack([*(place * depth / 12.0), depth]).astype(np.float32)
    samples = Samples(position, np.ones_like(position), np.ones(400, np.float32), np.eye(3))
    paint, eye = painter(), Camera.from_intrinsics(12.0, 12.0, 26.0, 21.0, np.eye(4))
    scene = paint._scene(samples, eye.view(), (SIZE["height"], SIZE["width"]))
    runs = deferred.runs_of(scene, samples, are_mixed=True)
    scene = planned(scene, MIXTURE, runs, MOST_COLUMNS)
    by = deferred.splats_by_runs(scene, deferred.formula_of(scene, None, None))
    found = dealt(scene, runs, by.find_spacings)[0].spacing
    known = paint.footprints(samples, eye, **SIZE)
    screen = Screen(SIZE["width"], SIZE["height"], scene.screen.margin, np.zeros((4, 4)))
    tiles = dealt_to_tiles(known, screen, plan_of(scene).tile)
    style = style_of(paint, samples.lattice, None)
    grids = [[grid_of(spacing, style) for spacing in each] for each in (found, tiles.spacing)]
    assert grids[0] == grids[1]
    assert len(set(grids[0])) > 1


@pytest.mark.parametrize("key", ["depth", "distance"])
def test_the_order_of_samples_changes_no_bit(rng, key):
    samples, resample = box(rng), painter(order=EverySample(key=key))
    other = shuffled(samples, rng)
    assert_same(resample(samples, CLOSE, **SIZE), resample(other, CLOSE, **SIZE))


@pytest.mark.some(1)
@pytest.mark.parametrize("subpixels", [1, 2, 3, 5, 8, 16])
@pytest.mark.parametrize("extinction", [0.4, 6.0])
def test_splats_of_any_width_are_those_painted_from_records(rng, subpixels, extinction):
    samples, choice = box(rng, extinction, 7), {"primitive": Primitive.SPLATS}
    choice["subpixels"] = subpixels
    frame = painter(**choice)(samples, CAMERAS["far"], **SIZE)
    other = from_records(samples, CAMERAS["far"], **SIZE, **choice)
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=TOLERANCE)
    np.testing.assert_allclose(frame.coverage, other.coverage, atol=TOLERANCE)
    np.testing.assert_array_equal(np.isfinite(frame.first_depth), np.isfinite(other.first_depth))


@pytest.mark.parametrize(
    "side",
    [
        *(5, 20),
        pytest.param(
            100,
            marks=pytest.mark.sweep,
        ),
    ],
)
def test_any_number_of_samples_may_be_equally_near(rng, side):
    across, down = np.indices((side, side)).reshape(2, -1) - (side - 1) / 2
    samples = Samples(
        np.stack([across, down, np.zeros(side**2)], 1).astype(np.float32),
        rng.uniform(0, 1, (side**2, 3)).astype(np.float32),
        rng.uniform(0, 2, side**2).astype(np.float32),
        np.eye(3),
    )
    other = shuffled(samples, rng)
    camera = Orthographic(0.3, 0.3, 26.0, 21.0, look_at((0, 0, -30), (0, 0, 0)), -60.0)
    choice = {"primitive": Primitive.SPLATS, "subpixels": 2}
    frame = painter(**choice)(samples, camera, **SIZE)
    assert_same(frame, painter(**choice)(other, camera, **SIZE))
    records = from_records(samples, camera, **SIZE, **choice)
    np.testing.assert_allclose(frame.rgba, records.rgba, atol=TOLERANCE)


@pytest.mark.sweep
def test_filters_reach_into_other_tiles(rng):
    samples, pixel = box(rng), Gaussian(0.7, 2.0)
    frame = painter(pixel_filter=pixel)(samples, CLOSE, **SIZE)
    other = from_records(samples, CLOSE, **SIZE, pixel_filter=pixel)
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=TOLERANCE)


@pytest.mark.sweep
def test_many_rays_per_pixel_fit_the_rows(rng):
    samples, choice = box(rng, side=7), {"primitive": Primitive.SPLATS, "subpixels": 32}
    frame = painter(**choice)(samples, CLOSE, **SIZE)
    other = from_records(samples, CLOSE, **SIZE, **choice)
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=TOLERANCE)


@pytest.mark.parametrize("kernel", [GaussianKernel(), GaussianKernel(0.5, 1.5)])
def test_integrals_of_gaussians_have_a_formula(kernel):
    assert footprint_profile(kernel) is not None


class Ring:
    """A kernel whose integrals are below 0 near the rim."""

    radius = 2.0

    def __call__(self, distance):
        return np.where(distance <= 2.0, (1.0 - distance**2 / 3.0) * np.exp(-(distance**2)), 0.0)


def test_integrals_that_fall_below_zero_have_no_formula():
    assert footprint_profile(Ring()) is None


@pytest.mark.sweep
def test_integrals_of_splines_have_none_and_are_painted_all_the_same(rng):
    spline = BSplineKernel()
    assert footprint_profile(spline) is None
    assert painter(reconstruction=spline)(box(rng), CLOSE, **SIZE).rgba.max() > 0.1


@kernel
def asked_for(array, start, end):
    """Ask for samples of three arrays that are one."""
    prefetch(array, array, array, start, end)


def test_asking_for_samples_changes_none(rng):
    array = rng.uniform(size=40).astype(np.float32)
    before = array.copy()
    asked_for(array, 0, 13)
    np.testing.assert_array_equal(array, before)
