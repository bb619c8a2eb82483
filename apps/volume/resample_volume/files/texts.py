"""Read text headers and numbers written as text, and find the data files that they name.

A header may have words in place of numbers, or a number of them that contradicts its dimensions
(found by `make fuzz`).
"""

import re
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.lengths import SCALES, times, unit_of_length
from resample.messages import parts_of
from resample.reading.limits import check_items, neighbour
from resample_volume.types import VOXEL

LONGEST_LINE = 1000  # bytes; lines of numbers are shorter
MOST_LINES = 10_000  # of a header
MOST_DIMENSIONS = 9

NRRD_NUMBERS = (  # fields without blanks that consist of numbers only
    *("dimension", "spacedimension", "sizes", "spacings", "thicknesses", "axismins", "axismaxs"),
    *("spaceorigin", "spacedirections", "measurementframe", "lineskip", "byteskip", "min", "max"),
    *("blocksize", "oldmin", "oldmax"),
)
NRRD_PER_AXIS = ("sizes", "spacings", "thicknesses", "axismins", "axismaxs")
META_PER_AXIS = (
    *("dimsize", "elementspacing", "elementsize", "offset", "origin", "position"),
    *("centerofrotation",),
)
META_MATRICES = ("transformmatrix", "rotation", "orientation")
META_NUMBERS = (
    *("ndims", "headersize", "elementnumberofchannels", "elementmin", "elementmax"),
    *("compresseddatasize", "id", "parentid"),
)
NOTHING = ("none", "nan", "inf", "-inf", "?", "???")  # NRRD's words for a missing number
PATTERN = re.compile(r"[^%]*%0?\d{0,2}d[^%]*")  # of names with a number in them
LONGEST = 1 << 20  # bytes of a header

HOUNSFIELD = ("hu", "hounsfield", "hounsfield unit", "hounsfield units")
BATCH = 1 << 16  # words parsed at a time
PIECE = 1 << 20  # bytes of one piece of text
LONGEST_WORD = 1000
FORTRAN = re.compile(rb"(?<=[\d.])[dD]?(?=[+-]\d+$)|(?<=[\d.])[dD](?=\d+$)")  # of 1D-5, 1.0-101
SPACING = re.compile(r"(.*[\d.])\s*((?!x)[^\W\d_]+)")  # with a unit
Numbers = str | tuple[float, ...]  # three of them, x, y, z: (1, 1, 1.4) or "1x1x1.4"


def check_nrrd_numbers(path: Path, value: Mapping[str, str]) -> None:
    """Reject NRRD fields that lack their numbers."""
    fields = {key.replace(" ", ""): text for key, text in value.items()}
    _check_lengths(path)
    if "dimension" not in fields:
        return  # the reader reports the error
    axes = _dimensions(path, "dimension", fields["dimension"])
    for key in NRRD_NUMBERS:
        if key in fields:
            bare = fields[key].translate(str.maketrans("(),", "   "))
            words = [word for word in bare.split() if word.lower() not in NOTHING]
            _checked_numbers(path, key, " ".join(words))
            if key in NRRD_PER_AXIS:
                _check_count(path, key, len(fields[key].split()), axes)


def check_meta_numbers(path: Path, value: Mapping[str, str]) -> None:
    """Reject MetaImage fields that lack their numbers; errors as for NRRD."""
    _check_lengths(path)
    axes = _dimensions(path, "ndims", value.get("ndims", ""))
    if "dimsize" not in value:
        raise ValueError(f"{path.name} is not a MetaImage: its header has no DimSize")
    for key in value.keys() & set(META_NUMBERS):
        _checked_numbers(path, key, value[key])
    for keys, count in ((META_PER_AXIS, axes), (META_MATRICES, axes * axes)):
        for key in keys:
            if key in value:
                _check_count(path, key, len(_checked_numbers(path, key, value[key])), count)


def whole(path: Path, word: str) -> int:
    """Parse an integer of a header."""
    try:
        return int(word[:20])
    except ValueError:
        raise ValueError(f"{path.name}: {word!r:.40} is not a whole number; correct it") from None


def _dimensions(path: Path, key: str, text: str) -> int:
    axes = whole(path, text)
    if not 1 <= axes <= MOST_DIMENSIONS:
        raise ValueError(f"{path.name}: {key} {axes}; there are 1 to {MOST_DIMENSIONS}")
    return axes


def _check_lengths(path: Path) -> None:
    """Reject very long lines of fields; comments and custom keys may be long."""
    with path.open("rb") as file:
        for line in islice(file, MOST_LINES):
            text = line.strip()
            if not text or text.lower().startswith(b"elementdatafile"):
                return
            is_own = text.startswith(b"#") or b":=" in text[:LONGEST_LINE]
            if len(text) > LONGEST_LINE and not is_own:
                start = text[:20].decode("latin-1")
                raise ValueError(
                    f"{path.name}: a line of its header, {start!r}..., has {len(text)} letters; "
                    "correct it"
                )


def _checked_numbers(path: Path, key: str, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        message = f"{path.name}: its {key} is {text!r:.60}, not numbers; correct it"
        raise ValueError(message) from None


def _check_count(path: Path, key: str, given: int, wanted: int) -> None:
    if given != wanted:
        raise ValueError(f"{path.name}: its {key} has {given} numbers instead of {wanted}")


class Fields(NamedTuple):
    """A text header's `key: value` or `key = value` lines."""

    value: dict[str, str]  # keys in lower case
    end: int  # bytes; where the data begins if it is in the same file


def text_fields(path: Path, separator: str, last: str = "") -> Fields:
    """Read a text header until an empty line or the key that ends it."""
    value: dict[str, str] = {}
    with path.open("rb") as file:
        while file.tell() < LONGEST:
            text = file.readline(4096).decode("utf-8", "surrogateescape").strip()
            if not text:
                break
            key, found, rest = text.partition(separator)
            if found and not text.startswith("#"):
                value[key.strip().lower()] = rest.strip()
            if last and key.strip().lower() == last:
                break
        return Fields(value, file.tell())


def files_named(path: Path, data: str) -> list[Path]:
    """Return the data files that a header names: one, a list, or a numbered pattern."""
    if data.startswith("LIST"):
        with path.open("rb") as file:
            lines = file.read(LONGEST).decode("utf-8", "surrogateescape").splitlines()
        heads = [n for n, line in enumerate(lines) if "LIST" in line]
        names = [line.strip() for line in lines[heads[0] + 1 :] if line.strip()]
    elif "%" in data:
        pattern, *numbers = data.split()
        if not PATTERN.fullmatch(pattern) or not numbers:
            raise ValueError(
                f"{path.name}: {data!r:.60} is not a pattern of names; give one like a%03d.raw 1 "
                "99 1"
            )
        first, last, step = (whole(path, word) for word in [*numbers, *"111"][:3])
        step = max(1, abs(step)) * (1 if last >= first else -1)
        every = range(first, last + (1 if step > 0 else -1), step)
        check_items(path.name, len(every), "files named")
        names = [pattern % number for number in every]
    else:
        names = [data]
    check_items(path.name, len(names), "files named")
    if not names:
        raise ValueError(f"{path.name} names no files of data; correct its header")
    files = [neighbour(path, name) for name in names]
    for name, found in zip(names, files, strict=True):
        if not found.is_file():
            raise FileNotFoundError(f"{path.name} wants its data in {name}, which is not beside it")
    return files


def is_hounsfield(word: str) -> bool:
    """Return whether a word is a name of Hounsfield units."""
    return word.strip("\"'= ").lower() in HOUNSFIELD


def numbers(file: BinaryIO, count: int, dtype: np.dtype[Any], name: str) -> NDArray[Any]:
    """Read the next numbers (count,) of a file, up to the end of a line; name is for messages."""
    check_length(file, count, name)
    found, done = np.empty(count, dtype), 0
    for words in _batches(file, count, name):
        try:
            with np.errstate(over="ignore"):
                try:
                    part = np.array(words, dtype)
                except ValueError:
                    part = np.array([FORTRAN.sub(b"e", word) for word in words], dtype)
        except (ValueError, OverflowError) as error:
            told = f"{name} is damaged: {str(error)[:80]}; get the file again"
            raise ValueError(told) from None
        found[done : done + len(words)] = part
        done += len(words)
    return found


def skip_numbers(file: BinaryIO, count: int, name: str) -> None:
    """Skip numbers; errors as in `numbers`, except for words that are not numbers."""
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
        # Read a line, or a piece of a long one that ends with a word
        piece = file.readline(PIECE)
        if len(piece) == PIECE:
            rest = bytearray()
            while len(rest) < LONGEST_WORD and not (piece + rest)[-1:].isspace():
                letter = file.read(1)
                if not letter:
                    break
                rest += letter
            piece += bytes(rest)
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


def three_numbers(what: str, numbers: Numbers) -> tuple[float, ...]:
    """Return three positive numbers, given as such or as text like 1,1,1.4."""
    found = _numbers(numbers)
    if len(found) != 3 or not all(0 < number < float("inf") for number in found):
        raise ValueError(f"{what} is three positive numbers like 1,1,1.4 (x, y, z), not {numbers}")
    return found


def spacing_of(spacing: Numbers) -> tuple[tuple[float, ...], str]:
    """Parse a spacing such as 1x1x1.4 or 0.2x0.2x1um; also return its unit, as `Volume` has it.

    Without a spacing, it is 1 x 1 x 1 voxels.
    """
    if spacing == "":
        return (1.0, 1.0, 1.0), VOXEL
    found = SPACING.fullmatch(spacing) if isinstance(spacing, str) else None
    if found is None or not found[2]:
        return three_numbers("spacing", spacing), ""
    unit, by = unit_of_length(found[2])
    if not unit:
        raise ValueError(f"{found[2]!r:.20} is not a unit of length; give {', '.join(SCALES)}")
    return tuple(times(number, by) for number in three_numbers("spacing", found[1])), unit


def steps_of(spacing: Numbers) -> tuple[float, ...]:
    """Parse a spacing; one number applies to x, y and z; empty if nothing is given."""
    given = _numbers(spacing)
    if spacing == "":
        return ()
    return three_numbers("spacing", given * 3 if len(given) == 1 else spacing)


def _numbers(numbers: Numbers) -> tuple[float, ...]:
    """Parse numbers; empty if any is invalid."""
    pieces = parts_of(numbers.lower().replace("x", " ")) if isinstance(numbers, str) else numbers
    try:
        return tuple(float(piece) for piece in pieces)
    except (TypeError, ValueError):
        return ()


def sizes_of(shape: Numbers) -> tuple[int, ...]:
    """Parse the voxels along x, y, z, and times, if there are several."""
    found = _numbers(shape)
    if len(found) not in (3, 4) or not all(0 < number < float("inf") for number in found):
        raise ValueError(
            "shape is three positive numbers like 256x256x128 (x, y, z), or four, with times, not "
            f"{shape}"
        )
    if not all(number.is_integer() for number in found):
        raise ValueError(f"shape is three whole numbers like 256x256x128 (x, y, z), not {shape}")
    return tuple(map(int, found))
