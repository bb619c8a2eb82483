"""Write volumes as OME-Zarr 0.5, brick by brick."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec, ZstdCodec

from resample.files.stores import STORE
from resample.files.writing import beside, unwritten
from resample.outofcore.bricks import Step, boxes_of
from resample.progress import Progress
from resample.types import Doubles
from resample_volume.data.recordings import unit_of_space
from resample_volume.data.values import values_of
from resample_volume.types import ChannelLook, Recording
from resample_zarr.metadata import OWN

SMALLEST = 64  # voxels along the longest axis of the last level
VERSION = "0.5"
COMPRESSIONS = ("zstd", "blosc", "none")
UDUNITS = {"mm": "millimeter", "µm": "micrometer", "Å": "angstrom"}
NAMES = {"t": "time", "c": "channel", "z": "space", "y": "space", "x": "space"}


def sizes(shape: Step) -> list[Step]:
    """Return the shapes of all levels, the finest first; each halves the last, rounded up."""
    found = [shape]
    while max(found[-1]) > SMALLEST:
        z, y, x = (
            -(-size // per) for size, per in zip(found[-1], per_axis(found[-1]), strict=True)
        )
        found.append((z, y, x))
    return found


def per_axis(shape: Step) -> Step:
    """Return the voxels along each axis that become one; a volume keeps at least two."""
    z, y, x = (2 if size > 2 else 1 for size in shape)
    return z, y, x


def halved(values: NDArray[Any], per: Step) -> NDArray[Any]:
    """Average blocks of voxels along z, y and x, smaller at the ends; of the same type.

    Integers are rounded to nearest, halves to even; missing and infinite values take no part, and a
    block without others is missing.
    """
    shape = tuple(-(-size // step) for size, step in zip(values.shape, per, strict=True))
    is_whole = values.dtype.kind in "iu"
    total = np.zeros(shape, np.int64 if is_whole else np.float64)
    count = np.zeros(shape, np.uint8)
    for start in product(*map(range, per)):
        part = values[tuple(slice(n, None, step) for n, step in zip(start, per, strict=True))]
        inside = tuple(map(slice, part.shape))
        known = True if is_whole else np.isfinite(part)
        total[inside] += part if is_whole else np.where(known, part, 0.0)
        count[inside] += known
    if is_whole:
        return np.rint(total / count).astype(values.dtype)
    with np.errstate(invalid="ignore"):
        return (total / count).astype(values.dtype)


@dataclass(frozen=True)
class Layered:
    """Chunk layout and compression.

    Raises ValueError: a side is below 8 voxels, a shard is not of whole chunks, or the compression
    is unknown.
    """

    chunk: int = 64  # voxels along each side
    shard: int | None = None  # voxels along each side of a file that holds chunks; None: one each
    compression: str = "zstd"  # one of COMPRESSIONS
    is_layered: bool = True  # whether coarser levels are written

    def __post_init__(self) -> None:
        if self.chunk < 8:
            raise ValueError(f"chunks of {self.chunk} voxels; their sides are 8 or more")
        if self.shard is not None and (self.shard % self.chunk or self.shard < self.chunk):
            raise ValueError(
                f"shards of {self.shard} voxels are not of whole chunks of {self.chunk}; give a "
                f"multiple such as {4 * self.chunk}"
            )
        if self.compression not in COMPRESSIONS:
            raise ValueError(
                f"unknown compression {self.compression!r}; known are {', '.join(COMPRESSIONS)}"
            )

    @property
    def step(self) -> int:
        """Voxels per side of a unit of writing."""
        return self.shard or self.chunk


def write_store(
    path: Path, recording: Recording, form: Layered, progress: Progress | None = None
) -> None:
    """Write all times and channels of a recording, with one brick at a time in memory.

    What OME-Zarr lacks (a rotated direction, units of values, whether channels are colors) is
    stored in our own attribute, which other programs ignore.

    `progress`: called with the fraction of bricks written, 0 to 1.
    """
    check_store(path)
    shapes = sizes(_space(recording)) if form.is_layered else [_space(recording)]
    try:
        with beside(path) as temporary:
            group = zarr.open_group(temporary, mode="w-", zarr_format=3)
            every = enumerate(shapes)
            levels = [_array(group, str(n), shape, recording, form) for n, shape in every]
            for share in _fill(levels, recording, form):
                if progress is not None:
                    progress(share)
            # OME-Zarr's attributes of an image, and our own
            letters = _letters(recording)
            name = UDUNITS.get(unit_of_space(recording), "")
            unit = {"unit": name} if name else {}
            axes = [
                {"name": axis, "type": NAMES[axis], **(unit if NAMES[axis] == "space" else {})}
                for axis in letters
            ]
            # Levels with transforms: voxels are means, so their centers lie between finer ones
            found, ones = [], [1.0] * (len(_letters(recording)) - 3)
            spacing, origin = np.array(recording.spacing), np.array(recording.origin)
            for n, shape in enumerate(shapes):
                steps = [
                    {"type": "scale", "scale": ones + spacing[::-1].tolist()},
                    {
                        "type": "translation",
                        "translation": [0.0] * len(ones) + origin[::-1].tolist(),
                    },
                ]
                found.append({"path": str(n), "coordinateTransformations": steps})
                per: Doubles = np.array(per_axis(shape)[::-1], np.float64)
                origin = origin + recording.direction @ (spacing * (per - 1) / 2)
                spacing = spacing * per
            image = {"name": recording.name, "axes": axes, "datasets": found}
            own = {
                "direction": recording.direction.tolist(),
                "units": recording.units,
                "space": recording.space,
                "color": recording.is_color,
            }
            whole: dict[str, Any] = {"version": VERSION, "multiscales": [image]}
            if recording.looks:
                whole["omero"] = {"channels": [_channel(look) for look in recording.looks]}
            group.attrs.update({"ome": whole, OWN: own})
            temporary.rename(path)
    except OSError as error:
        raise unwritten(path, error) from None


def bricks_of(recording: Recording, form: Layered) -> int:
    """Return the number of bricks that `write_store` writes."""
    shapes = sizes(_space(recording)) if form.is_layered else [_space(recording)]
    each = sum(prod(-(-size // form.step) for size in shape) for shape in shapes)
    return prod(map(int, recording.values.shape[:2])) * each


def check_store(path: Path) -> None:
    """Reject a store that cannot be written, before any work is done."""
    if not path.name.lower().endswith(STORE):
        raise ValueError(f"{path}: volumes are converted to OME-Zarr, as volume.ome.zarr")
    if path.exists():
        raise ValueError(f"{path} already exists; remove it or give another name")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path.parent}: there is no such folder")
    if not os.access(path.parent, os.W_OK):
        raise PermissionError(f"{path.parent} must not be written to")


def _space(recording: Recording) -> Step:
    z, y, x = map(int, recording.values.shape[-3:])
    return z, y, x


def _letters(recording: Recording) -> str:
    """Return the axes to write: times and channels only if there are several."""
    times, parts = recording.values.shape[:2]
    return ("t" if times > 1 else "") + ("c" if parts > 1 else "") + "zyx"


def _array(
    group: zarr.Group, name: str, shape: Step, recording: Recording, form: Layered
) -> zarr.Array[Any]:
    """Create the empty array of one level."""
    compressors = {"zstd": ZstdCodec(level=3), "blosc": BloscCodec(cname="zstd", clevel=5)}
    letters = _letters(recording)
    before = tuple(
        n for n, letter in zip(recording.values.shape[:2], "tc", strict=True) if letter in letters
    )
    ones = (1,) * len(before)
    return group.create_array(
        name,
        shape=(*before, *shape),
        chunks=(*ones, *(form.chunk,) * 3),
        shards=None if form.shard is None else (*ones, *(form.shard,) * 3),
        dtype=recording.values.dtype.newbyteorder("="),
        compressors=compressors.get(form.compression),
        dimension_names=list(letters),
        fill_value=0,
    )


def _fill(levels: list[zarr.Array[Any]], recording: Recording, form: Layered) -> Iterator[float]:
    """Write all levels, the finest first; yield the fraction written."""
    letters, times, parts = _letters(recording), *recording.values.shape[:2]
    shapes = [level.shape[-3:] for level in levels]
    boxes = [boxes_of(shape, (form.step,) * 3) for shape in shapes]
    total, done = times * parts * sum(map(len, boxes)), 0
    for time, part in product(range(times), range(parts)):
        at = tuple(n for n, letter in ((time, "t"), (part, "c")) if letter in letters)
        given = values_of(recording.values[time, part]).read
        for n, level in enumerate(levels):
            for box in boxes[n]:
                if n == 0:
                    values = given(box)
                else:
                    per = per_axis(shapes[n - 1])
                    sides = zip(box, per, strict=True)
                    finer = (slice(by * side.start, by * side.stop) for side, by in sides)
                    values = halved(np.asarray(levels[n - 1][(*at, *finer)]), per)
                level[(*at, *box)] = values
                done += 1
                yield done / total


def _channel(look: ChannelLook) -> dict[str, Any]:
    """Return the look of a channel as OMERO has it."""
    told: dict[str, Any] = {"label": look.label, "active": look.is_active}
    if look.color:
        told["color"] = look.color.removeprefix("#").upper()
    if look.window is not None:
        low, high = look.window
        told["window"] = {"start": low, "end": high, "min": low, "max": high}
    return told
