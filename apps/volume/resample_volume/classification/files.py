"""Read files of transfer functions, JSON or TOML."""

import json
import math
from pathlib import Path
from typing import Annotated

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
)

from resample.reading.limits import check_size
from resample.reading.texts import json_of, toml_of
from resample_volume.classification.transfer import (
    Color,
    Region,
    RegionTransfer,
    Transfer,
    TransferFunction,
    from_points,
)


def _share(number: float) -> float:
    if not 0 <= number <= 1:
        raise ValueError("must be between 0 and 1")
    return number


def displayed_color(given: object) -> Color:
    """Parse a color to sRGB, 0..1, from a code, a name or three numbers."""
    import matplotlib.colors

    is_form_known = isinstance(given, str) or (isinstance(given, list) and len(given) == 3)
    if is_form_known and matplotlib.colors.is_color_like(given):
        return matplotlib.colors.to_rgb(given)  # type: ignore[arg-type]
    raise ValueError("must be '#rrggbb', a color's name or [red, green, blue] between 0 and 1")


class _Point(BaseModel):
    """A control point in a file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    value: float
    color: Annotated[Color, BeforeValidator(displayed_color)]
    opacity: Annotated[float, AfterValidator(_share)]


def _ends(given: object, info: ValidationInfo) -> tuple[float, float]:
    """Parse a range, in which null is infinity in JSON, or a softness."""
    is_range = info.field_name != "softness"
    if isinstance(given, list) and len(given) == 2:
        low, high = (
            end if bound is None and is_range else bound
            for bound, end in zip(given, (-math.inf, math.inf), strict=True)
        )
        if _is_number(low) and _is_number(high):
            return float(low), float(high)
    meaning = "[least, greatest]; inf is allowed" if is_range else "[along values, along gradients]"
    raise ValueError(f"must be two numbers, {meaning}")


def _is_number(given: object) -> bool:
    return isinstance(given, int | float) and not isinstance(given, bool) and not math.isnan(given)


class _Region(BaseModel):
    """A region in a file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    value: Annotated[tuple[float, float], BeforeValidator(_ends)]
    color: Annotated[Color, BeforeValidator(displayed_color)]
    opacity: Annotated[float, AfterValidator(_share)]
    gradient: Annotated[tuple[float, float], BeforeValidator(_ends)] = Region.gradient
    softness: Annotated[tuple[float, float], BeforeValidator(_ends)] = Region.softness


class _Head(BaseModel):
    """Keys of all files."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    normalized: bool = False
    opacity_unit: Annotated[float, Field(gt=0)] | None = None


class _Points(_Head):
    """File of a function of values."""

    points: Annotated[list[_Point], Field(min_length=1)]

    def transfer(self) -> TransferFunction:
        points = [(point.value, point.color, point.opacity) for point in self.points]
        return from_points(points, opacity_unit=self.opacity_unit, normalized=self.normalized)


class _Regions(_Head):
    """File of a function of values and gradients."""

    regions: Annotated[list[_Region], Field(min_length=1)]

    def transfer(self) -> RegionTransfer:
        regions = [Region(**region.model_dump()) for region in self.regions]
        return RegionTransfer(tuple(regions), self.opacity_unit, self.normalized)


def read_transfer(path: Path) -> Transfer:
    """Read a transfer function of `points` over values or `regions` over values and gradients."""
    try:
        check_size(str(path), path.stat().st_size, "tree")
        text = path.read_text(encoding="utf-8-sig")
        content = toml_of(text) if path.suffix.lower() == ".toml" else json_of(text)
        form = _Regions if isinstance(content, dict) and "regions" in content else _Points
        return form.model_validate(content).transfer()
    except ValidationError as error:
        # As in `points.2.opacity: must be between 0 and 1 (got 1.7)`
        complaints = []
        for detail in error.errors():
            is_region = detail["loc"][:1] == ("regions",)
            if len(detail["loc"]) < 2:
                keys = dict.fromkeys([*_Points.model_fields, *_Regions.model_fields])
            else:
                keys = dict.fromkeys((_Region if is_region else _Point).model_fields)
            got = f" (got {detail['input']!r:.40})"
            text = detail["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
            texts = {
                "missing": "is missing",
                "extra_forbidden": f"is unknown; known: {', '.join(keys)}",
                "model_type": f"must be a table of {', '.join(keys)}{got}",
            }
            place = ".".join(map(str, detail["loc"]))
            complaints.append(f"{place}: " * bool(place) + texts.get(detail["type"], text + got))
        raise ValueError(f"{path}: {'; '.join(complaints)}") from None
    except json.JSONDecodeError as error:
        place = f"at line {error.lineno}, column {error.colno}"
        raise ValueError(f"{path}: {error.msg} ({place})") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is not UTF-8 text (at byte {error.start})") from None
    except ValueError as error:  # TOML's message ends in line and column
        raise ValueError(f"{path}: {error}") from None
