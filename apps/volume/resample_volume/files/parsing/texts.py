"""Read text headers, and find the data files that they name."""

import re
from pathlib import Path
from typing import NamedTuple

from resample.reading.headers import whole
from resample.reading.limits import check_items, neighbour

PATTERN = re.compile(r"[^%]*%0?\d{0,2}d[^%]*")  # of names with a number in them
LONGEST = 1 << 20  # bytes of a header

HOUNSFIELD = ("hu", "hounsfield", "hounsfield unit", "hounsfield units")


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
        names = _numbered(path, data)
    else:
        names = [data]
    check_items(path.name, len(names), "files named")
    if not names:
        raise ValueError(f"{path.name} names no files of data; correct its header")
    return [_beside(path, name) for name in names]


def _numbered(path: Path, data: str) -> list[str]:
    pattern, *numbers = data.split()
    if not PATTERN.fullmatch(pattern) or not numbers:
        raise ValueError(
            f"{path.name}: {data!r:.60} is no pattern of names; give one such as a%03d.raw 1 99 1"
        )
    first, last, step = (whole(path, word) for word in [*numbers, *"111"][:3])
    step = max(1, abs(step)) * (1 if last >= first else -1)
    every = range(first, last + (1 if step > 0 else -1), step)
    check_items(path.name, len(every), "files named")
    return [pattern % number for number in every]


def is_hounsfield(word: str) -> bool:
    """Return whether a word is a name of Hounsfield units."""
    return word.strip("\"'= ").lower() in HOUNSFIELD


def _beside(path: Path, name: str) -> Path:
    file = neighbour(path, name)
    if not file.is_file():
        raise FileNotFoundError(f"{path.name} wants its data in {name}, which is not beside it")
    return file
