"""What command lines say while they work, and check before they do."""

import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

Progress = Callable[[float], None]

GIB = 1 << 30


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


def rows_as_json(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows as JSON, which cannot say infinity."""
    finite = [
        {key: None if value == math.inf else value for key, value in row.items()} for row in rows
    ]
    return json.dumps(finite, indent=2) + "\n"


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write facts to a file."""
    from resample.images import replacing

    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def check_targets(*paths: Path | None) -> None:
    """Refuse files that could not be written in the end, before any work is done; None is none.

    Raises
    ------
    ValueError
        Two are the same.
    OSError
        A folder is missing or must not be written to, or a target is no file.
    """
    from resample.images import replacing

    given = [path for path in paths if path is not None]
    if len({path.resolve() for path in given}) < len(given):
        raise ValueError(f"{given[0]} cannot be written twice; give each output its own name")
    for path in given:
        with suppress(_Abandoned), replacing(path):
            raise _Abandoned


def physical_memory() -> int | None:
    """Bytes of memory this machine has; None where the platform does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def require_memory(count: int, what: str, remedy: str) -> None:
    """Refuse what cannot fit, however long one waits.

    Parameters
    ----------
    count
        Bytes that will be held at once.
    what
        Name for the message.
    remedy
        What to do about it, for the message.

    Raises
    ------
    ValueError
        The machine has less memory than that, used or not.
    """
    installed = physical_memory()
    if installed is not None and count > installed:
        raise ValueError(
            f"{what} needs {count / GIB:.1f} GiB, this machine has {installed / GIB:.1f} GiB "
            f"of memory; {remedy}"
        )


class _Abandoned(Exception):  # noqa: N818 - no error: the file was only tried
    """Leaves a file that is being replaced as it was."""
