"""Go through a volume in parts, so that one mapped from a file is never held as a whole."""

from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

CHUNK = 1 << 22  # voxels looked at together


def slabs(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Whole slices (z, Y, X) in their order, about `CHUNK` voxels at a time; views, not copies."""
    step = max(1, CHUNK // max(1, values[0].size))
    for z in range(0, len(values), step):
        yield values[z : z + step]
