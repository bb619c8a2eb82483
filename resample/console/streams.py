"""Make stdin, stdout and stderr usable even if the caller has closed them.

Otherwise a file opened while one of the first three descriptors is free would get it, and with it
all printed text.
"""

import os
import sys
from contextlib import suppress
from typing import TextIO

NAMES = ("stdin", "stdout", "stderr")


def open_streams() -> None:
    """Open closed streams on the null device; characters that cannot be encoded are escaped."""
    for number, name in enumerate(NAMES):
        is_closed = not _is_open(number)
        if is_closed:
            _lead_nowhere(number)
        if getattr(sys, name) is None:
            place = number if is_closed else os.devnull
            setattr(sys, name, open(place, "w" if number else "r", encoding="utf-8"))  # noqa: SIM115
        elif number and hasattr(getattr(sys, name), "reconfigure"):
            getattr(sys, name).reconfigure(errors="backslashreplace")


def give_up(stream: TextIO | None) -> None:
    """Discard what is still buffered for a stream that nobody reads."""
    with suppress(OSError, ValueError, AttributeError):
        _lead_nowhere(stream.fileno())  # type: ignore[union-attr]


def write_message(text: str) -> None:
    """Write a message for the user to stderr, if possible."""
    try:
        sys.stderr.write(text)
    except (OSError, AttributeError):  # full, gone, or missing
        give_up(sys.stderr)


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _lead_nowhere(number: int) -> None:
    """Point an inherited file descriptor at a sink that stores nothing."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    if nowhere == number:
        os.set_inheritable(number, True)
        return
    os.dup2(nowhere, number)
    os.close(nowhere)
