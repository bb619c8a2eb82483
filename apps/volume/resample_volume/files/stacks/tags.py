"""What DICOM files say under their tags: one number, as many as there must be, or one text."""

from typing import Any

import numpy as np

from resample.types import Doubles

UNDEFINED = 0xFFFFFFFF  # length of what says itself where it ends


def whole(told: Any, key: str, otherwise: int | None = None) -> int:
    """Whole number of a header; `otherwise` where there is none.

    Raises
    ------
    ValueError
        There are several, or something else, or none and there must be one.
    """
    given = told.get(key)
    if given in (None, "") and otherwise is not None:
        return otherwise
    try:
        found = numbers(given, key, 1)[0]
        if not found.is_integer():
            raise ValueError
    except ValueError:
        raise ValueError(f"its {key} is {_shown(given)}, where one whole number is") from None
    return int(found)


def text(told: Any, key: str) -> str:
    """Text of a header, the first of several; empty where there is none."""
    given = told.get(key) or ""
    return given if isinstance(given, str) else str(next(iter(given), ""))


def check_text(told: Any, key: str) -> None:
    """Refuse several texts in the place of one; errors as of `whole`."""
    given = told.get(key) or ""
    if not isinstance(given, str):
        raise ValueError(f"its {key} is {_shown(given)}, where one text is")


def numbers(given: Any, key: str, *counts: int) -> Doubles:
    """Finite numbers (N,) that a header has under a key, of which there are so many.

    Raises
    ------
    ValueError
        There are others, more or fewer.
    """
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


def check_lengths(told: Any) -> None:
    """Refuse a header whose elements claim more bytes than there are.

    Raises
    ------
    ValueError
        One does.
    """
    for tag in told.keys():  # noqa: SIM118  a header's own iteration makes values of all
        raw = told.get_item(tag)
        claimed, value = getattr(raw, "length", 0), getattr(raw, "value", None)
        if claimed != UNDEFINED and isinstance(value, bytes) and len(value) < claimed:
            raise ValueError(f"its {tag} claims {claimed} bytes, {len(value)} are there")


def _shown(given: Any) -> str:
    """What was given, in a few words."""
    return "missing" if given in (None, "") else f"{str(given)!r:.40}"
