"""Commands that are told to stop, at any moment of their life.

A signal ends the work of the main thread by an exception, as Python does for Ctrl-C, so that what
is being written is tidied up. Five things are added. SIGTERM does so, too. It is caught while
modules are imported. Where Python cannot raise it, in a finalizer, in what a library calls back or
while a library in C++ is loaded, it is raised a little later. When the command has ended,
signals change nothing any more. And threads that do not end, Python waits for no longer than
`AT_LAST`.
"""

import gc
import os
import signal
import sys
import time
from typing import TYPE_CHECKING, Any, NoReturn

# Little else, so that signals find somebody soon.
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

INTERRUPTED = 128 + signal.SIGINT  # what shells report for Ctrl-C
WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
SOON = 0.05  # seconds, after which what could not be raised is raised again
ONCE = 1.0  # seconds, in which a second signal is taken for the same wish
AT_LAST = 10.0  # seconds, after which a process ends whatever its threads are doing


class StoppedError(SystemExit):
    """A signal told the process to stop.

    No KeyboardInterrupt: Python, once one has passed through code that was given as a text, ends
    by the signal whatever was made of it.
    """

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.number = signal.Signals(number)


def start(module: str) -> NoReturn:
    """Run the `main` of a module as this process's command.

    Parameters
    ----------
    module
        Its name. It is imported here.

    Raises
    ------
    SystemExit
        Always: with the status of the command, 130 after SIGINT and 143 after SIGTERM.
    """
    stop = _stopping()
    for number in WORDS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as `nohup` and shells' jobs have it
            signal.signal(number, stop)
    status: Any = 0
    try:
        from resample.command.threads import leave_algebra_alone
        from resample.console.streams import open_streams

        open_streams()
        leave_algebra_alone()
        _imported(module).main()
    except StoppedError as end:
        from resample.console.messages import say

        say(WORDS[end.number])
        status = end.code
    except SystemExit as end:
        status = end.code
    finally:
        for number in WORDS:
            signal.signal(number, signal.SIG_IGN)
    raise SystemExit(status)


def _imported(module: str) -> Any:
    """A module, imported; what that makes stays, and is not looked through for garbage."""
    from importlib import import_module

    gc.disable()
    try:
        return import_module(module)
    finally:
        gc.enable()
        gc.freeze()


def _stopping() -> "Callable[[int, FrameType | None], None]":
    """What handles signals; it makes Python raise later what it cannot raise now."""
    last = -ONCE
    report = sys.unraisablehook

    def stop(number: int, frame: "FrameType | None") -> None:
        nonlocal last
        before, last = last, time.monotonic()
        if last - before < ONCE:
            return
        if _is_in_native_import(frame):
            last = -ONCE
            _tell_soon(number)
            return
        _end_at_last(128 + number)
        raise StoppedError(number)

    def again(unraisable: Any) -> None:
        nonlocal last
        error = unraisable.exc_value
        if not isinstance(error, StoppedError):
            report(unraisable)
            return
        last = -ONCE
        _tell_soon(error.number)

    sys.unraisablehook = again
    return stop


def _end_at_last(status: int) -> None:
    """End the process after a while, should Python still wait for a thread of it."""
    from threading import Timer

    timer = Timer(AT_LAST, os._exit, (status,))
    timer.daemon = True
    timer.start()


def _is_in_native_import(frame: "FrameType | None") -> bool:
    """Whether a library in C or C++ is being loaded: some end the process where that fails."""
    while frame is not None:
        if type(frame.f_locals.get("self")).__name__ == "ExtensionFileLoader":
            return True
        frame = frame.f_back
    return False


def _tell_soon(number: int) -> None:
    """Send the main thread a signal once more, a little later."""
    from threading import Timer, main_thread

    def tell() -> None:
        if hasattr(signal, "pthread_kill"):  # wakes who sleeps
            signal.pthread_kill(main_thread().ident or 0, number)
        else:
            signal.raise_signal(number)

    timer = Timer(SOON, tell)
    timer.daemon = True
    timer.start()
