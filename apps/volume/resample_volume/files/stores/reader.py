"""Read OME-Zarr and plain zarr arrays."""

import math
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from resample.files.stores.metadata import SPACE, Layout, Level, layout_of, moved
from resample.files.stores.opening import Place
from resample.outofcore.bricks import Step
from resample.reading.limits import check_free
from resample_volume.data.memory import require_memory
from resample_volume.data.recordings import alone
from resample_volume.files.parsing.headers import (
    Check,
    VolumeHeader,
    accept_any,
    check_alone,
    check_not_empty,
    header,
    stem,
)
from resample_volume.files.parsing.texts import Numbers, spacing_of
from resample_volume.types import UNKNOWN, VOXEL, ChannelLook, Recording, Volume

if TYPE_CHECKING:
    import zarr

LOSS = {1: "27 to 44", 2: "21 to 39"}  # measured dB of pictures from coarser levels
SERIES = "bioformats2raw.layout"  # attribute of a group of images, which are 0, 1 and so on
LETTERS = {3: "zyx", 4: "tzyx", 5: "tczyx"}  # of plain arrays, by their dimensions


@dataclass(frozen=True)
class Zarr:
    """OME-Zarr 0.4 and 0.5, or a plain array of zarr 2 or 3; a folder, zipped, or at an address.

    Plain arrays are (Z, Y, X), (T, Z, Y, X) or (T, C, Z, Y, X), unless they name their axes.
    """

    level: int = 0  # of an image at several sizes; 0 is the finest
    spacing: Numbers = ""  # of a plain array, which has none: "1x1x1.4" (x, y, z)

    suffixes: ClassVar[tuple[str, ...]] = (
        *(".ome.zarr", ".zarr", ".ome.zarr.zip", ".zarr.zip", ".ozx", ".zip"),
    )

    def __post_init__(self) -> None:
        spacing_of(self.spacing)

    def __call__(self, path: Place) -> Volume:
        return alone(self.recorded(path, check_alone))

    def recorded(self, path: Place, check: Check = accept_any) -> Recording:
        found = self.streamed(path, check)
        times, size = found.values, math.prod(found.values.shape) * found.values.dtype.itemsize
        require_memory(size, found.name)
        check_free(found.name, size)
        return found._replace(values=np.stack([times[n] for n in range(times.shape[0])]))

    def streamed(
        self, path: Place, check: Check = accept_any, brick: Step | None = None
    ) -> Recording:
        """Open all times and channels; values stay in the file, see `Chunked`.

        Parameters
        ----------
        path
            Folder or zip file, or address.
        check
            May reject the header.
        brick
            Voxels along z, y and x that are read together; None: by chunks.

        Raises
        ------
        ValueError, OSError
            It cannot be read, or holds no such level.
        """
        from resample.files.stores.guarding import guard
        from resample.files.stores.metadata import holes_of
        from resample_volume.files.stores.chunks import Chunked

        name = stem(PurePath(path.resolve().name), self.suffixes)
        layout, node = _image(path, name)
        number, count = self.level, len(layout.levels)
        if not 0 <= number < count:
            raise ValueError(
                f"{name} has {count} levels, 0 (the finest) to {count - 1}; there is no level "
                f"{number}"
            )
        level = moved(layout, number)
        array = _array(node, level, name)
        if min(array.chunks, default=0) < 1:
            raise ValueError(f"{name}/{level.path} has chunks of {array.chunks}; get it again")
        if array.ndim != len(layout.axes):
            raise ValueError(
                f"{name}/{level.path} has {array.ndim} dimensions, its metadata {layout.axes}"
            )
        known = self._header(layout, level, array, name)
        check_not_empty(known)
        check(known)
        guard(array, name)
        holes = holes_of(array, name)
        values = Chunked(array, layout.axes, brick=brick, store=path.resolve(), holes=holes)
        place = (known.spacing, known.origin, known.direction)
        told = Recording(values, *place, name, layout.units, layout.is_color, space=layout.space)
        told = told._replace(length=known.length, looks=_looks(layout))
        missing = holes.message(array.fill_value)
        if not number:
            return told._replace(note=missing)
        finest = _lengths(layout.levels[0], layout.axes)[0]
        size = " x ".join(map(str, known.shape))
        where = ", whose place the file does not tell"
        where = "" if layout.levels[number].is_placed else where
        note = (
            f"level {number} of 0 to {count - 1} ({level.path}{where}) has {size} voxels: its "
            f"pictures are {LOSS.get(number, 'less than 39')} dB from those of level 0"
        )
        notes = [note, missing]
        return told._replace(
            note="; ".join(filter(None, notes)), thickness=float(np.cbrt(abs(finest.prod())))
        )

    def levels(self, path: Place) -> list[dict[str, Any]]:
        """Return levels with `path`, `shape` and `spacing` (x, y, z); errors as of `streamed`."""
        name = stem(PurePath(path.resolve().name), self.suffixes)
        layout, node = _image(path, name)
        listed = []
        for level in layout.levels:
            size = dict(zip(layout.axes, _array(node, level, name).shape, strict=True))
            spacing = _lengths(level, layout.axes)[0]
            shape = tuple(size[letter] for letter in SPACE[::-1])
            listed.append({"path": level.path, "shape": shape, "spacing": spacing.tolist()})
        return listed

    def _header(
        self, layout: Layout, level: Level, array: "zarr.Array[Any]", name: str
    ) -> VolumeHeader:
        size = dict(zip(layout.axes, map(int, array.shape), strict=True))
        spacing, origin = _lengths(level, layout.axes)
        direction = np.diag(np.where(spacing < 0, -1.0, 1.0))
        if layout.direction is not None:
            direction = layout.direction @ direction
        if self.spacing:
            spacing = np.array(spacing_of(self.spacing)[0])
        known = header(
            tuple(size[letter] for letter in SPACE[::-1]),
            array.dtype,
            name,
            spacing=np.abs(spacing),
            origin=origin,
            direction=direction,
        )
        times, parts = size.get("t", 1), size.get("c", 1)
        length = spacing_of(self.spacing)[1] if self.spacing else layout.unit or UNKNOWN
        known = known._replace(times=times, parts=parts, length=length)
        return known._replace(is_color=layout.is_color)


def _image(path: Place, name: str) -> "tuple[Layout, zarr.Array[Any] | zarr.Group]":
    """Return the metadata of an image, and its location."""
    from resample.files.stores.opening import open_node, reading_metadata

    node = open_node(path)  # the message says what is missing
    import zarr

    if isinstance(node, zarr.Array):
        return _plain(node, name), node
    attributes = dict(node.attrs)
    told = attributes.get("ome", attributes)
    if isinstance(told, dict) and SERIES in told and "multiscales" not in told:
        with reading_metadata(name):
            keys = sorted(key for key, _ in node.groups() if key.isdigit())
            node = node[keys[0]] if len(keys) == 1 else node
        if len(keys) != 1:
            raise ValueError(
                f"{name} holds {len(keys)} images; name one of them, such as "
                f"{path / (keys[0] if keys else '0')}"
            )
        attributes = dict(node.attrs)
    layout = layout_of(attributes, name)
    if layout is None:
        with reading_metadata(name):
            held = ", ".join(sorted(node.keys()))
        raise ValueError(
            f"{name} is a group without multiscales, so no image of OME-Zarr; name one of what it "
            f"holds ({held or 'nothing'}) if that is a volume"
        )
    return layout, node


def _plain(array: "zarr.Array[Any]", name: str) -> Layout:
    """Return an array that is not part of an image."""
    named = getattr(array.metadata, "dimension_names", None) or array.attrs.get("_ARRAY_DIMENSIONS")
    letters = "".join(str(axis).lower()[:1] for axis in named or ())
    if not (set(letters) >= set(SPACE) and set(letters) <= set("tczyx")):
        letters = LETTERS.get(array.ndim, "")
    if len(letters) != array.ndim or len(set(letters)) < len(letters):
        raise ValueError(
            f"{name} has {array.ndim} dimensions; a volume has 3 (z, y, x), or 4 or 5 with times "
            "and channels before them"
        )
    count = array.ndim
    return Layout(letters, (Level("", np.ones(count), np.zeros(count), is_placed=True),), VOXEL)


def _array(node: "zarr.Array[Any] | zarr.Group", level: Level, name: str) -> "zarr.Array[Any]":
    """Return the array of a level."""
    import zarr

    from resample.files.stores.opening import reading_metadata

    if isinstance(node, zarr.Array):
        return node
    with reading_metadata(f"{name}/{level.path}"):
        found = node.get(level.path)
    if found is None:
        raise ValueError(f"{name} names a level {level.path!r}, which is not there; is it whole?")
    if not isinstance(found, zarr.Array):
        raise ValueError(f"{name}/{level.path} is a group; a level is an array")
    return found


def _looks(layout: Layout) -> tuple[ChannelLook, ...]:
    """Return the looks of channels, if some have a color."""
    if not any(one.color for one in layout.looks):
        return ()
    found = []
    for one in layout.looks:
        window = None if one.window is None else (one.window.start, one.window.end)
        color = f"#{one.color.strip('#')[:6].lower()}" if one.color else ""
        found.append(ChannelLook(one.label, color, window, one.active))
    return tuple(found)


def _lengths(level: Level, axes: str) -> "tuple[Any, Any]":
    """Return spacing and origin (3,) along x, y and z."""
    order = [axes.index(letter) for letter in SPACE[::-1]]
    return level.scale[order], level.start[order]
