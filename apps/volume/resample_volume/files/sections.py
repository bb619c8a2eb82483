"""Sections of a legacy VTK file: keywords, and the location of arrays."""

from collections.abc import Sequence
from typing import Any, BinaryIO, NamedTuple
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_items
from resample.types import Doubles
from resample_volume.data.recordings import is_color
from resample_volume.data.values import require_memory
from resample_volume.files.headers import VolumeHeader
from resample_volume.files.texts import numbers, skip_numbers

PARTS = ("", "magnitude")
ROWS = 1 << 18  # vectors converted to lengths at a time
HIDDEN = "vtkGhost"  # begins names of arrays that VTK keeps for itself
Numbers = NDArray[Any]
LONGEST = 4096  # bytes of a line
TYPES = {
    "unsigned_char": "u1",
    "char": "i1",
    "signed_char": "i1",
    "unsigned_short": "u2",
    "short": "i2",
    "unsigned_int": "u4",
    "int": "i4",
    "unsigned_long": "u8",
    "long": "i8",
    "float": "f4",
    "double": "f8",
    "vtkidtype": "i4",  # in files, whatever it is in memory
    "vtktypeint64": "i8",
    "vtktypeuint64": "u8",
}
WIDTHS = {"vectors": 3, "normals": 3, "tensors": 9, "tensors6": 6, "global_ids": 1}


class ArrayQuery(NamedTuple):
    """The user's choice."""

    array: str  # its name; empty: the active one, or the only one that it can be
    part: str  # one of PARTS
    reader: str  # which is asked; empty: none, a caller has the data


class Named(NamedTuple):
    """An array of a file."""

    name: str
    parts: int  # numbers at each place
    is_of_cells: bool
    is_active: bool  # whether the file marks it as the scalars


def choose(known: Sequence[Named], wanted: ArrayQuery, file: str) -> Named:
    """Choose an array: by name, else the active one, the only one, or the only one of scalars.

    Point arrays take precedence: if there are any, cell arrays must be chosen by name.
    """
    shown = [each for each in known if not each.name.startswith(HIDDEN)]
    if wanted.array:
        found = [each for each in known if each.name == wanted.array]
    else:
        some = [each for each in shown if not each.is_of_cells] or shown
        active = [each for each in some if each.is_active]
        scalars = [each for each in some if each.parts == 1]
        found = next((one for one in (active, some, scalars) if len(one) == 1), [])
    if not found:
        names = ", ".join(each.name + " (cells)" * each.is_of_cells for each in shown)
        how = f"--reader {wanted.reader}:array=NAME" if wanted.reader else "part=NAME"
        given, known_names = wanted.array or "none", names or "there is none"
        raise ValueError(f"{file}: choose an array, {how} ({given} given): {known_names}")
    return found[0]


def check_part(part: str) -> None:
    """Reject an unknown part of vectors."""
    if part not in PARTS:
        raise ValueError(f"part is magnitude, or left out, not {part!r}")


def listed(known: Sequence[Named]) -> str:
    """Return the names of all arrays, with their numbers of components."""
    return f"arrays are {', '.join(f'{each.name}: {each.parts}' for each in known)}"


def of_parts(
    known: VolumeHeader, chosen: Named, every: Sequence[Named], wanted: ArrayQuery
) -> VolumeHeader:
    """Return the header for an array, with the chosen part of its components."""
    parts = chosen.parts
    if wanted.part and parts < 2:
        raise ValueError(
            f"{known.name}: {chosen.name} has one number at each place; leave out "
            f"part={wanted.part}, or choose a vector ({listed(every)})"
        )
    if wanted.part:
        return known._replace(dtype=_kind(known.dtype))
    kind = f"vector of {known.dtype.name} ({chosen.name}; {listed(every)})"
    return known._replace(parts=parts, is_color=is_color((parts,), known.dtype), pixel=kind)


def part_of(values: NDArray[Any], chosen: Named, wanted: ArrayQuery, name: str) -> NDArray[Any]:
    """Return values (N * C,), or the lengths (N,) of vectors if asked for."""
    if not wanted.part:
        return values
    rows = values.reshape(-1, chosen.parts)
    found = np.empty(len(rows), _kind(values.dtype))
    require_memory(found.nbytes, name)
    for start in range(0, len(rows), ROWS):
        some = rows[start : start + ROWS].astype(np.float64)
        found[start : start + ROWS] = np.linalg.norm(some, axis=1)
    return found


def check_single(known: VolumeHeader, file: str) -> None:
    """Reject several components on an uneven grid."""
    if known.parts > 1:
        raise ValueError(
            f"{file} has {known.parts} numbers at each place, a volume on an uneven grid has one; "
            f"choose another array, or --reader vtr:part=magnitude; it is a {known.pixel}"
        )


def cells_between(points: Sequence[int]) -> tuple[int, ...]:
    """Return the cells along x, y, z between points."""
    return tuple(max(1, count - 1) for count in points)


def middles(planes: Doubles, *, of_cells: bool) -> Doubles:
    """Return coordinates of planes, or of the centers of cells between them."""
    return (planes[1:] + planes[:-1]) / 2 if of_cells else planes


def _kind(dtype: np.dtype[Any]) -> np.dtype[Any]:
    return np.dtype(np.float64 if dtype.newbyteorder("=") == np.float64 else np.float32)


WIDTHS |= {"pedigree_ids": 1, "edge_flags": 1}
SHADES = 4  # numbers of a color in a table of colors


class Array(NamedTuple):
    """Location of an array."""

    named: Named
    dtype: np.dtype[np.generic]
    size: int  # numbers
    start: int  # bytes before them
    is_shade: bool = False  # written as text, floats from 0 to 1 that stand for bytes


class Sections:
    """A file, parsed once from beginning to end."""

    def __init__(self, file: BinaryIO, name: str) -> None:
        self.file, self.name = file, name
        start = [file.readline(LONGEST) for _ in range(2)]
        if not start[0].lower().startswith(b"# vtk datafile"):
            raise ValueError(f"{name} is not a legacy file of VTK: its first line is another")
        self._last = 0
        form = self.line()[:1]
        if not form or form[0].lower() not in ("ascii", "binary"):
            raise ValueError(f"{name} is damaged: its third line is not ASCII or BINARY")
        self.is_text = form[0].lower() == "ascii"
        words = self.line()
        if len(words) < 2 or words[0].lower() != "dataset":
            raise ValueError(f"{name} is damaged: its fourth line names no DATASET")
        self.dataset = words[1].lower()

    def line(self) -> list[str]:
        """Return the words of the next non-empty line outside METADATA; empty at the end."""
        while True:
            self._last = self.file.tell()
            text = self.file.readline(LONGEST)
            words = text.decode("utf-8", "surrogateescape").split()
            if words[:1] == ["METADATA"]:
                while self.file.readline(LONGEST).strip():
                    pass
            elif words or not text:
                return words

    def back(self) -> None:
        """Go back to before the last line."""
        self.file.seek(self._last)

    def floats(self, words: list[str]) -> list[float]:
        """Parse the numbers of a line."""
        try:
            return [float(word) for word in words]
        except ValueError:
            told = " ".join(words)
            raise ValueError(f"{self.name}: {told!r:.60} are not numbers; correct it") from None

    def coordinates(self, words: list[str]) -> Doubles:
        """Read coordinates of planes, after their line."""
        return np.asarray(self.block(words, 1, self.word(words, 2)), np.float64)

    def block(self, words: list[str], place: int, kind: str, parts: int = 1) -> Numbers:
        """Read the numbers after a line; one of its words is their count.

        `parts`: numbers per counted item.
        """
        count = parts * self.whole(words, place)
        array = self._array(Named("", 1, False, False), count, kind)
        end = self.file.tell()
        found = self.values(array)
        self.file.seek(end)
        return found

    def values(self, array: Array) -> Numbers:
        """Read the numbers of an array into memory."""
        require_memory(array.size * array.dtype.itemsize, self.name)
        self.file.seek(array.start)
        if self.is_text:
            return numbers(self.file, array.size, array.dtype, self.name)
        data = self.file.read(array.size * array.dtype.itemsize)
        return np.frombuffer(data, array.dtype).astype(array.dtype.newbyteorder("="))

    def arrays(self, points: int, cells: int) -> list[Array]:
        """Return all arrays with a value for each point, or cell."""
        found: list[Array] = []
        wanted, is_of_cells = 0, False
        while words := self.line():
            key = words[0].lower()
            if key in ("point_data", "cell_data"):
                is_of_cells = key == "cell_data"
                wanted = cells if is_of_cells else points
                if self.whole(words, 1) != wanted:
                    raise ValueError(
                        f"{self.name} is damaged: {words[1]:.20} values of {wanted} {key[:-5]}s"
                    )
            elif key == "field":
                found += self._field(words, wanted, is_of_cells)
            else:
                is_first = not any(
                    each.named.is_active and each.named.is_of_cells == is_of_cells for each in found
                )
                found += self._attribute(words, wanted, is_of_cells, is_first)
            check_items(self.name, len(found), "arrays")
        return found

    def skip_field(self, words: list[str]) -> None:
        """Skip a field, after its line."""
        self._field(words, -1, False)

    def _field(self, words: list[str], wanted: int, is_of_cells: bool) -> list[Array]:
        found = []
        count = self.whole(words, 2)
        check_items(self.name, count, "arrays")
        for _ in range(count):
            words = self.line()
            if words[:1] == ["NULL_ARRAY"]:
                continue
            parts, rows = self.whole(words, 1), self.whole(words, 2)
            named = Named(unquote(words[0]), parts, is_of_cells, is_active=False)
            array = self._array(named, parts * rows, self.word(words, 3))
            found += [array] if rows == wanted and parts else []
        return found

    def _attribute(
        self, words: list[str], wanted: int, is_of_cells: bool, is_first: bool
    ) -> list[Array]:
        key, label = words[0].lower(), unquote(self.word(words, 1))
        if key == "lookup_table":
            kind = "float" if self.is_text else "unsigned_char"
            size = self.whole(words, 2)
            self._array(Named(label, SHADES, is_of_cells, False), SHADES * size, kind)
            return []
        if key == "scalars":
            parts = self.whole(words, 3) if len(words) > 3 else 1
            here = self.file.tell()
            if self.line()[:1] not in (["LOOKUP_TABLE"], ["lookup_table"]):
                self.file.seek(here)
            named = Named(label, parts, is_of_cells, is_first)
            array = self._array(named, parts * wanted, self.word(words, 2))
        elif key == "color_scalars":
            parts = self.whole(words, 2)
            kind = "float" if self.is_text else "unsigned_char"
            array = self._array(Named(label, parts, is_of_cells, is_first), parts * wanted, kind)
            array = array._replace(is_shade=self.is_text)
        elif key == "texture_coordinates":
            parts = self.whole(words, 2)
            named = Named(label, parts, is_of_cells, False)
            array = self._array(named, parts * wanted, self.word(words, 3))
        elif key in WIDTHS:
            named = Named(label, WIDTHS[key], is_of_cells, False)
            array = self._array(named, WIDTHS[key] * wanted, self.word(words, 2))
        else:
            raise ValueError(f"{self.name} is damaged: unknown keyword {words[0]!r:.40}")
        return [array] if array.named.parts else []

    def _array(self, named: Named, count: int, kind: str) -> Array:
        """Return the array that begins here, and skip it."""
        if kind.lower() not in TYPES:
            known = ", ".join(TYPES)
            raise ValueError(f"{self.name} has numbers of type {kind!r:.40}; known are {known}")
        dtype = np.dtype(TYPES[kind.lower()])
        array = Array(named, dtype if self.is_text else dtype.newbyteorder(">"), count, 0)
        array = array._replace(start=self.file.tell())
        if self.is_text:
            skip_numbers(self.file, count, self.name)
            return array
        end = array.start + count * dtype.itemsize
        size = self.file.seek(0, 2)
        if end > size:
            raise ValueError(
                f"{self.name} is cut off: it has {size} bytes, {end} are wanted; get it again"
            )
        self.file.seek(end)
        return array

    def whole(self, words: list[str], place: int) -> int:
        """Parse a count from a word of a line."""
        word = self.word(words, place)
        if not (word.isascii() and word.isdecimal() and len(word) < 19):
            raise ValueError(f"{self.name} is damaged: {word!r:.40} is not a count of numbers")
        return int(word)

    def word(self, words: list[str], place: int) -> str:
        """Return a required word of a line."""
        if len(words) <= place:
            told = " ".join(words)
            raise ValueError(f"{self.name} is damaged: {told!r:.60} has too few words")
        return words[place]
