"""Messages, progress bars and standard streams of commands, and background colors by name.

A file opened while one of the first three descriptors is free would get it, and with it all printed
text.
"""

import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from typing import TextIO

from resample.messages import visible

Progress = Callable[[float], None]

NAMES = ("stdin", "stdout", "stderr")
LOUDNESS = "RESAMPLE_LOG"  # name of an environment variable
LEVELS = ("debug", "info", "warning")
Color = tuple[float, float, float]  # linear light

# Notes of a command, and whether they are printed.
_notes: ContextVar[dict[str, bool] | None] = ContextVar("_notes", default=None)

SPLAT_COLOR: Color = (0.8, 0.02, 0.02)  # linear red, the paper's Figure 8a
COLORS: dict[str, Color] = {"black": (0.0, 0.0, 0.0), "white": (1.0, 1.0, 1.0)}


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
    """Drop output buffered for a closed pipe."""
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


def say(text: str) -> None:
    """Print one line for the user to stderr."""
    write_message(f"resample: {visible(text)}\n")


def note(text: str) -> None:
    """Print a line, in a command once and at its end if it succeeds."""
    notes = _notes.get()
    if notes is None:
        say(text)
    elif text not in notes:
        notes[text] = False


def say_notes() -> None:
    """Print the notes of a command that are not yet printed."""
    notes = _notes.get() or {}
    for text, is_said in notes.items():
        if not is_said:
            say(text)
            notes[text] = True


def say_of(path: Path, text: str) -> None:
    """Print one line about a file, unless it was printed for another in its folder."""
    first = _first_of(path.absolute().parent, text)
    if first.setdefault("name", path.name) == path.name:
        say(f"{path.name}: {text}")


@lru_cache(1 << 10)
def _first_of(folder: Path, text: str) -> dict[str, str]:  # noqa: ARG001 - the key
    """Name of the folder's file that messages are about; empty at first."""
    return {}


class _Listener(logging.Handler):
    """Logging handler that prints the library's messages."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one line for the user."""
        say(record.getMessage())


@contextmanager
def listening() -> Iterator[None]:
    """Print the library's messages, such as compilation; all if `RESAMPLE_LOG=debug`."""
    level = os.environ.get(LOUDNESS, "info")
    if level not in LEVELS:
        raise ValueError(f"{LOUDNESS} is {level!r}; it can be {', '.join(LEVELS)}")
    log, listener = logging.getLogger("resample"), _Listener()
    before = log.level
    log.addHandler(listener)
    log.setLevel(level.upper())
    token = _notes.set({})
    try:
        yield
        say_notes()
    finally:
        _notes.reset(token)
        log.setLevel(before)
        log.removeHandler(listener)


@contextmanager
def progress_bar(what: str, count: int = 0) -> Iterator[Progress | None]:
    """Progress bar on a terminal's stderr, indeterminate until it gets a fraction.

    It shows the remaining time and, if `count` parts are given, how many are done.
    """
    if sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn
    from rich.progress import Progress as Bar

    columns = [*Bar.get_default_columns(), *([MofNCompleteColumn()] if count else [])]
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task, total = bar.add_task(what, total=None), count or 1.0
        yield lambda share: bar.update(task, total=total, completed=round(share * total, 3))


def background_in(suffix: str, name: str | None, own: str = "none") -> Color | None:
    """Linear color behind a picture in a file with this suffix; None: transparent.

    The rule of all commands: `name` if it is given; JPEG and films, which are opaque, show black;
    other files are transparent, unless the pictures have their own background: `own`.
    """
    if suffix.lower() in (".jpg", ".jpeg"):
        own = "black"
        if name is not None and name.lower() == "none":
            raise ValueError("JPEG has no transparency; give --background white, or take .png")
    return linear_color(own if name is None else name)


def film_background(name: str) -> Color:
    """Linear color behind a film, which is opaque."""
    found = linear_color(name)
    if found is None:
        raise ValueError("films are opaque; give --background black, white or #rrggbb")
    return found


def linear_color(name: str) -> Color | None:
    """Linear RGB of a color name or #rrggbb; None for "none"."""
    if name.lower() in ("none", "transparent"):
        return None
    if name in COLORS:
        return COLORS[name]
    import matplotlib.colors
    import numpy as np

    from resample.colors import from_srgb

    if not matplotlib.colors.is_color_like(name):
        raise ValueError(f"background {name!r}; give none, #rrggbb or a color's name")
    red, green, blue = from_srgb(np.array(matplotlib.colors.to_rgb(name))).tolist()
    return red, green, blue
