"""Readers of rectilinear grids, whose planes may be uneven; see `data.rectilinear`."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from resample.reading.arrays import DamageError, read_npz
from resample_volume.data.rectilinear import rectilinear
from resample_volume.files.parsing.headers import Check, OneOfAll, existing_file, header, stem
from resample_volume.files.parsing.sections import ArrayQuery, check_part
from resample_volume.files.readers import recording_of
from resample_volume.types import UNKNOWN, Recording, Volume

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Vtr:
    """VTK rectilinear grid; values at points, or at the cells between planes."""

    array: str = ""  # name of the array; empty: the active one, or the only one of scalars
    part: str = ""  # magnitude: lengths of the array's vectors

    suffixes: ClassVar[tuple[str, ...]] = (".vtr",)

    def __post_init__(self) -> None:
        check_part(self.part)

    def __call__(self, path: Path) -> Volume:
        from resample_volume.files.xml.vti import read_vtr

        wanted = ArrayQuery(self.array, self.part, "vtr")
        return read_vtr(existing_file(path), wanted, stem(path, self.suffixes))


@dataclass(frozen=True)
class Npz(OneOfAll):
    """NumPy arrays: one as in `.npy`, or coordinates of planes `x`, `y`, `z` and one of values."""

    array: str = ""  # name of the values; empty: the only one besides x, y, z

    suffixes: ClassVar[tuple[str, ...]] = (".npz",)

    def read(self, path: Path, name: str, check: Check) -> Recording:
        try:
            held = read_npz(path)
        except DamageError as error:
            raise ValueError(
                f"{path.name} holds no arrays, or is damaged: {error.reason}"
            ) from None
        others = [key for key in held if key not in AXES]
        chosen = self.array or (others[0] if len(others) == 1 else "")
        if chosen not in others:
            raise ValueError(
                f"{path.name} holds {', '.join(held) or 'nothing'}; a volume is one array "
                "of values (Z, Y, X), which is chosen by its name: --reader npz:array=density"
            )
        values = held[chosen]
        if not set(AXES) <= held.keys():
            return recording_of(values, name, check=check)
        check(header(values.shape[::-1], values.dtype, name))
        made = rectilinear(values, held["x"], held["y"], held["z"], name)
        found = Recording(made.values[None, None], *made[1:5], note=made.note)
        return found._replace(length=UNKNOWN)
