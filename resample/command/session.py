"""A run of a command line: its stages timed, and what the user is told while it works."""

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from resample.console.messages import Progress, progress_bar
from resample.memory import require

COMPILER = 135 << 20  # bytes that numba and LLVM hold
OTHERS = 115 << 20  # bytes that Python, and what reads and writes files, hold by themselves
ENCODED = 27  # bytes per value of a picture that is painted, encoded and written as integers
AS_FLOATS = 10  # the same of one that is written as it is


def libraries() -> int:
    """Bytes that libraries hold by themselves; numba is one where kernels are compiled."""
    from resample.engine.compiled.library import is_there

    return OTHERS if is_there() else OTHERS + COMPILER


@dataclass
class Session:
    """Stages of a run, timed; what the user should know goes to stderr."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, bar: str | None = None) -> Iterator[Progress | None]:
        """Book the time of a block under a name.

        Parameters
        ----------
        name
            What the time is booked under.
        bar
            What a bar on the terminal says the while; None shows none.

        Yields
        ------
        What tells the bar the share of the work that is done, if there is one.
        """
        shown: AbstractContextManager[Progress | None]
        shown = nullcontext() if bar is None else progress_bar(bar)
        start = time.perf_counter()
        with shown as progress:
            yield progress
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def times(self) -> dict[str, float]:
        """Seconds of all stages, for `--stats`."""
        return {name: round(seconds, 6) for name, seconds in self.seconds.items()}


def bytes_written(shape: tuple[int, int], output: Path) -> int:
    """Bytes that a channel of a picture (height, width) takes, painted and written to a file."""
    is_float = output.suffix.lower() == ".exr"
    return (AS_FLOATS if is_float else ENCODED) * shape[0] * shape[1]


def require_picture(
    shape: tuple[int, int], bytes_per_pixel: int, others: dict[str, int] | None = None
) -> None:
    """Refuse a picture (height, width) that this machine cannot hold, before any work is done.

    Parameters
    ----------
    shape
        Height and width, px.
    bytes_per_pixel
        Of the picture and the copies that are made when it is painted and written.
    others
        Bytes of what else is held at that time, by what it is.

    Raises
    ------
    ValueError
        It is more than is allowed or free.
    """
    height, width = shape
    picture = {"the picture": bytes_per_pixel * height * width}
    what = f"a picture of {width} x {height} pixels"
    require(what, {"libraries": libraries(), **(others or {}), **picture}, "take a smaller size")
