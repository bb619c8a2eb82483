"""The three streams of a process: there though a caller has closed them, no reason to fail.

A file that is opened while one of the first three numbers is free would get it, and with it all
that is printed.
"""

import os
import sys
from contextlib import suppress
from typing import TextIO

NAMES = ("stdin", "stdout", "stderr")


def open_streams() -> None:
    """Open what the caller has closed, to nowhere; what has no letter is written as a code."""
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
    """Let what is still to be written to a stream go nowhere: nobody takes it."""
    with suppress(OSError, ValueError, AttributeError):
        _lead_nowhere(stream.fileno())  # type: ignore[union-attr]


def told(text: str) -> None:
    """Write to stderr what a user should know, if anybody takes it."""
    try:
        sys.stderr.write(text)
    except (OSError, AttributeError):  # full, gone, or not there at all
        give_up(sys.stderr)


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _lead_nowhere(number: int) -> None:
    """Let a number, which children inherit, be that of a file that takes all and holds nothing."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    if nowhere == number:
        os.set_inheritable(number, True)
        return
    os.dup2(nowhere, number)
    os.close(nowhere)
