"""Read variables of NetCDF: of version 4 by h5py (the extra `hdf5`), of older ones by SciPy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.reading.arrays import dataset_in, hard_members
from resample.reading.limits import check_items
from resample.reading.native import damage
from resample_volume.data.memory import require_memory
from resample_volume.data.rectilinear import rectilinear
from resample_volume.files.axes import SPACE, LabelledAxis, lattice_of, recording_along
from resample_volume.files.hdf5 import contents
from resample_volume.files.parsing.headers import Check, OneOfAll
from resample_volume.types import UNKNOWN, Recording

CLASSIC = b"CDF"
EVEN = 1e-3  # of a step, by which even coordinates may differ
MISSING = ("_FillValue", "missing_value")


class _Variable(NamedTuple):
    """A variable with its attributes, not yet read."""

    data: Any
    dimensions: tuple[str, ...]
    facts: dict[str, Any]

    def text(self, name: str) -> str:
        value = self.facts.get(name, "")
        return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)

    def number(self, name: str) -> float | None:
        value = np.asarray(self.facts.get(name, ""))
        return float(value.ravel()[0]) if value.dtype.kind in "iuf" and value.size else None


@dataclass(frozen=True)
class NetCdf(OneOfAll):
    """A variable (t, z, y, x) of NetCDF: the only one with three axes, or one that is named.

    Coordinates of one unit are spacings; along uneven ones the values are interpolated. Scale and
    offset are applied, and fill values are missing.
    """

    array: str = ""  # name of the variable

    suffixes: ClassVar[tuple[str, ...]] = (".nc", ".nc4", ".cdf")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        with path.open("rb") as raw:
            is_classic = raw.read(3) == CLASSIC
        if not is_classic:
            with contents(path) as file:
                return self._recorded(path, name, _variables(path, file), check)
        from scipy.io import netcdf_file

        with damage(path):
            file = netcdf_file(path, "r", mmap=False)
        with file:
            check_items(path.name, len(file.variables), "variables")
            held = {
                key: _Variable(one.data, tuple(one.dimensions), dict(one._attributes))
                for key, one in file.variables.items()
            }
            return self._recorded(path, name, held, check)

    def _recorded(
        self, path: Path, volume: str, held: dict[str, _Variable], check: Check
    ) -> Recording:
        fields = {
            name: one
            for name, one in held.items()
            if sum(size > 1 for size in one.data.shape) >= SPACE and one.data.dtype.kind in "iuf"
        }
        name = self.array or (next(iter(fields)) if len(fields) == 1 else "")
        if name not in fields:
            raise ValueError(
                f"{path.name} holds {', '.join(fields) or 'no variable of three axes'}; choose one "
                "by --reader netcdf:array=NAME"
            )
        chosen = fields[name]
        names = [
            one for one, size in zip(chosen.dimensions, chosen.data.shape, strict=True) if size > 1
        ]
        sizes = [size for size in chosen.data.shape if size > 1]
        places = [_places(held.get(one), size) for one, size in zip(names, sizes, strict=True)]
        axes = [
            _axis(one, size, place, held[one].text("units") if one in held else "")
            for one, size, place in zip(names, sizes, places, strict=True)
        ]
        known = lattice_of(axes[::-1], _kind(chosen), f"{volume}, {name}")
        told = [f"values are in {chosen.text('units')}"] if chosen.text("units") else []
        known = known._replace(note="; ".join([*told, *filter(None, [known.note])]))
        check(known)
        require_memory(known.size, known.name)
        with damage(path):
            values = _read(chosen, known.dtype).reshape(sizes)
        is_uneven = any(place is not None and not _is_even(place) for place in places)
        if is_uneven and values.ndim == SPACE:
            z, y, x = (
                np.arange(size) if place is None else place
                for place, size in zip(places, sizes, strict=True)
            )
            made = rectilinear(values, x, y, z, known.name)
            return Recording(made.values[None, None], *made[1:5], note=made.note, length=UNKNOWN)
        return recording_along(values, axes[::-1], known)


def _variables(path: Path, file: Any) -> dict[str, _Variable]:
    """Return the variables of a file of version 4, whose axes are named by scales."""
    found = {}
    for name, one in hard_members(path, file).items():
        if not hasattr(one, "dims") or one.dtype.kind not in "iuf" or not one.shape:
            continue
        data = dataset_in(path, file, name)
        with damage(path):
            scales = [axis[0].name.rpartition("/")[2] if len(axis) else "" for axis in data.dims]
            is_scale = data.attrs.get("CLASS") == b"DIMENSION_SCALE"
            facts = {
                key: data.attrs[key]
                for key in data.attrs
                if key not in ("DIMENSION_LIST", "REFERENCE_LIST")
            }
        found[name] = _Variable(
            data, (name,) if is_scale and data.ndim == 1 else tuple(scales), facts
        )
    return found


def _kind(variable: _Variable) -> np.dtype[Any]:
    """Return the type of read values: floats where they are scaled, or some are missing."""
    kind: np.dtype[Any] = variable.data.dtype.newbyteorder("=")
    changed = any(
        variable.number(key) is not None for key in ("scale_factor", "add_offset", *MISSING)
    )
    if kind.kind == "f" or not changed:
        return kind
    return np.dtype(np.float32 if kind.itemsize <= 2 else np.float64)


def _read(variable: _Variable, kind: np.dtype[Any]) -> NDArray[Any]:
    """Read values; missing ones become NaN, and scale and offset are applied."""
    stored = np.asarray(variable.data[...])
    values = stored.astype(kind)
    for key in MISSING:
        lost = variable.number(key)
        if lost is not None and kind.kind == "f":
            values[stored == np.asarray(lost, stored.dtype)] = np.nan
    scale, offset = variable.number("scale_factor"), variable.number("add_offset")
    if scale is not None or offset is not None:
        values = values * kind.type(1.0 if scale is None else scale)
        values = values + kind.type(offset or 0.0)
    return values


def _places(variable: _Variable | None, count: int) -> NDArray[np.float64] | None:
    """Return the coordinates of an axis; None if there are none."""
    if variable is None or variable.data.shape != (count,) or variable.data.dtype.kind not in "iuf":
        return None
    return np.asarray(variable.data[...], np.float64)


def _is_even(place: NDArray[np.float64]) -> bool:
    steps = np.diff(place)
    return bool(np.allclose(steps, steps.mean(), rtol=EVEN, atol=0.0))


def _axis(name: str, count: int, place: NDArray[np.float64] | None, unit: str) -> LabelledAxis:
    if place is None or not _is_even(place):
        return LabelledAxis(name, count)
    step = float(place[-1] - place[0]) / (count - 1)
    return LabelledAxis(name, count, step, unit, float(place[0]))
