"""LAS, LAZ and COPC: points of laser scanners, read through laspy with lazrs (the extra `las`).

Places are whole numbers times a scale, plus an offset, as the American Society for Photogrammetry
and Remote Sensing's LAS 1.4 has it; they are worked out in float64. COPC 1.0 is LAZ whose points
stand in an octree: each of its levels adds points between those of the levels before.
"""

import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import mapped
from resample.memory import amount, available_memory
from resample.reading.limits import check_free, check_unpacked
from resample.types import Floats
from resample.words import one_line
from resample_warp3d.clouds.cloud import Cloud
from resample_warp3d.clouds.fields import COLORS, Fields, cloud_of

ENTRY = np.dtype(
    {
        "names": ["level", "x", "y", "z", "offset", "size", "points"],
        "formats": ["<i4", "<i4", "<i4", "<i4", "<u8", "<i4", "<i4"],
    }
)  # of a page of COPC's hierarchy
HEAD = struct.Struct("<4s90xHII")  # mark, bytes of the header, where points begin, other parts
PART = 54  # bytes of the least of these
ITEMS = 34  # where the parts of a point begin, in what LAZ says of itself; their number is before
LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # that parts of a point are packed in, by their kinds
BYTES = 14  # kind of extra bytes, each of which is a layer
PAGE = -1  # points of an entry that names another page
PER_POINT = 100  # bytes that a point takes beside those of its record, while it is read
LEFT_OUT = {  # what is of use to no picture
    *("X", "Y", "Z", "red", "green", "blue", "withheld", "x_t", "y_t", "z_t"),
    *("wavepacket_index", "wavepacket_offset", "wavepacket_size", "return_point_wave_location"),
}
BRIGHT = 0.98  # share of the points that are darker than white, of intensities
CLASSES = 20  # colors of classes, of the colormap tab20


class _Laser(NamedTuple):
    """An open file."""

    path: Path
    file: BinaryIO
    header: Any  # laspy's
    length: int  # bytes of the file

    @property
    def packing(self) -> bytes:
        """How a LAZ file is packed.

        Raises
        ------
        OSError
            It does not say so, or says something that does not fit its points.
        """
        import lazrs

        with _damage(self.path):
            packing = bytes(self.header.vlrs[self.header.vlrs.index("LasZipVlr")].record_data)
            size = lazrs.LazVlr(packing).item_size()
            if size != self.header.point_format.size:
                raise ValueError(f"its points have {size} bytes packed and others unpacked")
        return packing


def read_las(path: Path, level: int = 0) -> Cloud:
    """Cloud of a LAS, LAZ or COPC file.

    Parameters
    ----------
    path
        Of any version and format of points. Points that are marked as withheld are left out.
    level
        So many of the finest levels of a COPC file are left out.

    Returns
    -------
    Colors are sRGB in 16 bits, or in 8 where none is above 255. Where there are none, or all are
    black, points have the gray of their intensity, of which the 98 % quantile is white, or else
    a color per class.

    Raises
    ------
    ValueError
        The extra is not installed, there is no such level, or it does not fit into memory.
    OSError
        The file is damaged or cut off.
    """
    laspy = _required(path.name)
    with _quiet(), path.open("rb") as file:
        length = path.stat().st_size
        with _damage(path):
            _check_head(file, length)
            header = laspy.LasHeader.read_from(file)
        laser = _Laser(path, file, header, length)
        entries = _entries(laser) if level or _is_copc(laser) else None
        if level and entries is None:
            raise ValueError("has no levels, which COPC files have; leave out the level")
        if not level:
            _check_room(laser, entries)
        if entries is None:
            record = _all_points(laspy, laser)
        else:
            record = _some_points(laspy, laser, _coarse(entries, level))
        with _damage(path):
            fields = _fields(laser, record)
    return _colored(cloud_of(fields))


def _required(name: str) -> Any:
    """The package laspy, with what it unpacks by."""
    try:
        import laspy
        import lazrs  # noqa: F401
    except ImportError as error:
        raise ValueError(
            f"{name} is of laspy, and {error.name} is not installed: "
            "pip install 'hybrid-resample[las]'"
        ) from None
    return laspy


@contextmanager
def _quiet() -> Iterator[None]:
    """What laspy logs is said by errors."""
    logger = logging.getLogger("laspy")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Make one error of the many kinds that damaged files raise."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        raise OSError(f"{path} is damaged: {one_line(error):.200}") from None
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # of Rust
            raise
        raise OSError(f"{path} is damaged: its points cannot be unpacked") from None


def _check_head(file: BinaryIO, length: int) -> None:
    """Refuse a header whose parts have no room in its file; laspy would take them one by one."""
    head = file.read(HEAD.size)
    file.seek(0)
    if len(head) < HEAD.size:
        raise ValueError("it is cut off")
    mark, size, points, parts = HEAD.unpack(head)
    if mark != b"LASF":
        raise ValueError("it does not begin with LASF")
    if not size <= points <= length or parts * PART > points - size:
        raise ValueError("its header has no room in it")


def _is_copc(laser: _Laser) -> bool:
    return any(type(part).__name__ == "CopcInfoVlr" for part in laser.header.vlrs)


def _entries(laser: _Laser) -> NDArray[Any]:
    """Entries (N,) of `ENTRY` of all chunks of a COPC file."""
    info = next((each for each in laser.header.vlrs if type(each).__name__ == "CopcInfoVlr"), None)
    if info is None:
        raise ValueError("has no levels, which COPC files have; leave out the level")
    pages = [(int(info.hierarchy_root_offset), int(info.hierarchy_root_size))]
    found, read = [], 0
    with _damage(laser.path):
        while pages:
            start, size = pages.pop()
            read += size
            if size < 0 or start + size > laser.length or read > laser.length:
                raise ValueError("a page of its levels is not there")
            laser.file.seek(start)
            page = np.frombuffer(laser.file.read(size // ENTRY.itemsize * ENTRY.itemsize), ENTRY)
            inner = page[page["points"] == PAGE]
            pages += zip(inner["offset"].tolist(), inner["size"].tolist(), strict=True)
            found.append(page[page["points"] > 0])
        chunks = np.concatenate(found)
        is_bad = (chunks["size"] < 0) | (chunks["level"] < 0) | (chunks["offset"] > laser.length)
        if not len(chunks) or is_bad.any() or chunks["size"].sum(dtype=np.int64) > laser.length:
            raise ValueError("its levels are not there")
    return chunks


def _coarse(entries: NDArray[Any], level: int) -> NDArray[Any]:
    """Chunks without those of the finest levels, in the order of the file."""
    deepest = int(entries["level"].max())
    if not 0 <= level <= deepest:
        raise ValueError(f"has the levels 0 to {deepest}, and no level {level}")
    kept = entries[entries["level"] <= deepest - level]
    return kept[np.argsort(kept["offset"], kind="stable")]


def _check_room(laser: _Laser, entries: NDArray[Any] | None) -> None:
    """Refuse what cannot be there, and what is more than memory holds."""
    header, name = laser.header, laser.path.name
    size = header.point_format.size
    if header.are_points_compressed:
        check_unpacked(name, laser.length, header.point_count * size)
    elif header.point_count * size > laser.length - header.offset_to_point_data:
        given = max(0, laser.length - header.offset_to_point_data) // size
        raise OSError(f"{laser.path} is cut off: {given} of {header.point_count} points are there")
    needed, free = header.point_count * (size + PER_POINT), available_memory()
    if free is not None and needed > free and entries is not None:
        most = free // (size + PER_POINT)
        raise ValueError(
            f"needs {amount(needed)} of memory and {amount(free)} are free; "
            + (f"--level {fits} fits" if (fits := _fitting(entries, most)) else "free some")
        )
    check_free(name, needed)


def _fitting(entries: NDArray[Any], most: int) -> int | None:
    """Least level at which a file has at most so many points, if there is one."""
    deepest = int(entries["level"].max())
    for level in range(1, deepest + 1):
        if _coarse(entries, level)["points"].sum(dtype=np.int64) <= most:
            return level
    return None


def _all_points(laspy: Any, laser: _Laser) -> Any:
    """All points of a file without levels, as laspy has them."""
    header = laser.header
    if header.are_points_compressed and header.point_count:
        return _some_points(laspy, laser, _chunks(laser))
    with _damage(laser.path):
        laser.file.seek(0)
        reader = laspy.LasReader(laser.file, closefd=False, read_evlrs=False)
        return reader.read_points(-1)


def _chunks(laser: _Laser) -> NDArray[Any]:
    """Chunks (N,) of `ENTRY` of a LAZ file, by its table."""
    import lazrs

    file, start, count = laser.file, laser.header.offset_to_point_data, laser.header.point_count
    packing = laser.packing
    with _damage(laser.path):
        file.seek(start)
        (table,) = struct.unpack("<q", file.read(8))
        if table == -1:  # of a writer that could not go back
            file.seek(laser.length - 8)
            (table,) = struct.unpack("<q", file.read(8))
        file.seek(table)
        number = struct.unpack("<2I", file.read(8))[1]
        if number > laser.length // laser.header.point_format.size:  # the first of each is bare
            raise ValueError("the table of its chunks has no room in it")
        file.seek(start)
        points, size = np.array(lazrs.read_chunk_table(file, lazrs.LazVlr(packing)), np.int64).T
        chunks = np.zeros(number, ENTRY)
        before = np.cumsum(points) - points
        chunks["points"] = np.clip(points, 0, np.maximum(count - before, 0))
        chunks["size"], chunks["offset"] = size, start + 8 + np.cumsum(size) - size
        if size.min() < 0 or size.sum() > table - start or before[-1] + points[-1] < count:
            raise ValueError("its chunks do not hold its points")
    return chunks


def _some_points(laspy: Any, laser: _Laser, chunks: NDArray[Any]) -> Any:
    """Points of some chunks of a LAZ file, as laspy has them."""
    import lazrs

    count, size = int(chunks["points"].sum(dtype=np.int64)), laser.header.point_format.size
    check_unpacked(laser.path.name, laser.length, count * size)
    check_free(laser.path.name, count * (size + PER_POINT))
    packing = laser.packing
    with _damage(laser.path):
        packed = bytearray()
        for offset, length in zip(chunks["offset"].tolist(), chunks["size"].tolist(), strict=True):
            laser.file.seek(offset)
            chunk = laser.file.read(length)
            _check_layers(chunk, length, size, packing)
            packed += chunk
        points = np.zeros(count * size, np.uint8)
        table = list(zip(chunks["points"].tolist(), chunks["size"].tolist(), strict=True))
        lazrs.decompress_points_with_chunk_table(packed, packing, points, table)
        return laspy.PackedPointRecord.from_buffer(points, laser.header.point_format)


def _check_layers(chunk: bytes, length: int, size: int, packing: bytes) -> None:
    """Refuse a chunk with layers (formats 6 to 10) that are larger than it; lazrs believes them."""
    if len(chunk) < max(length, size):
        raise ValueError("it is cut off")
    items = np.frombuffer(packing[ITEMS:], "<u2")[: 3 * packing[ITEMS - 2]].reshape(-1, 3)
    layers = sum(
        width if kind == BYTES else LAYERS.get(kind, 0) for kind, width, _ in items.tolist()
    )
    first = size + 4 + 4 * layers
    if layers:
        sizes = np.frombuffer(chunk[size + 4 : first], "<u4")
        if len(sizes) < layers or first + int(sizes.sum(dtype=np.int64)) > len(chunk):
            raise ValueError("layers of its points are not there")


def _fields(laser: _Laser, record: Any) -> Fields:
    """Columns of points, without those that are marked as withheld."""
    kept = ~np.asarray(record["withheld"], np.bool_)
    names = [name for name in record.point_format.dimension_names if name not in LEFT_OUT]
    columns = {name: np.asarray(record[name])[kept] for name in names}
    fields = {name: column for name, column in columns.items() if column.ndim == 1}
    for axis, scale, offset in zip("xyz", laser.header.scales, laser.header.offsets, strict=True):
        fields[axis] = record[axis.upper()][kept] * np.float64(scale) + np.float64(offset)
    if "red" in record.point_format.dimension_names:
        levels = [np.asarray(record[name])[kept] for name in COLORS[0]]
        most = max(int(level.max(initial=0)) for level in levels)
        kind = np.uint8 if most <= 255 else np.uint16
        if most:
            fields |= {n: c.astype(kind) for n, c in zip(COLORS[0], levels, strict=True)}
    return fields


def _colored(cloud: Cloud) -> Cloud:
    """Cloud whose points have colors, of intensities or classes if of nothing else."""
    if len(cloud.color) or not len(cloud.position):
        return cloud
    intensity = np.asarray(cloud.columns.get("intensity", np.zeros(1)), np.float32)
    number = np.asarray(cloud.columns.get("classification", np.zeros(1)), np.int64)
    if intensity.min() < intensity.max():
        white = max(float(np.quantile(intensity, BRIGHT)), 1.0)
        gray = np.minimum(intensity / np.float32(white), np.float32(1))
        return cloud._replace(color=np.repeat(gray[:, None], 3, axis=1))
    if number.min() < number.max():
        color: Floats = mapped("tab20", (number % CLASSES + 0.5) / CLASSES)
        return cloud._replace(color=color)
    return cloud
