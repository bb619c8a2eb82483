"""Read deep pictures, as tests need it."""

from pathlib import Path

import numpy as np
import OpenImageIO

from resample.files.saving import DEEP_CHANNELS
from resample.types import Floats


def read_deep(path: Path) -> list[list[Floats]]:
    """Read samples (N, 6) of each pixel in the order of `DEEP_CHANNELS`, row by row."""
    source = OpenImageIO.ImageInput.open(str(path))
    spec, data = source.spec(), source.read_native_deep_image()
    assert spec.deep
    order = [list(spec.channelnames).index(name) for name in DEEP_CHANNELS]
    pixels = [
        np.array(
            [[data.deep_value(n, c, k) for c in order] for k in range(data.samples(n))], np.float32
        ).reshape(-1, len(DEEP_CHANNELS))
        for n in range(spec.height * spec.width)
    ]
    return [pixels[row * spec.width : (row + 1) * spec.width] for row in range(spec.height)]
