"""Read LAS, LAZ and COPC laser scans through laspy with lazrs (the extra `las`).

Positions are integers times a scale plus an offset, as in the American Society for Photogrammetry
and Remote Sensing's LAS 1.4; they are computed in float64. COPC 1.0 is LAZ with points stored
in an octree: each level adds points between the previous levels' points. LAS 1.4 takes coordinate
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


def read_las(path: Path, level: int = 0, columns: Sequence[str] | None = None) -> Cloud:
    """Read the cloud of a LAS, LAZ or COPC file; columns: names of the ones to keep, None for all.

    Colors are sRGB in 16 bits, or in 8 if none is above 255. If there are none, or all are black,
    points are gray by their intensity, with the 98 % quantile white, or else get a color per
    class.
    """
    with _opened(path) as (laspy, file, header):
        length, size, count = path.stat().st_size, header.point_format.size, header.point_count
        is_packed = header.are_points_compressed
        is_copc = any(type(part).__name__ == "CopcInfoVlr" for part in header.vlrs)
        entries = _entries(path, file, header) if level or is_copc else None
        if not level and is_packed:
            check_ratio(path.name, length, count * size)
        elif not level and count * size > length - header.offset_to_point_data:
            given = max(0, length - header.offset_to_point_data) // size
            raise OSError(f"{path} is cut off: {given} of {count} points are there")
        if entries is None and not (is_packed and count):
            records = _bare_in_parts(path, laspy, file, count)
        else:
            chunks = _chunks(path, file, header) if entries is None else _coarse(entries, level)
            count = int(chunks["points"].sum(dtype=np.int64))
            check_ratio(path.name, length, count * size)
            records = _unpacked(path, laspy, file, header, chunks)
        gathering, read = CloudBuilder(storage_for(count, path.name, _hint(entries, level))), 0
        for record in records:
            with damage(path):
                levels, fields = _fields(header, record)
            part = cloud_of(fields)
            kept = kept_columns(part, columns)
            shown = {name: part.columns[name] for name in SCANNED if name in part.columns}
            gathering.add(kept._replace(columns={**kept.columns, **shown, **levels}))
            read += len(record)
            report(read, count)
        cloud = colored_as_scanned(gathering.cloud())
        return cloud if columns is None else kept_columns(cloud, columns)


def records_of(path: Path, owner: str) -> dict[int, bytes]:
    """Return the variable length records of an owner in a file's header, by their number."""
    with _opened(path, read_evlrs=True) as (_, _, header), damage(path):
        records = (each for each in (*header.vlrs, *(header.evlrs or ())) if each.user_id == owner)
        return {each.record_id: each.record_data_bytes() for each in records}


@contextmanager
def _opened(path: Path, **options: Any) -> Iterator[tuple[Any, BinaryIO, Any]]:
    """Open a file; return laspy, the file and its header. laspy's errors are raised, not logged.

    A header with more records than the file holds is rejected, as laspy would read them all.
    """
    try:
        import laspy
        import lazrs  # noqa: F401
    except ImportError as error:
        raise lacking(path.name, "laspy", error, "las") from None
    logger = logging.getLogger("laspy")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        with path.open("rb") as file:
            with damage(path):
                head = file.read(HEAD.size)
                file.seek(0)
                if len(head) < HEAD.size:
                    raise ValueError("it is cut off")
                mark, size, points, parts = HEAD.unpack(head)
                if mark != b"LASF":
                    raise ValueError("it does not begin with LASF")
                if not size <= points <= path.stat().st_size or parts * PART > points - size:
                    raise ValueError("its header does not fit into it")
                header = laspy.LasHeader.read_from(file, **options)
            yield laspy, file, header
    finally:
        logger.setLevel(before)


def _entries(path: Path, file: BinaryIO, header: Any) -> NDArray[Any]:
    """Return the entries (N,) of all chunks of a COPC file."""
    info = next((each for each in header.vlrs if type(each).__name__ == "CopcInfoVlr"), None)
    if info is None:
        raise ValueError("has no levels, as only COPC files do; leave out the level")
    pages = [(int(info.hierarchy_root_offset), int(info.hierarchy_root_size))]
    found, read, length = [], 0, path.stat().st_size
    with damage(path):
        while pages:
            start, size = pages.pop()
            read += size
            if size < 0 or start + size > length or read > length:
                raise ValueError("a page of its levels is missing")
            file.seek(start)
            page = np.frombuffer(file.read(size // ENTRY.itemsize * ENTRY.itemsize), ENTRY)
            inner = page[page["points"] == PAGE]
            pages += zip(inner["offset"].tolist(), inner["size"].tolist(), strict=True)
            found.append(page[page["points"] > 0])
        chunks = np.concatenate(found)
        is_bad = (chunks["size"] < 0) | (chunks["level"] < 0) | (chunks["offset"] > length)
        if not len(chunks) or is_bad.any() or chunks["size"].sum(dtype=np.int64) > length:
            raise ValueError("its levels are missing")
    return chunks


def _coarse(entries: NDArray[Any], level: int) -> NDArray[Any]:
    """Drop the chunks of the finest levels; return the rest in the order of the file."""
    deepest = int(entries["level"].max())
    if not 0 <= level <= deepest:
        raise ValueError(f"has levels 0 to {deepest}, but no level {level}")
    kept = entries[entries["level"] <= deepest - level]
    return kept[np.argsort(kept["offset"], kind="stable")]


def _hint(entries: NDArray[Any] | None, level: int) -> str:
    """Return a hint for a level of a file that fits into memory."""
    left = memory_left()
    if entries is None or left is None:
        return ""
    deepest = int(entries["level"].max())
    for coarser in range(level + 1, deepest + 1):
        if int(_coarse(entries, coarser)["points"].sum(dtype=np.int64)) * PER_POINT <= left:
            return f"; --level {coarser} fits"
    return ""


def _bare_in_parts(path: Path, laspy: Any, file: BinaryIO, count: int) -> Iterator[Any]:
    """Yield uncompressed points, as laspy records."""
    with damage(path):
        file.seek(0)
        reader = laspy.LasReader(file, closefd=False, read_evlrs=False)
        yield reader.read_points(min(STEP, count))
    for _ in range(STEP, count, STEP):
        with damage(path):
            record = reader.read_points(STEP)
        yield record


def _packing(path: Path, header: Any) -> bytes:
    """Return the compression record of a LAZ file."""
    import lazrs

    with damage(path):
        packing = bytes(header.vlrs[header.vlrs.index("LasZipVlr")].record_data)
        size = lazrs.LazVlr(packing).item_size()
        if size != header.point_format.size:
            raise ValueError(f"its points have {size} bytes when unpacked, not as its header says")
    return packing


def _chunks(path: Path, file: BinaryIO, header: Any) -> NDArray[Any]:
    """Return the chunks (N,) of a LAZ file from its chunk table."""
    import lazrs

    start, count, length = header.offset_to_point_data, header.point_count, path.stat().st_size
    packing = _packing(path, header)
    with damage(path):
        file.seek(start)
        (table,) = struct.unpack("<q", file.read(8))
        if table == -1:  # written by a writer that could not seek
            file.seek(length - 8)
            (table,) = struct.unpack("<q", file.read(8))
        file.seek(table)
        number = struct.unpack("<2I", file.read(8))[1]
        if number > length // header.point_format.size:  # the first point of each is bare
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


def _unpacked(
    path: Path, laspy: Any, file: BinaryIO, header: Any, chunks: NDArray[Any]
) -> Iterator[Any]:
    """Yield points of a LAZ file's chunks as laspy records, about `STEP` at a time."""
    import lazrs

    packing, size = _packing(path, header), header.point_format.size
    # Layers of points (formats 6 to 10); lazrs trusts their sizes.
    items = np.frombuffer(packing[ITEMS:], "<u2")[: 3 * packing[ITEMS - 2]].reshape(-1, 3).tolist()
    layers = sum(width if kind == BYTES else LAYERS.get(kind, 0) for kind, width, _ in items)
    first = size + 4 + 4 * layers
    part = (np.cumsum(chunks["points"], dtype=np.int64) - 1) // STEP
    for some in np.split(chunks, 1 + np.flatnonzero(np.diff(part))):
        count = int(some["points"].sum(dtype=np.int64))
        check_free(path.name, count * (size + UNPACKED))
        with damage(path):
            packed = bytearray()
            for offset, length in zip(some["offset"].tolist(), some["size"].tolist(), strict=True):
                file.seek(offset)
                chunk = file.read(length)
                if len(chunk) < max(length, size):
                    raise ValueError("it is cut off")
                if layers:
                    sizes = np.frombuffer(chunk[size + 4 : first], "<u4")
                    if len(sizes) < layers or first + sizes.sum(dtype=np.int64) > len(chunk):
                        raise ValueError("layers of its points are missing")
                packed += chunk
            points = np.zeros(count * size, np.uint8)
            table = list(zip(some["points"].tolist(), some["size"].tolist(), strict=True))
            lazrs.decompress_points_with_chunk_table(packed, packing, points, table)
            record = laspy.PackedPointRecord.from_buffer(points, header.point_format)
        yield record


def _fields(header: Any, record: Any) -> tuple[Fields, Fields]:
    """Return red, green and blue, if any, and all other columns, without withheld points."""
    kept = ~np.asarray(record["withheld"], np.bool_)
    known = tuple(record.point_format.dimension_names)
    columns = {name: np.asarray(record[name])[kept] for name in known if name not in LEFT_OUT}
    fields = {name: column for name, column in columns.items() if column.ndim == 1}
    for axis, scale, offset in zip("xyz", header.scales, header.offsets, strict=True):
        fields[axis] = record[axis.upper()][kept] * np.float64(scale) + np.float64(offset)
    if "scan_angle" in fields:
        fields["scan_angle"] = fields["scan_angle"] * ANGLE
    levels = COLORS[0] if "red" in known else ()
    return {name: np.asarray(record[name])[kept] for name in levels}, fields


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
    """Read the coordinate system of a LAS or LAZ file; None if not stated."""
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
    """Return GeoTIFF's directory of keys, with the key for pixels as areas."""
    whole = sorted([*entries, [RASTER, 0, 1, IS_AREA]])
    return Tag(SHORT, np.array([[1, 1, 0, len(whole)], *whole], np.uint16).ravel())
