"""Boxes of MP4 that tell players about two eyes and about pictures of directions.

`st3d` says how the pictures of both eyes lie in a frame, `sv3d` which directions it shows
("Spherical Video V2 RFC", Google). FFmpeg's muxer writes them from side data that PyAV cannot set,
so they are added to finished files.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

MODES = {"top-bottom": 1, "left-right": 2}  # of st3d
QUARTER = 0x40000000  # of a panorama, beside the half ahead at each side: as 0.32 fixed point
# Boxes that contain others, and the bytes before these.
HEADS = {b"moov": 0, b"trak": 0, b"mdia": 0, b"minf": 0, b"stbl": 0, b"stsd": 8}
OFFSETS = {b"stco": ">I", b"co64": ">Q"}  # tables of places in the file
CODERS = (b"avc1", b"hvc1", b"hev1", b"av01")


class StereoMarks(NamedTuple):
    """What a player has to know of a film for two eyes."""

    mode: str | None = None  # of `MODES`; None: no layout that players show to both eyes
    around: str | None = None  # "360" or "180"; None: flat pictures
    name: str = ""  # of the layout in the names of files that players read
    matroska: str | None = None  # FFmpeg's name of Matroska's StereoMode
    packing: int | None = None  # of H.264's SEI, for squeezed pictures

    def boxes(self) -> bytes:
        """Return the boxes of a sample entry."""
        made = b""
        if self.mode is not None:
            made += _box(b"st3d", struct.pack(">IB", 0, MODES[self.mode]))
        if self.around is not None:
            side = QUARTER if self.around == "180" else 0
            head = _box(b"svhd", struct.pack(">I", 0) + b"hybrid-resample\0")
            pose = _box(b"prhd", struct.pack(">Iiii", 0, 0, 0, 0))
            shown = _box(b"equi", struct.pack(">IIIII", 0, 0, 0, side, side))
            made += _box(b"sv3d", head + _box(b"proj", pose + shown))
        return made


UNMARKED = StereoMarks()


def mark_stereo(path: Path, marks: StereoMarks) -> None:
    """Add the boxes of two eyes to the video of an MP4 file, which begins with its tables.

    Raises ValueError: the file's tables do not lie before its pictures.
    """
    added = marks.boxes()
    with path.open("r+b") as file:
        found = [box for box in _boxes_in(file.read(1 << 16), 0) if box[0] == b"moov"]
        if not found:
            raise ValueError(f"{path}: the tables of an MP4 file lie before its pictures")
        _, place, size = found[0]
        file.seek(place)
        moov, end, last = file.read(size), place + size, path.stat().st_size
        growth = len(_marked(moov, added, 0)) - size
        # Everything behind the tables moves by their growth, from the end on.
        while last > end:
            first = max(end, last - (1 << 24))
            file.seek(first)
            part = file.read(last - first)
            file.seek(first + growth)
            file.write(part)
            last = first
        file.seek(place)
        file.write(_marked(moov, added, growth))


def _box(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", 8 + len(body)) + kind + body


def _boxes_in(data: bytes, start: int) -> Iterator[tuple[bytes, int, int]]:
    """Kind, place and size of the boxes from a place on."""
    while start + 8 <= len(data):
        size = int.from_bytes(data[start : start + 4], "big")
        if size == 1:
            size = int.from_bytes(data[start + 8 : start + 16], "big")
        yield data[start + 4 : start + 8], start, size
        start += max(size, 8)


def _marked(box: bytes, added: bytes, growth: int) -> bytes:
    """Return a box with boxes added to its video's sample entry, and places moved by a growth."""
    kind, body = box[4:8], box[8:]
    if kind in HEADS:
        head = HEADS[kind]
        parts = (body[at : at + size] for _, at, size in _boxes_in(body, head))
        return _box(kind, body[:head] + b"".join(_marked(each, added, growth) for each in parts))
    if kind in OFFSETS:
        places = (at + growth for (at,) in struct.iter_unpack(OFFSETS[kind], body[8:]))
        return _box(kind, body[:8] + b"".join(struct.pack(OFFSETS[kind], at) for at in places))
    return _box(kind, body + added) if kind in CODERS else box
