"""Decompress data, with a limit on the unpacked size.

Decompression stops when the output exceeds its limit, before memory holds it all.
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
PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # methods that stop at the stated size
ANY, RAW = 47, -15  # zlib's `wbits` for zlib or gzip headers, and for raw data
PIECE = 1 << 20  # bytes unpacked at a time
JOINED = (b"\x1f\x8b", b"BZ", b"\xfd7")  # first bytes of streams that may be followed by others


def deflated(data: Buffer, most: int, form: int = ANY) -> bytes:
    """Unpack zlib or gzip data of one or more streams.

    Parameters
    ----------
    most
        Limit in bytes.

    Examples
    --------
    >>> import zlib
    >>> from resample.reading.unpacking import deflated
    >>> deflated(zlib.compress(b"a" * 9), most=10)
    b'aaaaaaaaa'
    """
    return _unpacked(data, most, lambda: zlib.decompressobj(wbits=form))


def bunzipped(data: Buffer, most: int) -> bytes:
    """Unpack bzip2 data; parameters and errors as in `deflated`."""
    return _unpacked(data, most, bz2.BZ2Decompressor)


def unlzma(data: Buffer, most: int, form: int, filters: Any = None) -> bytes:
    """Unpack LZMA data in one of its forms; parameters and errors as in `deflated`."""
    return _unpacked(data, most, lambda: lzma.LZMADecompressor(form, None, filters))


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
    """Reject a zip file with too many members, or with unreliable sizes.

    `what`: name for the message. `members`: members of the file. `things`: word for them in the
    message. Raises ValueError: it is rejected.
    """
    listed = list(members)
    check_items(what, len(listed), things)
    for member in listed:
        check_member(what, member)


def check_member(what: str, member: zipfile.ZipInfo) -> None:
    """Reject a member of a zip file with an unreliable size; parameters as above."""
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
