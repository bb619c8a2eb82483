"""Suppress what C and C++ libraries print in addition to their error results."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock


class _Silence:
    """Standard error of the process, suppressed while any block needs it."""

    def __init__(self) -> None:
        self._turn, self._blocks, self._kept = Lock(), 0, -1

    def begin(self) -> None:
        """Redirect the descriptor, unless another block has done so."""
        with self._turn:
            self._blocks += 1
            if self._blocks > 1:
                return
            try:
                self._kept = os.dup(2)
            except OSError:  # a daemon without standard error
                self._kept = -1
                return
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 2)
            os.close(nowhere)

    def end(self) -> None:
        """Restore the descriptor, unless another block still needs it redirected."""
        with self._turn:
            self._blocks -= 1
            if self._blocks or self._kept < 0:
                return
            os.dup2(self._kept, 2)
            os.close(self._kept)


_SILENCE = _Silence()


@contextmanager
def suppressed_output() -> Iterator[None]:
    """Discard what the process writes to standard error in this block.

    VTK, libpng and others write to file descriptor 2 directly; only the descriptor itself can be
    redirected. Other threads' messages are lost as well.
    """
    _SILENCE.begin()
    try:
        yield
    finally:
        _SILENCE.end()
