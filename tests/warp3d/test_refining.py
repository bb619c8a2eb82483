import cv2
import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.command.session import Session
from resample.engine.jit import kernel, threads
from resample.files.pictures import Kind, Picture
from resample.samples.rooms import room
from resample_comparisons.warp3d.scenes import generated
from resample_warp3d import warp
from resample_warp3d.command.choices import DepthWarping
from resample_warp3d.command.inputs import DepthInput
from resample_warp3d.command.rendering import prepared
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.depth.refining import conditioning
from resample_warp3d.depth.refining.conditioning import REFINES, refine
from resample_warp3d.depth.refining.hardening import RECIPES, RefinementTask, window
from resample_warp3d.depth.refining.inspecting import OVERSHOOT, WIDEST, Findings
from resample_warp3d.depth.refining.kernels.voting import Voters, vote_rows, weighted_median
from resample_warp3d.depth.refining.resizing import enlarged, fitted
from resample_warp3d.types import DepthImage
from resample_warp3d.warping import registered
from tests.warp3d import naive_refining
from tests.warp3d.naive_sheet import EMPTY, camera_at

SIZE = 384
NEAR, FAR = 0.5, 0.2
Y, X = np.mgrid[:64, :64] + 0.5


@pytest.fixture(scope="module")
def scene():
    """The generated room, with exact depth."""
    return generated(SIZE).depth_image(rays=4)


def depth_image(nearness, color):
    return DepthImage(np.asarray(color, np.float32), np.asarray(nearness, np.float32), EMPTY)


def spoiled(image, change):
    """A depth image whose nearness was changed."""
    return image._replace(nearness=np.asarray(change(image.nearness), np.float32))


def blurred(sigma):
    return lambda nearness: cv2.GaussianBlur(nearness, (0, 0), sigma)


def shifted(nearness):
    return np.roll(nearness, 2, axis=1)


def in_blocks(nearness):
    return np.repeat(np.repeat(nearness[2::4, 2::4], 4, axis=0), 4, axis=1)


def painted(is_near, rng, *, noise=0.02):
    """Colors that tell a near thing from what is behind it, a little noisy."""
    color = np.where(is_near[..., None], (0.8, 0.3, 0.1), (0.1, 0.4, 0.7))
    return color + noise * rng.standard_normal(color.shape)


def wall_and_thing(is_near, rng):
    """A slanted thing before a slanted wall, and its colors."""
    nearness = np.where(is_near, NEAR * (1 + 0.002 * X), FAR * (1 + 0.001 * Y))
    return nearness, painted(is_near, rng)


# The vote


@kernel
def median_of(value, weight):
    """The weighted median."""
    return weighted_median(value.copy(), weight.copy(), value.size)


@pytest.mark.parametrize("count", [1, 2, 7, 100])
@pytest.mark.parametrize("levels", [2, 5, 1000])
def test_the_weighted_median_is_where_half_of_the_weight_is_reached(count, levels, rng):
    for _ in range(20):
        value = rng.integers(0, levels, count).astype(float)
        weight = rng.random(count) ** 3
        assert median_of(value, weight) == naive_refining.weighted_median(value, weight)


@pytest.mark.sweep
def test_votes_are_counted_as_one_by_one(rng):
    shape = 45, 48
    color = rng.standard_normal((*shape, 3)).astype(np.float32)
    nearness = np.where(rng.random(shape) < 0.5, 0.2, 0.5) + 0.01 * rng.random(shape)
    nearness = nearness.astype(np.float32)
    trust = rng.choice(np.array([0.0, 0.05, 1.0], np.float32), shape)
    slope = (0.002 * rng.standard_normal((*shape, 4))).astype(np.float32)
    band = np.zeros(shape, np.uint8)
    band[::4, ::4] = 1  # those that are asked first
    found, agreed = nearness.copy(), np.ones(shape, np.float32)
    for apart in (4, 2, 1):
        vote_rows(
            Voters(color, nearness, trust, slope), window(), band, apart, False, found, agreed
        )
    for row, column in zip(*np.nonzero(band), strict=True):
        expected = naive_refining.vote(color, nearness, trust, slope, (row, column))
        assert (found[row, column], agreed[row, column]) == pytest.approx(expected, rel=1e-5)
    np.testing.assert_array_equal(found[band == 0], nearness[band == 0])


def test_a_ball_goes_on_to_where_it_turns_away(rng, record):
    # Its outermost samples are lost; planes would end in front of where it turns away.
    squared = (X - 32) ** 2 + (Y - 32) ** 2
    depth = np.where(squared < 24**2, 3 - np.sqrt(np.maximum(24**2 - squared, 0)) / 24, 6.0)
    image = depth_image(cv2.GaussianBlur(1 / depth, (0, 0), 1.0), painted(squared < 24**2, rng))
    found = refine(image, "sharpen").image.nearness
    is_rim = (squared > 21**2) & (squared < 23**2)
    error, before = (np.abs(d * depth - 1)[is_rim] for d in (found, image.nearness))
    record.error("median", np.median(error))
    assert error.mean() < 0.5 * before.mean()


def test_who_has_no_one_to_ask_stays_unknown():
    image = depth_image(np.where(X < 4, NEAR, 0.0), np.ones((64, 64, 3)))
    assert not refine(image, "complete").image.nearness[:, 60:].any()


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["snap", "sharpen", "complete"])
def test_threads_make_no_difference_to_a_single_bit(name, scene):
    image = spoiled(scene, lambda nearness: np.where(nearness > 0.3, 0, blurred(1.0)(nearness)))
    with threads(1):
        alone = refine(image, name)
    with threads(3):
        together = refine(image, name)
    np.testing.assert_array_equal(alone.image.nearness, together.image.nearness)
    np.testing.assert_array_equal(alone.confidence, together.confidence)


# What is found


@pytest.mark.sweep
def test_exact_depth_stays_as_it_is_to_the_last_bit(scene):
    refined = refine(scene)
    assert refined.chosen == "none"
    np.testing.assert_array_equal(refined.image.nearness, scene.nearness)
    assert (refined.confidence == (scene.nearness > 0)).all()
    for one, other in zip(prepare(scene), prepare(scene, refine="none"), strict=True):
        np.testing.assert_array_equal(one, other)


SPOILS = {
    "blurred by 1 px": (blurred(1.0), "sharpen"),
    "blurred by 2 px": (blurred(2.0), "sharpen"),
    "displaced": (shifted, "shift"),
    "dilated": (lambda nearness: cv2.dilate(nearness, np.ones((7, 7))), "snap"),
    "in blocks": (in_blocks, "snap"),
    "in 8 bits": (lambda nearness: np.maximum(np.round(255 * nearness), 1) / 255, "none"),
}


@pytest.mark.sweep
@pytest.mark.parametrize("name", SPOILS)
def test_what_is_wrong_is_found(name, scene):
    change, remedy = SPOILS[name]
    assert refine(spoiled(scene, change)).chosen == remedy


@pytest.mark.sweep
@pytest.mark.parametrize("sigma", [1.0, 1.5])
def test_the_softness_of_edges_is_measured(sigma, scene):
    findings = refine(spoiled(scene, blurred(sigma))).findings
    assert not findings.is_depth
    assert findings.sigma == pytest.approx(sigma, rel=0.15)  # the ends of edges are not seen


@pytest.mark.sweep
@pytest.mark.parametrize("sigma", [2.0, 3.0, 4.0, 6.0])
def test_softness_does_not_fall_as_edges_get_wider(sigma, scene):
    findings = refine(spoiled(scene, blurred(sigma)), "complete").findings
    assert findings.soft > 0.9
    assert findings.sigma == pytest.approx(sigma, rel=0.25)  # surfaces end before their edges do


@pytest.mark.sweep
@pytest.mark.parametrize(("right", "down"), [(1, 0), (-4, 0), (6, 0), (0, 3), (2, -1)])
def test_a_map_that_is_shifted_goes_back(right, down, scene):
    moved = spoiled(scene, lambda nearness: np.roll(nearness, (down, right), (0, 1)))
    refined = refine(moved)
    assert refined.chosen == "shift"
    assert refined.findings.shift == (-right, -down)
    inner = slice(8, -8), slice(8, -8)
    np.testing.assert_array_equal(refined.image.nearness[inner], scene.nearness[inner])


@pytest.mark.some(2)
@pytest.mark.parametrize(("right", "down"), [(0, 0), (1, 0), (2, 0), (-3, 0), (0, -2), (0, 3)])
def test_a_sensor_map_too_wide_by_a_pixel_says_how_far_it_is_off(right, down):
    seen = room(384)
    wide = cv2.dilate(np.float32(1.0) / seen.depth, np.ones((1, 2)))
    found = refine(depth_image(np.roll(wide, (down, right), (0, 1)), seen.color)).findings
    assert found.offset == pytest.approx((-right - 0.5 if right else 0, -down), abs=0.3)


@pytest.mark.parametrize(
    ("right", "down", "told"),
    [
        (0, 0, ""),
        (2, 0, "2.0 px right of its colors"),
        (-1, -3, "1.0 px left of and 3.0 px above its"),
    ],
)
def test_how_far_depth_is_off_is_said(right, down, told, scene, capsys):
    moved = spoiled(scene, lambda nearness: np.roll(nearness, (down, right), (0, 1)))
    picture = Picture(moved.color, Kind(("R", "G", "B"), 8, is_encoded=True))
    view = DepthInput(picture, moved, Camera.from_fov(60.0, SIZE, SIZE), None)
    prepared(Session(), [view], DepthWarping())
    said = capsys.readouterr().err
    assert told in said
    assert bool(said) == bool(told)


@pytest.mark.sweep
def test_overshoot_is_found_in_sharpened_maps_only(scene):
    def sharpened(nearness):
        soft = cv2.GaussianBlur(nearness, (0, 0), 2.0)
        return np.maximum(2 * soft - cv2.GaussianBlur(soft, (0, 0), 2.0), 1e-3)

    assert refine(spoiled(scene, sharpened)).findings.overshoot > OVERSHOOT
    assert refine(spoiled(scene, blurred(2.0))).findings.overshoot < OVERSHOOT / 2


@pytest.mark.some(1)
@pytest.mark.parametrize("sigma", [3.0, 4.0])
def test_wide_edges_become_hard_at_a_smaller_scale(sigma, rng):
    row, column = np.mgrid[:256, :320]
    is_near = (abs(column - 160) < 70) & (abs(row - 128) < 60)
    truth = np.where(is_near, NEAR, FAR)
    color = (0.3 + 0.4 * is_near + 0.02 * rng.standard_normal(row.shape))[..., None]
    given = cv2.GaussianBlur(truth, (0, 0), sigma)
    found = refine(depth_image(given, np.repeat(color, 3, axis=2))).image.nearness
    wrong = [np.mean(abs(each / truth - 1) > 0.05) for each in (given, found)]
    assert wrong[1] < wrong[0] / 8


@pytest.mark.sweep
def test_whether_depth_or_nearness_was_blurred_is_found(scene):
    depth = spoiled(scene, lambda nearness: 1 / cv2.GaussianBlur(1 / nearness, (0, 0), 1.0))
    assert refine(depth).findings.is_depth


@pytest.mark.sweep
def test_noise_on_exact_edges_changes_nothing(scene, rng):
    noisy = spoiled(scene, lambda d: d * (1 + 0.005 * rng.standard_normal(d.shape)))
    assert refine(noisy).chosen == "none"


@pytest.mark.sweep
def test_what_was_computed_may_have_nothing_and_what_was_measured_has_lost_it(scene, rng):
    is_lost = np.zeros(scene.nearness.shape, np.bool_)
    is_lost[40:48, 60:80] = True
    computed = spoiled(scene, lambda d: np.where(is_lost, 0, d))
    assert refine(computed).chosen == "none"
    noise = 1 + 0.002 * rng.standard_normal(is_lost.shape)
    measured = refine(spoiled(computed, lambda d: d * noise))
    assert measured.chosen == "complete"
    assert (measured.image.nearness[is_lost] > 0).mean() > 0.8


# What is done about it


def test_displaced_edges_go_back_to_those_of_color_and_planes_stay_planes(rng):
    is_near = (abs(X - 32) < 12) & (abs(Y - 32) < 14)
    truth, color = wall_and_thing(is_near, rng)
    is_there = np.roll(is_near, 2, axis=1)
    given = np.where(is_there, NEAR * (1 + 0.002 * X), FAR * (1 + 0.001 * Y))
    found = refine(depth_image(given, color), "snap").image.nearness
    assert np.abs(given / truth - 1).max() > 0.5
    np.testing.assert_allclose(found, truth, rtol=5e-3)  # at corners no sample is straight beside


def test_soft_edges_become_hard_and_nothing_flies_between_surfaces(rng):
    is_near = X < 30
    truth, color = wall_and_thing(is_near, rng)
    given = cv2.GaussianBlur(truth, (0, 0), 1.5)
    found = refine(depth_image(given, color), "sharpen").image.nearness
    inner = slice(8, -8)
    assert ((given > 1.2 * FAR) & (given < 0.9 * NEAR)).sum() > 64
    assert not ((found > 1.2 * FAR) & (found < 0.9 * NEAR)).any()
    np.testing.assert_allclose(found[inner, inner], truth[inner, inner], rtol=0.02)


def test_thin_things_get_back_what_softness_took(rng):
    is_near = abs((X - 24) % 40) < 4
    truth = np.where(is_near, NEAR, FAR)
    image = depth_image(cv2.GaussianBlur(truth, (0, 0), 2.0), painted(is_near, rng))
    assert image.nearness.max() < 0.9 * NEAR
    refined = refine(image, "sharpen")
    inner = slice(8, -8)
    error = np.abs(refined.image.nearness / truth - 1)[inner, inner]
    assert error.max() < 0.6 * np.abs(image.nearness / truth - 1)[is_near].min()


def test_gaps_are_filled_by_the_surface_that_has_their_color(rng):
    is_near = X < 32
    truth, color = wall_and_thing(is_near, rng)
    is_lost = (abs(X - 32) < 6) & (abs(Y - 32) < 20)
    refined = refine(depth_image(np.where(is_lost, 0, truth), color), "complete")
    np.testing.assert_allclose(refined.image.nearness, truth, rtol=1e-2)
    assert (refined.confidence[~is_lost] == 1).all()
    assert (refined.confidence[is_lost] <= 0.5).all()


def test_what_has_a_color_of_its_own_stays_unknown(rng):
    is_sky = Y < 12
    color = painted(Y > 40, rng)
    color[is_sky] = (1.0, 1.0, 1.0)
    refined = refine(depth_image(np.where(is_sky, 0, FAR), color), "complete")
    assert not refined.image.nearness[is_sky].any()
    assert not refined.confidence[is_sky].any()


def test_a_lone_sample_between_surfaces_is_dropped(rng):
    is_near = X < 32
    truth, color = wall_and_thing(is_near, rng)
    given = truth.copy()
    given[:, 32] = 0.5 * (given[:, 31] + given[:, 33])
    found = refine(depth_image(given, color), "sharpen").image.nearness
    np.testing.assert_allclose(found[8:-8, 32], truth[8:-8, 32], rtol=1e-2)


# Depth of another size, and of another camera


def test_a_smaller_map_is_interpolated_on_planes_and_not_across_edges():
    small = np.where(X < 32, NEAR + 0.001 * X, FAR + 0.002 * Y)
    found = enlarged(small, (128, 128))
    y, x = (np.mgrid[:128, :128] + 0.5) / 2
    np.testing.assert_allclose(
        found, np.where(x < 32, NEAR + 0.001 * x, FAR + 0.002 * y), rtol=1e-5
    )


@pytest.mark.sweep
def test_depth_of_another_size_is_refined_to_the_picture(scene):
    small = scene._replace(nearness=np.ascontiguousarray(scene.nearness[2::4, 2::4]))
    refined = refine(small)
    assert refined.chosen == "snap"
    wrong = np.abs(refined.image.nearness / scene.nearness - 1) > 0.05
    nearest = np.abs(in_blocks(scene.nearness) / scene.nearness - 1) > 0.05
    assert wrong.mean() < 0.7 * nearest.mean()


def test_maps_of_other_proportions_are_refused_in_one_line():
    image = depth_image(np.ones((10, 20)), np.ones((40, 40, 3)))
    with pytest.raises(ValueError, match="color of 40 × 40 px does not fit depth of 20 × 10 px"):
        refine(image)


def test_depth_comes_to_the_cameras_place_and_size():
    camera, beside = camera_at(), camera_at((0.5, 0.0, 0.0))
    found = registered(np.full((64, 64), 0.5, np.float32), beside, camera, (64, 64))
    known = found > 0
    np.testing.assert_allclose(found[known], 0.5, rtol=1e-5)
    moved = 0.5 * 0.5 * camera.matrix[0, 0]  # px that what is at 2 is further right
    assert known.sum() == pytest.approx(64 * (64 - moved), abs=64)
    assert known[:, -8:].all()


def test_depth_that_the_picture_does_not_see_is_refused():
    far_away = camera_at((100.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="check the depth camera's pose"):
        registered(np.ones((8, 8), np.float32), far_away, camera_at(), (8, 8))


def test_unknown_names_list_the_known_ones(scene):
    with pytest.raises(LookupError, match=f"unknown refine 'blur'; known: {', '.join(REFINES)}"):
        refine(scene, "blur")
    camera = camera_at()
    with pytest.raises(LookupError, match="unknown refine 'blur'"):
        warp(scene.color, np.ones((SIZE, SIZE)), camera, camera, refine="blur")


@pytest.mark.sweep
@pytest.mark.parametrize(("sigma", "remedy"), [(0.0, "snap"), (3.0, "sharpen")])
def test_a_small_map_is_sharpened_if_it_is_soft_itself(sigma, remedy, scene):
    soft = blurred(sigma)(scene.nearness) if sigma else scene.nearness
    small = cv2.resize(soft, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_NEAREST)
    given = DepthImage(scene.color, small, EMPTY)
    assert refine(given).chosen == remedy
    kind, camera = Kind(("R", "G", "B"), 8, is_encoded=True), Camera.from_fov(60, SIZE, SIZE)
    view = DepthInput(Picture(scene.color, kind), fitted(given), camera, None, is_fitted=True)
    assert view.refined("auto").chosen == remedy


def test_a_soft_map_stays_smooth_until_colors_say_where_its_edges_are(scene):
    soft = blurred(3.0)(scene.nearness)
    small = cv2.resize(soft, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    made = fitted(DepthImage(scene.color, small, EMPTY)).nearness
    assert np.abs(made / soft - 1).max() < 0.03


def test_what_a_depth_camera_beside_the_picture_does_not_see_is_filled(rng):
    """A box that hides a part of the wall from the depth camera only."""
    camera, beside = camera_at(), camera_at((0.5, 0.0, 0.0))
    y, x = np.mgrid[:64, :64]
    depth = np.where((abs(x - 32) < 10) & (abs(y - 32) < 10), 2.0, 5.0)  # as the picture sees it
    theirs = np.where((abs(x - 16) < 10) & (abs(y - 32) < 10), 2.0, 5.0)
    found = registered((1 / theirs).astype(np.float32), beside, camera, (64, 64))
    image = depth_image(found, painted(depth < 3, rng))
    kind = Kind(("R", "G", "B"), 8, is_encoded=True)
    view = DepthInput(Picture(image.color, kind), image, camera, None, is_registered=True)
    refined = view.refined("auto")
    is_lost = (found <= 0) & (x >= 16)
    assert (found[is_lost] == 0).sum() > 100
    assert refined.chosen == "complete"
    np.testing.assert_allclose(1 / refined.image.nearness[is_lost], 5.0, rtol=1e-3)


@pytest.mark.parametrize(
    ("sigma", "scale"), [(0.8, 1), (WIDEST, 1), (2.8, 2), (5.2, 3), (6.8, 3), (7.2, 4)]
)
@pytest.mark.parametrize("is_large", [True, False])
def test_wide_edges_are_hardened_where_they_are_about_2_px_wide(
    monkeypatch, sigma, scale, is_large
):
    """That is in a smaller picture first, unless that has no side of 32 px."""
    tried = []

    def hardened(task, nearness, *_, **__):
        tried.append((nearness.shape, task.findings.sigma, task.noise))
        return nearness, nearness

    monkeypatch.setattr(conditioning, "hardened", hardened)
    side = (32 if is_large else 31) * max(scale, 2) + 1
    flat = np.full((side, side + 8), 0.3, np.float32)
    findings = Findings(0.5, sigma, False, 1.0, 0.0, False)
    task = RefinementTask(flat[..., None], findings, 0.1, 0.0, RECIPES["snap"])
    found, _ = conditioning._sharpened(task, flat)
    np.testing.assert_allclose(found, flat)
    least = scale if is_large else 1
    small = (flat.shape[0] // least, flat.shape[1] // least)
    assert tried[0] == (small, pytest.approx(sigma / least), pytest.approx(0.1 / least))
    assert tried[-1] == (flat.shape, sigma, 0.1)


def test_a_thin_thing_before_a_surface_that_falls_does_not_make_its_end_rise(rng):
    """Blurred, the bar is a bump, whose slope led the surface nearer, up to its end 12 px on."""
    is_near = X < 40
    true = np.where(is_near, NEAR - 0.004 * X, 0.1)
    true[:, 28] = 1.4 * NEAR  # the bar
    soft = blurred(3.0)(np.float32(true))
    found = refine(depth_image(soft, painted(is_near, rng)), "sharpen").image.nearness
    assert found[8:-8].min() > 0  # all samples keep a depth
    assert found[8:-8, 32:40].max() <= soft[:, 28:40].max()
