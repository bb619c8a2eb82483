"""The checker box turned through 45°, where axis-aligned sheets pop (paper, section 4.1)."""

import sys

import numpy as np
import pytest

from tests.benchmarks.quality_table import HYBRID, SPLATS, rotation

AZIMUTHS = np.arange(40.0, 50.01, 0.25)  # degrees
CROSSING = [19, 20]  # from 44.75° to 45° and on to 45.25°
LARGEST = 1.15  # times the median: measured 1.08; exchanged sheets give several times the median


@pytest.fixture(
    scope="module",
    params=[("hybrid", HYBRID, 0.5), ("splats", SPLATS, 1.5)],
    ids=lambda case: case[0],
)
def change(request) -> np.ndarray:
    """RMS difference of consecutive frames, of either form at the size it is for."""
    name, form, scale = request.param
    found = rotation(form, scale, AZIMUTHS)
    sys.stdout.write(
        f"\n{name}: rms of frame differences has median {np.median(found):.4f}, largest "
        f"{found.max():.4f}, {found[CROSSING].max():.4f} at 45°\n"
    )
    return found


@pytest.mark.slow
def test_a_turning_volume_changes_evenly(change):
    assert change.max() <= LARGEST * np.median(change)


@pytest.mark.slow
def test_nothing_pops_at_45_degrees(change):
    neighbours = np.delete(change, CROSSING)[CROSSING[0] - 4 : CROSSING[0] + 4]
    assert change[CROSSING].max() <= 1.1 * neighbours.max()
