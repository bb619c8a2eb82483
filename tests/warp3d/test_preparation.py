import numpy as np
import pytest

from resample_warp3d.depth.preparation import prepare
from resample_warp3d.depth.refining.inspecting import known
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage
from tests.warp3d.naive_sheet import EMPTY, ball, camera_at, depth_image, flat, plane

SHAPE = 64, 64
Y, X = np.mgrid[:64, :64] + 0.5


def prepared(nearness, **given):
    """Source with this nearness and no colors."""
    nearness = np.asarray(nearness, np.float32)
    return prepare(DepthImage(np.zeros((*nearness.shape, 1), np.float32), nearness, EMPTY), **given)


def to_right(source):
    """Links to the right, (H, W − 1)."""
    return source.links[:, :-1] & RIGHT != 0


def downward(source):
    """Links downward, (H − 1, W)."""
    return source.links[:-1] & DOWN != 0


@pytest.mark.parametrize("across", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("steepness", [0.001, 0.02, 0.25])
def test_a_plane_is_linked_throughout_even_at_grazing_angles(steepness, across):
    # The steepest one changes its nearness by 20 % from one sample to the next, at its far end.
    rising = 1.0 + steepness * (Y + across * X)
    source = prepared(0.1 * rising, step=0.0)
    assert to_right(source).all()
    assert downward(source).all()


def test_both_ends_of_a_link_know_it():
    source = prepared(np.where((X > 20) & (Y < 30), 2.0, 1.0), step=0.0)
    links = source.links
    np.testing.assert_array_equal(links[:, :-1] & RIGHT != 0, links[:, 1:] & LEFT != 0)
    np.testing.assert_array_equal(links[:-1] & DOWN != 0, links[1:] & UP != 0)


@pytest.mark.parametrize("height", [0.5, 0.1, 0.01])
def test_a_step_between_slopes_is_cut_and_nothing_else(height):
    slope = 1 + 0.001 * Y + 0.002 * X
    source = prepared(np.where(X < 32, slope, (1 - height) * slope), step=0.0)
    is_cut = np.arange(63) == 31
    np.testing.assert_array_equal(to_right(source), np.broadcast_to(~is_cut, (64, 63)))
    assert downward(source).all()


@pytest.mark.parametrize("height", [0.2, 0.03, 0.01])
def test_two_edges_in_a_row_do_not_explain_each_other(height):
    stairs = np.where(X < 32, 1.0, np.where(X < 33, 1 - height / 2, 1 - height))
    source = prepared(stairs, step=0.0)
    assert not to_right(source)[:, 31:33].any()
    assert to_right(source)[:, :31].all()
    assert to_right(source)[:, 33:].all()


def test_a_ball_is_linked_up_to_its_last_sample_and_not_to_what_is_behind_it():
    things = [ball((0, 0, 3), 1.0, flat(1)), plane((0, 0, 1), 6, flat(0))]
    image = depth_image(things, camera_at(), SHAPE, rays=1)
    source = prepared(image.nearness)
    is_ball = image.nearness > 0.2
    links, both = to_right(source), is_ball[:, :-1] & is_ball[:, 1:]
    assert links[25:39][both[25:39]].all()
    # Where a row only grazes the ball, no row of samples looks like a surface.
    assert links[both].mean() > 0.99
    assert not links[is_ball[:, :-1] ^ is_ball[:, 1:]].any()


@pytest.mark.parametrize("unknown", [0.0, np.nan, np.inf, -np.inf, -1.0])
def test_unknown_depth_is_never_linked(unknown):
    nearness = np.ones((5, 5))
    nearness[2, 2] = unknown
    source = prepared(nearness)
    assert source.nearness[2, 2] == 0
    assert source.links[2, 2] == 0
    assert not source.links[2, 1] & RIGHT
    assert not source.links[2, 3] & LEFT
    assert not source.links[1, 2] & DOWN
    assert not source.links[3, 2] & UP


@pytest.mark.parametrize("noise", [0.0005, 0.002, 0.004])
def test_noise_is_measured(noise, rng):
    slope = 0.5 + 0.001 * X - 0.002 * Y
    source = prepared(slope * (1 + noise * rng.normal(size=SHAPE)))
    # 0.2 σ: beyond 0.4 %, the links that noise cuts hide its largest differences.
    assert source.noise == pytest.approx(noise, rel=0.2)


def test_noise_does_not_tear_surfaces_nor_hide_steps(rng, record):
    slope = np.where(X < 32, 1.0, 0.9) * (0.5 + 0.001 * X - 0.002 * Y)
    source = prepared(slope * (1 + 0.002 * rng.normal(size=SHAPE)))
    assert not to_right(source)[:, 31].any()
    # Six standard deviations of a difference are allowed, as far as the noise was seen.
    record.error("torn links", ~np.delete(to_right(source), 31, axis=1))


def test_noise_is_smoothed_along_surfaces(rng, record):
    slope = 0.5 + 0.001 * X - 0.002 * Y
    source = prepared(slope * (1 + 0.002 * rng.normal(size=SHAPE)))
    error = np.std(source.nearness / slope - 1)
    record.error("rms", error)  # nine samples along both axes: a ninth in a plane's middle


def test_without_noise_samples_keep_their_nearness():
    things = [ball((0, 0, 3), 0.6, flat(1)), plane((0, 0, 1), 6, flat(0))]
    image = depth_image(things, camera_at(), SHAPE, rays=1)
    np.testing.assert_array_equal(prepared(image.nearness).nearness, image.nearness)


def test_slopes_of_a_plane_are_exact():
    source = prepared(0.5 + 0.003 * X - 0.002 * Y)
    np.testing.assert_allclose(source.slope[..., 0], 0.003, atol=1e-7)  # float32 near 0.5
    np.testing.assert_allclose(source.slope[..., 1], -0.002, atol=1e-7)


def test_slopes_stop_at_steps():
    source = prepared(np.where(X < 32, 1.0, 0.5))
    assert not source.slope.any()


def test_the_quantum_of_an_8_bit_map_is_found():
    source = prepared(np.round((0.3 + 0.003 * X + 0.001 * Y) * 255) / 255)
    assert source.step == pytest.approx(1 / 255, rel=1e-5)
    assert to_right(source).all()
    assert downward(source).all()


def test_an_8_bit_map_is_smoothed_to_a_fraction_of_its_quantum(record):
    slope = 0.3 + 0.003 * X + 0.001 * Y
    source = prepared(np.round(slope * 255) / 255)
    record.error(
        "largest, of the quantum", np.abs(source.nearness - slope).max() * 255
    )  # 0.5 before


def test_a_few_flat_things_are_cut_however_close_they_are():
    source = prepared(np.where(X < 20, 0.30, np.where(X < 40, 0.31, 0.32)))
    assert source.step == 0
    np.testing.assert_array_equal(np.flatnonzero(~to_right(source)[0]), [19, 39])


def test_given_noise_and_step_are_used():
    nearness = np.where(X < 32, 1.0, 0.98)
    assert not to_right(prepared(nearness))[:, 31].any()
    noisy, coarse = prepared(nearness, noise=0.005), prepared(nearness, step=0.015)
    assert noisy.noise == 0.005
    assert coarse.step == 0.015
    assert to_right(noisy)[:, 31].all()
    assert to_right(coarse)[:, 31].all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (6, 1), (2, 2)])
def test_tiny_pictures_are_prepared(shape):
    source = prepared(np.ones(shape))
    assert to_right(source).all()
    assert downward(source).all()


def test_sizes_that_do_not_fit_are_both_named():
    image = DepthImage(np.zeros((4, 5, 3), np.float32), np.ones((3, 7), np.float32), EMPTY)
    with pytest.raises(ValueError, match="color of 5 × 4 px does not fit depth of 7 × 3 px"):
        prepare(image)


@pytest.mark.parametrize("unknown", [0.0, np.nan, np.inf, -1.0])
def test_no_depth_at_all_is_refused(unknown):
    with pytest.raises(ValueError, match="no pixel has a depth; check its unit and its file"):
        prepared(np.full((4, 4), unknown))


@pytest.mark.parametrize(
    ("part", "value"),
    [("place", np.nan), ("place", np.inf), ("color", np.nan), ("color", -np.inf)]
    + [("nearness", value) for value in (np.nan, np.inf, 0.0, -1.0)],
)
@pytest.mark.parametrize("channel", [0, 1])
def test_a_pixel_of_which_anything_is_unknown_has_no_nearness(part, value, channel):
    image = DepthImage(
        np.ones((4, 5, 2), np.float32), np.full((4, 5), 0.5, np.float32), np.ones((4, 5, 2))
    )
    getattr(image, part)[(2, 3) if part == "nearness" else (2, 3, channel)] = value
    expected = np.full((4, 5), 0.5, np.float32)
    expected[2, 3] = 0
    np.testing.assert_array_equal(known(image), expected)


def test_a_picture_without_any_depth_is_refused():
    nothing = DepthImage(
        np.ones((4, 5, 3), np.float32), np.zeros((4, 5), np.float32), np.ones((0, 0, 2))
    )
    with pytest.raises(ValueError, match="no pixel has a depth"):
        known(nothing)
    with pytest.raises(ValueError, match="color of 5 × 4 px does not fit depth of 4 × 4 px"):
        known(nothing._replace(nearness=np.ones((4, 4), np.float32)))
