"""Session of a command: one-line errors, timed stages, progress, memory checks."""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from traceback import extract_tb
from typing import TYPE_CHECKING, NoReturn

from resample.command.stopping import INTERRUPTED, StoppedError
from resample.console import Progress, give_up, listening, open_streams, progress_bar, say
from resample.memory import LOG, amount, peak_memory, require
from resample.messages import one_line

if TYPE_CHECKING:
    import cyclopts

USER_ERROR = 2  # exit status for errors in arguments, files or settings
COMPILER = 135 << 20  # bytes held by numba and LLVM
OTHERS = 115 << 20  # bytes held by Python and by file readers and writers
ENCODED = 27  # bytes per value of a picture that is painted, encoded and written as integers
AS_FLOATS = 10  # bytes per value of a picture that is written as it is


def run(app: "cyclopts.App", arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command line and end the process.

    `arguments`: of the command line; None takes the process's.
    """
    from cyclopts import CycloptsError

    open_streams()  # for callers that do not use `stopping.start`
    try:
        with listening():
            status = _call(app, arguments)
    except (StoppedError, KeyError, IndexError):
        raise
    except (KeyboardInterrupt, SystemExit) as end:  # cyclopts turns the first into the second
        if isinstance(end, SystemExit) and end.code != INTERRUPTED:
            raise
        say("interrupted")
        status = INTERRUPTED
    except BrokenPipeError:  # the reader, such as `head`, has closed the pipe
        give_up(sys.stdout)
        status = 0
    except ImportError as error:
        frames = [Path(frame.filename).parent.name for frame in extract_tb(error.__traceback__)]
        if "cv2" not in (error.name, *frames[-3:]):
            raise
        say(
            f"error: cv2 (OpenCV) cannot be imported: {one_line(error)}; install one of its four "
            "wheels and no other, such as: pip install --force-reinstall "
            "opencv-contrib-python-headless"
        )
        status = USER_ERROR
    except (CycloptsError, ValueError, LookupError, OSError, MemoryError) as error:
        from resample.command.usage_errors import explained, with_own_pip

        words = sys.argv[1:] if arguments is None else arguments
        say(f"error: {with_own_pip(explained(error, words))}")
        status = USER_ERROR
    raise SystemExit(status)


def _call(app: "cyclopts.App", arguments: Sequence[str] | None) -> int:
    words = sys.argv[1:] if arguments is None else arguments
    if any("sample:" in word for word in words):
        from resample.command.applications import check_added
        from resample.samples.finding import expanded

        arguments = expanded(words, partial(check_added, app, words))
    result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    LOG.debug("peak memory: %s", amount(peak_memory()))
    # Flush stdout, so that a full disk is reported here and not after the end.
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        give_up(sys.stdout)
        raise OSError(
            error.errno, f"cannot be written: {error.strerror}", "standard output"
        ) from None
    return result if isinstance(result, int) else 0


def libraries() -> int:
    """Bytes that loaded libraries hold; numba counts where kernels are compiled."""
    from resample.engine.compiled.library import is_there

    return OTHERS if is_there() else OTHERS + COMPILER


@dataclass
class Session:
    """Timed stages of a run; messages for the user go to stderr."""

    seconds: dict[str, float] = field(default_factory=dict)
    is_quiet: bool = False  # stages have no bars, as within a film's

    @contextmanager
    def stage(self, name: str, bar: str | None = None) -> Iterator[Progress | None]:
        """Measure the time of a block and add it to a named stage.

        `bar`: text of the progress bar on the terminal; None shows no bar. Yields: the callback
        that updates the bar with the fraction done, if there is a bar.
        """
        shown: AbstractContextManager[Progress | None]
        shown = nullcontext() if bar is None or self.is_quiet else progress_bar(bar)
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

    `shape`: height and width, px. `others`: other memory that is held at the same time, bytes by
    name.
    """
    height, width = shape
    picture = {"the picture": bytes_per_pixel * height * width}
    parts = {"libraries": libraries(), **(others or {}), **picture}
    if workers:
        parts[f"{workers} workers"] = workers * sum(parts.values())
    require(f"a picture of {width} x {height} pixels", parts, "take a smaller size")
