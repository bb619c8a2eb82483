"""Pictures of every painter are those on record, which `tests.golden.scenes` makes."""

import numpy as np
import pytest

from tests.golden.scenes import SCENES, recorded

ROUNDING = 4e-5  # of a picture's span: 16 bits, and which products and sums are one operation
BORDERLINE = 2e-3  # share of numbers where a choice, such as a tile's grid, may tip elsewhere

known = pytest.fixture(scope="module")(recorded)


def test_every_scene_is_on_record(known):
    assert sorted(known) == sorted(SCENES)


@pytest.mark.parametrize("name", SCENES)
def test_a_picture_is_the_one_on_record(name, known):
    found, wanted = np.asarray(SCENES[name](), np.float32), known[name]
    assert found.shape == wanted.shape
    error = np.abs(found - wanted) / max(1.0, float(np.ptp(wanted)))
    apart = error > ROUNDING
    assert apart.mean() <= BORDERLINE, f"{apart.mean():.2%} differ, by up to {error.max():.2g}"
