"""Read deep pictures, as tests need it."""

from pathlib import Path

import numpy as np

from resample.files.painted.deep import CHANNELS, _stored
from resample.types import Floats


def read_deep(path: Path) -> list[list[Floats]]:
    """Read samples (N, 6) of each pixel in the order of `CHANNELS`, row by row.

    Raises
    ------
    OSError
        The file is missing or not a deep picture.
    """
    spec, data = _stored(path)
    order = [list(spec.channelnames).index(name) for name in CHANNELS]
    pixels = [
        np.array(
            [[data.deep_value(n, c, k) for c in order] for k in range(data.samples(n))], np.float32
        ).reshape(-1, len(CHANNELS))
        for n in range(spec.height * spec.width)
    ]
    return [pixels[row * spec.width : (row + 1) * spec.width] for row in range(spec.height)]
