"""Metadata of picture files: Exif, color profile, georeference, orientation.

Exif blocks are copied tag by tag, since OpenImageIO drops tags that it does not know. Tags that a
warp invalidates are removed: thumbnails, sizes, and areas in pixels.
"""

import json
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.metadata.colors import assumed_of, colors_of, marks_of
from resample.files.metadata.tags import (
    LONG,
    PNG_START,
    SHORT,
    TAGS,
    Directory,
    Geo,
    Tag,
    add_tags,
    block_of,
    block_tags,
    chunks,
    geo_of,
    put_into_png,
    read_tags,
    tags_of,
    text,
    text_tag,
)
from resample.reading.pictures import exif_block, is_avif
from resample.types import Doubles

JPEG, TIFF, PNG = (".jpg", ".jpeg"), (".tif", ".tiff"), (".png",)
REDUCED, SUBFILE, ORIENTATION, DESCRIPTION = 1, 254, 274, 270
# Description, maker, model, software, date, artist, computer, rating, copyright.
CAMERA = (DESCRIPTION, 271, 272, 305, 306, 315, 316, 18246, 18249, 33432)
EXIF, GPS = 34665, 34853
NESTED = {EXIF: None, GPS: None}
WIDTH, HEIGHT, MAKERS_NOTES = 0xA002, 0xA003, 0x927C
UNTRUE = (WIDTH, HEIGHT, 0xA005, 0x9214, 0xA214)  # after a warp; 0xA005 points to a directory
SAMPLE_FORMAT = 339
AS_FLOATS = ("int32", "uint32")  # types that OpenImageIO cannot write, except as the bits of floats
PROFILE_SPACES = {b"GRAY": 1, b"RGB ": 3}  # number of color channels of a profile
MARKS = (*range(0xE0, 0xF0), 0xFE)  # of JPEG segments without pixels
LONGEST_SEGMENT = 65_533 - 6  # bytes of Exif in a JPEG
TURNS = {  # rows and columns exchanged, then rows reversed, then columns
    1: (False, False, False), 2: (False, False, True), 3: (False, True, True),
    4: (False, True, False), 5: (True, False, False), 6: (True, False, True),
    7: (True, True, True), 8: (True, True, False),
}  # fmt: skip
# OpenImageIO's names, for EXR.
SPOKEN = (
    *("Make", "Model", "DateTime", "Artist", "Copyright", "ImageDescription", "ExposureTime"),
    *("FNumber", "chromaticities"),
)


class FileMetadata(NamedTuple):
    """Metadata of a file other than pixels and channels."""

    camera: Directory = MappingProxyType({})  # Exif tags
    profile: bytes = b""  # ICC profile of the encoded values
    colors: str = ""  # what the file says of its colors, in words; empty for sRGB, or if nothing
    marks: bytes = b""  # PNG's chunks that say so
    assumed: str = ""  # assumption about colors where the file says nothing
    geo: Geo | None = None
    spoken: tuple[tuple[str, Any, Any], ...] = ()  # name, type and value in OpenImageIO
    number: str = ""  # integer type of numbers as stored; empty for light or floats
    says_linear: bool = False  # integers are linear light, by the file's own words


def page_tags(path: Path) -> list[Directory]:
    """Selected tags of all pages of a TIFF file; none for other files."""
    wanted = (*TAGS, *CAMERA, SUBFILE, ORIENTATION)
    return list(read_tags(path, wanted, NESTED))


def about_file(path: Path, spec: Any, tags: Directory) -> FileMetadata:
    """Read a file's metadata; `tags` belong to its page, for a TIFF file."""
    camera = tags or block_tags(_exif_block(path), CAMERA, NESTED)
    profile = spec.getattribute("ICCProfile")
    spoken = []
    for entry in spec.extra_attribs:
        if entry.name in SPOKEN or entry.name.startswith(("Exif:", "GPS:")):
            value = entry.value
            if isinstance(value, str) and not value.isascii():
                stored = value.encode("utf-8", "surrogateescape")
                try:
                    value = stored.decode("utf-8")
                except UnicodeDecodeError:  # Latin-1, such as © of old cameras
                    value = stored.decode("latin-1")
            spoken.append((entry.name, entry.type, value))
    colors = colors_of(path, spec)
    # Camera tags that remain valid after a warp.
    found: dict[int, Tag | Directory] = {
        tag: value for tag, value in camera.items() if tag in (*CAMERA, EXIF, GPS)
    }
    if "<OME" in text(found.get(DESCRIPTION)):  # lists the sizes of all pages
        del found[DESCRIPTION]
    inner = found.get(EXIF)
    if isinstance(inner, Mapping):
        found[EXIF] = {tag: value for tag, value in inner.items() if tag not in UNTRUE}
    return FileMetadata(
        found,
        b"" if profile is None else np.asarray(profile, np.uint8).tobytes(),
        colors,
        marks_of(path) if colors else b"",
        assumed_of(path, spec),
        geo=geo_of(tags),
        spoken=tuple(spoken),
    )


def orientation_of(path: Path, spec: Any) -> int:
    """Exif's number of a picture's orientation, which PNG may have behind the pixels."""
    told = int(spec.get_int_attribute("Orientation", 0))
    if not told:
        tag = block_tags(_exif_block(path), (ORIENTATION,), {}).get(ORIENTATION)
        told = int(tag.values[0]) if isinstance(tag, Tag) else 1
    return told if told in TURNS else 1


def upright(data: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Rotate a picture (H, W, ...) by its orientation tag."""
    is_crossed, rows, columns = TURNS.get(orientation, TURNS[1])
    data = data.swapaxes(0, 1) if is_crossed else data
    return data[:: -1 if rows else 1, :: -1 if columns else 1]


def turn(orientation: int, shape: tuple[int, int]) -> Doubles:
    """Matrix (3, 3) of `upright` for a picture (height, width), px from the corners."""
    is_crossed, rows, columns = TURNS.get(orientation, TURNS[1])
    height, width = shape[::-1] if is_crossed else shape
    crossing = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]]) if is_crossed else np.eye(3)
    x, y = (-1 if columns else 1), (-1 if rows else 1)
    flips = np.array([[x, 0, width * columns], [0, y, height * rows], [0, 0, 1]], np.float64)
    return np.asarray(flips @ crossing, np.float64)


def describe(spec: Any, about: FileMetadata, suffix: str) -> None:
    """Set metadata that OpenImageIO can write."""
    if suffix == ".exr" or not about.camera:
        shape = spec.height, spec.width, spec.nchannels
        for name, kind, told in about.spoken:
            value = described(told, shape) if name == "ImageDescription" else told
            if name not in ("Exif:ColorSpace", "Exif:PixelXDimension", "Exif:PixelYDimension"):
                spec.attribute(name, kind, value)
    if about.profile:
        values = np.frombuffer(about.profile, np.uint8)
        spec.attribute("ICCProfile", f"uint8[{values.size}]", values)


class WrittenPage(NamedTuple):
    """A page to write."""

    about: FileMetadata
    shape: tuple[int, ...]  # height, width and channels
    form: str  # type of its values


def complete(path: Path, pages: list[WrittenPage]) -> None:
    """Add metadata that OpenImageIO cannot write: Exif and, for TIFF, the georeference."""
    suffix = path.suffix.lower()
    if suffix in TIFF:
        additions = []
        for about, shape, form in pages:
            own = {**_sized(about.camera, shape), **(tags_of(about.geo) if about.geo else {})}
            if form in AS_FLOATS:
                kind = 1 if form == "uint32" else 2
                own[SAMPLE_FORMAT] = Tag(SHORT, np.full(shape[2], kind, np.uint16))
            additions.append(own)
        if any(additions):
            add_tags(path, additions)
        return
    about, shape, _ = pages[0]
    tags = _upright_tags(about, shape)
    if suffix in PNG and (about.camera or about.profile or about.marks):
        put_into_png(path, block_of(tags) if about.camera else b"", about.marks)
    elif suffix in JPEG and about.camera:
        block, inner = block_of(tags), tags.get(EXIF)
        if len(block) > LONGEST_SEGMENT:  # maker notes are long
            shorter: Directory = {}
            if isinstance(inner, Mapping):
                kept = {tag: inner[tag] for tag in inner if tag != MAKERS_NOTES}
                shorter = {**tags, EXIF: kept}
            block = block_of(shorter)
        # Replace or insert the Exif segment of a JPEG file.
        data = path.read_bytes()
        place, before, after = 2, b"", b""
        while data[place + 1] in MARKS:
            size = 2 + int(struct.unpack(">H", data[place + 2 : place + 4])[0])
            segment = data[place : place + size]
            if segment[1] == 0xE0:
                before += segment
            elif segment[4:10] != b"Exif\0\0":
                after += segment
            place += size
        exif = b"\xff\xe1" + struct.pack(">H", len(block) + 8) + b"Exif\0\0" + block
        path.write_bytes(data[:2] + before + exif + after + data[place:])


def exif_of(about: FileMetadata, shape: tuple[int, ...]) -> bytes:
    """Exif block of a picture (height, width, channels); empty if its source has none."""
    return block_of(_upright_tags(about, shape)) if about.camera else b""


def _upright_tags(about: FileMetadata, shape: tuple[int, ...]) -> Directory:
    return {**_sized(about.camera, shape), ORIENTATION: Tag(SHORT, np.array([1], np.uint16))}


def _sized(tags: Directory, shape: tuple[int, ...]) -> Directory:
    """Tags with the size of a picture (height, width, ...), without other sizes."""
    words = text(tags.get(DESCRIPTION))
    true = described(words, shape)
    if true != words:
        others = {tag: value for tag, value in tags.items() if tag != DESCRIPTION}
        tags = {**others, DESCRIPTION: text_tag(true)} if true else others
    inner = tags.get(EXIF)
    if not isinstance(inner, Mapping):
        return tags
    height, width = (Tag(LONG, np.array([side], np.uint32)) for side in shape[:2])
    return {**tags, EXIF: {**inner, WIDTH: width, HEIGHT: height}}


def described(words: str, shape: tuple[int, ...]) -> str:
    """Description without the shape of another picture, as tifffile's JSON has it."""
    if not words.startswith("{"):
        return words
    try:
        told = json.loads(words)
    except ValueError:
        return words
    if told.get("shape", list(shape)) in (list(shape), list(shape[:2])):
        return words
    del told["shape"]
    return json.dumps(told) if told else ""


def _exif_block(path: Path) -> bytes:
    """Exif block of a JPEG, PNG, WebP or AVIF file; empty if missing or damaged."""
    with path.open("rb") as file:
        start = file.read(12)
        blocks: Iterator[bytes]
        try:
            if start[:2] == b"\xff\xd8":
                blocks = (block for block in _segments(file) if block[:6] == b"Exif\0\0")
            elif start[:8] == PNG_START:
                blocks = chunks(file, 8, b"eXIf", ">I4s", 4)
            elif start[:4] == b"RIFF" and start[8:] == b"WEBP":
                blocks = chunks(file, 12, b"EXIF", "<4sI", 0)
            elif is_avif(path):
                blocks = iter([exif_block(path)])
            else:
                return b""
            block = next(blocks, b"")
        except struct.error:
            return b""
    return block.removeprefix(b"Exif\0\0")


def _segments(file: BinaryIO) -> Iterator[bytes]:
    """Contents of a JPEG file's segments up to its pixels."""
    file.seek(2)
    while True:
        lead, marker, size = struct.unpack(">BBH", file.read(4))
        if lead != 0xFF or marker == 0xDA or size < 2:
            return
        yield file.read(size - 2)
