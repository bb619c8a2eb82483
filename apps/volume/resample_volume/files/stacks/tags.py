"""Read DICOM tags, and check compressed frames before they are decoded."""

from typing import Any

import numpy as np

from resample.reading.limits import LimitError
from resample.reading.pictures import size_of
from resample.types import Doubles

UNDEFINED = 0xFFFFFFFF  # length of elements with an end mark


def whole(dataset: Any, key: str, otherwise: int | None = None) -> int:
    """Return an integer of a header; `otherwise` if there is none."""
    given = dataset.get(key)
    if given in (None, "") and otherwise is not None:
        return otherwise
    try:
        found = numbers(given, key, 1)[0]
        if not found.is_integer():
            raise ValueError
    except ValueError:
        raise ValueError(f"its {key} is {_shown(given)}, where one whole number is") from None
    return int(found)


def text(dataset: Any, key: str) -> str:
    """Return a text of a header, the first of several; empty if there is none."""
    given = dataset.get(key) or ""
    return given if isinstance(given, str) else str(next(iter(given), ""))


def check_text(dataset: Any, key: str) -> None:
    """Reject several texts instead of one; errors as of `whole`."""
    given = dataset.get(key) or ""
    if not isinstance(given, str):
        raise ValueError(f"its {key} is {_shown(given)}, where one text is")


def numbers(given: Any, key: str, *counts: int) -> Doubles:
    """Return the finite numbers (N,) of a header's key, of an allowed count."""
    try:
        found = np.atleast_1d(np.array(given, np.float64))
        is_right = found.ndim == 1 and len(found) in counts and bool(np.isfinite(found).all())
    except (TypeError, ValueError, OverflowError):
        is_right = False
    if not is_right:
        wanted = " or ".join(map(str, sorted(set(counts))))
        numbered = "finite number is" if wanted == "1" else "finite numbers are"
        raise ValueError(f"its {key} is {_shown(given)}, where {wanted} {numbered}")
    return found


def check_lengths(dataset: Any) -> None:
    """Reject a header whose elements claim more bytes than there are."""
    for tag in dataset.keys():  # noqa: SIM118  iterating a header itself converts all values
        raw = dataset.get_item(tag)
        claimed, value = getattr(raw, "length", 0), getattr(raw, "value", None)
        if claimed != UNDEFINED and isinstance(value, bytes) and len(value) < claimed:
            raise ValueError(f"its {tag} claims {claimed} bytes, {len(value)} are there")


def _shown(given: Any) -> str:
    """Return what was given, in short."""
    return "missing" if given in (None, "") else f"{str(given)!r:.40}"


def check_frames(dataset: Any, name: str) -> None:
    """Reject compressed frames whose own size differs from the header's."""
    from pydicom.encaps import generate_frames

    wanted = (int(dataset.Rows), int(dataset.Columns))
    count = int(dataset.get("NumberOfFrames", 1) or 1)
    for frame in generate_frames(dataset.PixelData, number_of_frames=count):
        size = size_of(frame)
        if size is not None and size != wanted:
            raise LimitError(
                f"{name} holds a picture of {size[1]} x {size[0]} pixels and says that it has "
                f"{wanted[1]} x {wanted[0]}; get it again"
            )
