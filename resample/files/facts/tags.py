"""Tags of TIFF files, and of the Exif blocks of others, which are built alike.

OpenImageIO and pillow hide what they do not know, such as where on Earth a picture lies; so the
directories themselves are read here, and written at the end of a file that is whole.
"""

import struct
from collections.abc import Collection, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

SHORT, LONG, DOUBLE = 3, 4, 12
ASCII = 2
# Types of values by their numbers; of a fraction, two whole numbers.
TYPES = {
    1: "u1", 2: "u1", 3: "u2", 4: "u4", 5: "u4", 6: "i1", 7: "u1", 8: "i2", 9: "i4", 10: "i4",
    11: "f4", 12: "f8", 13: "u4", 16: "u8", 17: "i8", 18: "u8",
}  # fmt: skip
FRACTIONS = (5, 10)
MOST_DIRECTORIES = 65536  # a file with more points in circles
PER_BYTE, BESIDE = 4, 1 << 20  # bytes that are read of directories, by those that a file has
LARGEST_VALUE = 1 << 26  # bytes of one tag


class Tag(NamedTuple):
    """Values of one tag."""

    kind: int  # of `TYPES`
    values: NDArray[Any]  # flat; text as bytes that end with 0


Directory = Mapping[int, "Tag | Directory"]


class _Layout(NamedTuple):
    """How a file writes its numbers."""

    order: Literal["<", ">"]  # of bytes
    is_big: bool  # BigTIFF, whose offsets have 8 bytes

    @property
    def offset(self) -> str:
        return self.order + ("Q" if self.is_big else "I")

    @property
    def length(self) -> str:
        return self.order + ("Q" if self.is_big else "H")

    @property
    def entry(self) -> str:
        """Tag, type, number of values, and the values or where they are."""
        return self.order + ("HHQ8s" if self.is_big else "HHI4s")


class _Entry(NamedTuple):
    """One line of a directory, as it is stored."""

    tag: int
    kind: int
    size: int  # how many values
    field: bytes  # the values, or their offset


class _Counted(BytesIO):
    """A file of which little more is read than it has: directories may overlap, or go round."""

    def __init__(self, file: BinaryIO) -> None:
        super().__init__()
        self._file = file
        self._left = PER_BYTE * file.seek(0, 2) + BESIDE

    def seek(self, place: int, whence: int = 0) -> int:
        """Go to a place."""
        return self._file.seek(place, whence)

    def read(self, size: int | None = -1) -> bytes:
        """Bytes from there."""
        found = self._file.read(-1 if size is None else size)
        self._left -= len(found)
        if self._left < 0:
            raise ValueError("they overlap, or go in circles")
        return found


def text(tag: "Tag | Directory | None") -> str:
    """What a tag says, of a tag of text; nothing if there is none."""
    if not isinstance(tag, Tag):
        return ""
    return tag.values.astype(np.uint8).tobytes().partition(b"\0")[0].decode("latin-1").strip()


def text_tag(words: str) -> Tag:
    """Tag that says something."""
    return Tag(ASCII, np.frombuffer(words.encode("latin-1", "replace") + b"\0", np.uint8))


def read_tags(
    path: str | Path, wanted: Collection[int], nested: Mapping[int, Collection[int] | None]
) -> list[dict[int, "Tag | Directory"]]:
    """Some tags of every directory of a TIFF file.

    Parameters
    ----------
    path
        File; one that is no TIFF has no directory.
    wanted
        Which tags.
    nested
        Tags that lead to a directory of their own, and which of its tags are read; None is all.

    Raises
    ------
    OSError
        The file is damaged.
    """
    with Path(path).open("rb") as file:
        try:
            return _directories(_Counted(file), wanted, nested)
        except (struct.error, ValueError) as error:
            raise OSError(f"{path}: its tags are damaged: {error}") from None


def block_tags(
    block: bytes, wanted: Collection[int], nested: Mapping[int, Collection[int] | None]
) -> dict[int, "Tag | Directory"]:
    """Some tags of an Exif block; none if it is damaged."""
    try:
        found = _directories(_Counted(BytesIO(block)), wanted, nested, 1)
    except (struct.error, ValueError):
        return {}
    return found[0] if found else {}


def block_of(directory: Directory) -> bytes:
    """Exif block with these tags."""
    file, layout = BytesIO(), _Layout("<", False)
    file.write(b"II*\0" + bytes(4))
    place = _append(file, layout, [], directory, 0)
    file.seek(4)
    file.write(struct.pack(layout.offset, place))
    return file.getvalue()


def add_tags(path: Path, additions: Sequence[Directory]) -> None:
    """Add tags to the directories of a TIFF file, in place of those that are there.

    Parameters
    ----------
    path
        File that nobody else reads yet.
    additions
        For each directory; the tags of one within them become a directory of their own.

    Raises
    ------
    OSError
        The file cannot be written or becomes too large.
    """
    with path.open("r+b") as file:
        layout, pointer = _head(file)
        if layout is None:
            raise OSError(f"{path} is no TIFF file")
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


def _head(file: BinaryIO) -> tuple[_Layout | None, int]:
    """Layout of a TIFF file, and where the place of its first directory stands."""
    file.seek(0)
    start = file.read(8)
    if start[:2] not in (b"II", b"MM") or len(start) < 8:
        return None, 0
    order: Literal["<", ">"] = "<" if start[:2] == b"II" else ">"
    version = struct.unpack(order + "H", start[2:4])[0]
    if version not in (42, 43):
        return None, 0
    return _Layout(order, version == 43), 8 if version == 43 else 4


def _number(file: BinaryIO, place: int, form: str) -> int:
    file.seek(place)
    return int(struct.unpack(form, file.read(struct.calcsize(form)))[0])


def _entries(file: BinaryIO, layout: _Layout, place: int) -> tuple[list[_Entry], int]:
    """Lines of a directory, and where the place of the next one stands."""
    count = _number(file, place, layout.length)
    size = struct.calcsize(layout.entry)
    if count > 65535:
        raise ValueError(f"a directory of {count} tags")
    stored = file.read(count * size)
    lines = [_Entry(*line) for line in struct.iter_unpack(layout.entry, stored)]
    if len(lines) < count:
        raise ValueError("a directory is cut off")
    return lines, place + struct.calcsize(layout.length) + count * size


def _directories(
    file: BinaryIO,
    wanted: Collection[int],
    nested: Mapping[int, Collection[int] | None],
    most: int = MOST_DIRECTORIES,
) -> list[dict[int, "Tag | Directory"]]:
    layout, pointer = _head(file)
    found: list[dict[int, Tag | Directory]] = []
    if layout is None:
        return found
    place = _number(file, pointer, layout.offset)
    while place and len(found) < most:
        lines, pointer = _entries(file, layout, place)
        directory: dict[int, Tag | Directory] = {}
        for line in lines:
            if line.tag in nested and line.size == 1 and line.kind in TYPES:
                inner = int(_tag(file, layout, line).values[0])
                directory[line.tag] = _tags(file, layout, inner, nested[line.tag])
            elif line.tag in wanted and line.kind in TYPES:
                directory[line.tag] = _tag(file, layout, line)
        found.append(directory)
        place = _number(file, pointer, layout.offset)
    return found


def _tags(
    file: BinaryIO, layout: _Layout, place: int, wanted: Collection[int] | None
) -> dict[int, Tag]:
    return {
        line.tag: _tag(file, layout, line)
        for line in _entries(file, layout, place)[0]
        if (wanted is None or line.tag in wanted) and line.kind in TYPES
    }


def _tag(file: BinaryIO, layout: _Layout, line: _Entry) -> Tag:
    kind = np.dtype(TYPES[line.kind])
    count = line.size * (2 if line.kind in FRACTIONS else 1)
    size = count * kind.itemsize
    if size > LARGEST_VALUE:
        raise ValueError(f"tag {line.tag} of {size} bytes")
    stored = line.field[:size]
    if size > len(line.field):
        file.seek(struct.unpack(layout.offset, line.field)[0])
        stored = file.read(size)
    if len(stored) < size:
        raise ValueError(f"tag {line.tag} is cut off")
    values = np.frombuffer(stored, kind.newbyteorder(layout.order))
    return Tag(line.kind, values.astype(kind))


def _append(
    file: BinaryIO, layout: _Layout, lines: Sequence[_Entry], added: Directory, following: int
) -> int:
    """Write a directory to the end of a file; gives its place."""
    kept = [line for line in lines if line.tag not in added]
    fresh = [_stored(file, layout, tag, value) for tag, value in added.items()]
    place = _end(file)
    both = sorted(kept + fresh)
    file.write(struct.pack(layout.length, len(both)))
    file.write(b"".join(struct.pack(layout.entry, *line) for line in both))
    file.write(struct.pack(layout.offset, following))
    return place


def _stored(file: BinaryIO, layout: _Layout, tag: int, value: "Tag | Directory") -> _Entry:
    """Line of a tag, whose values are in the file."""
    if not isinstance(value, Tag):
        value = Tag(LONG, np.array([_append(file, layout, [], value, 0)], np.uint32))
    stored = value.values.astype(np.dtype(TYPES[value.kind]).newbyteorder(layout.order)).tobytes()
    room = struct.calcsize(layout.offset)
    count = value.values.size // (2 if value.kind in FRACTIONS else 1)
    if len(stored) > room:
        place = _end(file)
        file.write(stored)
        stored = struct.pack(layout.offset, place)
    return _Entry(tag, value.kind, count, stored.ljust(room, b"\0"))


def _end(file: BinaryIO) -> int:
    """End of a file, to which it is put; an even number."""
    if file.seek(0, 2) % 2:
        file.write(b"\0")
    return file.tell()
