"""Points that tiles project for themselves are those that are painted from records."""

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.engine.points.octets import spread
from resample.painting import points as deferred_points
from resample.painting.choices import Opacity, Primitive
from resample.profiles.filters import Box, Gaussian, Mitchell, profile, table
from resample.profiles.orders import EverySample
from resample.profiles.reconstruction import BSplineKernel
from tests.bits import assert_same
from tests.records import from_records
from tests.samples import painter, shuffled
from tests.sheared import CLOSE, INSIDE, PLANE, SIZE, box

PIXEL = (26.0, 21.0)
FAR = Camera.from_intrinsics(90.0, 90.0, *PIXEL, look_at((20, -250, 60), (0, 0, 0)))
CAMERAS = {
    "far": FAR,
    "farther": Camera.from_intrinsics(90.0, 80.0, *PIXEL, look_at((40, -1000, 60), (0, 0, 0))),
    "wide": Camera.from_intrinsics(20.0, 20.0, *PIXEL, look_at((8, -45, 12), (0, 0, 0))),
    "at the edge": Camera.from_intrinsics(
        90.0, 90.0, 0.4, 43.0, look_at((20, -250, 60), (0, 0, 0))
    ),
    "parallel": Orthographic(0.5, 0.4, *PIXEL, look_at((30, 20, -30), (0, 0, 0)), -60.0),
}
# Filters are within 1e-5 by either way, and weights have steps of 2**-17.
TOLERANCE = 1e-4


@pytest.fixture
def deferred_only(monkeypatch):
    """Count the pictures that are painted without records."""
    painted = []
    paint = deferred_points.paint_points

    def counted(*args):
        result = paint(*args)
        painted.append(result is not None)
        return result

    monkeypatch.setattr(deferred_points, "paint_points", counted)
    return painted


def assert_alike(frame, other, *, are_counted=True):
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=TOLERANCE)
    np.testing.assert_allclose(frame.coverage, other.coverage, atol=TOLERANCE)
    for name in ("depth", "first_depth"):
        depth, expected = getattr(frame, name), getattr(other, name)
        np.testing.assert_array_equal(np.isfinite(depth), np.isfinite(expected))
        clear = other.rgba[..., 3] > 0.01
        np.testing.assert_allclose(depth[clear], expected[clear], rtol=1e-3)
    # Beside the frame, points among splats are bounded by their kernels: more of them may be seen.
    counts = ("points", "splats", "subpixels") if are_counted else ("subpixels",)
    for name in counts:
        assert getattr(frame.statistics, name) == getattr(other.statistics, name), name


@pytest.mark.sweep
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("extinction", [0.02, 0.4, 6.0])
def test_pictures_are_those_painted_from_records(rng, deferred_only, camera, extinction):
    samples, choice = box(rng, extinction), {"primitive": Primitive.POINTS}
    frame = painter(**choice)(samples, camera, **SIZE)
    assert deferred_only == [True]
    assert_alike(frame, from_records(samples, camera, **SIZE, **choice))


CHOICES = {
    "tinted splats": {"splat_color": (1.0, 0.0, 0.0)},
    "linear opacity": {"opacity": Opacity.LINEAR},
    "distance": {"order": EverySample(key="distance")},
    "thin layers": {"order": EverySample(thickness=0.3)},
    "thick layers": {"order": EverySample(thickness=5.0)},
    "a spline": {"reconstruction": BSplineKernel()},
    "sub-pixels": {"subpixels": 3},
    "pixel filter": {"pixel_filter": Gaussian(0.7, 2.0)},
}


@pytest.mark.sweep
@pytest.mark.parametrize("choice", CHOICES.values(), ids=CHOICES)
@pytest.mark.parametrize("camera", ["far", "wide", "parallel"])
def test_choices_are_those_of_records(rng, deferred_only, camera, choice):
    samples, choices = box(rng), {"primitive": Primitive.POINTS, **choice}
    frame = painter(**choices)(samples, CAMERAS[camera], **SIZE)
    assert deferred_only == [True]
    assert_alike(frame, from_records(samples, CAMERAS[camera], **SIZE, **choices))


@pytest.mark.sweep
@pytest.mark.parametrize("primitive", [Primitive.POINTS, Primitive.HYBRID])
@pytest.mark.parametrize("scale", [1.0, 0.02])
def test_the_hybrid_s_points_are_those_of_records(rng, scale, primitive):
    samples, camera = (
        box(rng),
        Camera.from_intrinsics(scale, scale, *PIXEL, look_at((8, -60, 12), (0, 0, 0))),
    )
    frame = painter(primitive=primitive)(samples, camera, **SIZE)
    assert frame.statistics.points == samples.extinction.size
    assert_alike(frame, from_records(samples, camera, **SIZE, primitive=primitive))


@pytest.mark.some(1)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_plane_cuts_as_it_cuts_records(rng, camera):
    samples, choice = box(rng), {"primitive": Primitive.POINTS}
    frame = painter(**choice)(samples, camera, clip=PLANE, **SIZE)
    assert_alike(frame, from_records(samples, camera, **SIZE, clip=PLANE, **choice))


UNFIT = {
    "near plane": Camera.from_intrinsics(
        90.0, 90.0, *PIXEL, look_at((20, -250, 60), (0, 0, 0)), 252.0
    ),
    "inside": INSIDE,
    "close": CLOSE,
}


@pytest.mark.sweep
@pytest.mark.parametrize("camera", UNFIT.values(), ids=UNFIT)
def test_what_is_no_small_point_is_painted_in_order(rng, deferred_only, camera):
    samples, choice = box(rng, side=11), {"primitive": Primitive.POINTS}
    frame = painter(**choice)(samples, camera, **SIZE)
    assert deferred_only == [False]
    assert_alike(frame, from_records(samples, camera, **SIZE, **choice), are_counted=False)


@pytest.mark.sweep
@pytest.mark.parametrize("choice", [{"subpixels": 32}, {"pixel_filter": Gaussian(1.0, 4.0)}])
def test_rows_that_are_too_long_are_painted_in_order(rng, choice):
    camera = Camera.from_intrinsics(0.02, 0.02, *PIXEL, look_at((8, -60, 12), (0, 0, 0)))
    samples, choices = box(rng, side=7), {"primitive": Primitive.POINTS, **choice}
    frame = painter(**choices)(samples, camera, **SIZE)
    assert_alike(frame, from_records(samples, camera, **SIZE, **choices), are_counted=False)


@pytest.mark.some(1)
@pytest.mark.parametrize("thickness", [1e-6, 1e-3, 0.02])
def test_sheets_may_be_thin(rng, thickness):
    samples = box(rng)
    choices = {"primitive": Primitive.POINTS, "order": EverySample(thickness=thickness)}
    frame = painter(**choices)(samples, FAR, **SIZE)
    other = from_records(samples, FAR, **SIZE, **choices)
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=TOLERANCE)
    # Areas are as large as layers are thin, and so are the steps of what they cover at rims.
    np.testing.assert_allclose(frame.coverage, other.coverage, atol=1e-3)


@pytest.mark.parametrize("pixel", [Box(), Mitchell()], ids=repr)
def test_steps_and_lobes_have_no_formula(pixel):
    assert profile(table(pixel)) is None


@pytest.mark.each_value
@pytest.mark.parametrize("longest", [1, 7, 256])
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_runs_change_no_bit(rng, monkeypatch, camera, longest):
    samples, resample = box(rng), painter(primitive=Primitive.POINTS)
    frame = resample(samples, camera, **SIZE)
    monkeypatch.setattr(deferred_points, "LONGEST_RUN", longest)
    assert_same(frame, resample(samples, camera, **SIZE))


@pytest.mark.parametrize("key", ["depth", "distance"])
@pytest.mark.parametrize("extinction", [0.02, 6.0])
def test_the_order_of_samples_changes_no_bit(rng, key, extinction):
    resample = painter(primitive=Primitive.POINTS, order=EverySample(key=key))
    samples = box(rng, extinction)
    other = shuffled(samples, rng)
    assert_same(resample(samples, FAR, **SIZE), resample(other, FAR, **SIZE))


@pytest.mark.sweep
def test_samples_beside_the_view_do_no_harm(rng):
    samples, choice = box(rng, side=40), {"primitive": Primitive.POINTS}
    camera = Camera.from_intrinsics(60.0, 60.0, -5.0, 50.0, look_at((20, -150, 60), (0, 0, 0)))
    frame = painter(**choice)(samples, camera, **SIZE)
    assert 0 < frame.statistics.points < samples.extinction.size
    assert_alike(frame, from_records(samples, camera, **SIZE, **choice))


def test_threads_change_no_bit(rng):
    samples, resample = box(rng), painter(primitive=Primitive.POINTS)
    assert_same(*(resample(samples, FAR, threads=count, **SIZE) for count in (1, 2)))


@pytest.mark.sweep
def test_hidden_points_are_skipped(rng):
    samples = box(rng, 50.0, 64)
    resample = painter(primitive=Primitive.POINTS)
    assert resample(samples, FAR, **SIZE).statistics.hidden > 10000


@pytest.mark.sweep
def test_colors_may_be_bright(rng):
    samples = box(rng, side=9)._replace(color=rng.uniform(0, 500, (9**3, 3)).astype(np.float32))
    frame = painter(primitive=Primitive.POINTS)(samples, FAR, **SIZE)
    other = from_records(samples, FAR, **SIZE, primitive=Primitive.POINTS)
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=500 * TOLERANCE)


def test_lines_are_spread_as_the_obvious_loop_spreads_them(rng):
    amount, weight = rng.uniform(0, 1, 24), rng.uniform(0, 1, 40)
    cells, rounding = rng.uniform(0, 1, 400), 1.5 * 2.0**28
    expected = cells.copy()
    for row in range(3):
        shares = (amount[8:16] * weight[20 + 5 * row] + rounding) - rounding
        for column in range(3):
            first = 16 + 80 * row + 8 * column
            expected[first : first + 8] += shares * weight[2 + 5 * column]
    spread(cells, (16, 80), amount, 8, rounding, weight, (2, 20, 5, 3))
    np.testing.assert_allclose(cells, expected, rtol=1e-15)
