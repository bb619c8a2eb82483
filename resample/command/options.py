"""What all command lines share: how they run and how they report a user's mistake."""

import sys
from collections.abc import Sequence
from pathlib import Path
from traceback import extract_tb
from typing import TYPE_CHECKING, NoReturn

from resample.command.stopping import INTERRUPTED, StoppedError
from resample.console.messages import listening, say
from resample.console.streams import give_up, open_streams
from resample.memory import LOG, amount, held_at_most
from resample.words import one_line

if TYPE_CHECKING:
    import cyclopts

USER_ERROR = 2  # exit status of a mistake in the arguments, files or settings


def run(app: "cyclopts.App", arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command line and end the process.

    Parameters
    ----------
    app
        The commands. One that returns a whole number sets the exit status with it.
    arguments
        Words of the command line; None takes the process's own.

    Raises
    ------
    SystemExit
        Always. Status 0 after success. Status 2 and one line on stderr after a ValueError,
        LookupError, OSError, MemoryError, a pydantic ValidationError or a word that the command
        line does not know, or if OpenCV cannot be imported; 130 after Ctrl-C. A KeyError or an
        IndexError is a bug in a program, not the user's mistake: these and all others pass through
        with their traceback.
    """
    from cyclopts import CycloptsError

    open_streams()  # of who calls this without `stopping.start`
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
    except BrokenPipeError:  # the reader, `head` for one, has seen enough
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
    """What is wrong with the installed OpenCV and what to do; None if something else is."""
    frames = [str(frame.filename) for frame in extract_tb(error.__traceback__)]
    if error.name != "cv2" and "cv2" not in (Path(name).parent.name for name in frames[-3:]):
        return None
    return (
        f"cv2 (OpenCV) cannot be imported: {one_line(error)}; install one of its four wheels and "
        "no other, such as: pip install --force-reinstall opencv-contrib-python-headless"
    )


def _flush() -> None:
    """Write all that is printed: a full disk must show here, not after the end."""
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
    LOG.debug("at most %s of memory were held", amount(held_at_most()))
    _flush()
    return result if isinstance(result, int) else 0
