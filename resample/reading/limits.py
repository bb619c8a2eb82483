"""Limits on untrusted files: what they hold, their unpacked size, and the files they may refer to.

Each limit is far above what ordinary files need. `RESAMPLE_LIMIT` in the environment raises it for
this process and its children, as in `RESAMPLE_LIMIT=unpacked=8GiB,ratio=5000`; a command's
`--limit` raises it for the command.

An untrusted file must not cause others to be read that the user did not intend: the files it refers
to (textures, materials, buffers, raw data) must be in or below its own folder.
`RESAMPLE_ALLOW_OUTSIDE=1` in the environment, or a command's `--allow-outside`, allows all.

Decompression stops when the output exceeds its limit, before memory holds it all.
"""

import errno
import logging
import lzma
import os
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from resample.memory import amount, available_memory, bytes_of

SETTING = "RESAMPLE_LIMIT"  # name of an environment variable
SIMILAR_FRAMES = 40  # factor on the ratio for animations with similar frames
BYTES = ("text", "tree", "unpacked")  # limits that are amounts of memory
OUTSIDE = "RESAMPLE_ALLOW_OUTSIDE"  # name of an environment variable
ADDRESS = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]+:")  # not a drive's single letter
Buffer = bytes | bytearray | memoryview
PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # methods that stop at the stated size
ANY, RAW = 47, -15  # zlib's `wbits` for zlib or gzip headers, and for raw data
PIECE = 1 << 20  # bytes unpacked at a time
JOINED = (b"\x1f\x8b", b"BZ", b"\xfd7")  # first bytes of streams that may be followed by others
ZSTD = 0xFD2FB528  # magic number of a frame
ZSTD_BLOCK = 1 << 17  # largest unpacked size of a block, bytes


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


def limits() -> FileLimits:
    """Current limits."""
    changed = {}
    for part in filter(str.strip, os.environ.get(SETTING, "").split(",")):
        name, _, text = (word.strip() for word in part.partition("="))
        try:
            number = int(text) if text.isdecimal() else bytes_of(text) if name in BYTES else 0
        except ValueError:
            number = 0
        if number < 1 or name not in FileLimits._fields:
            raise ValueError(
                f"{SETTING} or --limit has {part.strip()!r}; give {', '.join(FileLimits._fields)} "
                "as in ratio=5000 or unpacked=8GiB, with commas between them"
            )
        changed[name] = number
    return FileLimits()._replace(**changed)


def refused(what: str, found: str, name: str) -> LimitError:
    """Error for a value above a named limit."""
    most = getattr(limits(), name)
    told = amount(most) if name in BYTES else str(most)
    return LimitError(
        f"{what}: {found}, over the limit of {told}; raise it by --limit {name}=..., or {SETTING}"
    )


def check_size(what: str, count: int, name: str = "text") -> None:
    """Reject a file with more bytes than a named limit."""
    if count > getattr(limits(), name):
        raise refused(what, amount(count), name)


def check_items(what: str, count: int, things: str) -> None:
    """Reject more items than allowed."""
    if count > limits().items:
        raise refused(what, f"{count} {things}", "items")


def check_unpacked(what: str, packed: int, unpacked: int) -> None:
    """Reject data that unpack to more than the limits or the free memory, before unpacking."""
    check_ratio(what, packed, unpacked)
    check_free(what, unpacked)


def check_ratio(what: str, packed: int, unpacked: int) -> None:
    """Reject data that unpack to more than plausible, wherever they go."""
    known = limits()
    if unpacked > known.unpacked and unpacked > known.ratio * max(1, packed):
        found = f"{amount(packed)} that unpack to {amount(unpacked)} or more"
        raise refused(what, found, "ratio")


def check_animation(what: str, packed: int, frame: int, count: int) -> None:
    """Reject `count` frames of `frame` bytes in memory that are implausibly many for their file."""
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


def check_file(path: str | Path) -> None:
    """Reject a path without a file; the message names a folder as such."""
    if Path(path).is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder; give a file in it", str(path))
    if not Path(path).is_file():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))


def neighbour(source: Path, name: str) -> Path:
    """Path of a file that another refers to, whether it exists or not."""
    if ADDRESS.match(name):
        raise _refusal(source, name, "an address, not a file; fetch it, and name the copy")
    if "\0" in name:
        raise _refusal(source, name, "no name of a file")
    file = source.parent / name
    if not allows_outside():
        remedy = "files are read from its own folder only; put it there, or give --allow-outside"
        path = Path(name.replace("\\", "/"))
        if path.is_absolute() or re.match(r"^[A-Za-z]:", name):
            raise _refusal(source, name, f"an absolute path; {remedy}")
        if ".." in path.parts:
            raise _refusal(source, name, f"a path that leads outside; {remedy}")
        try:
            real = file.resolve()
            homes = source.parent.resolve(), source.resolve().parent  # also where a link leads
            is_within = any(real.is_relative_to(home) for home in homes)
        except (OSError, RuntimeError):  # a cycle of links
            is_within = False
        if not is_within:
            raise _refusal(source, name, f"a link that leads outside; {remedy}")
    if file.exists() and not (file.is_file() or file.is_dir()):
        raise _refusal(source, name, "a device or a pipe, not a file")
    return file


def allows_outside() -> bool:
    """Whether files may refer to others outside their folder."""
    return os.environ.get(OUTSIDE, "") not in ("", "0")


def _refusal(source: Path, name: str, reason: str) -> ValueError:
    return ValueError(f"{source.name} names {name!r:.100}, {reason}")


@contextmanager
def raised(limit: str | None = None, *, allow_outside: bool = False) -> Iterator[None]:
    """Raise limits, or allow files outside of a folder, in this block."""
    with restored(SETTING, OUTSIDE):
        if limit is not None:
            os.environ[SETTING] = ",".join(filter(None, (os.environ.get(SETTING), limit)))
        if allow_outside:
            os.environ[OUTSIDE] = "1"
        limits()
        yield


@contextmanager
def restored(*names: str) -> Iterator[None]:
    """Restore variables of the environment after the block; all without names."""
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in names or {*before, *os.environ}:
            if name not in before:
                os.environ.pop(name, None)
            elif os.environ.get(name) != before[name]:
                os.environ[name] = before[name]


def deflated(data: Buffer, most: int, form: int = ANY) -> bytes:
    """Unpack zlib or gzip data of one or more streams, to `most` bytes at most."""
    return unpacked(data, most, lambda: zlib.decompressobj(wbits=form))


def check_deflated(what: str, data: Buffer, form: int = ANY) -> None:
    """Reject zlib data that unpack to too much; they are unpacked piece by piece."""
    unpacker, rest, count = zlib.decompressobj(wbits=form), bytes(data), 0
    with suppress(zlib.error):
        while rest:
            count += len(unpacker.decompress(rest, PIECE))
            check_ratio(what, len(data), count)
            rest = unpacker.unconsumed_tail
    check_free(what, count)


def check_becomes(count: int, most: int) -> None:
    """Reject an unpacked size above a limit."""
    if count > most:
        raise ValueError(f"it unpacks to more than {amount(most)}")


def check_members(what: str, members: Iterable[zipfile.ZipInfo], things: str) -> None:
    """Reject a zip file with too many members, or with unreliable sizes."""
    listed = list(members)
    check_items(what, len(listed), things)
    for member in listed:
        check_member(what, member)


def check_member(what: str, member: zipfile.ZipInfo) -> None:
    """Reject a member of a zip file if its stated size cannot be relied on."""
    if member.compress_type not in PLAIN:
        raise ValueError(
            f"{what} has {member.filename!r:.100} packed by a method with unreliable sizes"
            "; pack it by deflate, or not at all"
        )


def unpacked(data: Buffer, most: int, new: Callable[[], Any]) -> bytes:
    """Unpack streams by decompressors, to `most` bytes at most."""
    parts: list[bytes] = []
    rest, left = bytes(data), most
    may_follow = rest[:2] in JOINED
    try:
        while rest:
            unpacker = new()
            while not unpacker.eof:
                part = unpacker.decompress(rest, left + 1)
                rest = getattr(unpacker, "unconsumed_tail", b"")
                parts.append(part)
                left -= len(part)
                check_becomes(most - left, most)
                if not (part or rest or unpacker.eof):
                    raise ValueError("it is cut off")
            rest = unpacker.unused_data if may_follow else b""
            rest = rest if rest[:2] in JOINED else b""  # padding
    except (zlib.error, lzma.LZMAError, OSError, EOFError) as error:
        raise ValueError(f"it is damaged: {error}") from None
    return parts[0] if len(parts) == 1 else b"".join(parts)


def unzstd(data: Any, most: int, size: int) -> Any:
    """Unpack Zstandard data; the frame states the size, or blocks bound it.

    `most`: limit in bytes. `size`: if the bound exceeds `most`, the output must have this size.
    """
    import numpy as np
    from numcodecs import Zstd

    data = bytes(data)
    # The head of a frame, which may state the unpacked size.
    if len(data) < 6 or struct.unpack_from("<I", data)[0] != ZSTD:
        raise ValueError("it is not of Zstandard")
    flags = data[4]
    is_single = bool(flags & 0x20)
    start = 5 + (not is_single) + (0, 1, 2, 4)[flags & 3]
    width = (int(is_single), 2, 4, 8)[flags >> 6]
    if len(data) < start + width:
        raise ValueError("it is cut off")
    if width:
        told = int.from_bytes(data[start : start + width], "little") + 256 * (width == 2)
        check_becomes(told, most)
        return Zstd().decode(data)
    # Bound on the unpacked size of its blocks.
    count, is_last, place = 0, False, start
    while not is_last and count <= most:
        if place + 3 > len(data):
            raise ValueError("it is cut off")
        head = int.from_bytes(data[place : place + 3], "little")
        is_last, kind, length = bool(head & 1), head >> 1 & 3, head >> 3
        count += ZSTD_BLOCK if kind == 2 else length
        place += 3 + (1 if kind == 1 else length)
    is_whole = place + 4 * (flags >> 2 & 1) >= len(data)  # with its checksum
    if count <= most and is_whole:  # else further frames would be unpacked, too
        return Zstd().decode(data)
    try:
        return Zstd().decode(data, np.empty(size, np.uint8))
    except RuntimeError as error:
        raise ValueError(f"it unpacks to other than {size} bytes: {error}") from None


try:
    import grp
    import pwd
except ImportError:  # Windows
    grp = pwd = None  # type: ignore[assignment]

LOG = logging.getLogger("resample")
BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
ROOT = 0
UNBLOCKED = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


class NotOwnError(PermissionError):
    """A file that would steer a command is another user's, or others may write to it."""


def own_bytes(path: Path, limit: str | None = None) -> bytes:
    """Content of a file that nobody but the user, or root, can have written; links are rejected."""
    check_own(path.parent)
    with open(os.open(path, os.O_RDONLY | UNBLOCKED), "rb") as file:
        status = os.fstat(file.fileno())
        _check(path, status)
        if limit is not None:
            check_size(str(path), status.st_size, limit)
        return file.read()


def tell_unused(error: NotOwnError, variable: str) -> None:
    """Warn that a file is not used; `variable` names the folder of the cache."""
    LOG.warning("%s: it is not used; %s may name another folder", error, variable)


def check_own(path: Path) -> None:
    """Reject a file or folder that is another's, or that others may write to."""
    _check(path, os.stat(path))


def _check(path: Path, status: os.stat_result) -> None:
    if pwd is None:
        return
    if status.st_uid not in (os.geteuid(), ROOT):
        owner = _name_of(status.st_uid)
        raise NotOwnError(f"{path} belongs to {owner} and would steer your commands")
    is_sticky = stat.S_ISDIR(status.st_mode) and status.st_mode & stat.S_ISVTX
    is_private = False  # whether only the owner's own group may write: many systems give one each
    with suppress(KeyError):
        group, owner = grp.getgrgid(status.st_gid), _name_of(status.st_uid)
        is_owners = group.gr_name == owner and not set(group.gr_mem) - {owner}
        is_private = is_owners and not status.st_mode & stat.S_IWOTH
    if status.st_mode & BY_OTHERS and not is_sticky and not is_private:
        raise NotOwnError(
            f"{path} would steer your commands, and others may write to it (chmod go-w)"
        )


def _name_of(user: int) -> str:
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return f"user {user}"
