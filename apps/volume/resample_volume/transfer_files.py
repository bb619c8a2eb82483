"""Files of transfer functions, JSON or TOML, and clear words on what is wrong with one."""

import json
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from resample.images import replacing
from resample_volume.transfer import Color, TransferFunction, from_points

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

SUFFIXES = (".json", ".toml")


def save_transfer(path: str | Path, transfer: TransferFunction) -> None:
    """Write a file from which `load_transfer` makes the same function, by suffix JSON or TOML.

    Raises
    ------
    ValueError
        The suffix is neither .json nor .toml.
    OSError
        The file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{path}: transfer functions are written as {' or '.join(SUFFIXES)}")
    head: dict[str, object] = {"normalized": transfer.normalized}
    if transfer.opacity_unit is not None:
        head["opacity_unit"] = transfer.opacity_unit
    columns = (transfer.value.tolist(), transfer.color.tolist(), transfer.opacity.tolist())
    rows = zip(*columns, strict=True)
    points = [dict(zip(_Point.model_fields, row, strict=True)) for row in rows]
    text = _toml(head, points) if suffix == ".toml" else json.dumps({**head, "points": points})
    with replacing(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _toml(head: dict[str, object], points: list[dict[str, object]]) -> str:
    """TOML, one point a line. Numbers, truth values and lists are written as in JSON."""
    lines = [f"{key} = {json.dumps(item)}" for key, item in head.items()]
    rows = [", ".join(f"{key} = {json.dumps(item)}" for key, item in p.items()) for p in points]
    return "\n".join([*lines, "points = [", *(f"    {{ {row} }}," for row in rows), "]"])


def _share(number: float) -> float:
    if not 0 <= number <= 1:
        raise ValueError("must be between 0 and 1")
    return number


def _displayed(given: object) -> Color:
    """Color as a file may write it."""
    import matplotlib.colors

    is_form_known = isinstance(given, str) or (isinstance(given, list) and len(given) == 3)
    if is_form_known and matplotlib.colors.is_color_like(given):
        return matplotlib.colors.to_rgb(given)  # type: ignore[arg-type]
    raise ValueError("must be '#rrggbb', a color's name or [red, green, blue] between 0 and 1")


class _Point(BaseModel):
    """A control point in a file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    value: float
    color: Annotated[Color, BeforeValidator(_displayed)]
    opacity: Annotated[float, AfterValidator(_share)]


class _Document(BaseModel):
    """A transfer function's file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    normalized: bool = False
    opacity_unit: Annotated[float, Field(gt=0)] | None = None
    points: Annotated[list[_Point], Field(min_length=1)]


def read_transfer(path: Path) -> TransferFunction:
    """Transfer function of a file.

    Raises
    ------
    ValueError
        What the file holds is no transfer function; says where and what would be.
    OSError
        The file cannot be read.
    """
    try:
        document = _Document.model_validate(_parsed(path))
        points = [(point.value, point.color, point.opacity) for point in document.points]
        return from_points(
            points, opacity_unit=document.opacity_unit, normalized=document.normalized
        )
    except ValidationError as error:
        complaints = "; ".join(map(_complaint, error.errors()))
        raise ValueError(f"{path}: {complaints}") from None
    except json.JSONDecodeError as error:
        place = f"at line {error.lineno}, column {error.colno}"
        raise ValueError(f"{path}: {error.msg} ({place})") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is not UTF-8 text (at byte {error.start})") from None
    except ValueError as error:  # TOML's message ends in line and column
        raise ValueError(f"{path}: {error}") from None


def _parsed(path: Path) -> object:
    text = path.read_text(encoding="utf-8")
    return tomllib.loads(text) if path.suffix.lower() == ".toml" else json.loads(text)


def _complaint(detail: "ErrorDetails") -> str:
    """One of pydantic's findings: `points.2.opacity: must be between 0 and 1 (got 1.7)`."""
    place = ".".join(map(str, detail["loc"]))
    known = (_Point if "." in place else _Document).model_fields
    got = f" (got {detail['input']!r:.40})"
    text = detail["msg"].removeprefix("Value error, ").replace("Input should be", "must be") + got
    match detail["type"]:
        case "missing":
            text = "is missing"
        case "extra_forbidden":
            text = f"is unknown; known: {', '.join(known)}"
        case "model_type":
            text = f"must be a table of {', '.join(known)}{got}"
    return f"{place}: {text}" if place else text
