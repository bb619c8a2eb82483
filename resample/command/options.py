"""Run a command line and report errors of the user in one line."""

import sys
from collections.abc import Sequence
from pathlib import Path
from traceback import extract_tb
from typing import TYPE_CHECKING, NoReturn

from resample.command.stopping import INTERRUPTED, StoppedError
from resample.console import give_up, listening, open_streams, say
from resample.memory import LOG, amount, peak_memory
from resample.words import one_line

if TYPE_CHECKING:
    import cyclopts

USER_ERROR = 2  # exit status for errors in arguments, files or settings


def run(app: "cyclopts.App", arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command line and end the process.

    Parameters
    ----------
    arguments
        Arguments; None takes those of the process.
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
        if (complaint := _broken_opencv(error)) is None:
            raise
        say(f"error: {complaint}")
        status = USER_ERROR
    except (CycloptsError, ValueError, LookupError, OSError, MemoryError) as error:
        say(f"error: {one_line(error)}")
        status = USER_ERROR
    raise SystemExit(status)


def _broken_opencv(error: ImportError) -> str | None:
    """Explain what is wrong with the installed OpenCV and what to do; None for other errors."""
    frames = [str(frame.filename) for frame in extract_tb(error.__traceback__)]
    if error.name != "cv2" and "cv2" not in (Path(name).parent.name for name in frames[-3:]):
        return None
    return (
        f"cv2 (OpenCV) cannot be imported: {one_line(error)}; install one of its four wheels and "
        "no other, such as: pip install --force-reinstall opencv-contrib-python-headless"
    )


def _flush() -> None:
    """Flush stdout, so that a full disk is reported here and not after the end."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        give_up(sys.stdout)
        raise OSError(
            error.errno, f"cannot be written: {error.strerror}", "standard output"
        ) from None


def _call(app: "cyclopts.App", arguments: Sequence[str] | None) -> int:
    words = sys.argv[1:] if arguments is None else arguments
    if any("sample:" in word for word in words):
        from resample.samples.finding import expanded

        arguments = expanded(words)
    result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    LOG.debug("peak memory: %s", amount(peak_memory()))
    _flush()
    return result if isinstance(result, int) else 0
