import math
import time
from functools import cache

import numpy as np
import pytest

import resample_texture.warping
from resample.cameras.models import Camera
from resample.measuring.quality import psnr
from resample_warp3d.depth.equation import between, of_rectified
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.methods.hybrid import Hybrid, Preview
from resample_warp3d.types import DepthImage, Hole
from resample_warp3d.warping import render
from tests.warp3d.naive_sheet import EMPTY, ball, camera_at, depth_image, flat, pattern, plane, see
from tests.warp3d.naive_warp import EQUATIONS, random_source

SHAPE = 64, 64
SOURCE = camera_at()
LEVEL = (0.7, 0.3, 0.5)


def is_on_card(point):
    return (abs(point[..., 0]) < 0.5) & (abs(point[..., 1] - 0.1) < 0.4)


WALL = plane((0.2, 0.1, 1.0), 4.0, pattern(6.0))
CARD = plane((0.0, 0.0, 1.0), 2.5, pattern(3.0), is_on_card)
SCENES = {
    "wall": [WALL],
    "card": [CARD, plane((0.2, 0.1, 1.0), 4.0, pattern(2.0))],
    "ball": [ball((0.2, 0.1, 3.0), 0.6, pattern(3.0)), plane((0, 0, 1), 4.0, pattern(2.0))],
}
VIEWS = {
    "side": camera_at((0.15, -0.05, 0.05), 0.02),
    "roll": camera_at((0.05, 0.0, 0.1), 0.02, 0.5),
    "back4": camera_at((0.1, 0.2, -11.0)),
    "in3": camera_at((0.05, 0.05, 1.4)),
    "oblique": camera_at((2.0, -0.1, 1.0), -0.6),
}


@cache
def source_of(scene):
    return prepare(depth_image(SCENES[scene], SOURCE, SHAPE))


@cache
def truth_of(scene, view):
    return see(SCENES[scene], VIEWS[view], SHAPE, rays=8, other=SOURCE, other_shape=SHAPE)


def rendered(source, target, method=None, shape=SHAPE):
    return render(source, between(SOURCE, target), shape, method or Hybrid())


def picture(color, nearness, **given):
    """Source of numbers that broadcast to (H, W, C) and (H, W)."""
    color = np.ascontiguousarray(np.broadcast_to(color, (*SHAPE, np.shape(color)[-1])), np.float32)
    nearness = np.ascontiguousarray(np.broadcast_to(nearness, SHAPE), np.float32)
    return prepare(DepthImage(color, nearness, EMPTY), **given)


def eroded(mask, reach=1):
    for _ in range(reach):
        inner = np.zeros_like(mask)
        inner[1:-1, 1:-1] = (
            mask[1:-1, 1:-1] & mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
        )
        mask = inner
    return mask


TRUE = "side", "roll", "back4", "in3", "oblique"


# The waves have 5 px in the source and more: pixels' means are exact, what is interpolated between
# them is not. At silhouettes (card, ball) errors of a few hundredths of a pixel decide.
@pytest.mark.sweep
@pytest.mark.parametrize(
    ("scene", "view"),
    [
        *((scene, view) for scene in ("wall", "card") for view in TRUE),
        *(("ball", view) for view in TRUE if view != "oblique"),
    ],
)
def test_it_shows_what_rays_show(scene, view, record):
    truth = truth_of(scene, view)
    given = rendered(source_of(scene), VIEWS[view]).image
    # All pixels that the source sees whole, against 8 × 8 rays in each.
    found = psnr(given, truth.color.astype(np.float32), mask=truth.shown > 0.999)
    record.quality("picture", found)


@pytest.mark.sweep
@pytest.mark.parametrize("view", ["roll", "oblique"])
def test_more_quality_is_better_where_cells_lie_askew(view, record):
    truth = truth_of("wall", view)
    usual, more = (rendered(source_of("wall"), VIEWS[view], Hybrid(quality=q)) for q in (1, 4))
    mask = eroded(truth.shown > 0.999, 3)
    color = truth.color.astype(np.float32)
    better = psnr(more.image, color, mask=mask)
    assert better > psnr(usual.image, color, mask=mask) + 3
    record.quality("quality 4", better)


@pytest.mark.some(1)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("view", ["side", "roll", "back4", "in3"])
def test_what_the_source_sees_whole_is_no_hole(scene, view):
    truth = truth_of(scene, view)
    given = rendered(source_of(scene), VIEWS[view])
    assert given.coverage[truth.shown == 1].min() > 0.5


@pytest.mark.parametrize("view", VIEWS)
def test_depth_is_that_of_the_target_to_a_pixel(view):
    truth = truth_of("wall", view)
    is_inside = eroded(truth.shown == 1)
    given = rendered(source_of("wall"), VIEWS[view]).depth
    # The nearest of the cells over a pixel, which may end half a pixel beyond its center each way.
    per_pixel = np.abs(np.gradient(truth.depth)).sum(axis=0)
    assert (np.abs(given - truth.depth) < 0.75 * per_pixel + 1e-5 * truth.depth)[is_inside].all()


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 5, 7])
def test_identity_is_exact_in_any_number_of_channels(channels, rng):
    color = rng.normal(0, 100, (*SHAPE, channels))  # beyond 0..1 on both sides
    color[3, 4] = 1e30
    source = picture(color, 1 / truth_of("card", "side").depth)
    given = rendered(source, SOURCE)
    np.testing.assert_array_equal(given.image, source.color)
    np.testing.assert_array_equal(given.coverage, 1)
    np.testing.assert_array_equal(given.holes, Hole.NONE)


def test_identity_leaves_out_what_has_no_depth(rng):
    nearness = np.where(rng.random(SHAPE) < 0.1, 0.0, 0.4)
    source = picture(rng.random((*SHAPE, 3)), nearness, refine="none")
    given = rendered(source, SOURCE)
    is_known = nearness > 0
    np.testing.assert_array_equal(given.image, np.where(is_known[..., None], source.color, 0))
    np.testing.assert_array_equal(given.coverage, is_known)
    np.testing.assert_array_equal(given.holes == Hole.NO_DEPTH, ~is_known)
    np.testing.assert_array_equal(np.isinf(given.depth), ~is_known)


def test_a_picture_hardly_changes_when_the_camera_hardly_moves(record):
    source = source_of("card")
    given = rendered(source, camera_at((0.001 * 2.5 / 64, 0, 0)))  # 0.001 px
    # Beside silhouettes, samples mix what they show anew.
    record.quality("picture", psnr(given.image, source.color))
    is_inside = eroded(source.links == 15)
    record.error("largest inside", np.abs(given.image - source.color)[is_inside].max())


@pytest.mark.some(1)
@pytest.mark.parametrize("pixels", [1, 3, 7])
@pytest.mark.parametrize("axis", [0, 1])
def test_moves_by_whole_pixels_move_samples(pixels, axis):
    image = depth_image([plane((0, 0, 1), 4.0, pattern(6.0))], SOURCE, SHAPE, rays=4)
    eye = np.eye(3)[axis] * pixels * 4 / 64
    given = rendered(prepare(image), camera_at(eye)).image
    expected = np.roll(image.color, -pixels, axis=1 - axis)
    inside = np.s_[2 : -2 - pixels, 2 : -2 - pixels]
    np.testing.assert_allclose(given[inside], expected[inside], atol=3e-6)  # px in float32


@pytest.mark.parametrize("disparity", [2.0, 3.5])
def test_rectified_pairs_move_by_their_disparity(disparity):
    color = 0.5 + 0.4 * np.sin(0.5 * np.arange(64))[None, :, None]
    given = render(picture(color, disparity), of_rectified(1.0), SHAPE, Hybrid())
    moved = 0.5 + 0.4 * np.sin(0.5 * (np.arange(64) + disparity))
    # Half way between samples, the mean of two flattens a wave of 12.6 px by 3 %.
    np.testing.assert_allclose(given.image[5, 3:-7, 0], moved[3:-7], atol=0.4 * 0.035)


@pytest.mark.parametrize("focal", [25.0, 64.0, 160.0])
def test_a_rotation_warps_as_textures_do(focal, record):
    target = camera_at((0, 0, 0), 0.1, 0.3, focal=focal)
    image = depth_image([plane((0, 0, 1), 4.0, pattern(4.0))], SOURCE, SHAPE, rays=4)
    given = rendered(prepare(image), target)
    equation = between(SOURCE, target)
    texture = resample_texture.warping.warp(image.color, equation.matrix, SHAPE, filter="area")
    is_inside = eroded(texture.coverage > 0.999, 6 if focal > 100 else 2)
    # Colors are interpolated in other ways: Catmull-Rom there, parabolas here.
    record.quality("picture", psnr(given.image, texture.image, mask=is_inside))


def test_a_plane_warps_as_textures_do(record):
    target = camera_at((0.3, 0.2, -0.5), 0.1, 0.3)
    image = depth_image([plane((0, 0, 1), 4.0, pattern(4.0))], SOURCE, SHAPE, rays=4)
    given = rendered(prepare(image), target)
    equation = between(SOURCE, target)
    matrix = equation.matrix + np.outer(equation.epipole, [0, 0, 0.25])
    texture = resample_texture.warping.warp(image.color, matrix, SHAPE, filter="area")
    is_inside = eroded(texture.coverage > 0.999, 2)
    record.quality("picture", psnr(given.image, texture.image, mask=is_inside))


# What is bridged takes the color of sides that may be covered to 97 % only, as if they were full.
BRIDGED = 0.03
CLOSER = {
    "at a quarter": camera_at((0.3, 0.2, -11.7), 0.01, 0.3),
    "at 1 / 1.3": camera_at((0.1, 0.0, -1.0), 0.02, 0.2),
    "1.3 times": camera_at((0.0, 0.0, 1.0)),
    "5 times": camera_at((0.05, -0.03, 3.2), 0.05, 0.4),
    "at an angle": camera_at((3.4, 0.0, 2.4), -1.1),
    "at another": camera_at((-3.4, 0.5, 2.4), 1.1, 0.3),
}


@pytest.mark.some(1)
@pytest.mark.parametrize("view", CLOSER)
def test_a_constant_color_stays_constant(view):
    wall = [plane((0.2, 0.1, 1.0), 4.0, flat(*LEVEL))]
    shown = see(wall, CLOSER[view], SHAPE, rays=4, other=SOURCE, other_shape=SHAPE).shown
    given = rendered(prepare(depth_image(wall, SOURCE, SHAPE, rays=1)), CLOSER[view])
    is_inside = eroded(shown > 0.999)
    assert is_inside.any()
    color = given.image[is_inside] / given.coverage[is_inside][:, None]
    np.testing.assert_allclose(color, np.broadcast_to(LEVEL, color.shape), atol=BRIDGED)


@pytest.mark.some(1)
@pytest.mark.parametrize("view", CLOSER)
def test_there_is_no_gap_inside_a_surface(view):
    wall = [plane((0.2, 0.1, 1.0), 4.0, flat(*LEVEL))]
    shown = see(wall, CLOSER[view], SHAPE, rays=4, other=SOURCE, other_shape=SHAPE).shown
    given = rendered(prepare(depth_image(wall, SOURCE, SHAPE, rays=1)), CLOSER[view])
    # Boxes stand for cells: what they leave out here, they cover twice there, up to 6 %.
    assert given.coverage[eroded(shown > 0.999)].min() > 0.94


@pytest.mark.parametrize("view", CLOSER)
def test_the_picture_is_multiplied_by_the_coverage(view):
    wall = [plane((0.2, 0.1, 1.0), 4.0, flat(*LEVEL))]
    given = rendered(prepare(depth_image(wall, SOURCE, SHAPE, rays=1)), CLOSER[view])
    np.testing.assert_allclose(given.image, given.coverage[..., None] * LEVEL, atol=BRIDGED)


# A white card at 2.5 before black, in px from the middle of the source: left, top, right, bottom.
SIDES = np.array([-12.75, -8.1875, 12.3125, 12.6875])  # which 16 rays per pixel measure exactly


def is_on_white(point):
    x, y = 64 / 2.5 * point[..., 0], 64 / 2.5 * point[..., 1]
    return (x > SIDES[0]) & (x < SIDES[2]) & (y > SIDES[1]) & (y < SIDES[3])


ALONE = plane((0.0, 0.0, 1.0), 2.5, flat(1.0), is_on_white)
BEHIND = plane((0.0, 0.0, 1.0), 5.0, flat(0.0))


@pytest.mark.sweep
@pytest.mark.parametrize("eye", [(1e-5, 0, 0), (0.1, 0.03, 0), (0, 0, 1.0), (0, 0, 1.8)])
def test_silhouettes_cover_the_share_of_a_pixel_that_they_do(eye, record):
    things, target = [ALONE, BEHIND], camera_at(eye)
    given = rendered(prepare(depth_image(things, SOURCE, SHAPE)), target).image[..., 0]
    scale = 64 / (2.5 - eye[2])
    left, top, right, bottom = scale * (SIDES * 2.5 / 64 - np.tile(eye[:2], 2)) + 32
    start = np.arange(64)
    width = np.clip(np.minimum(right, start + 1) - np.maximum(left, start), 0, 1)
    height = np.clip(np.minimum(bottom, start + 1) - np.maximum(top, start), 0, 1)
    share = height[:, None] * width
    shown = see(things, target, SHAPE, rays=4, other=SOURCE, other_shape=SHAPE).shown
    is_edge = (shown == 1) & (abs(share - 0.5) < 0.5)
    error = np.abs(given - share)[is_edge]
    # 97 % of a pixel count as all of it; the card's corners are known to a part of a sample only.
    record.error("median", np.median(error))
    record.error("largest", error.max())


@pytest.mark.sweep
def test_silhouettes_of_a_turned_picture_cover_their_share(record):
    things, target = [ALONE, BEHIND], camera_at((0, 0, 0), 0, 0.3)
    given = rendered(prepare(depth_image(things, SOURCE, SHAPE)), target).image[..., 0]
    truth = see(things, target, SHAPE, other=SOURCE, other_shape=SHAPE)
    error = np.abs(given - truth.share[..., 0])[truth.shown == 1]
    record.error(
        "largest", error.max()
    )  # a corner; 0.06 along the sides, where boxes stand for cells
    record.error("share over 0.07", error > 0.07)


@pytest.mark.sweep
def test_without_anything_behind_it_a_surface_covers_its_area():
    source = prepare(depth_image([ALONE], SOURCE, SHAPE))
    target = camera_at((0.0, 0.0, -3.0))
    truth = see([ALONE], target, SHAPE).share.sum()
    # Where its silhouette runs between the samples nothing tells: half a sample all around is 8 %.
    assert rendered(source, target).coverage.sum() == pytest.approx(truth, rel=0.08)


def turned_around(depth):
    """Camera on the axis at twice a depth, looking back."""
    turn = np.diag([-1.0, 1.0, -1.0])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, -turn @ [0, 0, 2 * depth]
    return SOURCE.moved(pose)


def test_back_faces_are_not_seen():
    source = prepare(depth_image([ball((0, 0, 3), 0.8, flat(1.0))], SOURCE, SHAPE, rays=1))
    given = rendered(source, turned_around(3.0))
    assert not given.coverage.any()
    assert not given.image.any()
    assert np.isinf(given.depth).all()


@pytest.mark.sweep
@pytest.mark.parametrize(
    "target", [camera_at((0.3, 0.03, 0)), camera_at((0.3, 0, -3.0)), camera_at((1.2, 0, 0), -0.4)]
)
@pytest.mark.parametrize("gap", [1.005, 1.05, 2.0])
def test_what_is_hidden_does_not_bleed(target, gap):
    things = [
        plane((0, 0, 1), 2.0, flat(0, 0, 1), lambda point: abs(point[..., 0]) < 0.6),
        plane((0, 0, 1), 2.0 * gap, flat(1, 0, 0)),
    ]
    truth = see(things, target, SHAPE, other=SOURCE, other_shape=SHAPE)
    given = rendered(prepare(depth_image(things, SOURCE, SHAPE, rays=8)), target).image
    for n, other in ((0, 0), (1, 2)):
        is_whole = (truth.share[..., n] == 1) & (truth.shown == 1)
        # Of a silhouette's contrast, a thousandth is not trusted; a box leaks what it is too wide.
        assert given[is_whole][:, other].max() < 5e-3


@pytest.mark.sweep
@pytest.mark.parametrize("view", ["side", "in"])
def test_there_and_back_gives_the_picture_again(view, record):
    target = {"side": camera_at((0.2, 0.1, 0.1), 0.03, 0.1), "in": camera_at((0, 0, 1.0))}[view]
    image = depth_image([plane((0, 0, 1), 4.0, pattern(4.0))], SOURCE, SHAPE)
    there = rendered(prepare(image), target)
    nearness = np.where(there.coverage > 0.99, 1 / there.depth, 0).astype(np.float32)
    again = prepare(DepthImage(there.image, nearness, EMPTY))
    back = render(again, between(target, SOURCE), SHAPE, Hybrid())
    is_inside = eroded(back.coverage > 0.95, 3)
    assert is_inside.mean() > 0.4
    # Waves of 10 px and more, resampled twice by pixels' means.
    record.quality("picture", psnr(back.image, image.color, mask=is_inside))


@pytest.mark.parametrize("equation", EQUATIONS)
def test_one_and_two_threads_give_the_same_bits(equation):
    source = random_source(40, 50)
    one, two = (
        render(source, EQUATIONS[equation], (70, 80), Hybrid(), threads) for threads in (1, 2)
    )
    for given, expected in zip(two, one, strict=True):
        np.testing.assert_array_equal(given, expected)


@pytest.mark.some(1)
@pytest.mark.parametrize("labels", [False, True])
def test_what_a_method_warped_before_makes_no_difference(labels):
    method = Hybrid(labels=labels)
    nearness = source_of("card").nearness
    for _ in range(2):
        for level in range(6):
            source = picture(np.array([0.1 * level]), nearness)
            given = rendered(source, VIEWS["side"], method)
            expected = rendered(source, VIEWS["side"], Hybrid(labels=labels))
            np.testing.assert_array_equal(given.image, expected.image)


@pytest.mark.parametrize("view", ["side", "roll", "in3"])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_target_shows_the_picture_mirrored(view, axis):
    pose, fx, fy = VIEWS[view].world_to_camera, *((64, -64) if axis == 0 else (-64, 64))
    mirrored = Camera.from_intrinsics(fx, fy, 32, 32, world_to_camera=pose)
    source = source_of("card")
    given, expected = rendered(source, mirrored), rendered(source, VIEWS[view])
    np.testing.assert_allclose(given.coverage, np.flip(expected.coverage, axis), atol=1e-4)
    # At a few places the sides of what is bridged, or the nearest of two, are told otherwise.
    differing = np.abs(given.image - np.flip(expected.image, axis)).max(axis=2) > 1e-4
    assert differing.sum() <= 8


@pytest.mark.sweep
def test_a_mirrored_source_shows_the_same(record):
    mirrored = Camera.from_intrinsics(64, -64, 32, 32)
    image = depth_image(SCENES["card"], SOURCE, SHAPE)
    flipped = DepthImage(*(np.ascontiguousarray(part[::-1]) for part in image[:2]), EMPTY)
    given = render(prepare(flipped), between(mirrored, VIEWS["side"]), SHAPE, Hybrid())
    record.quality("picture", psnr(given.image, rendered(prepare(image), VIEWS["side"]).image))


@pytest.mark.parametrize("view", ["side", "roll", "in3"])
def test_labels_are_not_mixed(view, rng):
    names = rng.integers(0, 5, (*SHAPE, 1)) * 0.2
    source = picture(names, 1 / np.where(is_near_part(), 2.5, 4.0))
    given = rendered(source, VIEWS[view], Hybrid(labels=True))
    assert set(np.unique(given.image[given.coverage > 0])) <= set(np.unique(source.color))
    assert set(np.unique(given.coverage)) <= {0.0, 1.0}


def is_near_part():
    y, x = np.mgrid[:64, :64]
    return (abs(x - 30) < 12) & (abs(y - 36) < 10)


def test_large_labels_stay_where_they_are():
    source = picture(np.where(np.arange(64) < 32, 0.25, 0.75)[:, None], 0.25)
    given = rendered(source, camera_at((0.4 * 4 / 64, 0, 0)), Hybrid(labels=True))
    # 0.4 px to the left; the column at 31 is two fifths of the right label.
    np.testing.assert_array_equal(given.image[2:-2, 2:32], 0.25)
    np.testing.assert_array_equal(given.image[2:-2, 32:-2], 0.75)


@pytest.mark.parametrize("view", ["side", "roll", "in3"])
def test_a_preview_shows_what_is_over_the_pixels_centers(view, record):
    truth = truth_of("wall", view)
    given = rendered(source_of("wall"), VIEWS[view], Preview())
    is_inside = eroded(truth.shown > 0.999)
    np.testing.assert_array_equal(given.coverage[is_inside], 1)
    record.quality("picture", psnr(given.image, truth.color.astype(np.float32), mask=is_inside))


def test_a_preview_shows_the_nearest_surface():
    truth = truth_of("card", "in3")
    given = rendered(source_of("card"), VIEWS["in3"], Preview())
    is_inside = eroded(truth.share.max(axis=2) == 1, 2)
    np.testing.assert_allclose(given.depth[is_inside], truth.depth[is_inside], rtol=0.01)


def test_a_preview_of_what_does_not_move_is_exact(rng):
    source = picture(rng.random((*SHAPE, 4)), 0.4)
    np.testing.assert_array_equal(rendered(source, SOURCE, Preview()).image, source.color)


@pytest.mark.parametrize("quality", [0.2, 9, 0, -1, math.nan, math.inf])
def test_quality_out_of_range_is_refused(quality):
    with pytest.raises(ValueError, match=r"quality .*; 0\.25 to 8 parts per px are allowed"):
        Hybrid(quality=quality)


@pytest.mark.parametrize("depth", [2.0, 2.499, 2.5, 3.0, 3.9])
def test_what_is_behind_the_eye_is_not_seen(depth):
    source = picture(np.array([0.0, 1.0]), 1 / np.where(is_near_part(), 2.5, 4.0))
    near = picture(np.where(is_near_part()[..., None], 1.0, 0.0), source.nearness)
    given = rendered(near, camera_at((0, 0, depth)))
    assert np.isfinite(given.image).all()
    if depth >= 2.5:
        assert given.image.max() < 1e-3


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-7])
def test_right_before_a_surface_it_finishes_quickly(gap):
    source = picture(np.array([0.5]), 0.5)
    rendered(source, VIEWS["in3"])  # compiled
    before = time.process_time()
    given = rendered(source, camera_at((0.001, 0.0003, 2 - gap)))
    assert time.process_time() - before < 10  # CPU s; 0.1 measured; cells are up to 1e6 px wide
    assert np.isfinite(given.image).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 200), (37, 5), (130, 70)])
def test_the_target_has_any_shape(shape):
    target = camera_at((0.1, 0, 0.5), 0.05, shape=SHAPE)
    whole = rendered(source_of("card"), target, shape=(130, 200))
    given = rendered(source_of("card"), target, shape=shape)
    assert given.image.shape == (*shape, 3)
    rows, columns = min(shape[0], 130) - 3, min(shape[1], 200) - 3
    if min(rows, columns) > 0:  # what is bridged may look across the frame
        part = np.s_[:rows, :columns]
        np.testing.assert_allclose(given.image[part], whole.image[part], atol=1e-5)


@pytest.mark.sweep
def test_channels_do_not_depend_on_those_beside_them_in_smooth_places():
    wall = plane((0.2, 0.1, 1), 4.0, pattern(4.0, channels=7))
    image = depth_image([wall], SOURCE, SHAPE, rays=1)
    together = rendered(prepare(image), VIEWS["oblique"]).image
    for n in range(7):
        alone = image._replace(color=np.ascontiguousarray(image.color[..., n : n + 1]))
        given = rendered(prepare(alone), VIEWS["oblique"]).image[..., 0]
        np.testing.assert_allclose(given, together[..., n], atol=1e-6)


def test_bright_light_is_as_exact_as_dark():
    image = depth_image([WALL], SOURCE, SHAPE, rays=4)
    bright = image._replace(color=image.color * np.float32(1024))
    given, expected = (rendered(prepare(each), VIEWS["oblique"]).image for each in (bright, image))
    np.testing.assert_allclose(given, 1024 * expected, rtol=1e-5, atol=1e-3)
