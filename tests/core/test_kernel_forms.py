"""The same in another guise compiles nothing anew: what kernels get is made alike at the doors."""

from typing import Any

import numpy as np
import pytest

from resample import Camera, Resampler, particles
from resample.engine.rays.coefficients import find_bounds, find_coefficients
from resample.engine.rays.painting import paint_rays
from resample.engine.shaped.lists import deal_records
from resample.engine.shaped.painting import paint_behind
from resample.engine.shaped.records import project_shapes
from resample.painting.choices import Primitive
from resample.painting.splines import spline_of
from resample.profiles.orders import Rays
from resample.types import Classifier, Lamp, LatticeField
from tests.kernels import compiled_only, specialisations
from tests.samples import CAMERAS, SIDE, block

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
    kernels, samples = (paint_behind, deal_records, project_shapes), block(3)
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
    before = forms(paint_behind, project_shapes)
    resample(particles([[0, 0, 5]], (1, 0, 0), 0.9, 1), eye, **size)
    assert forms(paint_behind, project_shapes) == before


@pytest.mark.parametrize(
    "choices",
    [
        {"splat_color": (1, 0, 0)},
        {"splat_color": np.float32([0.5, 0.2, 0.1])},
        {"subpixels": np.int32(3)},
    ],
)
def test_choices_may_be_numbers_of_any_type(choices: dict[str, Any]) -> None:
    Resampler()(block(3), **SEEN)
    before = forms(paint_behind, project_shapes)
    Resampler(**choices)(block(3), **SEEN)
    assert forms(paint_behind, project_shapes) == before


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
