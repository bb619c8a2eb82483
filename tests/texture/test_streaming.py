import numpy as np
import pytest

from resample.profiles.interpolation import InterpolatingCatmullRom, Spline
from resample_texture.geometry.mappings import Homography
from resample_texture.texels.forward import CellGrid, project
from resample_texture.texels.streaming import warp_rows
from resample_texture.types import Edge

MATRIX = np.array([[0.5, 0.1, -3.0], [0.02, 0.4, 5.0], [0.0, 0.0004, 1.0]])
SHAPE = (150, 90)


def strips(source, *heights):
    ends = np.cumsum(heights)
    return np.split(source, ends)


@pytest.mark.parametrize("interpolation", [InterpolatingCatmullRom(), Spline()], ids=repr)
@pytest.mark.parametrize("zoom", [1.0, 3.0])
def test_strips_give_the_picture_of_the_whole(rng, interpolation, zoom):
    source = rng.random((700, 120, 3), np.float32)
    geometry = Homography(np.diag([zoom, zoom, 1.0]) @ MATRIX)
    cells = CellGrid(interpolation=interpolation)
    whole = project(source, geometry, SHAPE, Edge.TRANSPARENT, cells)
    parts = warp_rows(strips(source, 1, 99, 300, 7), source.shape, geometry, SHAPE, cells)
    np.testing.assert_allclose(parts.image, whole.image, atol=2e-5)  # order of float32 sums
    np.testing.assert_allclose(parts.coverage, whole.coverage, atol=2e-5)


def test_texels_are_joined_as_in_the_whole(rng):
    source = rng.random((1500, 800, 1), np.float32)
    geometry = Homography(np.diag([0.05, 0.05, 1.0]))
    whole = project(source, geometry, (75, 40), Edge.TRANSPARENT, CellGrid())
    parts = warp_rows(strips(source, 333, 333, 333), source.shape, geometry, (75, 40))
    np.testing.assert_allclose(parts.image, whole.image, atol=2e-5)  # order of float32 sums


def test_missing_rows_are_noticed(rng):
    source = rng.random((300, 10, 1), np.float32)
    with pytest.raises(ValueError, match="only 200 of 300 rows came"):
        warp_rows([source[:200]], source.shape, Homography(np.eye(3)), (30, 10))


def test_strips_of_another_width_are_refused(rng):
    source = rng.random((30, 10, 1), np.float32)
    with pytest.raises(ValueError, match="a strip of"):
        warp_rows([source[:, :5]], source.shape, Homography(np.eye(3)), (30, 10))
