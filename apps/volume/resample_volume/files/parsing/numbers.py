"""Read or skip numbers written as text."""

import re
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

BATCH = 1 << 16  # words parsed at a time
PIECE = 1 << 20  # bytes of one piece of text
LONGEST_WORD = 1000
FORTRAN = re.compile(rb"(?<=[\d.])[dD]?(?=[+-]\d+$)|(?<=[\d.])[dD](?=\d+$)")  # of 1D-5, 1.0-101


def numbers(file: BinaryIO, count: int, dtype: np.dtype[Any], name: str) -> NDArray[Any]:
    """Read the next numbers (count,) of a file, up to the end of a line; name is for messages."""
    check_length(file, count, name)
    found, done = np.empty(count, dtype), 0
    for words in _batches(file, count, name):
        found[done : done + len(words)] = _converted(words, dtype, name)
        done += len(words)
    return found


def skip_numbers(file: BinaryIO, count: int, name: str) -> None:
    """Skip numbers; errors as of `numbers`, except for words."""
    check_length(file, count, name)
    for _ in _batches(file, count, name):
        pass


def check_length(file: BinaryIO, count: int, name: str) -> None:
    """Reject a text too short for this many numbers, at two characters each."""
    here = file.tell()
    left = file.seek(0, 2) - file.seek(here)
    file.seek(here)
    if 2 * count > left + 1:
        raise _cut(name, f"{left} bytes are left", count)


def _cut(name: str, given: str, count: int) -> ValueError:
    return ValueError(f"{name} is cut off: {given} of {count} numbers; get the file again")


def _batches(file: BinaryIO, count: int, name: str) -> Iterator[list[bytes]]:
    left, held = count, list[bytes]()
    while left > 0:
        piece = _piece(file)
        if not piece:
            raise _cut(name, f"there are {count - left}", count)
        words = piece.split()
        left -= len(words)
        held += words
        if len(held) >= BATCH or left <= 0:
            if left < 0:
                raise ValueError(
                    f"{name} is damaged: a line holds more than {count} numbers end in"
                )
            yield held
            held = []


def _piece(file: BinaryIO) -> bytes:
    """Read a line, or a piece of a long one that ends with a word."""
    piece = file.readline(PIECE)
    if len(piece) == PIECE:
        rest = bytearray()
        while len(rest) < LONGEST_WORD and not (piece + rest)[-1:].isspace():
            letter = file.read(1)
            if not letter:
                break
            rest += letter
        piece += bytes(rest)
    return piece


def _converted(words: list[bytes], dtype: np.dtype[Any], name: str) -> NDArray[Any]:
    try:
        with np.errstate(over="ignore"):
            try:
                return np.array(words, dtype)
            except ValueError:
                return np.array([FORTRAN.sub(b"e", word) for word in words], dtype)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{name} is damaged: {str(error)[:80]}; get the file again") from None
