"""Flicker of a small checker box that moves by 1/16 px a frame: notes/quality.md, "Flicker"."""

import sys

import numpy as np
import pytest

from tests.benchmarks.splat_scenes import (
    CRUST,
    HYBRID,
    SPLATS,
    TRUTH,
    checker_box,
    distant,
    flicker,
    shifted_truths,
)

MORE = pytest.mark.sweep


@pytest.mark.sweep
def test_one_fine_picture_holds_the_truths_of_all_shifts():
    truth = shifted_truths(0.9, 0.1, 4)[3]
    direct = distant(0.1, shift=3 / 16).by(TRUTH, checker_box(0.9, CRUST[0.9])).rgba
    np.testing.assert_allclose(truth, direct, rtol=0, atol=1e-4)  # float32 sums; opaque at 1e-4


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize(
    ("alpha", "scale", "frames"),
    [(0.9, 0.2, 4), pytest.param(0.9, 0.4, 16, marks=MORE), pytest.param(0.3, 0.2, 16, marks=MORE)],
)
def test_hybrid_flickers_a_tenth_as_much_as_one_ray_per_pixel(alpha, scale, frames):
    hybrid, splats = (flicker(form, alpha, scale, frames) for form in (HYBRID, SPLATS))
    sys.stdout.write(
        f"\nalpha {alpha}, blocks of {10 * scale:.0f} px: temporal rms of the error "
        f"{hybrid:.2f} of 255 levels, splats at one ray per pixel {splats:.2f}\n"
    )
    assert hybrid < 0.1 * splats
    assert hybrid < 2.0  # levels: not to be seen
