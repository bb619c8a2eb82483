"""What command lines say while they work."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[float], None]


def say(text: str) -> None:
    """One line to the user, beside the results."""
    sys.stderr.write(f"resample: {text}\n")


@contextmanager
def progress_bar(what: str) -> Iterator[Progress | None]:
    """Bar on a terminal's stderr, which runs to and fro until it is told a share; else nothing."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda share: bar.update(task, total=1.0, completed=share)
