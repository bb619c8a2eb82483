"""Libraries that print what they also report are not heard."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

from resample.files.images import open_file, read_image
from resample.files.metadata.tags import settings_in
from resample.files.pictures import read_picture
from resample.reading.native import suppressed_output
from resample_warp3d.depth.files import read_depth


@pytest.fixture(params=["head", "middle", "end"])
def damaged(request, tmp_path, rng):
    """A PNG that libpng complains about."""
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), rng.integers(0, 256, (60, 50), np.uint8))
    content = bytearray(path.read_bytes())
    if request.param == "end":
        del content[len(content) // 2 :]
    else:
        start = 40 if request.param == "head" else len(content) // 2
        content[start : start + 30] = bytes(30)
    path.write_bytes(content)
    return path


def strips_of(path: Path) -> None:
    for _ in open_file(path).light_strips():
        pass


@pytest.mark.parametrize("read", [read_image, read_picture, read_depth, settings_in, strips_of])
def test_a_damaged_png_ends_in_an_error_and_nothing_is_printed(damaged, read, capfd):
    with pytest.raises((OSError, ValueError)):
        read(damaged)
    assert capfd.readouterr() == ("", "")


def test_blocks_of_several_threads_leave_the_descriptor_as_it_was(capfd):
    def said(n):
        with suppressed_output():
            os.write(2, b"noise")
            with suppressed_output():
                os.write(2, b"noise")
            os.write(2, b"noise")
        return n

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(said, range(100))) == list(range(100))
    os.write(2, b"words")
    assert capfd.readouterr().err == "words"
