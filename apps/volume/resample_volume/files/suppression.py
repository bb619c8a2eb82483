"""Silence for C++ libraries that print what they also report."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

_ONE_AT_A_TIME = RLock()  # two threads that swap the same descriptor would not get it back


@contextmanager
def suppressed_output() -> Iterator[None]:
    """Send what the process writes to standard error nowhere, while the block runs.

    ITK, VTK, libpng and niftilib write to file descriptor 2 behind Python's back; only the
    descriptor itself can be turned away. Other threads' messages are lost as well; other
    blocks like this one wait.
    """
    with _ONE_AT_A_TIME:
        try:
            kept = os.dup(2)
        except OSError:  # a daemon without standard error
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(nowhere)
            os.close(kept)
