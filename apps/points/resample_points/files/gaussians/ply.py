"""Read the elements of PLY files that hold Gaussians."""

import math
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_size
from resample_points.files.ply_headers import PlyElement, PlyHeader

ANTIALIASED = {"splatrendermode: mip": True, "antialiased 1": True}  # comments of trainers
ANTIALIASED |= {"splatrendermode: default": False, "antialiased 0": False}
VERTICAL = "vertical axis: "


@dataclass(frozen=True)
class PlyFile:
    """A PLY file of Gaussians, whose records are read by the element."""

    header: PlyHeader

    @property
    def path(self) -> Path:
        """Where it is."""
        return self.header.path

    def names(self, element: str = "vertex") -> set[str]:
        """Return the names of an element's properties."""
        same = (one for one in self.header.elements if one.name == element)
        return {each.name for one in same if not one.has_lists for each in one.properties}

    @property
    def is_antialiased(self) -> bool:
        """Whether a comment says so; the last one holds."""
        told = [ANTIALIASED[line] for line in self.header.comments if line in ANTIALIASED]
        return told[-1] if told else False

    @property
    def up(self) -> str | None:
        """The vertical axis, if a comment names it."""
        comments = self.header.comments
        told = [line.removeprefix(VERTICAL) for line in comments if line.startswith(VERTICAL)]
        return told[-1] if told and told[-1] in {"x", "y", "z"} else None

    def records(self, name: str) -> NDArray[Any]:
        """Return the records (N,) of an element; binary ones are mapped, not read."""
        before, wanted = self.header.split_at(name)
        if wanted.has_lists or any(one.has_lists and one.records for one in before):
            raise ValueError(f"has lists in or before its element {name}, which Gaussians have not")
        if self.header.encoding == "ascii":
            return self._parsed(sum(one.records for one in before), wanted)
        kind, count = wanted.scalars(), wanted.records
        at = self.header.start + sum(one.records * one.scalars().itemsize for one in before)
        needed, given = count * kind.itemsize, self.path.stat().st_size - at
        if needed > given:
            raise OSError(f"{self.path} is cut off: {max(0, given)} of {needed} bytes are there")
        if not needed:
            return np.zeros(0, kind)
        return np.memmap(self.path, kind, "r", at, (count,))

    def _parsed(self, before: int, wanted: PlyElement) -> NDArray[Any]:
        """Parse the records of a text."""
        size = self.path.stat().st_size
        check_size(str(self.path), size)
        with self.path.open("rb") as file:
            file.seek(self.header.start)
            for _ in islice(file, min(before, size)):
                pass
            given = islice(file, min(wanted.records, size))
            lines = [line.decode("latin-1") for line in given if line.strip()]
        count = wanted.records
        if len(lines) < count:
            raise OSError(f"{self.path} is cut off: {len(lines)} of {count} lines are there")
        try:
            table: NDArray[Any] = np.loadtxt(lines, wanted.scalars(), comments=None, ndmin=1)
        except ValueError as error:
            raise ValueError(f"is not a table of numbers: {error!s:.100}") from None
        if table.shape != (count,):
            raise ValueError(f"has {len(table)} records of {wanted.name}, not {count}")
        return table


def stacked(records: NDArray[Any], names: list[str]) -> NDArray[np.float32]:
    """Return properties of records in float32 (N, names)."""
    values = np.empty((len(records), len(names)), np.float32)
    with np.errstate(over="ignore"):  # of float64
        for n, name in enumerate(names):
            values[:, n] = records[name]
    return values


def largest_of(values: NDArray[Any]) -> float:
    """Return the largest size among finite numbers."""
    low, high = float(values.min(initial=0)), float(values.max(initial=0))
    if math.isfinite(low) and math.isfinite(high):
        return max(-low, high)
    finite = values[np.isfinite(values)]
    return float(np.abs(finite).max(initial=0))
