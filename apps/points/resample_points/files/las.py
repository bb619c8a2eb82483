"""Read LAS, LAZ and COPC laser scans through laspy with lazrs (the extra `las`).

Positions are integers times a scale plus an offset, as in the American Society for Photogrammetry
and Remote Sensing's LAS 1.4; they are computed in float64. COPC 1.0 is LAZ whose points are stored
in an octree: each level adds points between those of the previous levels. LAS 1.4 takes coordinate
systems over as they are in OGC's WKT and GeoTIFF 1.0; only EPSG's codes are read.
"""

import logging
import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.metadata.tags import ASCII, DOUBLE, KEYS, NUMBERS, SHORT, WORDS, Directory, Tag
from resample.progress import report
from resample.reading.limits import check_free, check_ratio
from resample.reading.native import damage, lacking
from resample_points.data.cloud import COLORS, Cloud, Fields, cloud_of, kept_columns
from resample_points.data.columns import SCANNED, colored_as_scanned
from resample_points.data.parts import PER_POINT, STEP, CloudBuilder, memory_left, storage_for

ENTRY = np.dtype(
    {
        "names": ["level", "x", "y", "z", "offset", "size", "points"],
        "formats": ["<i4", "<i4", "<i4", "<i4", "<u8", "<i4", "<i4"],
    }
)  # of a page of COPC's hierarchy
HEAD = struct.Struct("<4s90xHII")  # signature, header bytes, offset of points, records
PART = 54  # bytes of the smallest record
ITEMS = 34  # offset of the items in the LAZ record; their number is before
LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # number of layers of an item, by its kind
BYTES = 14  # kind of extra bytes; each byte is a layer
PAGE = -1  # number of points of an entry that refers to another page
UNPACKED = 100  # bytes per point beside its record, while unpacking
ANGLE = np.float32(0.006)  # degrees per step of scan angles of formats 6 to 10
LEFT_OUT = {  # dimensions that no picture uses
    *("X", "Y", "Z", "red", "green", "blue", "withheld", "x_t", "y_t", "z_t"),
    *("wavepacket_index", "wavepacket_offset", "wavepacket_size", "return_point_wave_location"),
}


class _Laser(NamedTuple):
    """An open LAS or LAZ file."""

    path: Path
    file: BinaryIO
    header: Any  # laspy's
    length: int  # bytes of the file

    @property
    def packing(self) -> bytes:
        """The compression record of a LAZ file."""
        import lazrs

        with damage(self.path):
            packing = bytes(self.header.vlrs[self.header.vlrs.index("LasZipVlr")].record_data)
            size = lazrs.LazVlr(packing).item_size()
            if size != self.header.point_format.size:
                raise ValueError(
                    f"its points have {size} bytes when unpacked, not as its header says"
                )
        return packing


def read_las(path: Path, level: int = 0, columns: Sequence[str] | None = None) -> Cloud:
    """Read the cloud of a LAS, LAZ or COPC file.

    `columns`: names of columns to keep; None: all. Result: colors are sRGB in 16 bits, or in 8 if
    none is above 255. If there are none, or all are black, points are gray by their intensity, of
    which the 98 % quantile is white, or else get a color per class.
    """
    laspy = _required(path.name)
    with _quiet(), path.open("rb") as file:
        length = path.stat().st_size
        with damage(path):
            _check_head(file, length)
            header = laspy.LasHeader.read_from(file)
        laser = _Laser(path, file, header, length)
        is_copc = any(type(part).__name__ == "CopcInfoVlr" for part in header.vlrs)
        entries = _entries(laser) if level or is_copc else None
        if not level:
            _check_length(laser)
        return _gathered(laspy, laser, entries, level, columns)


def records_of(path: Path, owner: str) -> dict[int, bytes]:
    """Return the variable length records of an owner in a file's header, by their number."""
    laspy = _required(path.name)
    with _quiet(), path.open("rb") as file, damage(path):
        _check_head(file, path.stat().st_size)
        header = laspy.LasHeader.read_from(file, read_evlrs=True)
        records = (each for each in (*header.vlrs, *(header.evlrs or ())) if each.user_id == owner)
        return {each.record_id: each.record_data_bytes() for each in records}


def _gathered(
    laspy: Any,
    laser: _Laser,
    entries: NDArray[Any] | None,
    level: int,
    columns: Sequence[str] | None,
) -> Cloud:
    """Read all points of a file, or those of the coarser levels."""
    if entries is None and not (laser.header.are_points_compressed and laser.header.point_count):
        records, count = _bare_in_parts(laspy, laser), laser.header.point_count
    else:
        chunks = _chunks(laser) if entries is None else _coarse(entries, level)
        count = int(chunks["points"].sum(dtype=np.int64))
        check_ratio(laser.path.name, laser.length, count * laser.header.point_format.size)
        records = _chunks_in_parts(laspy, laser, chunks)
    gathering, read = CloudBuilder(storage_for(count, laser.path.name, _hint(entries, level))), 0
    for record in records:
        with damage(laser.path):
            levels, fields = _fields(laser, record)
        part = cloud_of(fields)
        kept = kept_columns(part, columns)
        shown = {name: part.columns[name] for name in SCANNED if name in part.columns}
        gathering.add(kept._replace(columns={**kept.columns, **shown, **levels}))
        read += len(record)
        report(read, count)
    cloud = colored_as_scanned(gathering.cloud())
    return cloud if columns is None else kept_columns(cloud, columns)


def _required(name: str) -> Any:
    """Import laspy and its decompressor."""
    try:
        import laspy
        import lazrs  # noqa: F401
    except ImportError as error:
        raise lacking(name, "laspy", error, "las") from None
    return laspy


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence laspy's log; its errors are raised."""
    logger = logging.getLogger("laspy")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _check_head(file: BinaryIO, length: int) -> None:
    """Refuse a header whose records do not fit into the file; laspy would read them all."""
    head = file.read(HEAD.size)
    file.seek(0)
    if len(head) < HEAD.size:
        raise ValueError("it is cut off")
    mark, size, points, parts = HEAD.unpack(head)
    if mark != b"LASF":
        raise ValueError("it does not begin with LASF")
    if not size <= points <= length or parts * PART > points - size:
        raise ValueError("its header does not fit into it")


def _entries(laser: _Laser) -> NDArray[Any]:
    """Return the entries (N,) of all chunks of a COPC file."""
    info = next((each for each in laser.header.vlrs if type(each).__name__ == "CopcInfoVlr"), None)
    if info is None:
        raise ValueError("has no levels, as only COPC files do; leave out the level")
    pages = [(int(info.hierarchy_root_offset), int(info.hierarchy_root_size))]
    found, read = [], 0
    with damage(laser.path):
        while pages:
            start, size = pages.pop()
            read += size
            if size < 0 or start + size > laser.length or read > laser.length:
                raise ValueError("a page of its levels is missing")
            laser.file.seek(start)
            page = np.frombuffer(laser.file.read(size // ENTRY.itemsize * ENTRY.itemsize), ENTRY)
            inner = page[page["points"] == PAGE]
            pages += zip(inner["offset"].tolist(), inner["size"].tolist(), strict=True)
            found.append(page[page["points"] > 0])
        chunks = np.concatenate(found)
        is_bad = (chunks["size"] < 0) | (chunks["level"] < 0) | (chunks["offset"] > laser.length)
        if not len(chunks) or is_bad.any() or chunks["size"].sum(dtype=np.int64) > laser.length:
            raise ValueError("its levels are missing")
    return chunks


def _coarse(entries: NDArray[Any], level: int) -> NDArray[Any]:
    """Drop the chunks of the finest levels; return the rest in the order of the file."""
    deepest = int(entries["level"].max())
    if not 0 <= level <= deepest:
        raise ValueError(f"has levels 0 to {deepest}, but no level {level}")
    kept = entries[entries["level"] <= deepest - level]
    return kept[np.argsort(kept["offset"], kind="stable")]


def _check_length(laser: _Laser) -> None:
    """Refuse a number of points that the file cannot hold."""
    header, size = laser.header, laser.header.point_format.size
    if header.are_points_compressed:
        check_ratio(laser.path.name, laser.length, header.point_count * size)
    elif header.point_count * size > laser.length - header.offset_to_point_data:
        given = max(0, laser.length - header.offset_to_point_data) // size
        raise OSError(f"{laser.path} is cut off: {given} of {header.point_count} points are there")


def _hint(entries: NDArray[Any] | None, level: int) -> str:
    """Return the hint which level of a file fits into memory."""
    left = memory_left()
    if entries is None or left is None:
        return ""
    deepest = int(entries["level"].max())
    for coarser in range(level + 1, deepest + 1):
        if int(_coarse(entries, coarser)["points"].sum(dtype=np.int64)) * PER_POINT <= left:
            return f"; --level {coarser} fits"
    return ""


def _bare_in_parts(laspy: Any, laser: _Laser) -> Iterator[Any]:
    """Yield uncompressed points, as laspy records."""
    with damage(laser.path):
        laser.file.seek(0)
        reader = laspy.LasReader(laser.file, closefd=False, read_evlrs=False)
        yield reader.read_points(min(STEP, laser.header.point_count))
    for _ in range(STEP, laser.header.point_count, STEP):
        with damage(laser.path):
            record = reader.read_points(STEP)
        yield record


def _chunks(laser: _Laser) -> NDArray[Any]:
    """Return the chunks (N,) of a LAZ file from its chunk table."""
    import lazrs

    file, start, count = laser.file, laser.header.offset_to_point_data, laser.header.point_count
    packing = laser.packing
    with damage(laser.path):
        file.seek(start)
        (table,) = struct.unpack("<q", file.read(8))
        if table == -1:  # written by a writer that could not seek
            file.seek(laser.length - 8)
            (table,) = struct.unpack("<q", file.read(8))
        file.seek(table)
        number = struct.unpack("<2I", file.read(8))[1]
        if number > laser.length // laser.header.point_format.size:  # the first of each is bare
            raise ValueError("its chunk table does not fit into it")
        file.seek(start)
        points, size = np.array(lazrs.read_chunk_table(file, lazrs.LazVlr(packing)), np.int64).T
        chunks = np.zeros(number, ENTRY)
        before = np.cumsum(points) - points
        chunks["points"] = np.clip(points, 0, np.maximum(count - before, 0))
        chunks["size"], chunks["offset"] = size, start + 8 + np.cumsum(size) - size
        if size.min() < 0 or size.sum() > table - start or before[-1] + points[-1] < count:
            raise ValueError("its chunks do not hold its points")
    return chunks


def _chunks_in_parts(laspy: Any, laser: _Laser, chunks: NDArray[Any]) -> Iterator[Any]:
    """Yield points of a LAZ file's chunks as laspy records, about `STEP` at a time."""
    packing = laser.packing
    part = (np.cumsum(chunks["points"], dtype=np.int64) - 1) // STEP
    for some in np.split(chunks, 1 + np.flatnonzero(np.diff(part))):
        yield _unpacked(laspy, laser, some, packing)


def _unpacked(laspy: Any, laser: _Laser, chunks: NDArray[Any], packing: bytes) -> Any:
    """Unpack the points of chunks of a LAZ file."""
    import lazrs

    count, size = int(chunks["points"].sum(dtype=np.int64)), laser.header.point_format.size
    check_free(laser.path.name, count * (size + UNPACKED))
    with damage(laser.path):
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
    """Refuse a chunk with layers (formats 6 to 10) larger than it; lazrs trusts them."""
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
            raise ValueError("layers of its points are missing")


def _fields(laser: _Laser, record: Any) -> tuple[Fields, Fields]:
    """Return red, green and blue if there are, and all other columns of points.

    Points marked as withheld are dropped.
    """
    kept = ~np.asarray(record["withheld"], np.bool_)
    names = [name for name in record.point_format.dimension_names if name not in LEFT_OUT]
    columns = {name: np.asarray(record[name])[kept] for name in names}
    fields = {name: column for name, column in columns.items() if column.ndim == 1}
    for axis, scale, offset in zip("xyz", laser.header.scales, laser.header.offsets, strict=True):
        fields[axis] = record[axis.upper()][kept] * np.float64(scale) + np.float64(offset)
    if "scan_angle" in fields:
        fields["scan_angle"] = fields["scan_angle"] * ANGLE
    if "red" not in record.point_format.dimension_names:
        return {}, fields
    return {name: np.asarray(record[name])[kept] for name in COLORS[0]}, fields


OWNER, WKT = "LASF_Projection", 2112
MODEL, RASTER, GEOGRAPHIC, PROJECTED, VERTICAL = 1024, 1025, 2048, 3072, 4096  # GeoTIFF keys
IS_PROJECTED, IS_GEOGRAPHIC, IS_AREA = 1, 2, 1  # values of the first two
NAME = re.compile(r'\w+\s*\[\s*"([^"]*)"')
CODE = re.compile(r'"EPSG"\s*,\s*"?(\d+)"?\s*\]\s*\]$')  # of the whole, not of a part
PARTS = {  # of WKT 1 and 2, by the key that has their code
    PROJECTED: re.compile(r"\bPROJ(?:CS|CRS|ECTEDCRS)\s*\["),
    GEOGRAPHIC: re.compile(r"\bGEO(?:GCS|GCRS|GRAPHICCRS|DCRS|DETICCRS)\s*\["),
    VERTICAL: re.compile(r"\bVERT(?:_CS|CRS|ICALCRS)\s*\["),
}


class CoordinateSystem(NamedTuple):
    """Coordinate system of a file."""

    name: str  # for people
    is_geographic: bool  # x and y are degrees
    tags: Directory  # of a GeoTIFF; empty if it has no code of EPSG


def coordinate_system_of(path: Path) -> CoordinateSystem | None:
    """Read the coordinate system of a LAS or LAZ file; None if it says nothing."""
    held = records_of(path, OWNER)
    if WKT in held:
        return _of_wkt(held[WKT].decode("utf-8", "replace").strip("\0 "))
    shorts = np.frombuffer(held.get(KEYS, b"")[: len(held.get(KEYS, b"")) // 8 * 8], "<u2")
    entries = shorts.reshape(-1, 4)[1:]
    known = dict(entries[:, [0, 3]].tolist())
    code = next((known[key] for key in (PROJECTED, GEOGRAPHIC) if key in known), None)
    if code is None:
        return None
    rest = [entry for entry in entries.tolist() if entry[0] != RASTER]
    tags: dict[int, Tag | Directory] = {KEYS: _keys(rest)}
    numbers, words = held.get(NUMBERS, b""), held.get(WORDS, b"")
    if len(numbers) >= 8:
        tags[NUMBERS] = Tag(DOUBLE, np.frombuffer(numbers[: len(numbers) // 8 * 8], "<f8"))
    if words:
        tags[WORDS] = Tag(ASCII, np.frombuffer(words, np.uint8))
    return CoordinateSystem(f"EPSG:{code}", PROJECTED not in known, tags)


def _of_wkt(text: str) -> CoordinateSystem:
    """Read a system's name and the codes of its horizontal and vertical parts."""
    name, code = NAME.match(text), CODE.search(text)
    told = f"{name[1] if name else text:.80}" + (f" (EPSG:{code[1]})" if code else "")
    found = {
        key: _code_of(text, begin.start())
        for key, part in PARTS.items()
        if (begin := part.search(text))
    }
    is_projected = PROJECTED in found
    code_of_place = found.get(PROJECTED if is_projected else GEOGRAPHIC)
    if code_of_place is None:
        return CoordinateSystem(told, not is_projected, {})
    kept = {MODEL: IS_PROJECTED if is_projected else IS_GEOGRAPHIC}
    kept[PROJECTED if is_projected else GEOGRAPHIC] = code_of_place
    if found.get(VERTICAL) is not None:
        kept[VERTICAL] = found[VERTICAL] or 0
    tags = {KEYS: _keys([[key, 0, 1, value] for key, value in kept.items()])}
    return CoordinateSystem(told, not is_projected, tags)


def _code_of(text: str, begin: int) -> int | None:
    """Return EPSG's code of the part of a WKT that begins at a place."""
    depth = 0
    for place in range(begin, len(text)):
        depth += (text[place] == "[") - (text[place] == "]")
        if depth == 0 and text[place] == "]":
            code = CODE.search(text, begin, place + 1)
            return int(code[1]) if code and int(code[1]) < 1 << 16 else None
    return None


def _keys(entries: list[list[int]]) -> Tag:
    """Return GeoTIFF's directory of keys, with the one that says that values are of areas."""
    whole = sorted([*entries, [RASTER, 0, 1, IS_AREA]])
    return Tag(SHORT, np.array([[1, 1, 0, len(whole)], *whole], np.uint16).ravel())
