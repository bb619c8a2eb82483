import math

import numpy as np
import pytest

from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.sheet.filling import fill
from resample_warp3d.sheet.sheets import APART, background, behind, far_sides
from resample_warp3d.types import DepthImage, Hole
from resample_warp3d.warping import render, warp_disparity

HEIGHT, WIDTH = 48, 96
CARD = np.s_[12:36, 40:60]
WALL = (0.2, 0.5, 0.3)


def image(color=WALL, card=8.0, tilt=0.02):
    """A red card before a wall that turns away to the right; nearness is the disparity, px."""
    column = np.arange(WIDTH, dtype=np.float32)
    nearness = np.tile(2.0 + tilt * column, (HEIGHT, 1)).astype(np.float32)
    pixels = np.empty((HEIGHT, WIDTH, 3), np.float32)
    pixels[:] = color
    pixels[CARD], nearness[CARD] = (1.0, 0.0, 0.0), card
    return DepthImage(pixels, nearness)


def source(**words):
    return prepare(image(**words), noise=0.0, step=0.0)


def seen(given, fraction=0.6):
    return render(given, of_rectified(fraction), (HEIGHT, WIDTH), "hybrid")


def test_the_wall_goes_on_behind_the_card():
    given = source()
    layer = background(given, 0.1)
    wall = image(card=2.0).nearness
    wall[CARD] = (2.0 + 0.02 * np.arange(WIDTH, dtype=np.float32))[40:60]
    inside = np.zeros((HEIGHT, WIDTH), bool)
    inside[CARD] = True
    assert (layer.nearness > 0)[inside].mean() > 0.9
    made = inside & (layer.nearness > 0)
    np.testing.assert_allclose(layer.nearness[made], wall[made], rtol=0.05)
    np.testing.assert_allclose(layer.color[made], np.tile(WALL, (made.sum(), 1)), atol=1e-3)


def test_the_layer_has_the_reach_that_is_asked_for():
    given = source()
    for reach in (0.03, 0.08):
        layer = background(given, reach)
        middle = layer.nearness[24, 40:50] > 0
        assert middle.sum() == pytest.approx(reach * WIDTH, abs=1.5)


@pytest.mark.sweep
def test_what_is_made_lies_behind_what_is_seen():
    rng = np.random.default_rng(7)
    given = prepare(
        image()._replace(nearness=(1 + 5 * rng.random((HEIGHT, WIDTH))).astype(np.float32)),
        noise=0.0, step=0.0,
    )  # fmt: skip
    layer = background(given)
    far = layer.nearness > 0
    assert (layer.nearness[far] <= given.nearness[far] * (1 + 1e-6)).all()


def test_far_sides_are_samples_beside_something_nearer():
    given = source()
    expected = np.zeros((HEIGHT, WIDTH), bool)
    for row, column in np.ndindex(HEIGHT, WIDTH):
        for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            y, x = row + down, column + right
            if 0 <= y < HEIGHT and 0 <= x < WIDTH:
                ratio = given.nearness[y, x] / given.nearness[row, column]
                expected[row, column] |= ratio > APART
    np.testing.assert_array_equal(far_sides(given), expected)


def test_the_layer_is_that_of_the_nearest_far_side():
    given = source(tilt=0.0)
    layer = background(given, 0.08)
    far = np.argwhere(far_sides(given))
    for place in ((24, 42), (13, 50), (33, 58), (24, 50)):
        away = min(math.dist(place, other) for other in far)
        assert (layer.nearness[place] > 0) == (away <= 0.08 * WIDTH)


def test_nothing_is_made_where_nothing_hides_anything():
    assert background(source(card=2.9)) is None or not (
        background(source(card=2.9)).nearness[24, 50] > 2.9
    )
    flat = prepare(image()._replace(nearness=np.full((HEIGHT, WIDTH), 3.0, np.float32)))
    assert background(flat) is None


def test_holes_show_the_layer_and_keep_their_reason(record):
    given = source()
    front, back = seen(given), seen(background(given))
    both = behind(front, back)
    hole = (front.holes == Hole.DISOCCLUDED) & (front.coverage == 0)
    assert hole.sum() > 30
    record.error("not covered", 1 - both.coverage[hole].mean())
    np.testing.assert_allclose(
        both.image[hole] / both.coverage[hole][:, None], np.tile(WALL, (hole.sum(), 1)), atol=0.02
    )
    np.testing.assert_array_equal(both.holes, front.holes)
    np.testing.assert_array_equal(both.confidence, front.confidence)
    whole = front.coverage >= 1
    np.testing.assert_array_equal(both.image[whole], front.image[whole])
    np.testing.assert_array_equal(both.depth[front.coverage > 0], front.depth[front.coverage > 0])


@pytest.mark.parametrize("reason", [Hole.OUTSIDE, Hole.NO_DEPTH])
def test_other_holes_stay_empty(reason):
    given = source()
    front, back = seen(given), seen(background(given))
    front.holes[front.holes == Hole.DISOCCLUDED] = reason
    both = behind(front, back)
    hole = front.holes == reason
    assert (back.coverage[hole] > 0).any()
    assert not both.coverage[hole].any()
    assert np.isinf(both.depth[hole]).all()


@pytest.mark.sweep
def test_frames_of_a_film_show_one_layer():
    """What is made up moves with the wall: a texture in the layer stays where it is on the wall."""
    rng = np.random.default_rng(3)
    bands = np.repeat(rng.random((12, 1, 3)), 4, axis=0) * np.ones((1, WIDTH, 1))
    given = source(color=bands, tilt=0.0)
    layer = background(given)

    def rate(made):
        frames = [made(seen(given, f), f).image for f in (0.5, 1.0)]
        moved = np.roll(frames[0], -1, axis=1)  # the wall's disparity is 2 px
        hole = seen(given, 0.5).holes == Hole.DISOCCLUDED
        there = np.roll(hole, -1, axis=1) & (seen(given, 1.0).holes == Hole.DISOCCLUDED)
        return float(np.sqrt(np.square(frames[1] - moved)[there].mean()))

    by_layer = rate(lambda front, f: fill(behind(front, seen(layer, f))))
    by_picture = rate(lambda front, _: fill(front))
    assert by_layer < 0.25 * by_picture


def test_the_same_source_has_the_same_layer():
    one, other = background(source()), background(source())
    np.testing.assert_array_equal(one.color, other.color)
    np.testing.assert_array_equal(one.nearness, other.nearness)


def test_a_call_fills_by_the_layer():
    given = image()
    picture = warp_disparity(given.color, given.nearness, 0.6, fill=True)
    layer = warp_disparity(given.color, given.nearness, 0.6, fill="layer")
    empty = warp_disparity(given.color, given.nearness, 0.6)
    assert (layer.coverage == 1).all()
    np.testing.assert_array_equal(layer.holes, empty.holes)
    np.testing.assert_array_equal(
        warp_disparity(given.color, given.nearness, 0.6, fill="picture").image, picture.image
    )
    assert not np.array_equal(layer.image, picture.image)
    with pytest.raises(ValueError, match="unknown filling 'patch'; known: picture, layer"):
        warp_disparity(given.color, given.nearness, 0.6, fill="patch")


@pytest.mark.parametrize("reach", [0.0, -1.0, 2.0, math.nan])
def test_a_reach_is_a_share(reach):
    with pytest.raises(ValueError, match="give a share of the picture's side"):
        background(source(), reach)
