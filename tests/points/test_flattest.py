"""Normals of points: the direction in which their neighbours are spread least."""

from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from resample.engine.jit import kernel
from resample_points.kernels import cells as lines
from resample_points.kernels.cells import _turned_flattest, flattest
from tests.kernels import run_in_python

SPREAD = {
    "flat": (1.0, 0.7, 1e-4),
    "nearly isotropic": (1.0, 0.95, 0.9),
    "nearly a line": (1.0, 0.03, 0.01),
    "huge": (1e15, 1e15, 1e13),
    "tiny": (1e-19, 1e-19, 1e-21),
}


@kernel
def normal_of(matrix):
    """The normal of a matrix's rows."""
    return flattest(matrix)


def as_rows(matrix):
    return tuple(tuple(map(float, row)) for row in matrix)


@pytest.mark.some(1)
@pytest.mark.parametrize("name", SPREAD)
def test_normals_are_eigenvectors(rng, name):
    for _ in range(200):
        points = rng.normal(size=(13, 3)) * SPREAD[name]
        points = points @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
        matrix = (points - points.mean(axis=0)).T @ (points - points.mean(axis=0))
        matrix = 0.5 * (matrix + matrix.T)
        value, vector = np.linalg.eigh(matrix)
        found = np.array(normal_of(as_rows(matrix)))
        assert np.linalg.norm(found) == pytest.approx(1.0, abs=1e-14)
        error = np.linalg.norm(np.cross(found, vector[:, 0])) * (value[1] - value[0]) / value[2]
        assert error < 1e-12  # as far as rounding of the matrix lets it be known


@pytest.mark.parametrize("axis", range(3))
def test_a_plane_along_the_axes_has_the_third_as_its_normal(axis):
    matrix = np.diag(np.where(np.arange(3) == axis, 0.0, (2.0, 3.0, 5.0)))
    np.testing.assert_array_equal(np.abs(normal_of(as_rows(matrix))), np.arange(3) == axis)


@pytest.mark.parametrize("spread", [(0, 0, 0), (1, 1, 1), (0, 0, 1), (1, 0, 0), (1, 1, 2)])
def test_where_several_directions_serve_it_is_one_of_them(spread):
    matrix = np.diag(np.asarray(spread, float))
    found = np.array(normal_of(as_rows(matrix)))
    assert np.linalg.norm(found) == pytest.approx(1.0)
    assert found @ matrix @ found == pytest.approx(min(spread), abs=1e-12)


@pytest.mark.parametrize(
    "values", [*permutations((1.0, 2.0, 4.0)), (1.0, 1.0, 1.0), (3.0, 1.0, 3.0)]
)
@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0])
def test_jacobi_s_method_finds_the_direction_of_the_least_spread(monkeypatch, values, turn):
    run_in_python(monkeypatch, lines)
    axes = Rotation.from_rotvec(turn * np.array([0.5, -0.3, 0.8])).as_matrix()
    matrix = axes @ np.diag(values) @ axes.T
    found = np.array(_turned_flattest.__wrapped__(tuple(map(tuple, matrix))))
    assert np.linalg.norm(found) == pytest.approx(1.0)
    assert found @ matrix @ found == pytest.approx(min(values), rel=1e-6)
