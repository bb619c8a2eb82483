"""What painters decide before they paint: orders, and what may be seen."""

from types import SimpleNamespace

import numpy as np
import pytest

from resample.painting import rays
from resample.painting.rays import COMPOSITE
from resample.profiles.orders import Summing, sheets_of
from resample.types import Bounds, Layers

THICKNESS = 0.7
AHEAD = SimpleNamespace(rotation=np.eye(3), translation=np.zeros(3))
EYES = [-np.inf, 3.2]


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("summing", [Summing.POINTS, Summing.SHEETS])
def test_samples_are_ordered_by_their_distance_from_the_eye_s_place(rng, eye, summing):
    """Or by their places, where all lie behind the eye; by whole sheets where these are summed."""
    place = rng.uniform(-9.0, 9.0, 50)
    position = np.column_stack([0 * place, 0 * place, place]).astype(np.float32)
    found = sheets_of(Layers((0.0, 0.0, 1.0), 0.0, THICKNESS, eye), summing, position, AHEAD)
    np.testing.assert_array_equal(found.sheet, np.floor(place / THICKNESS))
    if summing is Summing.SHEETS:
        middle = found.sheet + (0.5 if eye > -np.inf else 0.0)
        key = np.abs(middle - eye / THICKNESS) if eye > -np.inf else middle
    else:
        key = np.abs(place - eye) if eye > -np.inf else place
    np.testing.assert_allclose(found.key, key, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("looks", [1, 2])
@pytest.mark.parametrize("slopes", [1, 5])
def test_bricks_are_visible_that_a_look_shows_at_a_slope(rng, looks, slopes):
    columns, shape = 16, (3, 2, 4)
    extinction = rng.uniform(size=(slopes, looks, columns)) * (rng.uniform(size=columns) < 0.2)
    table = np.zeros((slopes, looks * columns, 4), np.float32)
    table[..., 3] = extinction.reshape(slopes, -1)
    least = rng.uniform(0.0, columns - 1.0, shape)
    bounds = Bounds(least, np.minimum(least + rng.uniform(0.0, 3.0, shape), columns - 1.0))
    visible = rays.thickest(table, looks) > 0
    found = rays._visible(bounds, np.concatenate([[0], np.cumsum(visible)]))
    for at in np.ndindex(shape):
        first, last = int(np.floor(bounds.least[at])), int(np.ceil(bounds.greatest[at]))
        assert found[at] == extinction[..., first : last + 1].any()
    assert 0 < found.sum() < found.size


def test_the_number_of_a_brick_is_how_far_the_next_visible_one_is(rng):
    shape = (3, 2, 4)
    cells = np.where(rng.uniform(size=shape) < 0.2, np.uint64(1) << np.uint64(63), np.uint64(0))
    looks = SimpleNamespace(table=np.zeros((1, 4, 4)))
    field = SimpleNamespace(classifier=looks, classifiers=1, cells=cells, apart=cells[:0])
    bounds = Bounds(np.zeros(shape), np.ones(shape))
    found = rays._bricks(bounds, field, SimpleNamespace(projection=COMPOSITE))
    assert (found.across, found.down, found.deep) == shape[::-1]
    places = np.argwhere(cells > 0)
    away = [np.abs(places - at).max(axis=1).min() for at in np.ndindex(shape)]
    np.testing.assert_array_equal(found.empty, away)
