"""A minified checker box against 16 × 16 rays per pixel: notes/quality.md, "Minified volumes"."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.splat_scenes import (
    CRUST,
    HYBRID,
    SCALES,
    SPLATS,
    TRUTH,
    checker_box,
    distant,
    minification,
    object_psnr,
)

FEW = [(0.9, 0.125), (0.3, 0.25)]  # alpha and scale of what `make test` looks at
MORE = pytest.mark.sweep
NOISE = 0.05  # dB, between pictures that are equally good


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(
            (alpha, scale),
            id=f"alpha {alpha}, {scale} px",
            marks=[] if (alpha, scale) in FEW else [MORE],
        )
        for alpha in CRUST
        for scale in SCALES
    ],
)
def measured(request) -> dict[str, float]:
    """PSNR of every form in one case."""
    alpha, scale = request.param
    found = minification(alpha, scale)
    shown = ", ".join(f"{name} {value:.1f}" for name, value in found.items())
    sys.stdout.write(f"\nalpha {alpha}, {scale} px per voxel: {shown} dB\n")
    return found


@pytest.mark.sweep
@pytest.mark.slow
def test_hybrid_comes_near_sixteen_by_sixteen_rays(measured, record):
    record.quality("hybrid", measured["hybrid"])


@pytest.mark.some(2)
@pytest.mark.slow
@pytest.mark.parametrize("other", ["points", "splats"])
def test_hybrid_is_at_least_as_good_as_either_primitive_alone(measured, other):
    assert measured["hybrid"] >= measured[other] - NOISE


@pytest.mark.slow
def test_hybrid_is_better_than_the_papers_form(measured):
    assert measured["hybrid"] > measured["paper"]


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("alpha", [0.9, pytest.param(0.3, marks=pytest.mark.sweep)])
def test_the_truth_needs_no_voxel_behind_the_crust(alpha):
    crust, whole = (
        distant(0.125).by(TRUTH, checker_box(alpha, depth)).rgba for depth in (CRUST[alpha], None)
    )
    np.testing.assert_allclose(crust, whole, rtol=0, atol=1e-5)


@pytest.mark.sweep
@pytest.mark.slow
def test_the_truth_has_converged(record):
    # 32 rays a side, by moving the rays by a quarter of their distance each way.
    shot, samples = distant(0.125), checker_box(0.9, CRUST[0.9])
    camera = shot.camera
    moved = [
        shot._replace(
            camera=replace(
                camera, matrix=camera.matrix + np.array([[0, 0, right], [0, 0, down], [0, 0, 0]])
            )
        )
        for right in (-1 / 64, 1 / 64)
        for down in (-1 / 64, 1 / 64)
    ]
    twice = np.mean([each.by(TRUTH, samples).rgba for each in moved], axis=0)
    record.quality("truth", object_psnr(shot.by(TRUTH, samples).rgba, twice))


@pytest.mark.sweep
def test_hybrid_is_far_better_than_one_ray_per_pixel(record):
    # The gist of the slow tests, for every run.
    shot, samples = distant(0.125), checker_box(0.9, CRUST[0.9])
    truth = shot.by(TRUTH, samples).rgba
    hybrid = object_psnr(shot.by(HYBRID, samples).rgba, truth)
    assert hybrid > object_psnr(shot.by(SPLATS, samples).rgba, truth) + 10
    record.quality("hybrid", hybrid)
