"""Readers of VTK files of unstructured and multiblock grids, resampled onto a lattice."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from resample_volume.files.parsing.headers import (
    Check,
    OneOfAll,
    accept_any,
    existing_file,
    stem,
)
from resample_volume.files.parsing.sections import ArrayQuery, check_part
from resample_volume.files.parsing.texts import Numbers, steps_of
from resample_volume.types import Recording


@dataclass(frozen=True)
class _Cells(OneOfAll):
    """Base of readers that resample cells; values are at points or cells."""

    array: str = ""  # name of the array; empty: the active one, or the only one of scalars
    part: str = ""  # magnitude: lengths of the array's vectors
    spacing: Numbers = ""  # of the lattice, as 0.5 or 1x1x2; empty: the mean size of finest cells

    kind: ClassVar[str]  # by which messages name the reader

    def __post_init__(self) -> None:
        check_part(self.part)
        steps_of(self.spacing)

    def recorded(self, path: Path, check: Check = accept_any) -> Recording:
        from resample_volume.files.cells.resampling import resampled

        wanted, steps = ArrayQuery(self.array, self.part, self.kind), steps_of(self.spacing)
        pieces = self._pieces(existing_file(path))
        return resampled(pieces, wanted, steps, stem(path, self.suffixes), check)

    def _pieces(self, path: Path) -> list[Any]:
        """Return VTK's data sets in a file."""
        from resample_volume.files.cells.reading import read_grid

        return [read_grid(path)]


@dataclass(frozen=True)
class Vts(_Cells):
    """VTK structured grid, whose cells lie in curved rows; values at points or cells."""

    suffixes = (".vts",)
    kind = "vts"


@dataclass(frozen=True)
class Vtu(_Cells):
    """VTK unstructured grid, of cells of any shape; values at points or cells."""

    suffixes = (".vtu",)
    kind = "vtu"


@dataclass(frozen=True)
class Vtm(_Cells):
    """VTK multiblock and AMR files, whose pieces lie in or under their folder.

    Where pieces overlap, those with the smallest cells win.
    """

    suffixes = (".vtm", ".vthb")
    kind = "vtm"

    def _pieces(self, path: Path) -> list[Any]:
        from resample_volume.files.cells.reading import read_pieces

        return read_pieces(path)
