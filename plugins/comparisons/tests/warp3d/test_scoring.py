import math

import numpy as np
import pytest

from resample_comparisons.warp3d.scoring import (
    HIGHEST,
    ScoringTarget,
    WarpedScreen,
    delivered,
    hole_percent,
    iv_psnr,
    masked_ssim,
    near_steps,
    score,
)

SHAPE = (32, 40)


@pytest.fixture
def truth(rng):
    return rng.random((*SHAPE, 3)).astype(np.float32)


@pytest.fixture
def mask():
    mask = np.zeros(SHAPE, np.bool_)
    mask[8:24, 8:32] = True
    return mask


def screen_of(image, covered):
    return WarpedScreen(image, covered, np.where(covered[..., None], image, 0))


def target_of(truth, mask):
    edge = np.zeros(SHAPE, np.bool_)
    edge[:, 20:] = True
    return ScoringTarget(truth, mask, edge)


def test_the_truth_scores_best(truth, mask):
    scores = score(screen_of(truth, np.ones(SHAPE, np.bool_)), target_of(truth, mask))
    assert scores["psnr"] == scores["edge psnr"] == scores["iv-psnr"] == math.inf
    assert scores["ssim"] == pytest.approx(1.0)
    assert scores["hole %"] == 0.0


def test_an_even_error_is_worth_its_decibels(truth, mask):
    scores = score(screen_of(truth + np.float32(0.1), mask), target_of(truth, mask))
    assert scores["psnr"] == pytest.approx(20.0, abs=1e-4)  # float32


def test_pixels_beyond_the_mask_do_not_count(truth, mask):
    spoiled = np.where(mask[..., None], truth, np.float32(0.5))
    assert score(screen_of(spoiled, mask), target_of(truth, mask))["psnr"] == math.inf


def test_holes_count_as_black(truth, mask):
    covered = mask.copy()
    covered[10, 10] = False
    expected = 10 * math.log10(mask.sum() * 3 / float((truth[10, 10].astype(float) ** 2).sum()))
    scores = score(screen_of(truth, covered), target_of(truth, mask))
    assert scores["psnr"] == pytest.approx(expected)


def test_a_pixel_that_is_half_covered_is_half_black_over_black(truth, mask):
    screen = WarpedScreen(truth, mask, 0.5 * truth)
    expected = 10 * math.log10(4 / float(np.mean(truth[mask].astype(float) ** 2)))
    scores = score(screen, target_of(truth, mask))
    assert scores["psnr"] == math.inf
    assert scores["black psnr"] == pytest.approx(expected)


def test_edges_count_alone_in_their_measure(truth, mask):
    image = truth.copy()
    image[:, 20:] += np.float32(0.1)
    scores = score(screen_of(image, mask), target_of(truth, mask))
    assert scores["edge psnr"] == pytest.approx(20.0, abs=1e-4)
    assert scores["psnr"] > 22


def test_without_edges_their_measure_is_left_out(truth, mask):
    target = ScoringTarget(truth, mask, np.zeros(SHAPE, np.bool_))
    assert score(screen_of(truth, mask), target)["edge psnr"] is None


def test_hole_percent_is_a_share_of_the_mask(mask):
    covered = mask.copy()
    covered[8:10, 8:32] = False
    covered[0, 0] = False
    assert hole_percent(covered, mask) == pytest.approx(100 * 2 / 16)


def test_delivered_colors_are_without_their_coverage():
    image = np.array([[[0.2], [0.0], [0.3]]], np.float32)
    color, covered = delivered(image, np.array([[0.5, 0.0, 1.0]], np.float32))
    np.testing.assert_allclose(color[0, :, 0], [0.4, 0.0, 0.3])
    assert covered.tolist() == [[True, False, True]]


@pytest.mark.parametrize(("down", "right"), [(2, 0), (0, -2), (1, 2), (-2, -2)])
def test_iv_psnr_forgives_shifts_of_two_pixels(truth, mask, down, right):
    picture = truth * mask[..., None]  # dark around, so that the mean stays
    assert iv_psnr(np.roll(picture, (down, right), (0, 1)), picture) == pytest.approx(HIGHEST)


def test_iv_psnr_does_not_forgive_shifts_of_three_pixels(truth, mask):
    picture = truth * mask[..., None]
    assert iv_psnr(np.roll(picture, 3, axis=1), picture) < 25


def test_iv_psnr_forgives_a_small_offset_of_color(truth, mask):
    assert iv_psnr(truth + np.float32(0.009), truth, mask) > 80


def test_iv_psnr_takes_out_one_percent_of_a_larger_offset():
    gray = np.full((*SHAPE, 3), 0.5, np.float32)
    decibels = iv_psnr(gray + np.float32(0.06), gray)
    # Luma is off by 0.05; the chromas, which are not, count as HIGHEST.
    expected = (4 * -20 * math.log10(0.05) + 2 * HIGHEST) / 6
    assert decibels == pytest.approx(expected, abs=1e-3)


def test_iv_psnr_is_the_lower_one_of_both_directions(truth, mask):
    flat = np.full_like(truth, truth.mean())
    assert iv_psnr(flat, truth, mask) == pytest.approx(iv_psnr(truth, flat, mask))


def test_iv_psnr_compares_with_the_naive_search(rng):
    a, b = (rng.random((9, 8, 3)) for _ in range(2))
    to_ycc = np.array([[0.2126, 0.7152, 0.0722], [-0.1146, -0.3854, 0.5], [0.5, -0.4542, -0.0458]])
    weight = np.array([4, 1, 1]) / 6
    directions = []
    for first, second in ((a @ to_ycc.T, b @ to_ycc.T), (b @ to_ycc.T, a @ to_ycc.T)):
        offset = np.clip((second - first).mean(axis=(0, 1)), -0.01, 0.01)
        errors = []
        for row in range(9):
            for column in range(8):
                block = second[max(0, row - 2) : row + 3, max(0, column - 2) : column + 3]
                square = ((first[row, column] + offset - block) ** 2).reshape(-1, 3)
                errors.append(square[np.argmin(square @ weight)])
        directions.append(-10 * np.log10(np.mean(errors, axis=0)) @ weight)
    assert iv_psnr(a, b) == pytest.approx(min(directions), abs=1e-3)  # float32


def test_ssim_of_a_mask_ignores_what_is_beyond(truth, mask):
    image = truth.copy()
    image[~mask] = 0
    assert masked_ssim(image, truth, mask) == pytest.approx(1.0)


def test_two_pixels_around_a_step_are_near_it():
    nearest, farthest = np.full(SHAPE, 2.0), np.full(SHAPE, 2.05)
    farthest[16, 20] = 2.07
    near = near_steps(nearest, farthest)
    assert near.sum() == 25
    assert near[14:19, 18:23].all()


def test_emptiness_is_no_step():
    assert not near_steps(np.full(SHAPE, np.inf), np.full(SHAPE, np.inf)).any()
