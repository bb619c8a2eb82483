"""Relative depth of films: scales and shifts that vary, cuts, and noise where nothing moves."""

from dataclasses import replace

import numpy as np
import pytest

from resample.colors import to_srgb
from resample_warp3d.command.films import DepthRanges
from resample_warp3d.depth.stabilization import SteadyDepth
from resample_warp3d.depth.temporal import LONGEST, Alignment, align, fitted, is_cut, thumbnail

SHAPE, COUNT = (60, 80), 8
RAMP = 0.2 + 0.3 * np.arange(SHAPE[1]) / SHAPE[1] + np.zeros(SHAPE)


def patches(seed=0, shape=SHAPE, size=4):
    """Linear light of random patches."""
    rng = np.random.default_rng(seed)
    few = rng.random((shape[0] // size, shape[1] // size, 3))
    return few.repeat(size, 0).repeat(size, 1).astype(np.float32)


def wobble(rng, count=COUNT):
    """Scales that vary by 15 % from map to map, and shifts."""
    return np.exp(rng.normal(0, 0.15, count)), rng.normal(0, 0.1, count)


def scene(n, *, nearer=0.02):
    """Colors and depth of a card that moves right and nearer before a still wall."""
    color, depth, left = patches().copy(), RAMP.copy(), 10 + 4 * n
    color[20:50, left : left + 24] = patches(1)[:30, :24]
    depth[20:50, left : left + 24] = 0.8 + nearer * n
    return color, depth


def aligned(found, maps):
    return [
        scale * depth + shift
        for scale, shift, depth in zip(found.scale, found.shift, maps, strict=True)
    ]


def test_scales_and_shifts_are_found_behind_what_moves(rng):
    scales, shifts = wobble(rng)
    films = [scene(n) for n in range(COUNT)]
    maps = [a * depth + b for a, b, (_, depth) in zip(scales, shifts, films, strict=True)]
    found = align(thumbnail(color, raw) for (color, _), raw in zip(films, maps, strict=True))
    assert found.starts == (0,)
    assert found.aligned == (True,)
    for made, (_, depth) in zip(aligned(found, maps), films, strict=True):
        np.testing.assert_allclose(made, scales[0] * depth + shifts[0], atol=1e-6)


def test_scales_and_shifts_are_found_while_the_camera_pans(rng):
    scales, shifts = wobble(rng)
    wide, depths = patches(2, (60, 160)), patches(3, (60, 160), 20)[..., 0].astype(float)
    views = [np.s_[:, 2 * n : 2 * n + 80] for n in range(COUNT)]
    maps = [a * depths[view] + b for a, b, view in zip(scales, shifts, views, strict=True)]
    found = align(thumbnail(wide[view], raw) for view, raw in zip(views, maps, strict=True))
    assert found.starts == (0,)
    for made, view in zip(aligned(found, maps), views, strict=True):
        np.testing.assert_allclose(made, scales[0] * depths[view] + shifts[0], atol=1e-6)


@pytest.mark.parametrize("nearer", [0.0, 0.02, 0.1])
def test_maps_that_agree_are_left_unchanged(nearer):
    found = align(thumbnail(*scene(n, nearer=nearer)) for n in range(COUNT))
    assert found.aligned == (False,)
    assert found.changes == 0
    ends = [(0.2, 0.8), (0.1, 0.9)] * (COUNT // 2)
    assert found.ends(ends) == [(0.1, 0.9)] * COUNT


def test_a_thing_that_comes_nearer_is_no_change_of_scale():
    near, is_moving = np.linspace(0.1, 0.3, 100), np.arange(100) < 30
    near[is_moving] += 0.4
    nearer = near + 0.3 * is_moving
    weight = np.where(is_moving, 0.02, 1.0)  # of changed colors
    np.testing.assert_allclose(fitted(nearer, near, weight), (1, 0), atol=1e-6)


def test_alignment_starts_again_at_cuts(rng):
    scales, shifts = wobble(rng)
    shots = [patches(4 if n < 5 else 5) ** (1 if n < 5 else 4) for n in range(COUNT)]
    maps = [a * RAMP + b for a, b in zip(scales, shifts, strict=True)]
    found = align(map(thumbnail, shots, maps))
    assert found.starts == (0, 5)
    assert (found.scale[[0, 5]] == 1).all()
    each = [(float(raw.min()), float(raw.max())) for raw in maps]
    np.testing.assert_allclose(found.ends(each), each, atol=1e-6)  # each map has all of its shot


def test_cuts_are_told_from_flashes_pans_and_fades():
    color = patches(6, (60, 160)) ** 0.5
    view = color[:, :80]
    assert not is_cut(view, np.clip(2 * view, 0, 1))
    assert not is_cut(view, color[:, 12:92])
    assert not is_cut(view, 0.9 * view)
    assert not is_cut(view, view[:, ::-1])
    assert is_cut(view, (0.3 * patches(7)).astype(np.float32))


def test_what_is_unknown_takes_no_part(rng):
    scales, shifts = wobble(rng)
    maps = [a * RAMP + b for a, b in zip(scales, shifts, strict=True)]
    for raw in maps:
        raw[rng.random(SHAPE) < 0.1] = rng.choice([np.nan, np.inf])
    found = align(thumbnail(patches(), raw) for raw in maps)
    np.testing.assert_allclose(found.scale * scales, scales[0], rtol=1e-6)


def test_depth_of_unchanged_pixels_is_kept(rng):
    color, steady = patches(), SteadyDepth(1.0)
    first = steady.added(color, RAMP.astype(np.float32))
    for _ in range(3):
        grain = (np.sqrt(color) + rng.normal(0, 0.004, color.shape)).astype(np.float32) ** 2
        noisy = (RAMP + rng.uniform(-0.01, 0.01, SHAPE)).astype(np.float32)
        np.testing.assert_array_equal(steady.added(grain, noisy), first)


def test_depth_that_moves_is_followed():
    steady = SteadyDepth(1.0)
    for n in range(4):
        color, depth = scene(n)
        kept = steady.added(color, depth.astype(np.float32))
        np.testing.assert_allclose(kept, depth, atol=0.003)
    jumped = (depth + 0.2).astype(np.float32)
    np.testing.assert_array_equal(steady.added(color, jumped), jumped)


def test_nothing_is_kept_where_the_camera_moves(rng):
    wide, steady = patches(2, (60, 160)), SteadyDepth(1.0)
    for n in range(4):
        noisy = (RAMP + rng.uniform(-0.01, 0.01, SHAPE)).astype(np.float32)
        color = np.ascontiguousarray(wide[:, 2 * n : 2 * n + 80])
        np.testing.assert_array_equal(steady.added(color, noisy), noisy)


def test_gaps_that_come_and_go_stay_filled():
    steady, whole = SteadyDepth(1.0), RAMP.astype(np.float32)
    gappy = whole.copy()
    gappy[10:20, 30:50] = 0
    steady.added(patches(), whole)
    np.testing.assert_array_equal(steady.added(patches(), gappy), whole)


@pytest.mark.parametrize(
    ("shape", "small"),
    [
        ((40, 60), (40, 60)), ((2 * LONGEST, LONGEST), (LONGEST, LONGEST // 2)),
        ((1, 3 * LONGEST), (1, LONGEST)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_thumbnails_are_no_larger_than_the_picture_and_have_its_proportions(shape, small, channels):
    color, raw = np.full((*shape, channels), 0.5, np.float32), np.full((7, 9), 3.0)
    made = thumbnail(color, raw)
    assert made.color.shape == (*small, 3)
    assert made.depth.shape == small
    np.testing.assert_allclose(made.color, to_srgb(np.float32(0.5)), atol=1e-6)
    np.testing.assert_allclose(made.depth, 3.0)


def test_a_report_has_six_digits_and_says_what_is_aligned():
    scale, shift = np.array([1.0, 1.23456789]), np.array([0.0, -0.1234567])
    found = Alignment(scale, shift, (0, 1), (True, False))
    ranges = DepthRanges([(0.0, 1.0)], found=found)
    told = ranges.report()
    assert told["scale"] == [1.0, 1.234568]
    assert told["shift"] == [0.0, -0.123457]
    assert (told["temporal"], told["aligned"], told["shots"]) == ("aligned", [True, False], [0])
    assert DepthRanges(None).report() == {"temporal": "none"}
    unchanged = replace(found, aligned=(False, False))
    assert ranges._replace(found=unchanged).report()["temporal"] == "unchanged"
