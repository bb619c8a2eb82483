"""Which color and opacity a data value gets: transfer functions of one variable and their files."""

import json
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from resample.images import from_srgb, replacing
from resample.types import Doubles, Floats

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

MOST_OPAQUE = 1 - 1e-6  # opacity 1 would be infinite extinction
SUFFIXES = (".json", ".toml")

DataRange = tuple[float, float]  # least and greatest finite value of a volume
Color = tuple[float, float, float]  # sRGB as displayed, 0..1
Point = tuple[float, Color, float]  # value, color, opacity

BLACK, WHITE, RED = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.85, 0.12, 0.08)
BLUE, SAND = (0.15, 0.25, 0.55), (0.95, 0.85, 0.6)
GLASS, AMBER = (0.55, 0.65, 0.75), (1.0, 0.6, 0.2)


@dataclass(frozen=True, eq=False)
class TransferFunction:
    """Color and opacity, linear between K control points.

    Two points at one value make a step; the later holds at and above that value. Below the first
    and above the last point their colors and opacities go on. Colors are interpolated as they are
    displayed and turned into linear light afterwards, so that a ramp looks even.

    Raises
    ------
    ValueError
        Shapes do not fit, values descend, or a number is outside its range.
    """

    value: Doubles  # (K,) ascending; data units, or 0..1 of the data's range
    color: Doubles  # (K, 3) sRGB as displayed, 0..1
    opacity: Doubles  # (K,) 0..1 of a layer that is one `opacity_unit` thick
    opacity_unit: float | None = None  # scene units; None: cube root of a voxel's volume
    normalized: bool = False  # whether values are positions between the data's least and greatest

    def __post_init__(self) -> None:
        for name in ("value", "color", "opacity"):
            array = np.array(getattr(self, name), np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        _check(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TransferFunction) and self._identity() == other._identity()

    def __hash__(self) -> int:
        return hash(self._identity())

    def __call__(self, values: ArrayLike, data_range: DataRange) -> tuple[Floats, Floats]:
        """Color and opacity of data values.

        Parameters
        ----------
        values
            (N,) numbers. NaN is transparent and black.
        data_range
            Least and greatest finite value of the data; only normalized functions look at it.
            Where both are equal, the last point holds.

        Returns
        -------
        (N, 3) linear light, and (N,) opacity of one `opacity_unit`.
        """
        return self.colors(values, data_range), self.opacities(values, data_range)

    def colors(self, values: ArrayLike, data_range: DataRange) -> Floats:
        """Color of data values in linear light, (N, 3)."""
        place = self._places(data_range)
        given = np.asarray(values)
        channel = [np.interp(given, place, self.color[:, c]) for c in range(3)]
        displayed = np.nan_to_num(np.stack(channel, axis=-1), nan=0.0)
        return np.asarray(from_srgb(displayed), np.float32)

    def opacities(self, values: ArrayLike, data_range: DataRange) -> Floats:
        """Opacity of data values, (N,)."""
        opacity = np.interp(np.asarray(values), self._places(data_range), self.opacity)
        return np.asarray(np.nan_to_num(opacity, nan=0.0), np.float32)

    def _places(self, data_range: DataRange) -> Doubles:
        """Control points in data units, ascending in spite of rounding."""
        if not self.normalized:
            return self.value
        low, high = data_range
        place = np.clip(low * (1 - self.value) + high * self.value, low, high)
        return np.maximum.accumulate(place)

    def _identity(self) -> tuple[object, ...]:
        arrays = (self.value.tobytes(), self.color.tobytes(), self.opacity.tobytes())
        return (*arrays, self.opacity_unit, self.normalized)


def extinction(opacity: NDArray[Any], unit: float) -> Floats:
    """Optical depth per scene unit.

    Parameters
    ----------
    opacity
        (N,) 0..1 of a layer of the thickness `unit`; at most `MOST_OPAQUE` is used.
    unit
        Scene units.
    """
    share = np.minimum(np.asarray(opacity, np.float64), MOST_OPAQUE)
    return np.asarray(-np.log1p(-share) / unit, np.float32)


def from_points(
    points: Sequence[Point], *, opacity_unit: float | None = None, normalized: bool = False
) -> TransferFunction:
    """Transfer function of a list of control points: value, color, opacity."""
    value, color, opacity = (np.array(part) for part in zip(*points, strict=True))
    return TransferFunction(value, color, opacity, opacity_unit, normalized)


PRESETS: dict[str, Callable[[], TransferFunction]] = {
    # CT of a head: soft tissue lies near a quarter of the range, bone from two fifths on.
    "bone": partial(
        from_points,
        [
            (0.32, (0.55, 0.25, 0.15), 0.0),
            (0.4, (0.85, 0.65, 0.45), 0.25),
            (0.5, (0.95, 0.88, 0.75), 0.7),
            (1.0, WHITE, 0.95),
        ],
        normalized=True,
    ),
    # Angiography: brighter and denser toward the axis of a vessel.
    "vessels": partial(
        from_points,
        [
            (0.08, (0.45, 0.02, 0.02), 0.0),
            (0.2, (0.8, 0.15, 0.1), 0.3),
            (0.5, (0.95, 0.4, 0.3), 0.7),
            (1.0, (1.0, 0.9, 0.75), 0.9),
        ],
        normalized=True,
    ),
    # The block as glass around its denser parts.
    "engine": partial(
        from_points,
        [(70, GLASS, 0.0), (130, GLASS, 0.04), (175, GLASS, 0.04), (195, AMBER, 0.7)],
    ),
    # A translucent shell around white meat, as in the paper's Figure 8f; the resin ends at 30.
    "lobster": partial(
        from_points,
        [(30, RED, 0.0), (45, RED, 0.05), (95, RED, 0.12), (115, WHITE, 0.4), (150, WHITE, 0.8)],
    ),
    "checker": partial(from_points, [(64, BLUE, 1.0), (128, BLUE, 1.0), (128, SAND, 1.0)]),
    "gray": partial(from_points, [(0.0, BLACK, 0.0), (1.0, WHITE, 1.0)], normalized=True),
    # The paper's Figure 9: 1,160,038, 114,695 and 190,815 voxels are not transparent.
    "paper-engine": partial(from_points, [(71, WHITE, 0.0), (71, WHITE, 0.3)]),
    "paper-aneurism": partial(from_points, [(25, WHITE, 0.0), (25, WHITE, 0.3)]),
    "paper-lobster": partial(
        from_points,
        [
            (65, RED, 0.0),
            (65, RED, 0.1),
            (95, RED, 0.1),
            (115, WHITE, 0.3),
            (222, WHITE, 0.3),
            (222, WHITE, 0.0),
        ],
    ),
}


def load_transfer(name: str | Path) -> TransferFunction:
    """Transfer function by name or from a file.

    Parameters
    ----------
    name
        One of `PRESETS`; else a matplotlib colormap, over the range of the data and with an
        opacity that rises from 0 to 1; or a file ending in .json or .toml. After a name
        `:opacity=0.2,low=0.3` multiplies all opacities (0..1) and makes transparent what is below
        a value (for colormaps 0..1 of the data's range).

    Raises
    ------
    ValueError
        The name or a parameter is unknown, or the file's content is not what it should be.
    OSError
        The file cannot be read.
    """
    if Path(name).suffix.lower() in SUFFIXES:
        return _read(Path(name))
    base, _, text = str(name).partition(":")
    transfer = PRESETS[base]() if base in PRESETS else _colormap(base)
    try:
        for key, number in _parameters(text).items():
            transfer = ADJUSTMENTS[key](transfer, number)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    return transfer


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


def _colormap(name: str) -> TransferFunction:
    import matplotlib

    if name not in matplotlib.colormaps:
        raise ValueError(
            f"unknown transfer function {name!r}; known: {', '.join(PRESETS)}; the name of a "
            "matplotlib colormap or a .json or .toml file will also do"
        )
    position = np.linspace(0, 1, 256)
    color = np.asarray(matplotlib.colormaps[name](position))[:, :3]
    return TransferFunction(position, color, position, normalized=True)


def _parameters(text: str) -> dict[str, float]:
    """Numbers of `opacity=0.2,low=0.3`."""
    number = {}
    for part in filter(None, text.split(",")):
        key, _, given = part.partition("=")
        if key not in ADJUSTMENTS:
            raise ValueError(f"unknown parameter {key!r}; known: {', '.join(ADJUSTMENTS)}")
        try:
            number[key] = float(given)
        except ValueError:
            raise ValueError(f"{key} must be a number (got {given!r})") from None
    return number


def _thinned(transfer: TransferFunction, opacity: float) -> TransferFunction:
    """All opacities multiplied."""
    if not 0 <= opacity <= 1:
        raise ValueError(f"opacity must be between 0 and 1 (got {opacity})")
    return replace(transfer, opacity=opacity * transfer.opacity)


def _cut(transfer: TransferFunction, low: float) -> TransferFunction:
    """Transparent below a value."""
    if not np.isfinite(low) or (transfer.normalized and not 0 <= low <= 1):
        raise ValueError(f"low must be {'between 0 and 1' if transfer.normalized else 'finite'}")
    above = transfer.value > low
    edge = np.array([np.interp(low, transfer.value, transfer.color[:, c]) for c in range(3)])
    opacity = np.interp(low, transfer.value, transfer.opacity)
    return replace(
        transfer,
        value=np.concatenate([[low, low], transfer.value[above]]),
        color=np.concatenate([[edge, edge], transfer.color[above]]),
        opacity=np.concatenate([[0.0, opacity], transfer.opacity[above]]),
    )


ADJUSTMENTS = {"opacity": _thinned, "low": _cut}


def _check(transfer: TransferFunction) -> None:
    value, color, opacity = transfer.value, transfer.color, transfer.opacity
    if value.ndim != 1 or not value.size or opacity.shape != value.shape:
        raise ValueError(f"{value.shape} values do not fit {opacity.shape} opacities, (K,) each")
    if color.shape != (value.size, 3):
        raise ValueError(f"{value.size} points need colors of the shape ({value.size}, 3)")
    if transfer.opacity_unit is not None and not 0 < transfer.opacity_unit < np.inf:
        raise ValueError(f"opacity_unit: must be greater than 0 (got {transfer.opacity_unit})")
    _check_shares("color", color)
    _check_shares("opacity", opacity)
    if transfer.normalized:
        _check_shares("value", value, " where normalized")
    for n in range(value.size):
        if not np.isfinite(value[n]) or value[n] < value[max(n - 1, 0)]:
            raise ValueError(f"points.{n}.value: must be finite and not descend (got {value[n]})")


def _check_shares(name: str, array: Doubles, when: str = "") -> None:
    for n, number in enumerate(array):
        if not np.all((number >= 0) & (number <= 1)):
            raise ValueError(f"points.{n}.{name}: must be between 0 and 1{when} (got {number})")


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


def _read(path: Path) -> TransferFunction:
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
