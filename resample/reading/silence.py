"""Silence for C and C++ libraries that print what they also report."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock


class _Silence:
    """Standard error of the process, while some blocks want it to be silent."""

    def __init__(self) -> None:
        self._turn, self._blocks, self._kept = Lock(), 0, -1

    def begin(self) -> None:
        """Turn the descriptor away, unless another block has done so."""
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
        """Turn it back, if no other block wants silence."""
        with self._turn:
            self._blocks -= 1
            if self._blocks or self._kept < 0:
                return
            os.dup2(self._kept, 2)
            os.close(self._kept)


_SILENCE = _Silence()


@contextmanager
def suppressed_output() -> Iterator[None]:
    """Send what the process writes to standard error nowhere, while the block runs.

    VTK, libpng and others write to file descriptor 2 behind Python's back; only the descriptor
    itself can be turned away. Other threads' messages are lost as well.
    """
    _SILENCE.begin()
    try:
        yield
    finally:
        _SILENCE.end()
