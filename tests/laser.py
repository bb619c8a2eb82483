"""Small files of laser scanners: LAS and LAZ as laspy writes them, and COPC, which it reads."""

import io
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

CENTER, HALF = (435_000.0, 5_120_000.0, 250.0), 64.0  # of the octree of COPC files
SCALE = 0.001


def las_of(
    columns: Mapping[str, Any],
    *,
    point_format: int = 3,
    version: str = "1.2",
    packed: bool = False,
    offsets: Sequence[float] = CENTER,
) -> bytes:
    """LAS or LAZ file of columns x, y, z and laspy's names."""
    import laspy

    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [SCALE] * 3, list(offsets)
    points = laspy.LasData(header)
    for name in ("x", "y", "z", *columns):
        setattr(points, name, np.asarray(columns[name]))
    file = io.BytesIO()
    points.write(file, do_compress=packed)
    return file.getvalue()


def copc_of(levels: Sequence[Mapping[str, Any]], *, pages: int = 1) -> bytes:
    """COPC file with one chunk per level, in the first octant; of several pages, a level each."""
    import laspy
    import lazrs

    plain = [las_of(columns, point_format=7, version="1.4") for columns in levels]
    heads = [laspy.LasHeader.read_from(io.BytesIO(data)) for data in plain]
    size, count = heads[0].point_format.size, sum(head.point_count for head in heads)
    packing = lazrs.LazVlr.new_for_compression(7, 0, True)
    first = 375 + 54 + 160 + 54 + len(packing.record_data())
    file = io.BytesIO(bytes(first))
    file.seek(first)
    compressor = lazrs.LasZipCompressor(file, packing)
    chunks = []
    compressor.reserve_offset_to_chunk_table()
    for data, head in zip(plain, heads, strict=True):
        start, points = file.tell(), data[head.offset_to_point_data :][: head.point_count * size]
        compressor.compress_many(np.frombuffer(points, np.uint8))
        compressor.finish_current_chunk()
        chunks.append((start, file.tell() - start, head.point_count))
    compressor.done()
    root, root_size, pages_data = _pages(chunks, file.tell() + 60, pages)
    end = file.tell()
    file.write(b"\0\0" + b"copc".ljust(16, b"\0") + struct.pack("<HQ", 1000, len(pages_data)))
    file.write(bytes(32) + pages_data)
    head = bytearray(plain[0][:375])
    struct.pack_into("<H", head, 94, 375)
    struct.pack_into("<IIB", head, 96, first, 2, 7 | 128)
    struct.pack_into("<QIQ", head, 235, end, 1, count)
    spot = struct.pack("<5d2Q2d88x", *CENTER, HALF, HALF / 64, root, root_size, 0.0, 0.0)
    file.seek(0)
    file.write(bytes(head) + _record("copc", 1, spot))
    file.write(_record("laszip encoded", 22204, bytes(packing.record_data())))
    return file.getvalue()


def _pages(
    chunks: Sequence[tuple[int, int, int]], start: int, pages: int
) -> tuple[int, int, bytes]:
    """Place and size of the root page of a hierarchy that begins at a place, and all its pages."""
    entries = [struct.pack("<4iQ2i", level, 0, 0, 0, *chunk) for level, chunk in enumerate(chunks)]
    if pages == 1:
        return start, 32 * len(entries), b"".join(entries)
    inner = b"".join(entries[1:])
    link = struct.pack("<4iQ2i", 1, 0, 0, 0, start, len(inner), -1)
    return start + len(inner), 64, inner + entries[0] + link


def _record(owner: str, number: int, data: bytes) -> bytes:
    """A variable length record."""
    return (
        b"\0\0"
        + owner.encode().ljust(16, b"\0")
        + struct.pack("<HH", number, len(data))
        + (bytes(32) + data)
    )
