"""Limits on the contents of untrusted files, and on their unpacked size.

Each limit is far above what ordinary files need. `RESAMPLE_LIMIT` in the environment raises it for
this process and its children, as in `RESAMPLE_LIMIT=unpacked=8GiB,ratio=5000`; a command's
`--limit` raises it for the command.
"""

import os
from typing import NamedTuple

from resample.memory import amount, available_memory, bytes_of

SETTING = "RESAMPLE_LIMIT"  # name of an environment variable


class LimitError(ValueError):
    """A file exceeds a limit; it may still be intact."""


class FileLimits(NamedTuple):
    """Limits of files."""

    text: int = 1 << 30  # bytes of a text: points, poses
    tree: int = 1 << 26  # bytes of JSON, TOML and YAML, which use many times as much in memory
    depth: int = 64  # levels of nesting
    items: int = 10_000  # referenced files, members of an archive, parts of a name
    unpacked: int = 1 << 30  # bytes that compressed data may always unpack to
    ratio: int = 200  # unpacked size relative to the packed one, above that


SIMILAR_FRAMES = 40  # factor on the ratio for animations with similar frames
BYTES = ("text", "tree", "unpacked")  # limits that are amounts of memory


def limits() -> FileLimits:
    """Current limits.

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
    """Parse one part of the setting to a name and number."""
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
    """Error for a value above a named limit."""
    most = getattr(limits(), name)
    told = amount(most) if name in BYTES else str(most)
    return LimitError(
        f"{what}: {found}, over the limit of {told}; raise it by --limit {name}=..., or {SETTING}"
    )


def check_size(what: str, count: int, name: str = "text") -> None:
    """Reject a file whose size in bytes exceeds a named limit."""
    if count > getattr(limits(), name):
        raise refused(what, amount(count), name)


def check_items(what: str, count: int, things: str) -> None:
    """Reject more items than allowed."""
    if count > limits().items:
        raise refused(what, f"{count} {things}", "items")


def check_unpacked(what: str, packed: int, unpacked: int) -> None:
    """Reject data that unpack to more than the limits or the free memory, before unpacking.

    Examples
    --------
    >>> from resample.reading.limits import check_unpacked
    >>> check_unpacked("a.npz", packed=1000, unpacked=1_000_000)
    """
    check_ratio(what, packed, unpacked)
    check_free(what, unpacked)


def check_ratio(what: str, packed: int, unpacked: int) -> None:
    """Reject data that unpack to more than plausible, wherever they go."""
    known = limits()
    if unpacked > known.unpacked and unpacked > known.ratio * max(1, packed):
        found = f"{amount(packed)} that unpack to {amount(unpacked)} or more"
        raise refused(what, found, "ratio")


def check_animation(what: str, packed: int, frame: int, count: int) -> None:
    """Reject an animation with implausibly many pixels for its file.

    Parameters
    ----------
    what
        Name for the message.
    packed
        Bytes in the file. Similar frames compress well, so the limit is higher than for a picture.
    frame, count
        Bytes of a frame in memory, and number of frames.

    Raises
    ------
    ValueError
        There are too many.

    Examples
    --------
    >>> from resample.reading.limits import check_animation
    >>> check_animation("a.gif", packed=1_000_000, frame=1_000_000, count=500)
    """
    known = limits()
    whole = frame * count
    if whole > known.unpacked and whole > SIMILAR_FRAMES * known.ratio * max(1, packed):
        found = f"{amount(packed)} that unpack to {count} frames of {amount(frame)}"
        raise refused(what, found, "ratio")


def check_free(what: str, count: int) -> None:
    """Reject data larger than the free memory."""
    free = available_memory()
    if free is not None and count > free:
        raise LimitError(
            f"{what} needs {amount(count)} of memory and {amount(free)} are free; take a smaller "
            "one, or free some"
        )
