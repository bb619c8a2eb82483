"""The checker box turned through 45°, where axis-aligned sheets pop (paper, section 4.1)."""

import sys

import numpy as np
import pytest

from tests.benchmarks.splat_scenes import HYBRID, SPLATS, rotation

AZIMUTHS = np.arange(40.0, 50.01, 0.25)  # degrees
NARROW = AZIMUTHS[15:26]  # those around 45°
MORE = pytest.mark.sweep
LARGEST = 1.15  # times the median: measured 1.08; exchanged sheets give several times the median


def crossing(change):
    """The steps from 44.75° to 45° and on to 45.25°."""
    return [change.size // 2 - 1, change.size // 2]


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(("hybrid", HYBRID, 0.5, NARROW), id="hybrid"),
        pytest.param(("splats", SPLATS, 1.5, NARROW), id="splats"),
        pytest.param(("hybrid", HYBRID, 0.5, AZIMUTHS), id="hybrid from afar", marks=MORE),
        pytest.param(("splats", SPLATS, 1.5, AZIMUTHS), id="splats from afar", marks=MORE),
    ],
)
def change(request) -> np.ndarray:
    """RMS difference of consecutive frames, of either form at the size it is for."""
    name, form, scale, azimuths = request.param
    found = rotation(form, scale, azimuths)
    sys.stdout.write(
        f"\n{name}: rms of frame differences has median {np.median(found):.4f}, largest "
        f"{found.max():.4f}, {found[crossing(found)].max():.4f} at 45°\n"
    )
    return found


@pytest.mark.sweep
@pytest.mark.slow
def test_a_turning_volume_changes_evenly(change):
    assert change.max() <= LARGEST * np.median(change)


@pytest.mark.sweep
@pytest.mark.slow
def test_nothing_pops_at_45_degrees(change):
    at = crossing(change)
    neighbours = np.delete(change, at)[at[0] - 4 : at[0] + 4]
    assert change[at].max() <= 1.1 * neighbours.max()
