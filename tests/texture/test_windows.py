"""Large pictures drawn window by window: the same as in one go, and no window sees too little."""

import numpy as np
import pytest

from resample_texture import Homography, drawing, warp
from resample_texture.arguments import geometry_of, method_named
from resample_texture.geometry.mappings import BackwardMap
from resample_texture.geometry.matrices import turning
from resample_texture.geometry.regions import Rect, windows_of
from resample_texture.types import Edge

SIZE, SHAPE = (450, 630), (420, 570)
SHRUNK = np.diag([0.3, 0.4, 1.0])
PERSPECTIVE = np.array([[1.02, 0.03, 5.0], [-0.02, 0.97, 9.0], [3e-5, 6e-5, 1.0]])
AWAY = np.array([[1.0, 0.0, 5000.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def lens(x, y):
    """A barrel, and a hole in it."""
    u, v = x / SHAPE[1] - 0.5, y / SHAPE[0] - 0.5
    bend = 1.2 - 0.5 * (u * u + v * v)
    hole = np.where(np.hypot(u - 0.2, v) < 0.05, np.nan, 0.0)
    return (u * bend + 0.5) * SIZE[1] + hole, (v * bend + 0.5) * SIZE[0]


GEOMETRIES = {
    "perspective": PERSPECTIVE,
    "turned": turning(SIZE, 41.0, SHAPE),
    "grown": np.diag([2.5, 2.2, 1.0]),
    "shrunk": SHRUNK,
    "away": AWAY,
    "lens": lens,
}


@pytest.fixture
def source():
    return np.random.default_rng(0).random((*SIZE, 3), np.float32)


def in_windows(monkeypatch, most=180_000):
    """Draw all pictures in windows of at most so many values."""
    monkeypatch.setattr(drawing, "MOST_AT_ONCE", 0)
    monkeypatch.setattr(drawing, "MOST_IN_WINDOW", most)


def is_cut(geometry, edge):
    """Whether a picture is drawn in several windows."""
    given = geometry_of(geometry, SHAPE, "corner", inverse=False)
    border = Edge.WRAP if edge == "reflect-101" else Edge(edge)
    seen = method_named("hybrid").visible_tiles(SIZE, given, SHAPE, border)
    return len(list(windows_of(seen, SIZE, 60_000))) > 1


@pytest.mark.sweep
@pytest.mark.parametrize("edge", ["transparent", "clamp", "wrap", "mirror", "reflect-101"])
@pytest.mark.parametrize("name", GEOMETRIES)
def test_windows_make_the_picture_that_one_go_makes(monkeypatch, source, name, edge):
    whole = warp(source, GEOMETRIES[name], SHAPE, edge=edge)
    in_windows(monkeypatch)
    assert name == "away" or is_cut(GEOMETRIES[name], edge)
    parts = warp(source, GEOMETRIES[name], SHAPE, edge=edge)
    np.testing.assert_allclose(parts.image, whole.image, atol=2e-6)
    np.testing.assert_allclose(parts.coverage, whole.coverage, atol=2e-6)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "dtype", ["bool", "uint8", "uint16", "int16", "int64", "float16", "float64"]
)
@pytest.mark.parametrize("channels", [(), (4,), (7,)])
def test_windows_are_of_the_source_s_type(monkeypatch, dtype, channels):
    values = np.random.default_rng(1).random((*SIZE, *channels)) * 200
    image = (values > 100) if dtype == "bool" else values.astype(dtype)
    whole = warp(image, PERSPECTIVE, SHAPE, edge="clamp")
    in_windows(monkeypatch)
    parts = warp(image, PERSPECTIVE, SHAPE, edge="clamp")
    assert parts.image.dtype == whole.image.dtype
    rounding = {"float16": 0.2, "float64": 1e-4}.get(dtype, 1)
    difference = parts.image.astype(np.float64) - whole.image.astype(np.float64)
    assert np.abs(difference).max() <= rounding
    assert (difference != 0).mean() < 0.5 if dtype.startswith("float") else 1e-3


@pytest.mark.sweep
def test_values_that_are_missing_stay_missing(monkeypatch, source):
    source[30:40, 50:70, 1] = np.nan
    whole = warp(source, PERSPECTIVE, SHAPE)
    in_windows(monkeypatch)
    parts = warp(source, PERSPECTIVE, SHAPE)
    np.testing.assert_array_equal(np.isnan(parts.image), np.isnan(whole.image))
    np.testing.assert_allclose(parts.image, whole.image, atol=2e-6)


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["hybrid:magnified=splats", "paper", "lanczos4"])
def test_methods_that_tell_nothing_of_what_they_see_draw_in_one_go(monkeypatch, source, name):
    whole = warp(source, PERSPECTIVE, SHAPE, name)
    in_windows(monkeypatch)
    np.testing.assert_array_equal(warp(source, PERSPECTIVE, SHAPE, name).image, whole.image)


@pytest.mark.sweep
def test_a_floor_up_to_its_horizon_is_drawn_in_one_go(monkeypatch, source):
    floor = np.array([[1.0, 0.8, -90.0], [0.0, 0.3, 90.0], [0.0, 0.005, 1.0]])
    whole = warp(source, floor, SHAPE)
    in_windows(monkeypatch)
    np.testing.assert_array_equal(warp(source, floor, SHAPE).image, whole.image)


@pytest.mark.sweep
def test_threads_make_no_difference_to_windows(monkeypatch, source):
    in_windows(monkeypatch)
    one = warp(source, PERSPECTIVE, SHAPE, threads=1)
    np.testing.assert_array_equal(warp(source, PERSPECTIVE, SHAPE, threads=2).image, one.image)


@pytest.mark.parametrize("edge", [Edge.CLAMP, Edge.WRAP])
def test_windows_are_small_and_make_up_the_target(edge):
    seen = method_named("hybrid").visible_tiles(SIZE, Homography(PERSPECTIVE), SHAPE, edge)
    most, count = 60_000, np.zeros(SHAPE, int)
    for window in windows_of(seen, SIZE, most):
        count[window.target.part] += 1
        assert window.target.pixels <= most
        assert window.source.pixels <= most
        assert window.source.is_within(SIZE) or edge is Edge.WRAP
    assert (count == 1).all()


def test_windows_that_see_nothing_have_texels_still():
    seen = method_named("hybrid").visible_tiles(SIZE, Homography(AWAY), SHAPE, Edge.CLAMP)
    assert all(window.source.pixels > 0 for window in windows_of(seen, SIZE, 50_000))


def test_a_map_from_all_over_the_source_is_not_cut_for_nothing():
    rng = np.random.default_rng(2)
    places = BackwardMap(rng.random(SHAPE) * SIZE[1], rng.random(SHAPE) * SIZE[0])
    seen = method_named("hybrid").visible_tiles(SIZE, places, SHAPE, Edge.CLAMP)
    assert list(windows_of(seen, SIZE, 100)) == [
        (Rect(0, 0, SHAPE[1], SHAPE[0]), Rect(0, 0, SIZE[1], SIZE[0]))
    ]
