"""Inverses of forward and backward maps."""

import numpy as np
import pytest

from resample_texture import BackwardMap, ForwardMap, warp
from resample_texture.geometry.mappings import inverse_of

SHAPE = (64, 80)


def bent(x, y, far=3.0):
    return x + far * np.sin(y / 17), y + far * np.cos(x / 19)


def centers(shape=SHAPE):
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    return x, y


def bent_map(kind=ForwardMap, far=3.0):
    return kind(*bent(*centers(), far))


@pytest.mark.parametrize("far", [0.5, 3.0, 8.0])
@pytest.mark.parametrize("kind", [ForwardMap, BackwardMap])
def test_an_inverse_leads_back(kind, far, record):
    back = bent_map(kind, far).inverse(SHAPE)
    found, place = bent(back.x, back.y, far), centers()
    inner = (back.x > 0.5) & (back.x < 79.5) & (back.y > 0.5) & (back.y < 63.5)
    off = np.hypot(found[0] - place[0], found[1] - place[1])[inner]
    record.error("largest, px", off.max())
    assert inner.mean() > 0.7
    assert isinstance(back, BackwardMap if kind is ForwardMap else ForwardMap)


def test_a_tolerance_is_kept_at_the_pixels_of_the_map():
    place = centers()
    back = ForwardMap(1.25 * place[0] + 3.0, 0.5 * place[1] - 2.0).inverse(SHAPE, tolerance=1e-9)
    known = np.isfinite(back.x)
    np.testing.assert_allclose(back.x[known], (place[0][known] - 3.0) / 1.25, rtol=0, atol=1e-9)
    np.testing.assert_allclose(back.y[known], (place[1][known] + 2.0) / 0.5, rtol=0, atol=2e-9)
    inside = (place[0] > 3.0) & (place[1] < 30.0)
    assert known[inside].all()


@pytest.mark.parametrize("degrees", [90, 180, 217])
def test_a_turn_is_turned_back(degrees):
    turn, (x, y) = np.radians(degrees), centers((40, 40))
    across, down = x - 20, y - 20
    turned = (
        np.cos(turn) * across - np.sin(turn) * down + 20,
        np.sin(turn) * across + np.cos(turn) * down + 20,
    )
    back = ForwardMap(*turned).inverse((40, 40))
    known = np.isfinite(back.x)
    expected = np.cos(turn) * across + np.sin(turn) * down + 20
    np.testing.assert_allclose(back.x[known], expected[known], rtol=0, atol=2e-3)
    assert known[np.hypot(across, down) < 20].all()


def test_nothing_leads_to_where_the_map_does_not_go():
    x, y = centers()
    back = ForwardMap(x + 30.0, y).inverse(SHAPE)
    assert np.isnan(back.x[:, :27]).all()
    np.testing.assert_allclose(back.x[:, 30:], x[:, 30:] - 30.0, rtol=0, atol=1e-3)


def test_texels_that_go_nowhere_are_not_found():
    x, y = centers()
    x[20:30, 20:40] = np.nan
    back = ForwardMap(x, y).inverse(SHAPE)
    assert np.isnan(back.x[20:30, 20:40]).all()
    assert np.isfinite(back.x[:18]).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1)])
def test_maps_of_a_row_or_a_pixel_have_inverses(shape):
    back = ForwardMap(*centers(shape)).inverse(shape)
    assert back.x.shape == shape


def test_a_map_to_nowhere_has_an_inverse_from_nowhere():
    nowhere = np.full(SHAPE, np.nan)
    assert np.isnan(ForwardMap(nowhere, nowhere).inverse(SHAPE).x).all()


def test_a_tolerance_of_nothing_is_refused():
    with pytest.raises(ValueError, match="a tolerance lies above 0 px, not at 0"):
        bent_map().inverse(SHAPE, tolerance=0.0)


def waves(x, y):
    return 0.5 + 0.2 * np.cos(0.5 * x + 0.2 * y) + 0.2 * np.cos(0.3 * x - 0.6 * y)


def means(values):
    """Mean of each pixel, of 5 x 5 points."""
    x, y = centers()
    step = (np.arange(5) - 2.0) / 5.0
    return np.mean([values(x + a, y + b) for a in step for b in step], axis=0)


def test_gathering_by_the_inverse_is_closer_than_projecting():
    truth = means(lambda x, y: waves(*bent(x, y)))
    forward = bent_map(BackwardMap).inverse(SHAPE)
    image = means(waves).astype(np.float32)
    inner = np.s_[12:-12, 12:-12]
    projected, gathered = (
        np.sqrt(np.square(warp(image, way, SHAPE).image - truth)[inner].mean())
        for way in (forward, forward.inverse(SHAPE))
    )
    assert gathered < 0.5 * projected


@pytest.mark.parametrize(
    "shift", [(0.0, 0.0), (5.25, 0.0), (-5.25, 0.0), (0.0, 4.25), (0.0, -4.25)]
)
def test_a_map_is_inverted_up_to_two_pixels_beyond_each_of_its_sides(shift):
    y, x = np.mgrid[:10, :12] + 0.5
    found = np.array(inverse_of(x + shift[0], y + shift[1], (15, 18), 1e-3))
    down, across = np.mgrid[:15, :18] + 0.5
    wanted = np.array([across - shift[0], down - shift[1]])
    is_near = (wanted >= -2.0) & (wanted <= np.array([12, 10])[:, None, None] + 2.0)
    expected = np.where(is_near.all(axis=0), wanted, np.nan)
    np.testing.assert_allclose(found, expected, atol=1e-3)
