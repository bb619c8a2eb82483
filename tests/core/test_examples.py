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


def test_scattered_measurements_cover_exactly_their_area():
    scattered = example("scattered")
    _, reading, jacobian = scattered.measurements()
    area = np.abs(np.linalg.det(jacobian))[np.isfinite(reading)].sum()
    coverage = scattered.gridded().coverage
    assert coverage.sum(dtype=np.float64) == pytest.approx(area, rel=1e-6)


def test_scattered_measurements_give_the_field_where_they_cover_it():
    scattered = example("scattered")
    value, coverage = scattered.gridded()
    row, column = np.mgrid[: scattered.HEIGHT, : scattered.WIDTH] + 0.5
    error = np.abs(value - scattered.field(column, row))[coverage > 0.9]
    assert error.size > 0.65 * value.size
    assert error.max() < 0.03
    assert np.sqrt(np.mean(error**2)) < 5e-3


@pytest.mark.parametrize("name", ["scattered"])
def test_examples_draw_the_pictures_of_the_page(name, tmp_path):
    example(name).main(tmp_path / "picture.png")
    assert 1000 < (tmp_path / "picture.png").stat().st_size <= 60_000
