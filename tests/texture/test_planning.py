"""Plans: the pictures of `warp`, of which only what depends on the picture is worked out again."""

from itertools import product

import numpy as np
import pytest

from resample_texture import BackwardMap, ForwardMap, Hybrid, Plan, drawing, warp

SIZE, SHAPE = (60, 80), (50, 70)
MATRIX = np.array([[1.02, 0.03, 5.0], [-0.02, 0.97, 9.0], [1e-4, 2e-4, 1.0]])
FLOOR = np.array([[1.0, 0.8, -9.0], [0.0, 0.3, 9.0], [0.0, 0.05, 1.0]])
Y, X = np.mgrid[0:50, 0:70] + 0.5
PLACES = BackwardMap(X + 3 * np.sin(Y / 5), Y)
GEOMETRIES = {
    "matrix": MATRIX,
    "floor": FLOOR,
    "shift": np.array([[1.0, 0.0, 3.0], [0.0, 1.0, -2.0], [0.0, 0.0, 1.0]]),
    "map": PLACES,
    "function": lambda x, y: (x + np.sin(y), y),
    "forward": ForwardMap(np.mgrid[0:60, 0:80][1] * 0.8, np.mgrid[0:60, 0:80][0] * 0.9),
}


@pytest.fixture
def pictures():
    rng = np.random.default_rng(5)
    return [rng.integers(0, 256, (*SIZE, 3), np.uint8), rng.random(SIZE, np.float32)]


@pytest.mark.some(9)
@pytest.mark.parametrize(
    ("name", "edge"),
    [
        pytest.param(
            *pair,
            marks=pytest.mark.sweep
            if pair[0] == "floor" and pair[1] != "transparent"  # many mirror images
            else (),
        )
        for pair in product(GEOMETRIES, ("transparent", "mirror", "reflect-101"))
    ],
)
def test_a_plan_makes_the_pictures_of_warp(pictures, name, edge):
    plan = Plan(GEOMETRIES[name], SHAPE, SIZE, edge=edge)
    for picture in pictures:
        found, expected = plan(picture), warp(picture, GEOMETRIES[name], SHAPE, edge=edge)
        np.testing.assert_array_equal(found.image, expected.image)
        np.testing.assert_array_equal(found.coverage, expected.coverage)


@pytest.mark.parametrize("method", ["paper", "nearest", "lanczos4", "hybrid:total=true", Hybrid()])
def test_every_method_can_be_planned(pictures, method):
    found = Plan(MATRIX, SHAPE, SIZE, method)(pictures[1])
    np.testing.assert_array_equal(found.image, warp(pictures[1], MATRIX, SHAPE, method).image)


def test_a_plan_measures_once(monkeypatch, pictures):
    plan = Plan(PLACES, SHAPE, SIZE)
    monkeypatch.setattr("resample_texture.texels.gather.measure", None)
    plan(pictures[0])


def test_a_large_picture_is_drawn_in_windows(monkeypatch, pictures):
    plan = Plan(MATRIX, SHAPE, SIZE)
    expected = plan(pictures[1]).image
    monkeypatch.setattr("resample_texture.warping.MOST_AT_ONCE", 0)
    monkeypatch.setattr(drawing, "MOST_AT_ONCE", 0)
    np.testing.assert_allclose(plan(pictures[1]).image, expected, atol=1e-6)


def test_a_function_is_asked_once(pictures):
    asked = []
    plan = Plan(lambda x, y: asked.append(1) or (x, y + 0.5), SHAPE, SIZE)
    for picture in pictures:
        plan(picture)
    assert len(asked) == 1


def test_gaps_options_and_a_place_for_the_result_are_those_of_warp(pictures):
    plan, gray = Plan(MATRIX, SHAPE, SIZE), pictures[1].copy()
    gray[20:30, 20:30] = np.nan
    out = np.empty(SHAPE, np.float32)
    assert plan(gray, out=out, threads=1).image is out
    np.testing.assert_array_equal(out, warp(gray, MATRIX, SHAPE).image)
    found = plan(pictures[0], linear_light=False).image
    expected = warp(pictures[0], MATRIX, SHAPE, linear_light=False).image
    np.testing.assert_array_equal(found, expected)


def test_what_does_not_fit_a_plan_is_refused(pictures):
    with pytest.raises(ValueError, match="for pictures of"):
        Plan(MATRIX, SHAPE, SIZE)(pictures[0][:-1])
    with pytest.raises(ValueError, match="does not fit a target"):
        Plan(PLACES, (9, 9), SIZE)
    with pytest.raises(LookupError, match="unknown method"):
        Plan(MATRIX, SHAPE, SIZE, "none")
    method = Hybrid().planned(SIZE, PLACES, SHAPE, "mirror")
    with pytest.raises(ValueError, match="go another way"):
        method(np.zeros((*SIZE, 1), np.float32), BackwardMap(X, Y), SHAPE, "mirror")
