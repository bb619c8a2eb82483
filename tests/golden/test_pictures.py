"""Pictures of every painter are those on record, which `tests.golden.scenes` makes."""

import numpy as np
import pytest

from tests.golden.scenes import SCENES, recorded

ROUNDING = 4e-5  # of a picture's span: 16 bits, and which products and sums are one operation
BORDERLINE = 2e-3  # share of numbers where a choice, such as a tile's grid, may tip elsewhere

# Each has kernels compiled for itself, or the painter once more; what is new in it is tested by
# itself, and these tests are what keeps it.
KEPT_BY = {
    "depth image, mesh": "test_a_picture_is_the_one_on_record",
    "depth image, subsample": "test_a_picture_is_the_one_on_record",
    "depth image, ldi": "test_a_picture_is_the_one_on_record",
    "texture, splats, map": "test_a_picture_is_the_one_on_record",
    "texture, paper, map": "test_a_picture_is_the_one_on_record",
    "particles": "tests/core/test_scales.py::test_neither_order_nor_threads_change_a_bit",
    "volume, bspline": "tests/core/test_mixtures.py::test_pieces_are_the_line_integrals",
    "volume, linear opacity": "tests/core/test_mixtures.py::"
    "test_opacities_are_those_of_absorption_or_linear_in_the_line_integral",
}

known = pytest.fixture(scope="module")(recorded)


def test_every_scene_is_on_record(known):
    assert sorted(known) == sorted(SCENES)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.sweep) if name in KEPT_BY else name for name in SCENES],
)
def test_a_picture_is_the_one_on_record(name, known):
    found, wanted = np.asarray(SCENES[name](), np.float32), known[name]
    assert found.shape == wanted.shape
    error = np.abs(found - wanted) / max(1.0, float(np.ptp(wanted)))
    apart = error > ROUNDING
    assert apart.mean() <= BORDERLINE, f"{apart.mean():.2%} differ, by up to {error.max():.2g}"
