"""LAS, LAZ and COPC: points of laser scanners, read through laspy with lazrs (the extra `las`).

Places are whole numbers times a scale, plus an offset, as the American Society for Photogrammetry
and Remote Sensing's LAS 1.4 has it; they are worked out in float64. COPC 1.0 is LAZ whose points
stand in an octree: each of its levels adds points between those of the levels before.
"""

import logging
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_free, check_ratio
from resample.watching import look
from resample.words import one_line
from resample_warp3d.clouds.cloud import Cloud, kept_columns
from resample_warp3d.clouds.coloring import SCANNED, colored_as_scanned
from resample_warp3d.clouds.fields import COLORS, Fields, cloud_of
from resample_warp3d.clouds.parts import PER_POINT, STEP, Gathering, memory_left, storage_for

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
UNPACKED = 100  # bytes that a point takes beside those of its record, while it is unpacked
LEFT_OUT = {  # what is of use to no picture
    *("X", "Y", "Z", "red", "green", "blue", "withheld", "x_t", "y_t", "z_t"),
    *("wavepacket_index", "wavepacket_offset", "wavepacket_size", "return_point_wave_location"),
}


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


def read_las(path: Path, level: int = 0, columns: Sequence[str] | None = None) -> Cloud:
    """Cloud of a LAS, LAZ or COPC file.

    Parameters
    ----------
    path
        Of any version and format of points. Points that are marked as withheld are left out.
    level
        So many of the finest levels of a COPC file are left out.
    columns
        Names of those that are kept; None: all are.

    Returns
    -------
    Colors are sRGB in 16 bits, or in 8 where none is above 255. Where there are none, or all are
    black, points have the gray of their intensity, of which the 98 % quantile is white, or else
    a color per class.

    Raises
    ------
    ValueError
        The extra is not installed, there is no such level or column, or neither memory nor the
        disk has room for it.
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
            _check_length(laser)
        return _gathered(laspy, laser, entries, level, columns)


def _gathered(
    laspy: Any,
    laser: _Laser,
    entries: NDArray[Any] | None,
    level: int,
    columns: Sequence[str] | None,
) -> Cloud:
    """All points of a file, or those of the coarser levels of its entries."""
    if entries is None and not (laser.header.are_points_compressed and laser.header.point_count):
        records, count = _bare_in_parts(laspy, laser), laser.header.point_count
    else:
        chunks = _chunks(laser) if entries is None else _coarse(entries, level)
        count = _checked_points(laser, chunks)
        records = _chunks_in_parts(laspy, laser, chunks)
    gathering, read = Gathering(storage_for(count, laser.path.name, _hint(entries, level))), 0
    for record in records:
        with _damage(laser.path):
            levels, fields = _fields(laser, record)
        part = cloud_of(fields)
        kept = kept_columns(part, columns)
        shown = {name: part.columns[name] for name in SCANNED if name in part.columns}
        gathering.add(kept._replace(columns={**kept.columns, **shown, **levels}))
        read += len(record)
        look(read, count)
    cloud = colored_as_scanned(gathering.cloud())
    return cloud if columns is None else kept_columns(cloud, columns)


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


def _check_length(laser: _Laser) -> None:
    """Refuse points that cannot be there."""
    header, size = laser.header, laser.header.point_format.size
    if header.are_points_compressed:
        check_ratio(laser.path.name, laser.length, header.point_count * size)
    elif header.point_count * size > laser.length - header.offset_to_point_data:
        given = max(0, laser.length - header.offset_to_point_data) // size
        raise OSError(f"{laser.path} is cut off: {given} of {header.point_count} points are there")


def _hint(entries: NDArray[Any] | None, level: int) -> str:
    """The level of a file that memory holds, for the message that it does not hold all points."""
    left = memory_left()
    if entries is None or left is None:
        return ""
    deepest = int(entries["level"].max())
    for coarser in range(level + 1, deepest + 1):
        if int(_coarse(entries, coarser)["points"].sum(dtype=np.int64)) * PER_POINT <= left:
            return f"; --level {coarser} fits"
    return ""


def _bare_in_parts(laspy: Any, laser: _Laser) -> Iterator[Any]:
    """Points that are not packed, as laspy has them."""
    with _damage(laser.path):
        laser.file.seek(0)
        reader = laspy.LasReader(laser.file, closefd=False, read_evlrs=False)
        yield reader.read_points(min(STEP, laser.header.point_count))
    for _ in range(STEP, laser.header.point_count, STEP):
        with _damage(laser.path):
            record = reader.read_points(STEP)
        yield record


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


def _checked_points(laser: _Laser, chunks: NDArray[Any]) -> int:
    """How many points some chunks have; refused if their bytes cannot hold them."""
    count = int(chunks["points"].sum(dtype=np.int64))
    check_ratio(laser.path.name, laser.length, count * laser.header.point_format.size)
    return count


def _chunks_in_parts(laspy: Any, laser: _Laser, chunks: NDArray[Any]) -> Iterator[Any]:
    """Points of some chunks of a LAZ file, as laspy has them, chunks of `STEP` points at a time."""
    packing = laser.packing
    part = (np.cumsum(chunks["points"], dtype=np.int64) - 1) // STEP
    for some in np.split(chunks, 1 + np.flatnonzero(np.diff(part))):
        yield _unpacked(laspy, laser, some, packing)


def _unpacked(laspy: Any, laser: _Laser, chunks: NDArray[Any], packing: bytes) -> Any:
    """Points of some chunks of a LAZ file."""
    import lazrs

    count, size = int(chunks["points"].sum(dtype=np.int64)), laser.header.point_format.size
    check_free(laser.path.name, count * (size + UNPACKED))
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


def _fields(laser: _Laser, record: Any) -> tuple[Fields, Fields]:
    """Levels of red, green and blue, if there are, and all other columns of points.

    Those that are marked as withheld are left out.
    """
    kept = ~np.asarray(record["withheld"], np.bool_)
    names = [name for name in record.point_format.dimension_names if name not in LEFT_OUT]
    columns = {name: np.asarray(record[name])[kept] for name in names}
    fields = {name: column for name, column in columns.items() if column.ndim == 1}
    for axis, scale, offset in zip("xyz", laser.header.scales, laser.header.offsets, strict=True):
        fields[axis] = record[axis.upper()][kept] * np.float64(scale) + np.float64(offset)
    if "red" not in record.point_format.dimension_names:
        return {}, fields
    return {name: np.asarray(record[name])[kept] for name in COLORS[0]}, fields
