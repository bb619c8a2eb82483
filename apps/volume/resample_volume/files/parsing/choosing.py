"""Choose an array of a VTK file, and a part of it."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_volume.data.memory import require_memory
from resample_volume.data.recordings import is_color
from resample_volume.files.parsing.headers import VolumeHeader

PARTS = ("", "magnitude")
ROWS = 1 << 18  # vectors whose lengths are computed at a time
HIDDEN = "vtkGhost"  # begins names of arrays that VTK keeps for itself


class ArrayQuery(NamedTuple):
    """The user's choice."""

    array: str  # its name; empty: the active one, or the only one that it can be
    part: str  # one of PARTS
    reader: str  # which is asked; empty: none, a caller has the data


class Named(NamedTuple):
    """An array of a file."""

    name: str
    parts: int  # numbers at each place
    is_of_cells: bool
    is_active: bool  # whether the file marks it as the scalars


def choose(known: Sequence[Named], wanted: ArrayQuery, file: str) -> Named:
    """Choose an array: by name, else the active one, the only one, or the only one of scalars.

    Point arrays take precedence: if there are any, cell arrays must be chosen by name.
    """
    shown = [each for each in known if not each.name.startswith(HIDDEN)]
    if wanted.array:
        found = [each for each in known if each.name == wanted.array]
    else:
        some = [each for each in shown if not each.is_of_cells] or shown
        active = [each for each in some if each.is_active]
        scalars = [each for each in some if each.parts == 1]
        found = next((one for one in (active, some, scalars) if len(one) == 1), [])
    if not found:
        names = ", ".join(each.name + " (cells)" * each.is_of_cells for each in shown)
        how = f"--reader {wanted.reader}:array=NAME" if wanted.reader else "part=NAME"
        given, known_names = wanted.array or "none", names or "there is none"
        raise ValueError(f"{file}: choose an array, {how} ({given} given): {known_names}")
    return found[0]


def check_part(part: str) -> None:
    """Reject an unknown part of vectors."""
    if part not in PARTS:
        raise ValueError(f"part is magnitude, or left out, not {part!r}")


def listed(known: Sequence[Named]) -> str:
    """Return the names of all arrays, with their numbers of components."""
    return f"arrays are {', '.join(f'{each.name}: {each.parts}' for each in known)}"


def of_parts(
    known: VolumeHeader, chosen: Named, every: Sequence[Named], wanted: ArrayQuery
) -> VolumeHeader:
    """Return the header for an array, with the chosen part of its components."""
    parts = chosen.parts
    if wanted.part and parts < 2:
        raise ValueError(
            f"{known.name}: {chosen.name} has one number at each place; leave out "
            f"part={wanted.part}, or choose a vector ({listed(every)})"
        )
    if wanted.part:
        return known._replace(dtype=_kind(known.dtype))
    kind = f"vector of {known.dtype.name} ({chosen.name}; {listed(every)})"
    return known._replace(parts=parts, is_color=is_color((parts,), known.dtype), pixel=kind)


def part_of(values: NDArray[Any], chosen: Named, wanted: ArrayQuery, name: str) -> NDArray[Any]:
    """Return values (N * C,), or the lengths (N,) of vectors if asked for."""
    if not wanted.part:
        return values
    rows = values.reshape(-1, chosen.parts)
    found = np.empty(len(rows), _kind(values.dtype))
    require_memory(found.nbytes, name)
    for start in range(0, len(rows), ROWS):
        some = rows[start : start + ROWS].astype(np.float64)
        found[start : start + ROWS] = np.linalg.norm(some, axis=1)
    return found


def check_single(known: VolumeHeader, file: str) -> None:
    """Reject several components on an uneven grid."""
    if known.parts > 1:
        raise ValueError(
            f"{file} has {known.parts} numbers at each place, a volume on an uneven grid has one; "
            f"choose another array, or --reader vtr:part=magnitude; it is a {known.pixel}"
        )


def cells_between(points: Sequence[int]) -> tuple[int, ...]:
    """Return the cells along x, y, z between points."""
    return tuple(max(1, count - 1) for count in points)


def middles(planes: Doubles, *, of_cells: bool) -> Doubles:
    """Return coordinates of planes, or of the centers of cells between them."""
    return (planes[1:] + planes[:-1]) / 2 if of_cells else planes


def _kind(dtype: np.dtype[Any]) -> np.dtype[Any]:
    return np.dtype(np.float64 if dtype.newbyteorder("=") == np.float64 else np.float32)
