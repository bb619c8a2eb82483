"""What painters decide before they paint: orders, ends of steps, windows, what may be seen."""

from types import SimpleNamespace

import numpy as np
import pytest

from resample.painting import points, rays, runs, stepping
from resample.painting.rays import COMPOSITE
from resample.painting.scenes.cuts import NEVER, Between, cut_at
from resample.painting.scenes.plans import NOTHING, checked_window
from resample.profiles.orders import Summing, sheets_of
from resample.types import Bounds, Layers

THICKNESS, SLACK = 0.7, 1e-3
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


def end_at(between, key, eye=-np.inf, reach=0.4):
    layers = Layers((0.0, 0.0, 1.0), 0.0, THICKNESS, eye)
    ellipsoid = SimpleNamespace(covariance=np.eye(3) * reach**2)
    scene = SimpleNamespace(layers=layers, ellipsoid=ellipsoid)
    return cut_at(scene, between, np.float32(key), np.float32(SLACK))


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("key", [-2.2, 0.3, 5.1])
def test_a_step_ends_before_the_layer_of_what_is_to_come(key, eye):
    end = end_at(Between.LAYERS, key, eye)
    assert end.due == np.floor(key / THICKNESS)
    assert end.last <= key
    assert np.floor(end.last / np.float32(THICKNESS)) == end.due
    assert np.floor(np.nextafter(end.last, np.float32(-99)) / np.float32(THICKNESS)) < end.due
    assert end.again == pytest.approx(end.last - SLACK, abs=1e-6)


@pytest.mark.parametrize("key", [0.3, 5.1])
def test_a_step_ends_before_the_sheet_of_what_is_to_come(key):
    """Sheets on both sides of an eye are numbered by the distances of their middles."""
    end = end_at(Between.SHEETS, key)
    assert (end.last, end.again, end.due) == (np.floor(key / THICKNESS), end.last, NEVER)
    end = end_at(Between.SHEETS, key, 3.2)
    assert end.last == pytest.approx(max(0.0, (key - SLACK) / THICKNESS - 0.5), abs=1e-5)
    assert (end.again, end.due) == (end.last, NEVER)


@pytest.mark.parametrize("key", [-2.2, 0.3, 5.1])
def test_a_step_ends_before_the_slabs_that_what_is_to_come_reaches(key):
    end, reach = end_at(Between.SLABS, key), 0.4
    assert end.due * THICKNESS + reach <= key - SLACK < (end.due + 1) * THICKNESS + reach
    assert end.last == np.float32(key)
    assert end.again == pytest.approx((end.due - 1) * THICKNESS - reach - SLACK, abs=1e-5)


@pytest.mark.parametrize("between", list(Between))
def test_the_last_step_ends_after_everything(between):
    assert end_at(between, np.inf) == (np.inf, np.inf, NEVER)


def test_splats_and_sums_of_all_are_cut_at_any_key():
    for between in (Between.SPLATS, Between.NOTHING):
        assert end_at(between, 2.0) == (2.0, np.float32(2.0) - np.float32(SLACK), NEVER)


@pytest.mark.parametrize("window", [(0, 0, 7, 5), (6, 4, 7, 5), (0, 0, 1, 1)])
def test_a_window_may_touch_the_edges_of_its_picture(window):
    assert checked_window(np.array(window), 5, 7) == window


@pytest.mark.parametrize(
    "window",
    [(-1, 0, 7, 5), (0, -1, 7, 5), (0, 0, 8, 5), (0, 0, 7, 6), (3, 0, 3, 5), (0, 4, 7, 4)],
)
def test_a_window_that_is_empty_or_leaves_its_picture_is_refused(window):
    with pytest.raises(ValueError, match="is not inside a picture of 7 x 5 pixels"):
        checked_window(window, 5, 7)


@pytest.mark.parametrize("window", [(0, 0, 7), (0, 0, "a", 5), 3])
def test_a_window_is_four_numbers(window):
    with pytest.raises(ValueError, match="give x0, y0, x1 and y1, whole numbers of px"):
        checked_window(window, 5, 7)


def test_a_window_s_film_has_the_whole_picture_s_size():
    """Without a picture there is no film; outside of the window's tiles nothing is written."""
    tiles = SimpleNamespace(size=4)
    for window in (None, (2, 5, 9, 7)):
        scene = SimpleNamespace(window=window, screen=SimpleNamespace(height=12, width=10))
        film = runs.film_of(scene, tiles)
        assert film.rgba.shape == (12, 10, 4)
        assert film.depth.shape == film.first_depth.shape == film.coverage.shape == (12, 10)
        assert np.isinf(film.depth[4:8]).all()
        assert np.isinf(film.first_depth[4:8]).all()
        assert not film.rgba.any()
    nothing = SimpleNamespace(window=NOTHING, screen=scene.screen)
    assert runs.film_of(nothing, tiles).rgba.shape == (0, 0, 4)


@pytest.mark.parametrize("margin", [0.0, 1.6])
def test_parts_are_open_whose_bounds_meet_an_open_pixel(rng, margin):
    """Bounds are widened by the margin of filters and by a pixel."""
    screen = SimpleNamespace(height=8, width=12, margin=margin)
    tiles, open_pixels = SimpleNamespace(size=4), rng.uniform(size=(8, 12)) < 0.05
    open_pixels[0, 0] = open_pixels[7, 11] = True
    by_tile = open_pixels.reshape(2, 4, 3, 4).swapaxes(1, 2).reshape(6, 4, 4)
    low = rng.uniform(-6.0, 14.0, (400, 2))
    bounds = np.hstack([low, low + rng.uniform(0.0, 4.0, (400, 2))])
    found = stepping._are_open(
        SimpleNamespace(screen=screen), tiles, SimpleNamespace(is_open=by_tile), bounds
    )
    wide = margin + stepping.BORDER
    rows, columns = (np.arange(size) for size in (8, 12))
    for (left, top, right, bottom), is_open in zip(bounds, found, strict=True):
        down = (rows + 1 > top - wide) & (rows <= bottom + wide)
        across = (columns + 1 > left - wide) & (columns <= right + wide)
        assert is_open == open_pixels[np.ix_(down, across)].any()


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
    field = SimpleNamespace(classifier=looks, classifiers=1, cells=cells)
    bounds = Bounds(np.zeros(shape), np.ones(shape))
    found = rays._bricks(bounds, field, SimpleNamespace(projection=COMPOSITE))
    assert (found.across, found.down, found.deep) == shape[::-1]
    places = np.argwhere(cells > 0)
    away = [np.abs(places - at).max(axis=1).min() for at in np.ndindex(shape)]
    np.testing.assert_array_equal(found.empty, away)


def test_a_plan_that_shows_nothing_is_no_plan_of_points(monkeypatch):
    """Of nothing there is no spacing that a filter could suit."""
    monkeypatch.setattr("resample.engine.subpixels.grid_of", lambda *_: 1)
    monkeypatch.setattr(points, "_are_points", lambda *_: True)
    monkeypatch.setattr(points, "_form_of", lambda *_: "a filter")
    for visible in (0, 1):
        plan = SimpleNamespace(visible=visible, least=1.0, most=1.0)
        assert points.suits_points(SimpleNamespace(style=None), plan) is (visible > 0)
