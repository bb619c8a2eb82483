"""The way from a call to its first kernel is short, and opens nothing."""

import numpy as np
import pytest

from resample_texture.warping import warp
from tools.walk import modules, walk

MATRIX = [[0.9, -0.2, 10], [0.2, 0.9, 0], [0, 0.0005, 1]]
READERS = ("resample.files", "resample.reading", "resample.command", "resample.outofcore")


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_a_warp_enters_few_modules_and_no_reader_before_its_first_kernel(dtype):
    """By a matrix, of an array; the first call also finds its method, filter and interpolation."""
    image = np.random.default_rng(1).integers(0, 256, (60, 80, 3)).astype(dtype)
    entered = {name: modules(walk(lambda: warp(image, MATRIX))) for name in ("first", "next")}
    for rooms in entered.values():
        assert not [room for room in rooms if room.startswith(READERS)]
    assert len(entered["next"]) <= (12 if dtype == np.uint8 else 15), entered["next"]
