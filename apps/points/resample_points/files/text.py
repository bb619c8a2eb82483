"""Read clouds from columns of text: XYZ, PTS, CSV."""

import re
from pathlib import Path

import numpy as np

from resample.reading.limits import check_size
from resample.types import Doubles
from resample_points.data.cloud import Cloud
from resample_points.data.coloring import colored_as_scanned
from resample_points.data.fields import BITS_8, COLORS, NORMALS, PLACES, cloud_of
from resample_points.files.parsing import COMMENTS, NUMBER, check_count, table_of

NAMED = "columns named by the first line"
COLUMNS = {
    3: "x y z",
    4: "x y z value",
    6: "x y z r g b",
    7: "x y z intensity r g b",
    9: "x y z r g b nx ny nz",
    10: "x y z intensity r g b nx ny nz",
}
COLORS_FIRST = "x y z r g b value"
WITH_NORMALS = "x y z nx ny nz"
SEPARATORS = re.compile(r"[\s;,]+")
UNIT = 0.02  # most by which lengths of normals differ from 1


def read_columns(path: Path) -> Cloud:
    """Read a cloud from columns of numbers separated by commas, semicolons or blanks.

    Commas may be decimal points: between semicolons, or in numbers between blanks. The first line
    may name the columns, and the line before the points may hold their number.
    """
    try:
        check_size(str(path), path.stat().st_size)
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("is not a text file") from None
    comma = "." if _has_decimal_commas(text) else " "
    stripped = text.translate(str.maketrans(",;", f"{comma} ", '"'))
    lines = stripped.splitlines()
    first = next((n for n, line in enumerate(lines) if line.strip()), 0)
    names = _names(lines[first]) if lines else []
    is_comment = bool(names) and _is_comment(lines[first])
    table = table_of(_without_counts(path, lines[first + bool(names) :]))
    if names and not is_comment and len(names) != table.shape[1]:
        raise ValueError(f"names {len(names)} columns and has {table.shape[1]}")
    if len(names) != table.shape[1] or not set(names).issuperset("xyz"):
        names = _usual_names(table, path.suffix.lower())
    return cloud_of(dict(zip(names, table.T, strict=True)))


def read_pts(path: Path) -> Cloud:
    """Read columns of a laser scan; without colors, points are gray by their intensity."""
    return colored_as_scanned(read_columns(path))


def _has_decimal_commas(text: str) -> bool:
    """Whether commas are within numbers, by the first line of numbers."""
    for line in text.splitlines():
        parts = [part for part in SEPARATORS.split(line) if part]
        if len(parts) > 2 and all(NUMBER.fullmatch(part) for part in parts):
            words = line.split(";") if ";" in line else line.split()
            return len(words) > 2 and all(NUMBER.fullmatch(word.strip()) for word in words)
    return False


def _names(line: str) -> list[str]:
    """Return the column names of a line; empty if it holds a number."""
    words = line.strip().lstrip("#/").split()
    if any(_is_number(word) for word in words):
        return []
    known = {name for names in (*PLACES, *NORMALS, *COLORS) for name in names}
    return [word.lower() if word.lower() in known else word for word in words]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _without_counts(path: Path, lines: list[str]) -> list[str]:
    """Leave out lines that hold the number of points of the scan after them."""
    first = next((line.split() for line in lines if line.strip() and not _is_comment(line)), [])
    if len(first) != 1 or not first[0].isdecimal():
        return lines
    rows = [line for line in lines if len(line.split(None, 1)) > 1 and not _is_comment(line)]
    if rows:
        check_count(path, len(rows), int(first[0][:30]))
    return rows or lines


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _usual_names(table: Doubles, suffix: str) -> list[str]:
    """Return the usual names of columns for a table without names."""
    width = table.shape[1]
    usual = {6: WITH_NORMALS} if suffix == ".xyzn" else COLUMNS
    if width not in usual:
        raise ValueError(f"has {width} columns; known are {', '.join(usual.values())}, or {NAMED}")
    names = usual[width]
    if width == len(WITH_NORMALS.split()) and _are_normals(table[:, 3:]):
        names = WITH_NORMALS
    if width == len(COLORS_FIRST.split()) and _are_levels(table[:, 3:6]) > _are_levels(
        table[:, 4:]
    ):
        names = COLORS_FIRST
    if suffix == ".pts":
        names = names.replace("value", "intensity")
    return names.split()


def _are_normals(values: Doubles) -> bool:
    """Whether vectors (N, 3) have the length 1, and one has a negative part; colors have none."""
    lengths = np.sqrt((values * values).sum(axis=1))
    return bool(values.min(initial=0) < 0 and np.all(np.abs(lengths - 1) < UNIT))


def _are_levels(values: Doubles) -> bool:
    """Whether all numbers are levels of 8 bits."""
    return bool(np.all((values >= 0) & (values <= BITS_8) & (values == np.floor(values))))
