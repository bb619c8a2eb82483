"""Any footprint, kernel, opacity and order streams, and looks as it does from records."""

from dataclasses import dataclass

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.engine.ellipsoids.lanes import fall_of, line_integral, per_integral_of, t_of
from resample.engine.ellipsoids.mixed import Bend
from resample.engine.jit import kernel as compiled
from resample.painting.choices import Footprint, Opacity, Primitive
from resample.profiles.filters import Gaussian, Lanczos
from resample.profiles.orders import EverySample, Summing
from resample.profiles.reconstruction import (
    BSplineKernel,
    GaussianKernel,
    _line_integrals,
    footprint_pieces,
    footprint_profile,
    footprint_table,
)
from resample.types import Absorbing, Layers, Linear, Tabulated
from tests.bits import assert_same
from tests.records import from_records
from tests.samples import painter, shuffled
from tests.sheared import CAMERAS as SEEN
from tests.sheared import CLOSE, PLANE, SIZE, box

FAR = Camera.from_intrinsics(60.0, 60.0, 26.0, 21.0, look_at((20, -150, 60), (0, 0, 0)))
CAMERAS = {**SEEN, "far": FAR}
SMALL = 8  # samples a side


@dataclass(frozen=True)
class Shell:
    """A plugin's kernel with an edge, which no polynomial fits."""

    radius: float = 2.0

    def __call__(self, distance):
        return np.where(distance < 1.2, 1.0, 0.2) * (distance < self.radius)


@dataclass(frozen=True)
class Along:
    """A plugin's order along an axis of the scene, nearest to the eye first."""

    thickness: float = 1.0
    summing = Summing.POINTS

    def __call__(self, view, _):
        eye = float((-view.rotation.T @ view.translation)[1])
        return Layers((0.0, 1.0, 0.0), 0.0, self.thickness, eye if view.perspective else -np.inf)


CHOICES = {
    "spline": {"reconstruction": BSplineKernel()},
    "narrow": {"reconstruction": GaussianKernel(0.35)},
    "shell": {"reconstruction": Shell()},
    "linear": {"opacity": Opacity.LINEAR},
    "tint": {"splat_color": (1.0, 0.5, 0.0)},
    "affine": {"footprint": Footprint.AFFINE},
    "corrected": {"footprint": Footprint.CORRECTED},
    "small angles": {"footprint": Footprint.SMALL_ANGLE},
    "disc": {"footprint": Footprint.DISC},
    "inflate": {"primitive": Primitive.INFLATE},
    "ewa": {"primitive": Primitive.EWA},
    "points and splats": {"threshold": 1.3, "subpixels": 1, "splat_color": (0.0, 1.0, 0.0)},
    "points of a spline": {"threshold": 9.0, "subpixels": 4, "reconstruction": BSplineKernel()},
    "points": {"primitive": Primitive.POINTS},
    "along an axis": {"order": Along()},
    "a wide filter": {"pixel_filter": Lanczos(3)},
    "a wide filter, linear": {"pixel_filter": Lanczos(3), "opacity": Opacity.LINEAR},
    "by distance": {"order": EverySample(key="distance", thickness=2.0), "threshold": 1.3},
}


# Each of these has the painter compiled once more: what is new in them is tested by itself.
LINEAR = "test_opacities_are_those_of_absorption_or_linear_in_the_line_integral"
KEPT_BY = {
    "spline": "test_pieces_are_the_line_integrals",
    "narrow": "test_pieces_are_the_line_integrals",
    "linear": LINEAR,
    "a wide filter, linear": LINEAR,
    "points of a spline": "test_pieces_are_the_line_integrals",
    "shell": "test_all_kernels_are_one_integral_by_profile_pieces_or_table",
}
DAILY = [
    pytest.param(
        choice,
        id=name,
        marks=[pytest.mark.sweep] if name in KEPT_BY else [],
    )
    for name, choice in CHOICES.items()
]

# From inside, records leave out splats that reach into the frame by models which bend their rims,
# and put samples that are equally far, or cut by the eye's plane, in another order.
UNLIKE = [CHOICES[name] for name in ("affine", "small angles", "along an axis", "by distance")]


def assert_alike(frame, other, atol=1e-4):  # sub-pixels may become opaque one splat sooner
    np.testing.assert_allclose(frame.rgba, other.rgba, atol=atol)
    np.testing.assert_allclose(frame.coverage, other.coverage, atol=atol)
    clear = other.rgba[..., 3] > 0.01
    np.testing.assert_allclose(frame.depth[clear], other.depth[clear], rtol=1e-3)


@pytest.mark.some(1)
@pytest.mark.parametrize("choice", DAILY)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_what_streams_is_what_is_painted_from_records(rng, camera, choice):
    if camera is CAMERAS["inside"] and choice in UNLIKE:
        camera = CLOSE
    samples = box(rng, side=SMALL)
    frame = painter(**choice)(samples, camera, **SIZE)
    other = from_records(samples, camera, **SIZE, **choice)
    assert_alike(frame, other)
    assert frame.statistics.subpixels == other.statistics.subpixels
    for name in ("points", "splats") if camera is not CAMERAS["inside"] else ():
        assert getattr(frame.statistics, name) == getattr(other.statistics, name), name


@pytest.mark.sweep
@pytest.mark.parametrize("choice", DAILY)
def test_a_plane_cuts_what_streams(rng, choice):
    samples = box(rng, side=SMALL)
    frame = painter(**choice)(samples, CLOSE, clip=PLANE, **SIZE)
    assert_alike(frame, from_records(samples, CLOSE, clip=PLANE, **SIZE, **choice))


@pytest.mark.parametrize("choice", DAILY)
def test_order_of_samples_and_threads_change_no_bit(rng, choice):
    samples, resample = box(rng, 2.0, SMALL), painter(**choice)
    other = shuffled(samples, rng)
    frame = resample(samples, CLOSE, threads=1, **SIZE)
    assert_same(frame, resample(other, CLOSE, threads=2, **SIZE))


@pytest.mark.parametrize("kernel", [BSplineKernel(), GaussianKernel(), GaussianKernel(0.35)])
def test_pieces_are_the_line_integrals(kernel):
    distance = np.linspace(0, 1, 999)
    exact = _line_integrals(kernel, distance**2)
    piece = np.minimum((2 * distance).astype(int), 1)
    powers = (distance - (piece + 0.5) / 2)[:, None] ** np.arange(10)
    fitted = (np.array(footprint_pieces(kernel))[piece] * powers).sum(1) * np.sqrt(1 - distance**2)
    np.testing.assert_allclose(fitted, exact, atol=1e-5 * exact.max())


@pytest.mark.parametrize("sine", [0.0, 0.05, 0.6])
def test_a_bent_distance_is_the_index_corrected(sine):
    bend, form = Bend(*np.float32([1 - sine, sine, 1.0])), np.linspace(0, 1.2, 99)
    t = [t_of(bend, u, np.float32(1.0)) for u in form.astype(np.float32)]
    truth = np.where(form < 1, 1 - form / (1 - sine + sine * form), 0)
    np.testing.assert_allclose(t, truth, atol=3e-7)  # float32


@compiled
def integral_of(formula, t, chord):
    """The integral along a line, as painters find it."""
    return line_integral(formula, t, chord)


def test_all_kernels_are_one_integral_by_profile_pieces_or_table():
    kernel, chord = GaussianKernel(), np.float32(2.0)
    table = Tabulated(footprint_table(kernel).values)
    for t in np.linspace(0, 1, 50, dtype=np.float32):
        exact = integral_of(table, t, chord)
        for formula in (footprint_profile(kernel), footprint_pieces(kernel)):
            assert integral_of(formula, t, chord) == pytest.approx(exact, abs=1e-5)


@compiled
def opacity_of(kind, extinction, integral):
    """What a splat takes of the light along a ray, as painters find it."""
    per_integral, is_thin = per_integral_of(kind, extinction)
    return -fall_of(kind, per_integral * integral, is_thin)


@pytest.mark.parametrize("extinction", [0.01, 0.5, 3.0, 9.0])
def test_opacities_are_those_of_absorption_or_linear_in_the_line_integral(extinction):
    most, layer = 1.7, 0.8
    for integral in np.linspace(0, most, 50, dtype=np.float32):
        found = opacity_of(Absorbing(most), np.float32(extinction), integral)
        assert found == pytest.approx(-np.expm1(-extinction * integral), abs=1e-6)
        found = opacity_of(Linear(layer), np.float32(extinction), integral)
        assert found == pytest.approx(-np.expm1(-extinction * layer) / layer * integral, abs=1e-6)


def test_kernels_with_edges_have_no_pieces():
    assert footprint_pieces(Shell()) is None


def test_filters_that_reach_too_far_for_so_many_sub_pixels_are_refused(rng):
    resample = painter(pixel_filter=Gaussian(4.0, 16.0), subpixels=32)
    with pytest.raises(ValueError, match="at most 6 are possible"):
        resample(box(rng, side=SMALL), CLOSE, **SIZE)
