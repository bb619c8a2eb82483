"""A run of a command: times its stages and shows progress."""

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from resample.console import Progress, progress_bar
from resample.memory import require

COMPILER = 135 << 20  # bytes held by numba and LLVM
OTHERS = 115 << 20  # bytes held by Python and by file readers and writers
ENCODED = 27  # bytes per value of a picture that is painted, encoded and written as integers
AS_FLOATS = 10  # bytes per value of a picture that is written as it is


def libraries() -> int:
    """Bytes that loaded libraries hold; numba counts where kernels are compiled."""
    from resample.engine.compiled.library import is_there

    return OTHERS if is_there() else OTHERS + COMPILER


@dataclass
class Session:
    """Timed stages of a run; messages for the user go to stderr."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, bar: str | None = None) -> Iterator[Progress | None]:
        """Measure the time of a block and add it to a named stage.

        Parameters
        ----------
        bar
            Text of the progress bar on the terminal; None shows no bar.

        Yields
        ------
        The callback that updates the bar with the fraction done, if there is a bar.
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


def bytes_per_value(output: Path) -> int:
    """Peak bytes per value to paint and write a picture."""
    return AS_FLOATS if output.suffix.lower() == ".exr" else ENCODED


def bytes_written(shape: tuple[int, int], output: Path) -> int:
    """Peak bytes per channel to paint and write a picture (height, width)."""
    return bytes_per_value(output) * shape[0] * shape[1]


def require_picture(
    shape: tuple[int, int],
    bytes_per_pixel: int,
    others: dict[str, int] | None = None,
    workers: int = 0,
) -> None:
    """Reject a picture (height, width) too large for this machine, before any work is done.

    Parameters
    ----------
    shape
        Height and width, px.
    others
        Other memory that is held at the same time, bytes by name.
    """
    height, width = shape
    picture = {"the picture": bytes_per_pixel * height * width}
    parts = {"libraries": libraries(), **(others or {}), **picture}
    if workers:
        parts[f"{workers} workers"] = workers * sum(parts.values())
    require(f"a picture of {width} x {height} pixels", parts, "take a smaller size")
