"""Messages and progress bars that commands print while they work."""

import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from resample.console.streams import write_message
from resample.words import visible

Progress = Callable[[float], None]

LOUDNESS = "RESAMPLE_LOG"  # name of an environment variable
LEVELS = ("debug", "info", "warning")


def say(text: str) -> None:
    """Print one line for the user to stderr."""
    write_message(f"resample: {visible(text)}\n")


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
    try:
        yield
    finally:
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
