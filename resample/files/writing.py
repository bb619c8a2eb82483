"""Files that appear whole or not at all."""

import errno
import json
import math
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Write beside a file and put the result in its place when all went well.

    Parameters
    ----------
    path
        Target. It is created or replaced at the end of the block; a link is followed.

    Yields
    ------
    An empty file of the same folder and suffix, to be written to. It is removed after an error.

    Raises
    ------
    OSError
        The target cannot be created: its folder is missing or may not be written to, or it is a
        folder or device.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise OSError(errno.EISDIR, "is not a regular file, so it is not replaced", str(path))
    temporary = target.with_name(f".{target.stem}.tmp{secrets.token_hex(4)}{target.suffix}")
    try:
        temporary.open("xb").close()
    except OSError as error:
        raise OSError(error.errno, f"cannot be written: {error.strerror}", str(path)) from None
    try:
        yield temporary
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def rows_as_json(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows as JSON, which cannot say infinity."""
    finite = [
        {key: None if value == math.inf else value for key, value in row.items()} for row in rows
    ]
    return json.dumps(finite, indent=2) + "\n"


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write facts to a file."""
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
    given = [path for path in paths if path is not None]
    if len({path.resolve() for path in given}) < len(given):
        raise ValueError(f"{given[0]} cannot be written twice; give each output its own name")
    for path in given:
        with suppress(_Abandoned), replacing(path):
            raise _Abandoned


class _Abandoned(Exception):  # noqa: N818 - no error: the file was only tried
    """Leaves a file that is being replaced as it was."""
