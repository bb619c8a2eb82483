"""Windows of a picture, each of which shows no more of a scene than fits in memory."""

from collections import deque
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.painting.scenes.plans import Window


class WindowTask(NamedTuple):
    """A window to paint, and the parts of the scene that may show in it."""

    window: Window
    number: NDArray[np.int32]  # (N,) of the parts
    sizes: NDArray[np.int32]  # (N,) samples of each, at most

    @property
    def samples(self) -> int:
        """Samples of all its parts."""
        return int(self.sizes.sum(dtype=np.int64))


def split_windows(
    size: tuple[int, int],
    tile: int,
    bounds: Callable[[Window], WindowTask | None],
) -> list[WindowTask]:
    """Return windows of whole tiles that make up a picture (height, width), each of which fits.

    Where `bounds` gives None a window is halved; it raises if a single tile does not fit.
    """
    found: list[WindowTask] = []
    waiting: deque[Window] = deque([(0, 0, size[1], size[0])])
    while waiting:
        window = x0, y0, x1, y1 = waiting.popleft()
        columns, rows = -(-(x1 - x0) // tile), -(-(y1 - y0) // tile)
        task = bounds(window)
        if task is not None:
            found.append(task)
        elif columns >= rows:
            middle = x0 + columns // 2 * tile
            waiting += [(x0, y0, middle, y1), (middle, y0, x1, y1)]
        else:
            middle = y0 + rows // 2 * tile
            waiting += [(x0, y0, x1, middle), (x0, middle, x1, y1)]
    return found


def spans_within(start: NDArray[np.int64], most: int) -> Iterator[tuple[int, int]]:
    """Yield spans of tiles that have at most so many members together, or single tiles.

    `start` (T + 1,) is the number of members of all tiles before each.
    """
    tile, count = 0, len(start) - 1
    while tile < count and start[tile] < start[-1]:
        last = int(np.searchsorted(start, start[tile] + most, side="right")) - 1
        last = min(max(last, tile + 1), count)
        if start[last] > start[tile]:
            yield tile, last
        tile = last
