"""Handle signals during all stages of a command.

A signal raises an exception in the main thread, as Python does for Ctrl-C, so that files being
written are cleaned up. This module adds five things. SIGTERM is handled too. Signals are caught
while modules are imported. Where Python cannot raise an exception (in a finalizer, a callback of a
library, or while a C++ library is loaded) it is raised a little later. After the command has ended,
signals have no effect. And Python waits at most `AT_LAST` for threads that do not end.

It also limits libraries' thread pools to `--threads`, before the libraries are loaded.
"""

import gc
import os
import signal
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

# Few imports, so that signals are handled early.
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

INTERRUPTED = 128 + signal.SIGINT  # exit status that shells report for Ctrl-C
WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
SOON = 0.05  # seconds before an exception that could not be raised is raised again
ONCE = 1.0  # seconds during which a second signal counts as a repetition of the first
AT_LAST = 10.0  # seconds before a process ends even if its threads still run
# Variables that numba, BLAS and OpenMP, OpenCV and OpenImageIO read when they are loaded.
VARIABLES = (
    "NUMBA_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
    "OPENIMAGEIO_THREADS",
)
OPENEXR = "OPENIMAGEIO_OPTIONS"  # sets the size of OpenEXR's pool, among others


class StoppedError(SystemExit):
    """A signal stopped the process.

    Not a KeyboardInterrupt: once one has passed through code given as text, Python ends the process
    by the signal, even if the exception was handled.
    """

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.number = signal.Signals(number)


def start(module: str) -> NoReturn:
    """Run the `main` of a module as the command of this process."""
    stop = _stopping()
    for number in WORDS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # `nohup` ignores signals
            signal.signal(number, stop)
    status: Any = 0
    try:
        from resample.console import open_streams

        open_streams()
        # OpenBLAS gets one thread unless more are asked for: commands give it little work, and its
        # idle threads spin, which took a tenth of the total time of a small picture.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # a search of 10 ms
        _imported(module).main()
    except StoppedError as end:
        from resample.console import say

        say(WORDS[end.number])
        status = end.code
    except SystemExit as end:
        status = end.code
    finally:
        for number in WORDS:
            signal.signal(number, signal.SIG_IGN)
    raise SystemExit(status)


def _imported(module: str) -> Any:
    """Import a module; its objects are excluded from garbage collection."""
    from importlib import import_module

    gc.disable()
    try:
        return import_module(module)
    finally:
        gc.enable()
        gc.freeze()


def _stopping() -> "Callable[[int, FrameType | None], None]":
    """Signal handler; it makes Python retry an exception that could not be raised."""
    last = -ONCE
    report = sys.unraisablehook

    def stop(number: int, frame: "FrameType | None") -> None:
        nonlocal last
        before, last = last, time.monotonic()
        if last - before < ONCE:
            return
        if _is_in_native_import(frame):
            last = -ONCE
            _signal_again_soon(number)
            return
        # End the process after a while if Python still waits for one of its threads.
        from threading import Timer

        timer = Timer(AT_LAST, os._exit, (128 + number,))
        timer.daemon = True
        timer.start()
        raise StoppedError(number)

    def again(unraisable: Any) -> None:
        nonlocal last
        error = unraisable.exc_value
        if not isinstance(error, StoppedError):
            report(unraisable)
            return
        last = -ONCE
        _signal_again_soon(error.number)

    sys.unraisablehook = again
    return stop


def _is_in_native_import(frame: "FrameType | None") -> bool:
    """Whether a C or C++ library is being loaded: some end the process if that fails."""
    while frame is not None:
        if type(frame.f_locals.get("self")).__name__ == "ExtensionFileLoader":
            return True
        frame = frame.f_back
    return False


def _signal_again_soon(number: int) -> None:
    """Send the main thread the signal again, a little later."""
    from threading import Timer, main_thread

    def tell() -> None:
        if hasattr(signal, "pthread_kill"):  # wakes a sleeping thread
            signal.pthread_kill(main_thread().ident or 0, number)
        else:
            signal.raise_signal(number)

    timer = Timer(SOON, tell)
    timer.daemon = True
    timer.start()


@contextmanager
def at_most(count: int | None) -> "Iterator[None]":
    """Limit libraries loaded in a block to `count` threads; None sets no limit.

    A lower limit set in the environment is kept.
    """
    from resample.reading.limits import restored

    with restored(*VARIABLES, OPENEXR):
        if count is not None:
            for name in VARIABLES:
                given = os.environ.get(name, "")
                allowed = int(given) if given.isdecimal() else 0
                os.environ[name] = str(min(count, allowed or os.cpu_count() or 1))
            pool = count if count > 1 else -1  # -1: none
            os.environ.setdefault(OPENEXR, f"exr_threads={pool}")
        yield
