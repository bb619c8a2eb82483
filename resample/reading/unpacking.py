"""Packed data, unpacked to no more than they may become.

Each kind is stopped where its output goes on beyond what is allowed, before memory holds it.
"""

import bz2
import lzma
import zipfile
import zlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from resample.memory import amount
from resample.reading.limits import check_free, check_items, check_ratio

Buffer = bytes | bytearray | memoryview
PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # others unpack to their end, whatever they say
ANY, RAW = 47, -15  # zlib's numbers for its own form or gzip's, and for neither
PIECE = 1 << 20  # bytes that are unpacked at a time
JOINED = (b"\x1f\x8b", b"BZ", b"\xfd7")  # first bytes of streams behind which others may follow


def deflated(data: Buffer, most: int, form: int = ANY) -> bytes:
    """What zlib, or gzip, has packed, in one or more streams.

    Parameters
    ----------
    data
        All of it.
    most
        Bytes that it may become.
    form
        `ANY` or `RAW`.

    Raises
    ------
    ValueError
        It becomes more, is damaged or cut off.

    Examples
    --------
    >>> import zlib
    >>> from resample.reading.unpacking import deflated
    >>> deflated(zlib.compress(b"a" * 9), most=10)
    b'aaaaaaaaa'
    """
    return _unpacked(data, most, lambda: zlib.decompressobj(wbits=form))


def bunzipped(data: Buffer, most: int) -> bytes:
    """What bzip2 has packed; parameters and errors as of `deflated`."""
    return _unpacked(data, most, bz2.BZ2Decompressor)


def unlzma(data: Buffer, most: int, form: int, filters: Any = None) -> bytes:
    """What LZMA has packed in one of its forms; parameters and errors as of `deflated`."""
    return _unpacked(data, most, lambda: lzma.LZMADecompressor(form, None, filters))


def check_deflated(what: str, data: Buffer, form: int = ANY) -> None:
    """Refuse what zlib has packed if it becomes far too much; it is unpacked piece by piece.

    Parameters
    ----------
    what
        Name for the message.
    data, form
        As of `deflated`. What is damaged, or cut off, is counted up to there.

    Raises
    ------
    ValueError
        It is more than so many bytes can honestly hold, or than the memory that is free.
    """
    unpacker, rest, count = zlib.decompressobj(wbits=form), bytes(data), 0
    with suppress(zlib.error):
        while rest:
            count += len(unpacker.decompress(rest, PIECE))
            check_ratio(what, len(data), count)
            rest = unpacker.unconsumed_tail
    check_free(what, count)


def check_becomes(count: int, most: int) -> None:
    """Refuse what becomes more bytes than it may.

    Raises
    ------
    ValueError
        It does.
    """
    if count > most:
        raise ValueError(f"it unpacks to more than {amount(most)}")


def check_members(what: str, members: Iterable[zipfile.ZipInfo], things: str) -> None:
    """Refuse a zip file of too many members, or of some whose sizes cannot be relied on.

    Parameters
    ----------
    what
        Name for the message.
    members
        Of the file.
    things
        Word for them.

    Raises
    ------
    ValueError
        There are.
    """
    listed = list(members)
    check_items(what, len(listed), things)
    for member in listed:
        check_member(what, member)


def check_member(what: str, member: zipfile.ZipInfo) -> None:
    """Refuse a member of a zip file whose size cannot be relied on; parameters as of the above."""
    if member.compress_type not in PLAIN:
        raise ValueError(
            f"{what} has {member.filename!r:.100} packed by a method whose sizes cannot be relied "
            "on; pack it by deflate, or not at all"
        )


def _unpacked(data: Buffer, most: int, new: Callable[[], Any]) -> bytes:
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
