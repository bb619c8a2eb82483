"""Parse and check users' numbers; format text and errors as one safe line."""

import math
import operator
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

LONGEST = 2000  # characters of a message
DIGITS = re.compile(r"[\d.]{60,}")  # of a number
TOO_MANY_DIGITS = re.compile(r"Exceeds the limit \(\d+ digits\) for integer string conversion.*")
OURS = ("resample", "contextlib", "functools", "dataclasses")  # besides resample_points and so on
READERS = {  # by suffixes that other applications have not
    "ply las laz pcd xyz pts e57 sog spz ksplat splat": "resample-points",
    "nrrd nhdr nii mha mhd dcm vdb vti mrc": "resample-volume",
    "png jpg jpeg webp avif bmp": "resample-texture",
    "obj glb gltf": "resample-texture mesh",
}
TOO_LARGE = "a whole number has thousands of digits, beyond 64 bits; write it as 1e30"


def parts_of(text: str) -> list[str]:
    """Split a tuple at commas; slashes, semicolons and blanks are read, too.

    Examples
    --------
    >>> from resample.messages import parts_of
    >>> parts_of("30,20,1.5") == parts_of("30/20/1.5") == parts_of(" 30, 20 1.5 ")
    True
    """
    return re.split(r"[\s,;/]+", text.strip())


def choices_in(text: str) -> list[tuple[str, str]]:
    """Split choices `a=b,c=1,2` into names and values, which may be tuples.

    Examples
    --------
    >>> from resample.messages import choices_in
    >>> choices_in("window=40,400,colors=gray")
    [('window', '40,400'), ('colors', 'gray')]
    """
    found: list[tuple[str, str]] = []
    for part in filter(None, text.split(",")):
        name, equals, value = part.partition("=")
        if equals or not found:
            found.append((name, value))
        else:
            found[-1] = found[-1][0], f"{found[-1][1]},{part}"
    return found


def numbers_in(name: str, text: str, count: int | None = None) -> list[float]:
    """Parse finite numbers separated by commas, or as `parts_of` takes them.

    Raises ValueError: there is something else, or a different count.
    """
    try:
        numbers = [float(part) for part in parts_of(text)]
    except ValueError:
        numbers = []
    if (
        not numbers
        or not all(map(math.isfinite, numbers))
        or len(numbers) != (count or len(numbers))
    ):
        wanted = "numbers" if count is None else f"{count} numbers"
        raise ValueError(f"{name} {text!r:.60}; give {wanted} separated by commas")
    return numbers


def check_threads(given: Any) -> None:
    """Check the number of threads; None means all."""
    if given is None:
        return
    try:
        count = operator.index(given)
    except TypeError:
        raise TypeError(f"threads {shortly(given)}; give a whole number of 1 or more") from None
    if count < 1:
        raise ValueError(f"threads {count}; give a whole number of 1 or more")


def number(name: str, given: Any) -> float:
    """Return a number of users' arguments; reject texts such as `"30"`.

    Examples
    --------
    >>> from resample.messages import number
    >>> number("degrees", "30")
    Traceback (most recent call last):
    ...
    TypeError: degrees '30'; give a number
    """
    if not isinstance(given, str | bytes):
        try:
            return float(given)
        except (TypeError, ValueError):
            pass
    raise TypeError(f"{name} {shortly(given)}; give a number")


def check_numbers(choices: Any, *names: str) -> None:
    """Reject attributes of these names that are not numbers; None is allowed."""
    for name in names:
        given = getattr(choices, name)
        if given is not None:
            number(name, given)


def doubles_of(name: str, given: Any, wanted: str) -> "NDArray[np.float64]":
    """Return an array of users' numbers; reject texts, complex numbers and ragged lists."""
    import numpy as np

    try:
        found = np.asarray(given)
    except ValueError:
        found = np.empty(0, np.object_)
    if found.dtype.kind not in "biuf":
        raise TypeError(f"{name} {shortly(given)}; give {wanted}")
    return np.asarray(found, np.float64)


def check_kind(name: str, given: Any, kinds: Any, wanted: str) -> None:
    """Reject an argument that is not of one of these classes."""
    if not isinstance(given, kinds):
        raise TypeError(f"a {name} of {type(given).__name__}; give {wanted}")


def warn(message: str, kind: type[Warning] = UserWarning) -> None:
    """Warn at the line of the user's code from which ours was called."""
    frame: FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None:
        name = frame.f_globals.get("__name__", "").partition(".")[0]
        if name not in OURS and not name.startswith("resample_"):
            break
        frame, level = frame.f_back, level + 1
    warnings.warn(message, kind, stacklevel=level)


def reader_of(name: object) -> str:
    """Tell which command reads a file with the suffix of this name; empty if none is known.

    Examples
    --------
    >>> from resample.messages import reader_of
    >>> reader_of("scan.ply"), reader_of("scan.docx")
    ('resample-points reads such files', '')
    """
    suffix = str(name).lower().removesuffix(".gz").rpartition(".")[2]
    found = next((program for ends, program in READERS.items() if suffix in ends.split()), "")
    return f"{found} reads such files" if found else ""


def visible(text: str) -> str:
    r"""Escape control characters, which a terminal would obey.

    Undecodable bytes of file names, kept by Python as lone surrogates, are escaped too.

    Examples
    --------
    >>> from resample.messages import visible
    >>> visible("scan\x1b[2J.ply")
    'scan\\x1b[2J.ply'
    >>> visible("caf\udce9.png")
    'caf\\xe9.png'
    """
    if text.isprintable():
        return text
    shown = []
    for letter in text:
        if letter.isprintable() or letter == " ":
            shown.append(letter)
        elif "\udc80" <= letter <= "\udcff":  # an undecodable byte of a name; see `os.fsdecode`
            shown.append(f"\\x{ord(letter) - 0xDC00:02x}")
        else:
            shown.append(letter.encode("unicode_escape").decode("ascii"))
    return "".join(shown)


@contextmanager
def naming(place: str) -> Iterator[None]:
    """Prefix errors with their place in a file."""
    try:
        yield
    except KeyError as error:
        raise ValueError(f"{place} has no {error.args[0]}") from None
    except (ValueError, TypeError, ArithmeticError, RecursionError) as error:
        raise ValueError(f"{place}: {one_line(error)}") from None


def one_line(error: BaseException) -> str:
    """Message of an error on one line, without control characters.

    Thousands of digits or letters are truncated.

    Examples
    --------
    >>> from resample.messages import one_line
    >>> one_line(ValueError("size " + "1" * 10_000))
    'size 1111111111...'
    """
    text = TOO_MANY_DIGITS.sub(TOO_LARGE, visible(_message(error)))
    text = DIGITS.sub(lambda found: f"{found[0][:10]}...", text)
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"


def _message(error: BaseException) -> str:
    cause = error.__cause__
    if cause is not None and hasattr(cause, "error_count"):  # pydantic's, wrapped by cyclopts
        error = cause
    if hasattr(error, "errors") and hasattr(error, "error_count"):  # pydantic.ValidationError
        return "; ".join(map(_field_error, error.errors()))
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, MemoryError):
        return " ".join(["not enough memory", *str(error).split()])
    return " ".join(str(error).split()) or type(error).__name__


def _field_error(detail: dict[str, object]) -> str:
    """A field's error of pydantic: `camera.fov: Input should be a valid number (got 'x')`."""
    place = detail["loc"]
    field = ".".join(map(str, place)) if isinstance(place, tuple) else ""
    message = " ".join(str(detail["msg"]).removeprefix("Value error, ").split())
    if detail["type"] == "literal_error" and isinstance(detail["input"], str):
        from difflib import get_close_matches

        known = re.findall(r"'([^']*)'", message)
        near = get_close_matches(detail["input"], known, n=1)
        message += f"; did you mean {near[0]}?" if near else ""
    return f"{field}: {message} (got {shortly(detail['input'])})" if field else message


def shortly(given: object) -> str:
    """Representation of an input on one line, shortened; numbers may have too many digits."""
    try:
        return f"{' '.join(repr(given).split()):.60}"
    except (ValueError, RecursionError):
        return type(given).__name__


Window = tuple[int, int, int, int]  # x0, y0, x1, y1, px of the whole picture; the end is exclusive
LARGEST_PICTURE = 2**28  # px


def shape_of(size: Sequence[int] | int) -> tuple[int, int]:
    """Height and width from a size, which is width and height, or both of a square, px."""
    import numpy as np

    both = (size, size) if isinstance(size, int | np.integer) else size
    width, height = pair_of("size", both, "width and height")
    check_size(height, width)
    return height, width


def pair_of(name: str, given: Any, wanted: str) -> tuple[int, int]:
    """Two whole numbers of px."""
    try:
        first, second = (operator.index(number) for number in given)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} {shortly(given)}; give {wanted}, two whole numbers of px"
        ) from None
    return first, second


def check_call(camera: Any, height: Any, width: Any, threads: Any) -> None:
    """Check a camera, the size of a picture and the number of threads."""
    check_size(*pair_of("height and width", (height, width), "both"))
    check_threads(threads)
    if hasattr(camera, "dtype") or not callable(getattr(camera, "view", None)):
        raise TypeError(
            f"a camera of {type(camera).__name__}; give a Camera or another with a view, such as "
            "Camera.from_fov(60, height, width)"
        )


def check_size(height: int, width: int) -> None:
    """Reject an invalid size of a picture, px."""
    if height < 1 or width < 1 or height * width > LARGEST_PICTURE:
        raise ValueError(
            f"a picture of {width} x {height} pixels; both sides must be at least 1 and there can "
            f"be at most {LARGEST_PICTURE} pixels"
        )
