import numpy as np
import pytest

from resample.engine.cells.bands import Batch
from resample.engine.jit import kernel
from resample_texture.texels.kernels.placing import TexelMapping, place

BLOCK = np.array([[0, 4, 1, 0, 4, 0], [0, 4, 1, 0, 4, 0]])
BOUNDS = np.array([0, 0, 8, 8])


NONE = np.zeros((0, 0))


@kernel
def place_row(geometry, offset, batch):
    """Fill in a row of cells."""
    place(geometry, BLOCK, BOUNDS, 0.5, offset, 0, batch)


def placed(geometry):
    """What is filled in for a row of cells, from arrays that hold no numbers before."""
    offset = np.arange(4, dtype=np.float32) + np.float32(0.5)
    along = [np.full(4, np.nan, np.float32) for _ in range(3)]
    batch = Batch(np.full(4, -1, np.int32), *along, np.empty((1, 4), np.float32))
    place_row(geometry, offset, batch)
    return batch.pixel, along


@pytest.mark.parametrize("nowhere", [np.nan, 1e9])
def test_cells_of_a_map_that_are_nowhere_weigh_nothing_and_leave_no_gaps(nowhere):
    places = np.full((6, 6), nowhere)
    pixel, along = placed(TexelMapping(np.eye(3), places, places))
    assert pixel.tolist() == [0] * 4
    assert [array.tolist() for array in along] == [[0.0] * 4] * 3


def test_cells_in_the_plane_of_the_eye_weigh_nothing_and_leave_no_gaps():
    matrix = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 1.5]])  # d = 0 at u = 1.5
    pixel, along = placed(TexelMapping(matrix, NONE, NONE))
    assert pixel[1] == 0
    assert [array[1] for array in along] == [0.0] * 3
    assert np.isfinite(along).all()
