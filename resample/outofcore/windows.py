"""Paint a scene that is larger than memory, window by window.

An application says three things of a scene in parts (`InParts`): `bounds`, `load` and `paint`.
Windows that fit in memory follow from them. They are painted here or by an executor, whose
processes write them to files: those of a worker or command that was killed are taken as they are.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from resample.files.writing import replacing
from resample.outofcore.passes import PassContext, passed
from resample.painting.scenes.plans import Window
from resample.reading.arrays import read_npz
from resample.types import Film
from resample.watching import Executor, Progress

NAME = "window-{}-{}-{}-{}.npz"


class Budget(NamedTuple):
    """Memory budget and executor for painting in windows.

    Examples
    --------
    >>> from resample.outofcore.windows import Budget
    >>> Budget(memory=1 << 30).executor is None  # windows are painted here, one after the other
    True
    """

    memory: int  # bytes that the samples of a window may take, in each process
    threads: int | None = None  # of each process; None: all
    folder: Path | None = None  # folder that windows are written to
    executor: Executor | None = None  # of threads or processes; None: this one

    def context(self, progress: Progress | None) -> PassContext:
        """Who makes passes, and who is told of their progress."""
        return PassContext(self.executor, self.threads, progress)


class WindowTask(NamedTuple):
    """A window to paint, and the parts of the scene that may show in it."""

    window: Window
    number: NDArray[np.int32]  # (N,) of the parts
    sizes: NDArray[np.int32]  # (N,) samples of each, at most
    step: int = 0  # samples loaded together, nearest parts first; 0: all of them
    recent: int = 0  # bytes kept from one step for the next

    @property
    def samples(self) -> int:
        """Samples of all its parts."""
        return int(self.sizes.sum(dtype=np.int64))


class InParts(Protocol):
    """A scene in parts: what an application says of it. It is pickled for other processes.

    Windows are rectangles, spans of tiles or rows: whatever `bounds` takes.

    Examples
    --------
    A picture of a stored one, upside down, of which no more than some rows are in memory:

    >>> import numpy as np
    >>> stored = np.arange(6.0).reshape(3, 2)
    >>> class UpsideDown:
    ...     def bounds(self, rows):
    ...         return slice(3 - rows.stop, 3 - rows.start)
    ...     def load(self, part):
    ...         return stored[part]
    ...     def paint(self, part):
    ...         return self.load(part)[::-1]
    >>> scene, windows = UpsideDown(), [slice(0, 2), slice(2, 3)]
    >>> [scene.paint(scene.bounds(rows)).tolist() for rows in windows]
    [[[4.0, 5.0], [2.0, 3.0]], [[0.0, 1.0]]]
    """

    def bounds(self, window: Any, /) -> Any:
        """What a window shows of the scene; None: more than fits in memory."""

    def load(self, part: Any, /) -> Any:
        """The samples of parts that a window shows."""

    def paint(self, task: Any, /) -> Any:
        """The picture of a window; it loads its parts, together or one after the other."""


def split_windows(
    size: tuple[int, int],
    tile: int,
    bounds: Callable[[Window], WindowTask | None],
    fewest: int = 1,
) -> list[WindowTask]:
    """Return windows of whole tiles that make up a picture (height, width), each of which fits.

    Where `bounds` gives None a window is halved; it raises if a single tile does not fit. There are
    at least `fewest` windows where these do not fit in memory at once.
    """
    found: list[WindowTask] = []
    waiting: deque[Window] = deque([(0, 0, size[1], size[0])])
    while waiting:
        window = x0, y0, x1, y1 = waiting.popleft()
        columns, rows = -(-(x1 - x0) // tile), -(-(y1 - y0) // tile)
        is_tile, task = max(columns, rows) == 1, bounds(window)
        are_enough = is_tile or len(found) + len(waiting) + 1 >= fewest
        if task is not None and (task.step == 0 or are_enough):
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


def painted_in_windows(
    scene: InParts,
    tasks: Sequence[WindowTask],
    context: PassContext,
    folder: Path | None = None,
) -> Iterator[tuple[Window, Film, int]]:
    """Paint windows, in files of a folder if there is one; yield them with their reads.

    `paint` of the scene returns a film and the number of reads.
    """
    job, sizes = partial(_painted, scene, folder), [task.samples for task in tasks]
    for task, (film, reads) in zip(tasks, passed(job, tasks, context, sizes), strict=True):
        yield task.window, film or _from_file(folder, task.window), reads


def _from_file(folder: Path | None, window: Window) -> Film:
    stored = None if folder is None else kept_tile(folder, window)
    if stored is None:
        raise OSError(f"{folder}: a window of the picture is missing; try again")
    return stored[0]


def _painted(scene: InParts, folder: Path | None, task: WindowTask) -> tuple[Film | None, int]:
    """Paint a window; the film is None if it is in its file."""
    stored = None if folder is None else kept_tile(folder, task.window)
    if stored is not None:  # painted by a worker that ended before it could report
        return None, stored[1]["reads"]
    film, reads = scene.paint(task)
    if folder is None:
        return film, reads
    keep_tile(folder, task.window, film, {"reads": reads})
    return None, reads


def keep_tile(folder: Path, window: Window, film: Film, facts: Mapping[str, int]) -> None:
    """Write a window, px of the whole picture, atomically."""
    parts: dict[str, Any] = film._asdict() | {f"of_{name}": n for name, n in facts.items()}
    with replacing(folder / NAME.format(*window)) as temporary, temporary.open("wb") as file:
        np.savez(file, **parts)


def kept_tile(folder: Path, window: Window) -> tuple[Film, dict[str, int]] | None:
    """Read a window and its numbers; None if it was not written."""
    path = folder / NAME.format(*window)
    if not path.is_file():
        return None
    parts = read_npz(path)
    film = Film(*(parts[name] for name in Film._fields))
    return film, {name[3:]: int(part) for name, part in parts.items() if name.startswith("of_")}
