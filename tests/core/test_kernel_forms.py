"""The same in another guise compiles nothing anew: what kernels get is made alike at the doors."""

from typing import Any

import numpy as np
import pytest

from resample import Camera, Resampler, particles
from resample.engine.ellipsoids.run_bounds import break_runs, outline_runs
from resample.engine.mixtures.deferred import find_spacings, paint_runs
from resample.engine.rays.coefficients import find_bounds, find_coefficients
from resample.engine.rays.painting import paint_rays
from resample.engine.subpixels import grid, grid_of
from resample.painting.choices import Primitive
from resample.painting.preparing import style_of
from resample.painting.splines import spline_of
from resample.profiles.orders import Rays
from resample.types import Classifier, Lamp, LatticeField, Style
from resample_comparisons.volume.kernels.slabs.painting import paint_summed_runs
from resample_comparisons.volume.painting import ImageSheets
from tests.core.test_windows import HEIGHT, WIDTH, camera, cloud
from tests.kernels import compiled_only, specialisations
from tests.samples import CAMERAS, SIDE, block, field_cloud

pytestmark = compiled_only

LOOK = Classifier(
    np.linspace(0, 1, 32, dtype=np.float32).reshape(1, 8, 4), -1.0, 3.0, 1.0,
    Lamp(np.zeros(3), np.array([6.0, -5.0, 4.0, 1.0]), 0.0, 1.0, 0.0, 8.0, 0.0), 0.0, 1.0, 0.0,
)  # fmt: skip
SEEN = {"camera": CAMERAS["narrow"], "height": SIDE, "width": SIDE}


def frozen(array: Any) -> Any:
    array = np.array(array)
    array.setflags(write=False)
    return array


def strided(array: Any) -> Any:
    return np.repeat(array, 2, axis=-1)[..., ::2]


def in_bytes(array: Any) -> Any:
    """Array that begins between two numbers."""
    return np.frombuffer(b"\0" + array.tobytes(), array.dtype, offset=1).reshape(array.shape)


GUISES = {"frozen": frozen, "columns": np.asfortranarray, "strided": strided, "bytes": in_bytes}


def forms(*kernels: Any) -> list[int]:
    return [specialisations(kernel) for kernel in kernels]


@pytest.mark.parametrize("guise", GUISES.values(), ids=GUISES)
def test_samples_in_any_guise_are_painted_by_the_same_kernels(guise: Any) -> None:
    kernels, samples = (paint_runs, outline_runs, break_runs), block(3)
    truth = Resampler()(samples, **SEEN).rgba
    before = forms(*kernels)
    disguised = samples._replace(
        **{name: guise(getattr(samples, name)) for name in ("position", "color", "lattice")},
        extinction=guise(samples.extinction[None])[0],
    )
    np.testing.assert_array_equal(Resampler()(disguised, **SEEN).rgba, truth)
    assert forms(*kernels) == before


def test_a_single_particle_is_painted_by_the_kernels_of_many() -> None:
    eye, size = Camera.from_fov(60, SIDE, SIDE), {"height": SIDE, "width": SIDE}
    resample = Resampler(primitive=Primitive.SPLATS)
    resample(particles([[0, 0, 5], [0, 1, 6]], (1, 0, 0), 0.9, 1), eye, **size)
    before = forms(paint_runs, outline_runs)
    resample(particles([[0, 0, 5]], (1, 0, 0), 0.9, 1), eye, **size)
    assert forms(paint_runs, outline_runs) == before


@pytest.mark.parametrize(
    "choices",
    [
        {"splat_color": (1, 0, 0)},
        {"splat_color": np.float32([0.5, 0.2, 0.1])},
        {"subpixels": np.int32(3)},
        {"threshold": 0},
    ],
)
def test_choices_may_be_numbers_of_any_type(choices: dict[str, Any]) -> None:
    Resampler()(block(3), **SEEN)
    before = forms(paint_runs, outline_runs)
    Resampler(**choices)(block(3), **SEEN)
    assert forms(paint_runs, outline_runs) == before


GUISES_OF_LOOKS = {
    "integers": LOOK._replace(
        low=-1, high=3, steep=1, near=0, far=1, dimmed=0,
        lamp=LOOK.lamp._replace(ambient=0, diffuse=1, specular=0, shininess=8, flat=0),
    ),
    "float32": LOOK._replace(low=np.float32(-1), high=np.float32(3)),
    "frozen": LOOK._replace(
        table=frozen(LOOK.table), lamp=LOOK.lamp._replace(toward=frozen(LOOK.lamp.toward))
    ),
    "columns": LOOK._replace(table=np.asfortranarray(LOOK.table)),
}  # fmt: skip


@pytest.mark.parametrize("look", GUISES_OF_LOOKS.values(), ids=GUISES_OF_LOOKS)
def test_looks_of_fields_may_be_numbers_of_any_type(look: Classifier) -> None:
    paint, field = Resampler(order=ImageSheets()), field_cloud(np.random.default_rng(1), LOOK)
    truth = paint(field, **SEEN).rgba
    before = forms(paint_summed_runs)
    np.testing.assert_array_equal(paint(field._replace(classifier=look), **SEEN).rgba, truth)
    assert forms(paint_summed_runs) == before


def lattice_field(look: Classifier, lattice: Any, origin: Any) -> LatticeField:
    values = np.random.default_rng(2).uniform(-1, 3, (4, 5, 6)).astype(np.float32)
    spline, bounds = spline_of(values)
    return LatticeField(spline, bounds, np.zeros(0, np.uint8), lattice, origin, look)


@pytest.mark.parametrize("look", GUISES_OF_LOOKS.values(), ids=GUISES_OF_LOOKS)
def test_rays_take_looks_and_lattices_in_any_guise(look: Classifier) -> None:
    paint = Resampler(order=Rays())
    truth = paint(lattice_field(LOOK, np.eye(3), np.full(3, -2.0)), **SEEN).rgba
    before = forms(paint_rays)
    given = lattice_field(look, frozen(np.eye(3, dtype=int)), np.full(3, -2))
    np.testing.assert_array_equal(paint(given, **SEEN).rgba, truth)
    assert forms(paint_rays) == before


def test_fields_of_five_types_are_found_by_one_kernel_for_each_that_they_are_held_in() -> None:
    values = np.random.default_rng(3).integers(0, 100, (5, 6, 7))
    before, after = forms(find_coefficients, find_bounds), []
    for kind in ("uint8", "int8", "uint16", "int16", "float32"):
        spline_of(values.astype(kind))
        after.append(forms(find_coefficients, find_bounds))
    assert after[1] == after[0]  # both are held in 16 bits
    assert after[4] == after[3] == after[2]
    assert after[4][0] - before[0] <= 2  # held in 16 bits, and in float32
    assert after[4][1] - before[1] <= 1


def test_spacings_of_tiles_are_found_by_one_kernel() -> None:
    samples, eye = cloud(300, 20.0, 12), camera()
    counts = []
    for primitive in (Primitive.SPLATS, Primitive.EWA):
        paint = Resampler(primitive=primitive, threshold=0.0)
        paint(samples, eye, height=HEIGHT, width=WIDTH)
        counts.append(specialisations(find_spacings))
    assert counts[0] == counts[1]


# It compiles what nothing else does; records ask `grid_of`, and kernels `grid`.
@pytest.mark.sweep
def test_a_grid_is_found_without_a_kernel_and_is_that_of_the_kernel() -> None:
    style = style_of(Resampler(), np.eye(3), None)
    assert isinstance(style, Style)
    for spacing in (0.0, 1e-9, 0.01, 0.3, 0.5999999, 1.0, 7.0, np.inf, np.nan):
        for given in (spacing, np.float32(spacing)):
            assert grid_of(given, style) == grid(float(given), style)
