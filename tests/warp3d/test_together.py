from functools import cache
from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from resample.engine import jit
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DepthImage
from resample_warp3d.views import multi_source
from resample_warp3d.views.matching import balanced, match_colors, match_depths, scaled
from resample_warp3d.views.multi_source import (
    PLAIN,
    Joining,
    PosedSource,
    agreed,
    merge,
    render_together,
)
from resample_warp3d.warping import render
from tests.warp3d import naive_together as naive
from tests.warp3d.naive_sheet import camera_at, depth_image, pattern, plane, see

SHAPE = 64, 64
INSIDE = np.s_[6:-6, 6:-6]
EYES = ((-0.3, 0.0, 0.0), (0.3, 0.05, 0.0), (0.0, -0.3, 0.2))


def things():
    """A card before a wall that turns away."""

    def is_inside(point):
        return (abs(point[..., 0]) < 0.5) & (abs(point[..., 1]) < 0.4)

    wall = plane((0.1, 0, 1), 4.0, pattern(3.0))
    return [plane((0, 0, 1), 2.5, pattern(3.0), is_inside), wall]


@cache
def seen(eye):
    return depth_image(things(), camera_at(eye, shape=SHAPE), SHAPE, rays=8)


def target():
    return camera_at((0.05, 0.0, 0.05), shape=SHAPE)


def standing(gains=(1, 1, 1), factors=(1, 1, 1), biases=(0, 0, 0)):
    """Sources whose colors and depths are wrong."""
    made = []
    for eye, gain, factor, bias in zip(EYES, gains, factors, biases, strict=False):
        image = seen(eye)
        color = np.float32(gain) * image.color + np.float32(bias)
        nearness = (image.nearness / factor).astype(np.float32)
        source = prepare(image._replace(color=color, nearness=nearness), noise=0.0, step=0.0)
        made.append(PosedSource(source, camera_at(eye, shape=SHAPE)))
    return made


def views_of(given):
    return [render(s, between(camera, target()), SHAPE, "hybrid") for s, camera in given]


def joined(given, joining=None, **words):
    chosen = Joining() if joining is None else joining
    return render_together(agreed(given, chosen), target(), SHAPE, "hybrid", chosen, **words)


def error(warped):
    truth = see(things(), target(), SHAPE, rays=8).color
    return float(np.sqrt(np.square(warped.image - truth)[INSIDE].mean()))


def assert_same_bits(given, expected):
    for one, other in zip(given, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.sweep
def test_the_order_of_sources_changes_no_bit_and_their_numbers_go_with_them():
    given = standing((0.97, 1.0, 1.03), (0.995, 1.0, 1.005))
    expected = joined(given)
    for order in permutations(range(3)):
        found = joined([given[n] for n in order])
        assert_same_bits(found.warped, expected.warped)
        np.testing.assert_array_equal(found.match.gain, expected.match.gain[list(order)])


@pytest.mark.sweep
def test_threads_change_no_bit():
    given = standing((0.97, 1.0, 1.03), (0.995, 1.0, 1.005))
    expected = joined(given, threads=1)
    with jit.threads(2):
        assert_same_bits(joined(given, threads=2).warped, expected.warped)


@pytest.mark.sweep
def test_sources_that_agree_stay_as_they_are():
    given = standing()
    ready = agreed(given, Joining())
    np.testing.assert_array_equal(ready.scale, 1)
    for place, n in enumerate(ready.order):
        assert ready.standing[place].source is given[n].source
    np.testing.assert_allclose(joined(given).match.gain, 1, atol=2e-3)


@pytest.mark.sweep
@pytest.mark.parametrize("count", [2, 3])
def test_gains_are_found_up_to_their_mean(count):
    gains = np.linspace(0.97, 1.03, count)
    match = joined(standing(gains)).match
    expected = np.exp(np.log(gains).mean()) / gains
    np.testing.assert_allclose(match.gain, np.tile(expected[:, None], 3), rtol=3e-3)
    np.testing.assert_array_equal(match.bias, 0)


def test_each_channel_has_a_gain():
    gains = np.array([[0.9, 1.0, 1.1], [1.1, 1.0, 0.9]])
    match = joined(standing(gains)).match
    np.testing.assert_allclose(match.gain[0] / match.gain[1], gains[1] / gains[0], rtol=5e-3)


@pytest.mark.sweep
def test_gain_and_bias_are_found_together():
    given = standing((0.95, 1.05), biases=(0.02, -0.02))
    chosen = Joining(colors="gain-bias")
    views = views_of(given)
    match = match_colors(views, "gain-bias")
    one, other = (each.image for each in balanced(views, match))
    shared = (views[0].coverage > 0.99) & (views[1].coverage > 0.99)
    before = np.abs(views[0].image - views[1].image)[shared]
    assert np.median(np.abs(one - other)[shared]) < 0.2 * np.median(before)
    assert match.bias.sum(axis=0) == pytest.approx(0, abs=1e-6)
    assert error(joined(given, chosen).warped) < 0.6 * error(joined(given, PLAIN).warped)


def test_views_that_share_nothing_are_left_alone():
    left, right = views_of(standing((0.5, 1.5)))
    for view, half in ((left, np.s_[:, :32]), (right, np.s_[:, 32:])):
        view.coverage[half] = view.image[half] = view.confidence[half] = 0
        view.depth[half] = np.inf
    np.testing.assert_array_equal(match_colors([left, right]).gain, 1)


@pytest.mark.parametrize("colors", ["gain", "gain-bias"])
def test_a_view_that_shares_nothing_with_two_others_does_not_darken_them(colors):
    one, other, alone = views_of(standing((0.97, 1.03, 1.0)))
    for view, half in ((one, np.s_[:, :32]), (other, np.s_[:, :32]), (alone, np.s_[:, 32:])):
        view.coverage[half] = view.image[half] = view.confidence[half] = 0
        view.depth[half] = np.inf
    match = match_colors([one, other, alone], colors)
    np.testing.assert_allclose(match.gain[2], 1, atol=1e-3)
    np.testing.assert_allclose(match.gain[0] * match.gain[1], 1, atol=0.02)


def apart(views):
    """Mean distance, px, of where two views put a point from where a third one does."""
    point = np.array([0.3, 0.2, 3.0, 1.0])
    eye, *others = (
        np.linalg.inv(each.camera.world_to_camera) @ true.camera.world_to_camera @ point
        for each, true in zip(views, standing(), strict=True)
    )
    focal = views[0].camera.matrix[0, 0] / point[2]
    return focal * np.mean([np.linalg.norm(each - eye) for each in others])


def test_poses_of_hand_held_views_are_refined_by_colors_and_depths():
    # Views whose cameras are turned and moved by about so much
    views = standing((0.9, 1.0, 1.1))
    rng, given = np.random.default_rng(3), []
    for source, camera in views:
        moved = np.eye(4)
        moved[:3, :3] = Rotation.from_rotvec(np.radians(rng.normal(0, 0.6, 3))).as_matrix()
        moved[:3, 3] = rng.normal(0, 0.01, 3)
        given.append(PosedSource(source, camera.moved(moved @ camera.world_to_camera)))
    ready = agreed(given, Joining())
    found = [ready.standing[ready.order.index(n)] for n in range(3)]
    assert apart(given) > 1.0  # px
    assert apart(found) < 0.25 * apart(given)  # measured 0.20, of 3 px
    kept = agreed(given, Joining(poses="none"))
    for each, n in zip(kept.standing, kept.order, strict=True):
        assert each.camera is given[n].camera


def test_right_poses_stay_as_they_are():
    given = standing()
    for each, n in zip(*agreed(given, Joining())[:2], strict=True):
        np.testing.assert_array_equal(each.camera.world_to_camera, given[n].camera.world_to_camera)


def test_colors_of_any_range_and_dark_channels_are_matched():
    views = [view._replace(image=1e3 * view.image) for view in views_of(standing((0.97, 1.03)))]
    views = [view._replace(image=view.image * np.float32([1, 0, 1])) for view in views]
    gain = match_colors(views).gain
    np.testing.assert_allclose(gain[0, [0, 2]] / gain[1, [0, 2]], 1.03 / 0.97, rtol=3e-3)
    np.testing.assert_array_equal(gain[:, 1], 1)


@pytest.mark.some(1)
@pytest.mark.parametrize("count", [2, 3])
def test_scales_of_depth_are_found_up_to_their_mean(count):
    factors = np.linspace(0.995, 1.005, count)
    found = agreed(standing(factors=factors), Joining()).scale
    np.testing.assert_allclose(found, factors / np.exp(np.log(factors).mean()), rtol=3e-4)


def test_a_source_that_meets_no_other_keeps_its_scale():
    given = [each.source for each in standing(factors=(0.99, 1.01))]
    away = camera_at((0, 0, 0), yaw=np.pi, shape=SHAPE)
    cameras = camera_at(EYES[0], shape=SHAPE), away
    equations = [[between(one, other) for other in cameras] for one in cameras]
    np.testing.assert_array_equal(match_depths(given, equations), 1)


def test_a_scaled_source_is_the_source_of_scaled_depth():
    (source, _), *_ = standing()
    nearer = prepare(
        DepthImage(source.color, source.nearness * np.float32(1.25), source.place),
        noise=0.0, step=0.0,
    )  # fmt: skip
    np.testing.assert_allclose(scaled(source, 1.25).nearness, nearer.nearness, rtol=1e-6)
    np.testing.assert_allclose(scaled(source, 1.25).slope, nearer.slope, rtol=1e-3, atol=1e-7)


@pytest.mark.sweep
@pytest.mark.parametrize("wrong", ["brightness", "depth"])
def test_what_is_matched_is_as_good_as_if_it_had_never_differed(wrong):
    gains, factors = np.linspace(0.97, 1.03, 3), np.linspace(0.98, 1.02, 3)
    given = standing(gains) if wrong == "brightness" else standing(factors=factors)
    exact = error(joined(standing()).warped)
    assert error(joined(given).warped) < 1.05 * exact + 5e-4
    assert error(joined(given, PLAIN).warped) > 1.3 * exact


@pytest.mark.sweep
def test_views_that_agree_are_not_worse_than_plain_ones():
    assert error(joined(standing()).warped) <= error(joined(standing(), PLAIN).warped)


@pytest.mark.sweep
@pytest.mark.parametrize("blend", ["feathered", "confident"])
def test_blends_are_those_of_each_pixel_for_itself(blend):
    views = views_of(standing((0.9, 1.0, 1.1)))
    image, coverage = naive.front(views, blend)
    merged = merge(views, blend)
    opaque = coverage > 0.9999
    assert opaque.mean() > 0.8
    np.testing.assert_allclose(merged.image[opaque], image[opaque], atol=2e-4)


def test_the_best_view_is_one_of_them():
    views = views_of(standing((0.5, 1.0, 1.5)))
    merged = merge(views, "best")
    opaque = np.min([view.coverage for view in views], axis=0) > 0.9999
    equal = [(merged.image == view.image).all(axis=2) for view in views]
    assert np.any(equal, axis=0)[opaque].all()


def test_a_view_fades_out_where_it_ends():
    near, far = views_of(standing((0.9, 1.1))[:2])
    for view, part in ((near, np.s_[:, 40:]), (far, np.s_[:, :20])):
        view.coverage[part] = view.image[part] = view.confidence[part] = 0
        view.depth[part] = np.inf
    steps = [
        np.abs(np.diff(merge([near, far], blend).image.mean(axis=(0, 2))))[[19, 39]].max()
        for blend in ("feathered", "confident")
    ]
    assert steps[0] < 0.75 * steps[1]  # in two pixels instead of one, smoothly


def test_angles_are_those_between_rays_at_the_surface():
    (source, camera), *_ = standing()
    view = render(source, between(camera, target()), SHAPE, "hybrid")
    found = multi_source.angle_share(view, camera, target())
    for place in ((5, 9), (30, 31), (50, 40)):
        angle = naive.angle(place, view.depth[place], camera, target())
        expected = 1 / (1 + (angle / multi_source.OBLIQUE) ** 2)
        assert found[place] == pytest.approx(expected, rel=1e-3)


@pytest.mark.sweep
def test_outliers_are_those_that_half_of_the_sources_look_through(rng):
    given = standing()
    (source, camera) = given[0]
    depth = 1 / source.nearness
    flying = rng.random(SHAPE) < 0.05
    nearness = np.where(flying, 1 / (0.7 * depth), source.nearness).astype(np.float32)
    given[0] = PosedSource(source._replace(nearness=nearness), camera)
    views = views_of(given)
    equations = [between(each.camera, target()) for each in given]
    sources = [each.source for each in given]
    out = naive.outvoted(views, sources, equations)
    found = multi_source.outvoted(views, sources, equations)
    assert out[0].sum() > 50
    for view, kept, expected in zip(views, found, out, strict=True):
        np.testing.assert_array_equal((view.coverage > 0) & (kept.coverage == 0), expected)
    believed = error(joined(given, Joining(votes="none")).warped)
    assert error(joined(given).warped) < 0.7 * believed


@pytest.mark.parametrize("count", [2, 3])
def test_what_another_source_looks_through_goes_unless_a_third_one_sees_it(count):
    given = standing()[:count]
    wall = depth_image(things()[1:], given[1].camera, SHAPE, rays=2)
    given[1] = given[1]._replace(source=prepare(wall, noise=0.0, step=0.0))
    views = views_of(given)
    equations = [between(each.camera, target()) for each in given]
    kept = multi_source.outvoted(views, [each.source for each in given], equations)
    card = (views[0].depth < 2.6) & (views[1].depth > 3)
    assert card.sum() > 300
    assert (kept[0].coverage[card] > 0).mean() == pytest.approx(count - 2, abs=0.1)
    np.testing.assert_array_equal(kept[1].coverage, views[1].coverage)


@pytest.mark.sweep
def test_a_film_keeps_the_gains_of_a_frame():
    given = standing((0.97, 1.0, 1.03))
    first = joined(given)
    again = joined(given, match=first.match)
    assert again.match is first.match
    assert_same_bits(again.warped, first.warped)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"blend": "soft"}, "unknown blend 'soft'; known: feathered, confident, best"),
        ({"colors": "hue"}, "unknown way to match colors 'hue'; known: gain, gain-bias, none"),
        ({"depths": "bias"}, "unknown way to match depths 'bias'; known: scale, none"),
        ({"votes": "all"}, "unknown votes 'all'; known: majority, none"),
        ({"poses": "given"}, "unknown poses 'given'; known: refined, none"),
    ],
)
def test_unknown_names_are_refused(words, message):
    with pytest.raises(ValueError, match=message):
        Joining(**words)
