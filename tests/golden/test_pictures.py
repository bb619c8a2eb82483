"""Pictures of every painter are those on record, which `tests.golden.scenes` makes."""

import numpy as np
import pytest

from tests.golden.scenes import SCENES, recorded
from tests.golden.sheets import write_sheet
from tests.golden.truths import NONE, decibels, stored, truth_of

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
truths = pytest.fixture(scope="module")(stored)


def test_every_scene_is_on_record(known):
    assert sorted(known) == sorted(SCENES)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.sweep) if name in KEPT_BY else name for name in SCENES],
)
def test_a_picture_is_the_one_on_record(name, known, truths, record):
    found, wanted = np.asarray(SCENES[name](), np.float32), known[name]
    assert found.shape == wanted.shape
    error = np.abs(found - wanted) / max(1.0, float(np.ptp(wanted)))
    apart = error > ROUNDING
    truth = truths.get(truth_of(name) or "")
    if not apart.mean() <= BORDERLINE:
        told, decibel = f"no truth: {NONE.get(name)}", None
        if truth is not None:
            decibel = decibels(wanted, truth), decibels(found, truth)
            told = f"{decibel[0]:.2f} dB to the truth before, {decibel[1]:.2f} dB now"
        sheet = write_sheet(name, wanted, found, decibel)
        pytest.fail(
            f"{apart.mean():.2%} differ, by up to {error.max():.2g}; {told}; see {sheet}; "
            f'if this is a gain: python -m tests.golden.scenes "{name}"'
        )
    if truth is not None:
        record.quality("to the truth", decibels(found, truth))
