"""The examples of docs/library.md run, and what they claim is so."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def example(name):
    """An example as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.sweep
def test_scattered_measurements_cover_exactly_their_area():
    scattered = example("scattered")
    _, reading, jacobian = scattered.measurements()
    area = np.abs(np.linalg.det(jacobian))[np.isfinite(reading)].sum()
    coverage = scattered.gridded().coverage
    assert coverage.sum(dtype=np.float64) == pytest.approx(area, rel=1e-6)


def test_scattered_measurements_give_the_field_where_they_cover_it(record):
    scattered = example("scattered")
    value, coverage = scattered.gridded()
    row, column = np.mgrid[: scattered.HEIGHT, : scattered.WIDTH] + 0.5
    error = np.abs(value - scattered.field(column, row))[coverage > 0.9]
    assert error.size > 0.65 * value.size
    record.error("largest", error.max())
    record.error("rms", np.sqrt(np.mean(error**2)))


@pytest.mark.sweep
def test_a_particle_is_a_disc_as_wide_and_as_opaque_as_it_was_given():
    module = example("particles")
    taken = module.visible([[0, 0, 5]], [1, 1, 1], 0.8, 0.25).rgba[..., 3]
    row, column = np.mgrid[: module.HEIGHT, : module.WIDTH] + 0.5
    away = np.hypot(row - module.HEIGHT / 2, column - module.WIDTH / 2)
    # Rays that touch a sphere of radius r at distance d leave the axis at asin(r / d).
    rim = 200 * np.tan(np.arcsin(0.25 / 5))
    assert not taken[away > rim + 0.8].any()  # half a pixel's diagonal
    assert (taken[away < rim - 0.8] > 0).all()
    assert taken[away < 1] == pytest.approx(0.8, abs=0.02)  # half a pixel beside the center


def test_a_small_particle_before_a_large_one_hides_it_and_one_behind_is_hidden():
    module = example("particles")
    place, colors = np.array([[0, 0, 4.0], [0, 0, 5], [0.3, 0, 6]]), np.eye(3)
    frame = module.visible(place, colors, 0.99, [0.1, 1.0, 0.1])
    red, green, blue, alpha = frame.rgba[module.HEIGHT // 2, module.WIDTH // 2]
    assert min(red, alpha) > 0.9
    assert 0.05 > green > blue
    assert frame.depth[module.HEIGHT // 2, module.WIDTH // 2] == pytest.approx(4, abs=0.02)
    _, green, blue, _ = frame.rgba[module.HEIGHT // 2, module.WIDTH // 2 + 10]
    assert green > 0.8
    assert blue < 0.2


@pytest.fixture(scope="module")
def registered():
    """The example of a registration, and what it finds."""
    module = example("registration")
    return module, module.registered(*module.pictures())


@pytest.mark.sweep
def test_registration_finds_the_matrix_between_two_pictures(registered):
    module, found = registered
    truth = module.SECOND @ np.linalg.inv(module.FIRST)
    wide, high = module.WIDTH, module.HEIGHT
    corners = np.array([[0, wide, wide, 0], [0, 0, high, high], [1, 1, 1, 1.0]])
    expected, ours = ((m @ corners)[:2] / (m @ corners)[2] for m in (truth, found))
    assert np.abs(expected - corners[:2]).max() > 10  # px that they are apart at first
    assert np.abs(expected - ours).max() < 0.03


# Points of a size each have the painter compiled once more.
POINTS = pytest.mark.sweep


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "name", ["scattered", pytest.param("particles", marks=POINTS), "registration"]
)
def test_examples_draw_the_pictures_of_the_page(name, tmp_path, request, monkeypatch):
    module = example(name)
    if name == "registration":
        module, found = request.getfixturevalue("registered")
        monkeypatch.setattr(module, "registered", lambda *_: found)  # once is enough
    module.main(tmp_path / "picture.png")
    assert 1000 < (tmp_path / "picture.png").stat().st_size <= 60_000
