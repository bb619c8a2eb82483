"""HDF5: datasets, Imaris, and NetCDF-4 with its coordinates."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.lengths import unit_of_length
from resample.reading.limits import check_items
from resample.reading.native import damage
from resample_formats.axes import SPACE, LabelledAxis, lattice_of, recording_along
from resample_formats.groups import dataset_in, group_in, hard_members, names_in, numbers_of, opened
from resample_volume.data.recordings import SeveralChannelsError, SeveralTimesError
from resample_volume.data.rectilinear import rectilinear
from resample_volume.data.values import require_memory
from resample_volume.files.headers import Check, OneOfAll, header, recording
from resample_volume.files.readers import header_of_array
from resample_volume.types import UNKNOWN, VOXEL, ChannelLook, Recording

SIZES = ("element_size_um", "voxel_size", "spacing")  # attributes (z, y, x) of datasets
FULL = "ResolutionLevel 0"


@contextmanager
def contents(path: Path) -> Iterator[Any]:
    """Open an HDF5 file; errors begin with its name."""
    try:
        with opened(path) as file:
            yield file
    except (SeveralChannelsError, SeveralTimesError):  # which their callers answer
        raise
    except ValueError as error:
        raise ValueError(f"{path.name} {error}") from None


@dataclass(frozen=True)
class Hdf5(OneOfAll):
    """An array of an HDF5 file: the only one with three axes or more, or one that is named.

    Axes are those of `Npy`. Spacings are those of `element_size_um`, as ilastik and Fiji write it.
    """

    array: str = ""  # its path in the file, such as t0/channel1

    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5", ".hdf")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        with contents(path) as file:
            found = {self.array: _at(path, file, self.array)} if self.array else _arrays(path, file)
            if len(found) != 1:
                held = f"several arrays: {', '.join(found)}" if found else "no array of three axes"
                raise ValueError(f"holds {held}; choose one by --reader hdf5:array=NAME")
            (data,) = found.values()
            shape = tuple(size for size in data.shape if size > 1 or data.ndim == SPACE)
            known = header_of_array(shape, data.dtype, name, *_spacing(path, data))
            check(known)
            require_memory(known.size, name)
            with damage(path):
                values = np.asarray(data[()])
        return recording(values.reshape(shape), known, channels_first=not known.is_color)


def _at(path: Path, file: Any, place: str) -> Any:
    """Return the dataset at a path in a file."""
    *groups, last = place.strip("/").split("/")
    group = file
    for name in groups:
        group = group_in(path, group, name)
        if group is None:
            break
    found = None if group is None else dataset_in(path, group, last)
    if found is None or len(found.shape) < SPACE:
        known = ", ".join(_arrays(path, file)) or "none"
        raise ValueError(f"holds no array {place!r:.80} of three axes or more; it holds {known}")
    return found


def _arrays(path: Path, group: Any, prefix: str = "", depth: int = 8) -> dict[str, Any]:
    """Return all arrays of numbers with three axes or more, by their paths."""
    found: dict[str, Any] = {}
    for name, one in hard_members(path, group).items() if depth else ():
        if hasattr(one, "keys"):
            found |= _arrays(path, one, f"{prefix}{name}/", depth - 1)
        elif getattr(one, "ndim", 0) >= SPACE and one.dtype.kind in "iufb":
            found[prefix + name] = dataset_in(path, group, name)
    return found


def _spacing(path: Path, data: Any) -> tuple[Any, str]:
    for name in SIZES:
        sizes = numbers_of(path, data, name)
        if sizes is not None and len(sizes) >= SPACE:
            return sizes[-SPACE:][::-1], "µm" if name.endswith("_um") else UNKNOWN
    return (1.0, 1.0, 1.0), VOXEL


@dataclass(frozen=True)
class Imaris(OneOfAll):
    """Imaris 5.5 and later: all times and channels at full resolution, with colors and windows."""

    suffixes: ClassVar[tuple[str, ...]] = (".ims",)

    def read(self, path: Path, name: str, check: Check) -> Recording:
        with contents(path) as file:
            info, full = (group_in(path, file, one) for one in ("DataSetInfo", "DataSet"))
            full = full and group_in(path, full, FULL)
            image = info and group_in(path, info, "Image")
            if not (full and image):
                raise ValueError("is not an Imaris file: it has no DataSetInfo/Image or DataSet")
            shape = [int(_word(path, image, axis) or 0) for axis in "XYZ"]
            ends = [
                [float(_word(path, image, f"Ext{end}{n}") or 0) for n in range(SPACE)]
                for end in ("Min", "Max")
            ]
            groups = [
                [group_in(path, one, f"Channel {c}") for c in range(len(names_in(path, one)))]
                for one in (
                    group_in(path, full, f"TimePoint {t}") for t in range(len(names_in(path, full)))
                )
                if one
            ]
            data = [[one and dataset_in(path, one, "Data") for one in each] for each in groups]
            if not data or not data[0] or any(one is None for each in data for one in each):
                raise ValueError("has no channels at full resolution, or not all of them")
            steps = np.subtract(ends[1], ends[0]) / np.maximum(shape, 1)
            unit, by = unit_of_length(_word(path, image, "Unit") or "um")
            known = header(
                tuple(shape),
                data[0][0].dtype,
                name,
                spacing=by * steps,
                origin=by * (np.array(ends[0]) + steps / 2),
            )
            known = known._replace(times=len(data), parts=len(data[0]), length=unit or UNKNOWN)
            check(known)
            require_memory(known.size, name)
            x, y, z = shape
            with damage(path):  # stored in whole chunks
                values = np.array([[one[:z, :y, :x] for one in each] for each in data])
            infos = [group_in(path, info, f"Channel {c}") for c in range(known.parts)]
            looks = tuple(_channel(path, one) for one in infos)
        return recording(values, known, channels_first=True)._replace(looks=looks)


def _word(path: Path, group: Any, name: str) -> str:
    """Return an attribute that Imaris has as an array of letters; empty if missing."""
    with damage(path):
        if name not in group.attrs:
            return ""
        letters = np.asarray(group.attrs[name])
        return b"".join(letters.astype("S").ravel().tolist()).decode("utf-8", "replace").strip()


def _channel(path: Path, channel: Any) -> ChannelLook:
    """Return the name, color and window of a channel."""
    if channel is None:
        return ChannelLook()
    numbers = [
        [float(one) for one in re.findall(r"[-+.\deE]+", _word(path, channel, name))]
        for name in ("Color", "ColorRange")
    ]
    color, window = "", None
    if len(numbers[0]) == SPACE:
        levels = np.rint(255 * np.clip(numbers[0], 0, 1)).astype(int).tolist()
        color = "#" + "".join(f"{level:02x}" for level in levels)
    if len(numbers[1]) == 2 and numbers[1][0] < numbers[1][1]:
        window = numbers[1][0], numbers[1][1]
    return ChannelLook(_word(path, channel, "Name")[:80], color, window)


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
    """Return the variables of a version 4 file; scales name their axes."""
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
    """Return the coordinates of an axis; None if missing."""
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
