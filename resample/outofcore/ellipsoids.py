"""Ellipsoids in parts, more than memory holds: projected part by part, window by window.

A picture needs what it shows of each ellipsoid, `BYTES`, and one part at a time. Where that is more
than the budget, windows of the picture are painted one after the other.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.engine.shaped.records import WIDTH
from resample.messages import Window, check_size
from resample.painting.ellipsoids import (
    EllipsoidSource,
    HeldRecords,
    ShapedPicture,
    ShapedScene,
    ShapedStyle,
    empty_canvas,
    in_window,
)
from resample.painting.scenes import Clock
from resample.progress import Progress
from resample.types import Floats, Statistics

BYTES = 4 * WIDTH + 8 + 12  # per ellipsoid: a record, its key while it is sorted, and its lists
NOTHING = np.zeros(0, np.int32)


def paint_parts(
    source: EllipsoidSource,
    camera: AnyCamera,
    size: tuple[int, int],
    style: ShapedStyle | None = None,
    *,
    memory: int,
    progress: Progress | None = None,
) -> tuple[ShapedPicture, int]:
    """Paint ellipsoids in parts, with the bits of `paint_ellipsoids` of them all.

    `source`: parts, loaded one at a time. `camera`, `size`, `style`, `progress`: as
    `paint_ellipsoids` takes them. `memory`: bytes for all projected ellipsoids, besides one part.
    Returns the picture, and the number of windows. Raises ValueError: a number is out of range; or
    what a tile shows needs more memory.
    """
    check_size(*size)
    clock, most = Clock(), memory // BYTES
    scene = ShapedScene.of(source, camera, size, style)
    whole, held = (0, 0, size[1], size[0]), Held(min(most, sum(source.sizes())))
    projected = (held.add(records) for records in scene.projected())
    scene = scene.measured(projected)
    for _ in projected:
        pass  # given sub-pixels need no measure

    def bounds(window: Window) -> WindowTask | None:
        """Return the task of a window; None if it shows more than fits."""
        count = (
            held.count
            if window == whole
            else sum(len(in_window(records, window)) for records in scene.projected())
        )
        if count <= most:
            return WindowTask(window, NOTHING, np.array([count], np.int32))
        if max(window[2] - window[0], window[3] - window[1]) > scene.tile():
            return None
        raise ValueError(
            f"a tile of {scene.tile()} x {scene.tile()} px shows {count} ellipsoids, more than fit"
            " in the allowed memory; give more memory"
        )

    tasks = split_windows(size, scene.tile(), bounds)
    clock.lap("project")
    canvas, painted = empty_canvas(size), 0
    for done, task in enumerate(tasks):
        records = held.records
        if records is None:
            records = scene.records(task.window, task.samples)
        clock.lap("project")
        painted += scene.paint(records, task.window, canvas)
        clock.lap("paint")
        if progress is not None:
            progress((done + 1) / len(tasks))
    counts = Statistics(sum(source.sizes()), 0, painted, 0, scene.finest(), clock.seconds)
    return ShapedPicture(*canvas, counts), len(tasks)


class Held:
    """Records of all parts, counted, and kept as long as they fit."""

    def __init__(self, most: int) -> None:
        self.count, self._most = 0, most
        self.records: HeldRecords | None = HeldRecords(most)

    def add(self, whole: Floats) -> Floats:
        """Add some, and return them."""
        self.count += len(whole)
        if self.records is not None and self.count <= self._most:
            self.records.add(whole)
        else:
            self.records = None
        return whole


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
    """Return windows of whole tiles that make up a picture (height, width); each fits.

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
