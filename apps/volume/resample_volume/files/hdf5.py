"""Read arrays of HDF5 and volumes of Imaris by h5py, the extra `hdf5`."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from resample.lengths import unit_of_length
from resample.reading.arrays import dataset_in, group_in, hard_members, names_in, numbers_of, opened
from resample.reading.native import damage
from resample_volume.data.memory import require_memory
from resample_volume.files.parsing.headers import Check, OneOfAll, header, recording
from resample_volume.files.readers import header_of_array
from resample_volume.types import UNKNOWN, VOXEL, ChannelLook, Recording

SPACE = 3
SIZES = ("element_size_um", "voxel_size", "spacing")  # attributes (z, y, x) of datasets
FULL = "ResolutionLevel 0"


@contextmanager
def contents(path: Path) -> Iterator[Any]:
    """Open an HDF5 file; errors begin with its name."""
    try:
        with opened(path) as file:
            yield file
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
                raise ValueError("is no file of Imaris: it has no DataSetInfo/Image or DataSet")
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
    """Return an attribute that Imaris has as an array of letters; empty if there is none."""
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
