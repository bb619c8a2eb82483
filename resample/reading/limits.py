"""How much a file may hold, and how much more it may become, before it is refused.

Files come from anywhere. Each limit is far above what honest files need; `RESAMPLE_LIMIT` in the
environment raises it, for this process and all that it starts, as in
`RESAMPLE_LIMIT=unpacked=8GiB,ratio=5000`; a command's `--limit` does so for the command.
"""

import os
from typing import NamedTuple

from resample.memory import amount, available_memory, bytes_of

SETTING = "RESAMPLE_LIMIT"  # name of an environment variable


class LimitError(ValueError):
    """A file that holds more than is let in; it may be whole."""


class FileLimits(NamedTuple):
    """What is let in."""

    text: int = 1 << 30  # bytes of a text: points, poses
    tree: int = 1 << 26  # bytes of JSON, TOML and YAML, which become many times as much
    depth: int = 64  # of things within things
    items: int = 10_000  # files that a file names, members of an archive, parts of a name
    unpacked: int = 1 << 30  # bytes that compressed data may become, however small it is
    ratio: int = 200  # times its own size that it may become above that


ALIKE = 40  # times the ratio of one picture that frames which are alike may have
BYTES = ("text", "tree", "unpacked")  # limits that are amounts of memory


def limits() -> FileLimits:
    """Limits that hold now.

    Raises
    ------
    ValueError
        The setting names something else.

    Examples
    --------
    >>> from resample.reading.limits import limits
    >>> limits().depth
    64
    """
    given = os.environ.get(SETTING, "")
    changed = dict(_changed(part) for part in given.split(",") if part.strip())
    return FileLimits()._replace(**changed)


def _changed(part: str) -> tuple[str, int]:
    """Name and number of one limit that is set."""
    name, _, text = (word.strip() for word in part.partition("="))
    try:
        if name not in FileLimits._fields:
            raise ValueError
        number = int(text) if text.isdecimal() else bytes_of(text) if name in BYTES else 0
    except ValueError:
        number = 0
    if number < 1:
        raise ValueError(
            f"{SETTING} or --limit has {part.strip()!r}; give {', '.join(FileLimits._fields)} as "
            "in ratio=5000 or unpacked=8GiB, with commas between them"
        )
    return name, number


def refused(what: str, found: str, name: str) -> LimitError:
    """Make the error for what is over the limit of a name."""
    most = getattr(limits(), name)
    told = amount(most) if name in BYTES else str(most)
    return LimitError(
        f"{what}: {found}, over the limit of {told}; raise it by --limit {name}=..., or {SETTING}"
    )


def check_size(what: str, count: int, name: str = "text") -> None:
    """Refuse a file of more bytes than the limit of a name.

    Raises
    ------
    ValueError
        It has more.
    """
    if count > getattr(limits(), name):
        raise refused(what, amount(count), name)


def check_items(what: str, count: int, things: str) -> None:
    """Refuse more things than are let in.

    Raises
    ------
    ValueError
        There are more.
    """
    if count > limits().items:
        raise refused(what, f"{count} {things}", "items")


def check_unpacked(what: str, packed: int, unpacked: int) -> None:
    """Refuse what becomes too large, by itself or beside free memory, before it is unpacked.

    Parameters
    ----------
    what
        Name for the message.
    packed, unpacked
        Bytes in the file, and in memory.

    Raises
    ------
    ValueError
        It is more than the file can honestly hold, or than the memory that is free.

    Examples
    --------
    >>> from resample.reading.limits import check_unpacked
    >>> check_unpacked("a.npz", packed=1000, unpacked=1_000_000)
    """
    check_ratio(what, packed, unpacked)
    check_free(what, unpacked)


def check_ratio(what: str, packed: int, unpacked: int) -> None:
    """Refuse what becomes more than the file can honestly hold, wherever it is put.

    Parameters
    ----------
    what
        Name for the message.
    packed, unpacked
        Bytes in the file, and of what it becomes.

    Raises
    ------
    ValueError
        It is more.
    """
    known = limits()
    if unpacked > known.unpacked and unpacked > known.ratio * max(1, packed):
        found = f"{amount(packed)} that unpack to {amount(unpacked)} or more"
        raise refused(what, found, "ratio")


def check_animation(what: str, packed: int, frame: int, count: int) -> None:
    """Refuse an animation whose frames have far more pixels than its file can honestly hold.

    Parameters
    ----------
    what
        Name for the message.
    packed
        Bytes in the file. Frames that are alike take few, so more is let in than of one picture.
    frame, count
        Bytes of a frame in memory, and how many frames there are.

    Raises
    ------
    ValueError
        They have more.

    Examples
    --------
    >>> from resample.reading.limits import check_animation
    >>> check_animation("a.gif", packed=1_000_000, frame=1_000_000, count=500)
    """
    known = limits()
    whole = frame * count
    if whole > known.unpacked and whole > ALIKE * known.ratio * max(1, packed):
        found = f"{amount(packed)} that unpack to {count} frames of {amount(frame)}"
        raise refused(what, found, "ratio")


def check_free(what: str, count: int) -> None:
    """Refuse what is more than the memory that is free.

    Raises
    ------
    ValueError
        It is more.
    """
    free = available_memory()
    if free is not None and count > free:
        raise LimitError(
            f"{what} needs {amount(count)} of memory and {amount(free)} are free; take a smaller "
            "one, or free some"
        )
