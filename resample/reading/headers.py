"""Validate the numbers in NRRD and MetaImage headers before data are read.

A header may have words in place of numbers, or a number of them that contradicts its dimensions
(found by `make fuzz`).
"""

from collections.abc import Mapping
from itertools import islice
from pathlib import Path

LONGEST_LINE = 1000  # bytes; lines of numbers are shorter
MOST_LINES = 10_000  # of a header
MOST_DIMENSIONS = 9

NRRD_NUMBERS = (  # fields without blanks that consist of numbers only
    *("dimension", "spacedimension", "sizes", "spacings", "thicknesses", "axismins", "axismaxs"),
    *("spaceorigin", "spacedirections", "measurementframe", "lineskip", "byteskip", "min", "max"),
    *("blocksize", "oldmin", "oldmax"),
)
NRRD_PER_AXIS = ("sizes", "spacings", "thicknesses", "axismins", "axismaxs")
META_PER_AXIS = (
    *("dimsize", "elementspacing", "elementsize", "offset", "origin", "position"),
    *("centerofrotation",),
)
META_MATRICES = ("transformmatrix", "rotation", "orientation")
META_NUMBERS = (
    *("ndims", "headersize", "elementnumberofchannels", "elementmin", "elementmax"),
    *("compresseddatasize", "id", "parentid"),
)
NOTHING = ("none", "nan", "inf", "-inf", "?", "???")  # NRRD's words for a missing number


def check_nrrd_numbers(path: Path, value: Mapping[str, str]) -> None:
    """Reject NRRD fields that lack their numbers."""
    fields = {key.replace(" ", ""): text for key, text in value.items()}
    _check_lengths(path)
    if "dimension" not in fields:
        return  # the reader reports what is wrong
    axes = _dimensions(path, "dimension", fields["dimension"])
    for key in NRRD_NUMBERS:
        if key in fields:
            bare = fields[key].translate(str.maketrans("(),", "   "))
            words = [word for word in bare.split() if word.lower() not in NOTHING]
            _numbers(path, key, " ".join(words))
            if key in NRRD_PER_AXIS:
                _check_count(path, key, len(fields[key].split()), axes)


def check_meta_numbers(path: Path, value: Mapping[str, str]) -> None:
    """Reject MetaImage fields that lack their numbers; errors as for NRRD."""
    _check_lengths(path)
    axes = _dimensions(path, "ndims", value.get("ndims", ""))
    if "dimsize" not in value:
        raise ValueError(f"{path.name} is not a MetaImage: its header has no DimSize")
    for key in value.keys() & set(META_NUMBERS):
        _numbers(path, key, value[key])
    for keys, count in ((META_PER_AXIS, axes), (META_MATRICES, axes * axes)):
        for key in keys:
            if key in value:
                _check_count(path, key, len(_numbers(path, key, value[key])), count)


def whole(path: Path, word: str) -> int:
    """Parse an integer of a header."""
    try:
        return int(word[:20])
    except ValueError:
        raise ValueError(f"{path.name}: {word!r:.40} is not a whole number; correct it") from None


def _dimensions(path: Path, key: str, text: str) -> int:
    axes = whole(path, text)
    if not 1 <= axes <= MOST_DIMENSIONS:
        raise ValueError(f"{path.name}: {key} {axes}; there are 1 to {MOST_DIMENSIONS}")
    return axes


def _check_lengths(path: Path) -> None:
    """Reject very long lines of fields; comments and custom keys may be long."""
    with path.open("rb") as file:
        for line in islice(file, MOST_LINES):
            text = line.strip()
            if not text or text.lower().startswith(b"elementdatafile"):
                return
            is_own = text.startswith(b"#") or b":=" in text[:LONGEST_LINE]
            if len(text) > LONGEST_LINE and not is_own:
                start = text[:20].decode("latin-1")
                raise ValueError(
                    f"{path.name}: a line of its header, {start!r}..., has {len(text)} letters; "
                    "correct it"
                )


def _numbers(path: Path, key: str, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        message = f"{path.name}: its {key} is {text!r:.60}, not numbers; correct it"
        raise ValueError(message) from None


def _check_count(path: Path, key: str, given: int, wanted: int) -> None:
    if given != wanted:
        raise ValueError(f"{path.name}: its {key} has {given} numbers instead of {wanted}")
