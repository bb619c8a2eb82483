"""What users write and read: numbers in a text, a file's text, an error in one line."""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def numbers_in(name: str, text: str, count: int | None = None) -> list[float]:
    """Finite numbers of a text, separated by commas or blanks.

    Raises
    ------
    ValueError
        There is something else, or another count.
    """
    try:
        numbers = [float(part) for part in re.split(r"[\s,;]+", text.strip())]
    except ValueError:
        numbers = []
    if (
        not numbers
        or not all(map(math.isfinite, numbers))
        or len(numbers) != (count or len(numbers))
    ):
        wanted = "numbers" if count is None else f"{count} numbers"
        raise ValueError(f"{name} {text!r}; give {wanted} separated by commas")
    return numbers


def text_of(path: Path) -> str:
    """Text of a file.

    Raises
    ------
    OSError
        It cannot be read.
    ValueError
        It is no text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not a text") from None


@contextmanager
def naming(place: str) -> Iterator[None]:
    """Say where in a file a mistake is."""
    try:
        yield
    except KeyError as error:
        raise ValueError(f"{place} has no {error.args[0]}") from None
    except (ValueError, TypeError, ArithmeticError, RecursionError) as error:
        raise ValueError(f"{place}: {one_line(error)}") from None


def one_line(error: BaseException) -> str:
    """Message of an error without line breaks, for a user's eyes."""
    cause = error.__cause__
    if cause is not None and hasattr(cause, "error_count"):  # pydantic's, wrapped by cyclopts
        error = cause
    if hasattr(error, "errors") and hasattr(error, "error_count"):  # pydantic.ValidationError
        return "; ".join(map(_field_error, error.errors()))
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, MemoryError):
        return " ".join(["not enough memory", *str(error).split()])
    return " ".join(str(error).split()) or type(error).__name__


def _field_error(detail: dict[str, object]) -> str:
    """One field that pydantic refused: `camera.fov: Input should be a valid number (got 'x')`."""
    place = detail["loc"]
    field = ".".join(map(str, place)) if isinstance(place, tuple) else ""
    message = " ".join(str(detail["msg"]).removeprefix("Value error, ").split())
    return f"{field}: {message} (got {detail['input']!r:.60})" if field else message
