"""A uniform block has the transmittance of its depth, at any size and without a step in a zoom."""

import sys

import numpy as np
import pytest

from tests.benchmarks.splat_scenes import HYBRID, POINTS, SPLATS, TRUTH, Place, jumps, zoom

# The focal length zooms: rays keep their ways through the block, so that all that changes from
# frame to frame is what a pixel sees and how it is computed.
FAR = Place(distance=150, azimuth=0, elevation=0)  # along the lattice, where ripple is worst
TILTED = Place(distance=150, azimuth=9, elevation=6)
NEAR = Place(distance=53, azimuth=9, elevation=6)  # the back is four times as far as the front
SCALES = np.geomspace(4.0, 0.2, 12)  # px per voxel in the block's middle
FINE_SCALES = np.geomspace(4.0, 0.0374, 80)  # through every grid, and from all splats to none
MIXED_SCALES = np.geomspace(0.2, 0.0565, 40)  # at the end some are points


def largest_error(stills):
    return max(np.abs(still.error[still.interior]).max() for still in stills)


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("place", [FAR, TILTED], ids=["along the lattice", "tilted"])
@pytest.mark.parametrize(
    ("form", "scales"),
    [(POINTS, SCALES[SCALES < 0.6]), (SPLATS, SCALES[SCALES > 0.6]), (HYBRID, SCALES)],
    ids=["points far", "splats near", "hybrid"],
)
def test_a_constant_field_has_the_analytic_transmittance(form, scales, place, record):
    stills = zoom(place, scales, form)
    assert all(0.2 < still.analytic[still.interior].min() < 0.5 for still in stills)
    record.error("transmittance", largest_error(stills))


@pytest.mark.sweep
@pytest.mark.slow
def test_a_block_of_splats_around_a_sub_pixel_has_the_analytic_transmittance(record):
    stills = zoom(NEAR, (0.0595, 0.058, 0.0565), HYBRID)
    assert all(still.frame.statistics.splats > 0 for still in stills)
    record.error("transmittance", largest_error(stills))


def check_steps(record, place, *runs):
    """No step from frame to frame is larger than those of the truth; gives the grids."""
    grids, ours, reference = set(), [], []
    for scales in runs:
        hybrid = zoom(place, scales, HYBRID)
        grids |= {still.frame.statistics.subpixels for still in hybrid}
        ours.append(jumps(hybrid))
        reference.append(jumps(zoom(place, scales, TRUTH)))
    mean, pixel, error = np.max(ours, axis=0)
    sys.stdout.write(f"\ngrids {sorted(grids)}\nhybrid {ours}\nsplats 16 × 16 {reference}\n")
    assert mean <= 1.5 * max(steps.mean for steps in reference)
    assert pixel <= 1.5 * max(steps.pixel for steps in reference)
    record.error("transmittance", error)  # 0.004 is one of 255 levels
    return grids


@pytest.mark.sweep
@pytest.mark.slow
def test_the_first_grids_begin_without_a_step(record):
    """Where the whole zoom's largest steps and errors are."""
    first = (FINE_SCALES[n : n + 2] for n in (20, 31, 38))
    assert check_steps(record, FAR, *first) == {1, 2, 3, 4}


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("place", "scales"),
    [
        (FAR, FINE_SCALES[19:41]),  # 1 to 4 sub-pixels
        (NEAR, MIXED_SCALES[15:]),  # 14 to 16, and points
        (FAR, FINE_SCALES),
        (NEAR, MIXED_SCALES),
    ],
    ids=["first grids", "some points", "from splats to points", "mixtures"],
)
def test_a_zoom_crosses_every_threshold_without_a_step(place, scales, record):
    assert len(check_steps(record, place, scales)) >= 3
