"""Tags of TIFF files and of Exif blocks, which share a format, and chunks of PNG and WebP.

OpenImageIO hides unknown tags, such as georeferences. Pillow cannot add tags to a finished file,
writes Exif blocks with other types (maker's notes as bytes, floats as doubles), and reads on where
directories are damaged. So this module reads them itself, and appends new ones to finished files.
"""

import re
import struct
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from io import BytesIO
from pathlib import Path
from shutil import copyfileobj
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.reading.pictures import opened
from resample.types import Doubles

KEY = "resample:settings"  # key of the text in PNG and EXR
SUFFIXES = (".png", ".exr")  # files that can store it

_settings: ContextVar[str] = ContextVar("settings", default="")


@contextmanager
def stating(settings: str) -> Iterator[None]:
    """Store these settings, as TOML, in pictures written in this block."""
    # Texts of PNG are ASCII.
    token = _settings.set("".join(c if ord(c) < 128 else f"\\U{ord(c):08x}" for c in settings))
    try:
        yield
    finally:
        _settings.reset(token)


def state(spec: Any, path: Path) -> None:
    """Add the settings, if any, to an OpenImageIO header if the format can store them."""
    text = _settings.get()
    if text and path.suffix.lower() in SUFFIXES:
        spec.attribute(KEY, text)


def stated() -> dict[str, str]:
    """Texts to store in a PNG file: the settings, if any."""
    text = _settings.get()
    return {KEY: text} if text else {}


def settings_in(path: Path) -> str:
    """Read the settings, as TOML, that a picture was made with."""
    source = opened(path)
    text = str(source.spec().get_string_attribute(KEY))
    source.close()
    if not text:
        raise ValueError(
            f"{path} holds no settings; give a PNG or EXR that these commands have written, or a "
            ".toml file"
        )
    return text


ASCII, SHORT, LONG, DOUBLE = 2, 3, 4, 12
# Value types by number; fractions are two integers.
TYPES = {
    1: "u1", 2: "u1", 3: "u2", 4: "u4", 5: "u4", 6: "i1", 7: "u1", 8: "i2", 9: "i4", 10: "i4",
    11: "f4", 12: "f8", 13: "u4", 16: "u8", 17: "i8", 18: "u8",
}  # fmt: skip
FRACTIONS = (5, 10)
MOST_DIRECTORIES = 65536  # a file with more has pointers in a loop
PER_BYTE, BESIDE = 4, 1 << 20  # bytes of directories to read, relative to the file's size
LARGEST_VALUE = 1 << 26  # bytes of one tag
PNG_START = b"\x89PNG\r\n\x1a\n"


class Tag(NamedTuple):
    """Type and values of a tag."""

    kind: int  # of `TYPES`
    values: NDArray[Any]  # flat; text as zero-terminated bytes


Directory = Mapping[int, "Tag | Directory"]


class _Layout(NamedTuple):
    """Formats of a file's parts, in the letters of `struct`."""

    order: str  # of bytes
    entry: str  # tag, type, count, and values or their offset
    offset: str
    length: str  # of a directory
    pointer: int  # position of the first directory's offset


LAYOUTS = {  # by the first bytes of TIFF and BigTIFF
    **{start: _Layout(o, f"{o}HHI4s", f"{o}I", f"{o}H", 4)
       for start, o in ((b"II*\0", "<"), (b"MM\0*", ">"))},
    **{start: _Layout(o, f"{o}HHQ8s", f"{o}Q", f"{o}Q", 8)
       for start, o in ((b"II+\0", "<"), (b"MM\0+", ">"))},
}  # fmt: skip


class _Entry(NamedTuple):
    """One stored entry of a directory."""

    tag: int
    kind: int
    size: int  # number of values
    field: bytes  # the values, or their offset


class _Counted(BytesIO):
    """File with a budget for reads: directories may overlap or form loops."""

    def __init__(self, file: BinaryIO) -> None:
        super().__init__()
        self._file = file
        self._left = PER_BYTE * file.seek(0, 2) + BESIDE

    def seek(self, place: int, whence: int = 0) -> int:
        """Move to a position."""
        return self._file.seek(place, whence)

    def read(self, size: int | None = -1) -> bytes:
        """Read bytes from the current position."""
        found = self._file.read(-1 if size is None else size)
        self._left -= len(found)
        if self._left < 0:
            raise ValueError("directories overlap or form a loop")
        return found


def text(tag: "Tag | Directory | None") -> str:
    """Text of a tag; empty if there is none."""
    if not isinstance(tag, Tag):
        return ""
    return tag.values.astype(np.uint8).tobytes().partition(b"\0")[0].decode("latin-1").strip()


def text_tag(words: str) -> Tag:
    """Tag with a text."""
    return Tag(ASCII, np.frombuffer(words.encode("latin-1", "replace") + b"\0", np.uint8))


def read_tags(
    path: str | Path, wanted: Collection[int], nested: Mapping[int, Collection[int] | None]
) -> list[dict[int, "Tag | Directory"]]:
    """Read wanted tags of every directory of a TIFF file; none for other files.

    `nested`: tags that point to directories, and which of their tags to read; None: all.
    """
    with Path(path).open("rb") as file:
        try:
            return _directories(_Counted(file), wanted, nested)
        except (struct.error, ValueError) as error:
            raise OSError(f"{path}: its tags are damaged: {error}") from None


def block_tags(
    block: bytes, wanted: Collection[int], nested: Mapping[int, Collection[int] | None]
) -> dict[int, "Tag | Directory"]:
    """Read wanted tags of an Exif block, see `read_tags`; none if it is damaged."""
    try:
        found = _directories(_Counted(BytesIO(block)), wanted, nested, 1)
    except (struct.error, ValueError):
        return {}
    return found[0] if found else {}


def block_of(directory: Directory) -> bytes:
    """Exif block of a directory."""
    file, layout = BytesIO(), LAYOUTS[b"II*\0"]
    file.write(b"II*\0" + bytes(4))
    place = _append(file, layout, [], directory, 0)
    file.seek(layout.pointer)
    file.write(struct.pack(layout.offset, place))
    return file.getvalue()


def add_tags(path: Path, additions: Sequence[Directory]) -> None:
    """Add or replace tags in the directories of a TIFF file; nested mappings become directories."""
    with path.open("r+b") as file:
        layout = LAYOUTS.get(file.read(4))
        if layout is None:
            raise OSError(f"{path} is not a TIFF file")
        pointer = layout.pointer
        try:
            for directory in additions:
                place = _number(file, pointer, layout.offset)
                entries, after = _entries(file, layout, place)
                if directory:
                    following = _number(file, after, layout.offset)
                    place = _append(file, layout, entries, directory, following)
                    file.seek(pointer)
                    file.write(struct.pack(layout.offset, place))
                    after = _entries(file, layout, place)[1]
                pointer = after
        except struct.error as error:
            raise OSError(f"{path}: its tags cannot be written: {error}") from None


def _number(file: BinaryIO, place: int, form: str) -> int:
    file.seek(place)
    return int(struct.unpack(form, file.read(struct.calcsize(form)))[0])


def _entries(file: BinaryIO, layout: _Layout, place: int) -> tuple[list[_Entry], int]:
    """Entries of a directory, and the position of the next one's offset."""
    count = _number(file, place, layout.length)
    size = struct.calcsize(layout.entry)
    if count > 65535:
        raise ValueError(f"a directory of {count} tags")
    stored = file.read(count * size)
    if len(stored) < count * size:
        raise ValueError("a directory is cut off")
    lines = [_Entry(*line) for line in struct.iter_unpack(layout.entry, stored)]
    return lines, place + struct.calcsize(layout.length) + count * size


def _directories(
    file: BinaryIO,
    wanted: Collection[int],
    nested: Mapping[int, Collection[int] | None],
    most: int = MOST_DIRECTORIES,
) -> list[dict[int, "Tag | Directory"]]:
    file.seek(0)
    start = file.read(8)
    layout = LAYOUTS.get(start[:4])
    found: list[dict[int, Tag | Directory]] = []
    if layout is None or len(start) < 8:
        return found
    place = _number(file, layout.pointer, layout.offset)
    while place and len(found) < most:
        directory, pointer = _directory(file, layout, place, wanted, nested)
        found.append(directory)
        place = _number(file, pointer, layout.offset)
    return found


def _directory(
    file: BinaryIO,
    layout: _Layout,
    place: int,
    wanted: Collection[int] | None,
    nested: Mapping[int, Collection[int] | None],
) -> tuple[dict[int, "Tag | Directory"], int]:
    """Wanted tags of a directory, and the position of the next one's offset."""
    directory: dict[int, Tag | Directory] = {}
    lines, after = _entries(file, layout, place)
    for line in lines:
        is_nested = line.tag in nested and line.size == 1
        if line.kind in TYPES and (is_nested or wanted is None or line.tag in wanted):
            tag = _tag(file, layout, line)
            directory[line.tag] = tag
            if is_nested:
                inner = _directory(file, layout, int(tag.values[0]), nested[line.tag], {})
                directory[line.tag] = inner[0]
    return directory, after


def _tag(file: BinaryIO, layout: _Layout, line: _Entry) -> Tag:
    kind = np.dtype(TYPES[line.kind])
    size = line.size * (2 if line.kind in FRACTIONS else 1) * kind.itemsize
    if size > LARGEST_VALUE:
        raise ValueError(f"tag {line.tag} of {size} bytes")
    stored = line.field[:size]
    if size > len(line.field):
        file.seek(struct.unpack(layout.offset, line.field)[0])
        stored = file.read(size)
    if len(stored) < size:
        raise ValueError(f"tag {line.tag} is cut off")
    return Tag(line.kind, np.frombuffer(stored, layout.order + TYPES[line.kind]).astype(kind))


def _append(
    file: BinaryIO, layout: _Layout, lines: Sequence[_Entry], added: Directory, following: int
) -> int:
    """Append a directory to a file and return its position."""
    kept = [line for line in lines if line.tag not in added]
    both = sorted(kept + [_stored(file, layout, tag, value) for tag, value in added.items()])
    place = _end(file)
    file.write(struct.pack(layout.length, len(both)))
    file.write(b"".join(struct.pack(layout.entry, *line) for line in both))
    file.write(struct.pack(layout.offset, following))
    return place


def _stored(file: BinaryIO, layout: _Layout, tag: int, value: "Tag | Directory") -> _Entry:
    """Append a tag's values to the file and return its entry."""
    if not isinstance(value, Tag):
        value = Tag(LONG, np.array([_append(file, layout, [], value, 0)], np.uint32))
    stored = value.values.astype(layout.order + TYPES[value.kind]).tobytes()
    room = struct.calcsize(layout.offset)
    count = value.values.size // (2 if value.kind in FRACTIONS else 1)
    if len(stored) > room:
        place = _end(file)
        file.write(stored)
        stored = struct.pack(layout.offset, place)
    return _Entry(tag, value.kind, count, stored.ljust(room, b"\0"))


def _end(file: BinaryIO) -> int:
    """Pad the file to an even end and return its position."""
    if file.seek(0, 2) % 2:
        file.write(b"\0")
    return file.tell()


def is_animated_png(path: Path) -> bool:
    """Whether a file is an animated PNG."""
    with path.open("rb") as file:
        is_png = file.read(8) == PNG_START
        return is_png and next(chunks(file, 8, b"acTL", ">I4s", 4), None) is not None


def chunks(file: BinaryIO, place: int, wanted: bytes, form: str, tail: int) -> Iterator[bytes]:
    """Contents of the chunks of one name in a chunked file."""
    end = file.seek(0, 2)
    while place + 8 <= end:
        file.seek(place)
        head = struct.unpack(form, file.read(8))
        name, size = head if isinstance(head[0], bytes) else head[::-1]
        if name == wanted:
            yield file.read(size)
        place += 8 + size + tail + (size % 2 if tail == 0 else 0)


def before_pixels(file: BinaryIO) -> Iterator[bytes]:
    """Chunks of a PNG file from the current position up to its pixels."""
    while True:
        head = file.read(8)
        if len(head) < 8 or head[4:] == b"IDAT":
            file.seek(-len(head), 1)
            return
        yield head + file.read(4 + int(struct.unpack(">I", head[:4])[0]))


def put_into_png(path: Path, block: bytes, marks: bytes) -> None:
    """Insert an Exif chunk, unless empty, and chunks of colors after the header of a PNG file.

    If it gets these, or has a profile, other color chunks are removed.
    """
    fresh = path.with_name(f"{path.name}.exif")
    try:
        with path.open("rb") as source, fresh.open("xb") as target:
            target.write(source.read(8))
            header, *others = before_pixels(source)
            has_profile = any(chunk[4:8] == b"iCCP" for chunk in others)
            left_out = (b"eXIf", *((b"sRGB", b"gAMA", b"cHRM") if has_profile or marks else ()))
            named = b"eXIf" + block
            length, check = struct.pack(">I", len(block)), struct.pack(">I", zlib.crc32(named))
            target.write(header + (length + named + check if block else b"") + marks)
            target.writelines(chunk for chunk in others if chunk[4:8] not in left_out)
            copyfileobj(source, target)
        fresh.replace(path)
    finally:
        fresh.unlink(missing_ok=True)


SCALE, POINTS, MATRIX, KEYS, NUMBERS, WORDS = 33550, 33922, 34264, 34735, 34736, 34737
FACTS, NODATA, SATELLITE = 42112, 42113, 50844  # GDAL's, and coefficients of a satellite camera
TAGS = (SCALE, POINTS, MATRIX, KEYS, NUMBERS, WORDS, FACTS, NODATA, SATELLITE)
RASTER_TYPE, PIXEL_IS_POINT = 1025, 2  # a key, and its value for coordinates of pixel centers
STATISTICS = re.compile(r"\s*<Item[^>]*\bSTATISTICS_[^>]*>[^<]*</Item>")
STRAIGHT = 1e-12  # fraction of a matrix's largest number below which a rotation counts as 0


class Geo(NamedTuple):
    """Georeference of a picture."""

    matrix: Doubles | None  # (4, 4) of (x, y, z, 1), px from the corner, to Earth coordinates
    points: Doubles | None  # (n, 6) tie points: x, y, z in the picture and on Earth
    words: Directory  # tags that are copied
    nodata: str  # text of the value for missing data; empty if there is none
    is_point: bool  # coordinates start at the first pixel's center

    @property
    def has_place(self) -> bool:
        """Whether the picture is georeferenced."""
        return self.matrix is not None or self.points is not None

    @property
    def missing(self) -> float | None:
        """Value for missing data."""
        try:
            return float(self.nodata) if self.nodata else None
        except ValueError:
            return None


def geo_of(tags: Directory) -> Geo | None:
    """Parse georeference and missing value from tags; None if there are none."""
    if not set(TAGS) & set(tags):
        return None
    keys = _numbers(tags, KEYS).astype(int)
    types = [keys[n + 3] for n in range(4, len(keys) - 3, 4) if keys[n] == RASTER_TYPE]
    is_point = types[:1] == [PIXEL_IS_POINT]
    # A matrix (4, 4) from either form.
    given, scale, own = _numbers(tags, POINTS), _numbers(tags, SCALE), _numbers(tags, MATRIX)
    matrix: Doubles | None = None
    points: Doubles | None = None
    if own.size == 16:
        matrix = own.reshape(4, 4)
    elif scale.size >= 2 and given.size >= 6:
        x, y, z = scale[0], -scale[1], scale[2] if scale.size > 2 else 0.0
        matrix = np.diag([x, y, z, 1.0])
        matrix[:3, 3] = given[3:6] - np.array([x, y, z]) * given[:3]
    if matrix is None and given.size >= 6:
        points = given[: given.size // 6 * 6].reshape(-1, 6).copy()
        points[:, :2] += 0.5 * is_point
    elif matrix is not None and is_point:
        matrix = matrix @ _shift(-0.5)
    words = {tag: tags[tag] for tag in (KEYS, NUMBERS, WORDS) if tag in tags}
    facts = STATISTICS.sub("", text(tags.get(FACTS)))
    if "<Item" in facts:
        words[FACTS] = text_tag(facts)
    return Geo(matrix, points, words, text(tags.get(NODATA)), is_point)


def moved(geo: Geo, matrix: Doubles) -> Geo:
    """Georeference of a warped picture.

    `matrix`: (3, 3) homography from source to target, px from the corners. Result: georeference of
    the target. It is lost if `matrix` is not affine, except for tie points, which are mapped
    exactly.
    """
    bare = matrix / matrix[2, 2] if matrix[2, 2] else matrix
    if geo.points is not None:
        points = geo.points.copy()
        there = np.column_stack([points[:, :2], np.ones(len(points))]) @ bare.T
        points[:, :2] = there[:, :2] / there[:, 2:]
        return geo._replace(points=points)
    if geo.matrix is None or not is_affine(matrix):
        return unplaced(geo)
    full = np.eye(4)
    full[:2, :2], full[:2, 3] = bare[:2, :2], bare[:2, 2]
    return geo._replace(matrix=geo.matrix @ np.linalg.inv(full))


def is_affine(matrix: Doubles) -> bool:
    """Whether a homography (3, 3) maps parallels to parallels."""
    return bool(matrix[2, 2] != 0.0 and (matrix[2, :2] == 0.0).all())


def unplaced(geo: Geo) -> Geo:
    """Copy without the georeference, but with the missing value."""
    words = {tag: value for tag, value in geo.words.items() if tag == FACTS}
    return geo._replace(matrix=None, points=None, words=words)


def tags_of(geo: Geo) -> Directory:
    """Tags for a georeference."""
    tags = dict(geo.words)
    if geo.nodata:
        tags[NODATA] = text_tag(geo.nodata)
    if geo.points is not None:
        points = geo.points.copy()
        points[:, :2] -= 0.5 * geo.is_point
        tags[POINTS] = _doubles_tag(points)
    if geo.matrix is not None:
        matrix = geo.matrix @ _shift(0.5) if geo.is_point else geo.matrix
        plane, others = matrix[:2, :2], (matrix[:2, 2], matrix[2, :2], matrix[3])
        is_turned = np.abs([plane[0, 1], plane[1, 0]]).max() > STRAIGHT * np.abs(plane).max()
        is_flat = all((part[:3] == 0.0).all() for part in others)
        if is_turned or not is_flat or plane[0, 0] <= 0.0 or plane[1, 1] >= 0.0:
            return tags | {MATRIX: _doubles_tag(matrix)}
        # Without rotation there are a scale and a tie point instead.
        tags[SCALE] = _doubles_tag(np.array([plane[0, 0], -plane[1, 1], matrix[2, 2]]))
        tags[POINTS] = _doubles_tag(np.concatenate([np.zeros(3), matrix[:3, 3]]))
    return tags


def _doubles_tag(numbers: Doubles) -> Tag:
    return Tag(DOUBLE, np.asarray(numbers, np.float64).ravel())


def _numbers(tags: Directory, name: int) -> Doubles:
    tag = tags.get(name)
    return np.asarray(tag.values, np.float64) if isinstance(tag, Tag) else np.zeros(0)


def _shift(distance: float) -> Doubles:
    """Matrix (4, 4) that adds a distance to x and y."""
    matrix = np.eye(4)
    matrix[:2, 3] = distance
    return matrix
