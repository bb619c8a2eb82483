"""Sparse volumes of any size are rendered within the memory that is allowed."""

import time

import pytest

from benchmarks.scale import LOOK, MIB, RECENT, SIDE, Job, generated, measured

PICTURE = 64 * SIDE * SIDE  # bytes of a picture, and of what is made of it


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "allowed"),
    [
        (256, 96),
        *(
            pytest.param(size, allowed, marks=pytest.mark.sweep)
            for size, allowed in ((512, 192), (512, 320), (1024, 768), (1024, 1024))
        ),
    ],
)
def test_a_fresh_process_holds_no_more_than_is_allowed(size, allowed, tmp_path):
    path = tmp_path / "bubbles.ome.zarr"
    generated(path, size)
    time.sleep(RECENT)  # of what was just written nothing is kept
    told = measured(Job(path, allowed * MIB, "streamed", LOOK))
    assert told["voxels"] > 0.03 * size**2 * 256
    assert told["added"] <= allowed * MIB + PICTURE
    if size >= 512:
        assert told["reads"] <= 1.5 * told["bricks"]
