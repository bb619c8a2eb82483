"""Transfer functions of values, by control points, and of values and gradients, by regions.

Kniss, Kindlmann and Hansen, Multidimensional Transfer Functions for Interactive Volume Rendering,
2002. A boundary between two materials is an arch over their values, with the highest gradient in
the middle; so a region of high gradients shows a surface even if its values also occur elsewhere.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.colors import from_srgb, to_srgb
from resample.types import Doubles, Floats

SUFFIXES = (".json", ".toml")  # of files that hold one
MOST_OPAQUE = 1 - 1e-6  # opacity 1 would be infinite extinction

DataRange = tuple[float, float]  # least and greatest finite value of a volume
Color = tuple[float, float, float]  # sRGB as displayed, 0..1
Point = tuple[float, Color, float]  # value, color, opacity


class Transfer(Protocol):
    """Protocol of a transfer function. It is a dataclass, so `dataclasses.replace` works."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def opacity_unit(self) -> float | None:
        """Thickness that opacities refer to, scene units; None: cube root of a voxel's volume."""

    @property
    def normalized(self) -> bool:
        """Whether values are positions between the data's least and greatest."""

    @property
    def needs_gradient(self) -> bool:
        """Whether looks depend on gradients."""

    def opacities(self, values: ArrayLike, data_range: DataRange) -> Floats:
        """Return the greatest opacity (N,) of values at any slope; 0 for NaN."""

    def classify(
        self, values: NDArray[Any], slopes: Floats | None, data_range: DataRange, steep: float
    ) -> tuple[Floats, Floats]:
        """Return color (N, 3) in linear light and opacity (N,) by value and gradient length.

        `values`: (N,) data units. NaN is transparent. `slopes`: (N,) data units per scene unit;
        None if the function does not need them. `data_range`: least and greatest finite value of
        the data. `steep`: slope of a full surface, data units per scene unit; unit of fractions.
        """

    def steepest(self, steep: float) -> float:
        """Return the slope above which looks do not change; `steep`: slope of a full surface."""

    def thinned(self, share: float) -> Self:
        """Return the function with all opacities multiplied."""

    def cut(self, low: float) -> Self:
        """Return the function made transparent below a value, in its own units."""


@dataclass(frozen=True, eq=False)
class TransferFunction:
    """Color and opacity, linear between K control points.

    Two points at one value make a step; the later one applies at and above that value. Outside, the
    first and the last point apply. Colors are interpolated in sRGB and converted to linear light
    afterwards, so that a ramp looks even.

    Raises
    ------
    ValueError
        Shapes do not fit, values descend, or a number is outside its range.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import TransferFunction
    >>> color = np.array([[0, 0, 0], [1, 0.8, 0.2]])
    >>> ramp = TransferFunction(np.array([100.0, 300.0]), color, np.array([0.0, 0.5]))
    >>> _, opacity = ramp.classify(np.array([0.0, 200.0, 900.0]), None, (0.0, 1000.0), 0.0)
    >>> opacity
    array([0.  , 0.25, 0.5 ], dtype=float32)
    """

    value: Doubles  # (K,) ascending; data units, or 0..1 of the data's range
    color: Doubles  # (K, 3) sRGB as displayed, 0..1
    opacity: Doubles  # (K,) 0..1 of a layer that is one `opacity_unit` thick
    opacity_unit: float | None = None  # scene units; None: cube root of a voxel's volume
    normalized: bool = False  # whether values are positions between the data's least and greatest
    needs_gradient: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for name in ("value", "color", "opacity"):
            array = np.array(getattr(self, name), np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        value, color, opacity = self.value, self.color, self.opacity
        if value.ndim != 1 or not value.size or opacity.shape != value.shape:
            raise ValueError(
                f"{value.shape} values do not fit {opacity.shape} opacities, (K,) each"
            )
        if color.shape != (value.size, 3):
            raise ValueError(f"{value.size} points need colors of the shape ({value.size}, 3)")
        if self.opacity_unit is not None and not 0 < self.opacity_unit < np.inf:
            raise ValueError(f"opacity_unit: must be greater than 0 (got {self.opacity_unit})")
        _check_shares("color", color)
        _check_shares("opacity", opacity)
        if self.normalized:
            _check_shares("value", value, " where normalized")
        for n in range(value.size):
            if not np.isfinite(value[n]) or value[n] < value[max(n - 1, 0)]:
                raise ValueError(
                    f"points.{n}.value: must be finite and not descend (got {value[n]})"
                )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TransferFunction) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @property
    def _identity(self) -> tuple[object, ...]:
        arrays = (self.value.tobytes(), self.color.tobytes(), self.opacity.tobytes())
        return (*arrays, self.opacity_unit, self.normalized)

    def __call__(self, values: ArrayLike, data_range: DataRange) -> tuple[Floats, Floats]:
        """Return color and opacity of data values.

        Parameters
        ----------
        values
            (N,) numbers. NaN is transparent and black.
        data_range
            Least and greatest finite value of the data; only used by normalized functions. If both
            are equal, the last point applies.

        Returns
        -------
        (N, 3) linear light, and (N,) opacity of one `opacity_unit`.
        """
        return self.colors(values, data_range), self.opacities(values, data_range)

    def colors(self, values: ArrayLike, data_range: DataRange) -> Floats:
        """Return colors of data values in linear light, (N, 3)."""
        place = self.placed(data_range)
        given = np.asarray(values)
        channel = [np.interp(given, place, self.color[:, c]) for c in range(3)]
        if self.value.size == 1:
            channel = [np.where(np.isnan(given), np.nan, part) for part in channel]
        displayed = np.nan_to_num(np.stack(channel, axis=-1), nan=0.0)
        return np.asarray(from_srgb(displayed), np.float32)

    def opacities(self, values: ArrayLike, data_range: DataRange) -> Floats:
        """Return opacities of data values, (N,)."""
        opacity = np.interp(np.asarray(values), self.placed(data_range), self.opacity)
        if self.value.size == 1:  # NumPy would also give its value to NaN
            opacity = np.where(np.isnan(values), np.nan, opacity)
        return np.asarray(np.nan_to_num(opacity, nan=0.0), np.float32)

    def classify(
        self, values: NDArray[Any], slopes: Floats | None, data_range: DataRange, steep: float
    ) -> tuple[Floats, Floats]:
        del slopes, steep
        opacity = evaluated(self.opacities, values, data_range)
        return evaluated(self.colors, values, data_range), opacity

    def steepest(self, steep: float) -> float:
        del steep
        return 0.0

    def thinned(self, share: float) -> "TransferFunction":
        return replace(self, opacity=share * self.opacity)

    def cut(self, low: float) -> "TransferFunction":
        above = self.value > low
        edge = np.array([np.interp(low, self.value, self.color[:, c]) for c in range(3)])
        opacity = np.interp(low, self.value, self.opacity)
        return replace(
            self,
            value=np.concatenate([[low, low], self.value[above]]),
            color=np.concatenate([[edge, edge], self.color[above]]),
            opacity=np.concatenate([[0.0, opacity], self.opacity[above]]),
        )

    def placed(self, data_range: DataRange) -> Doubles:
        """Return the values of control points in data units, ascending despite rounding."""
        if not self.normalized:
            return self.value
        low, high = data_range
        place = np.clip(low * (1 - self.value) + high * self.value, low, high)
        return np.maximum.accumulate(place)


class TransferTable(NamedTuple):
    """A transfer function as a table; the first fields of `resample.types.Classifier`."""

    table: Floats  # (G, K, 4) straight linear RGB, and optical depth per scene unit
    low: float  # data units, the value of the first column
    high: float  # data units, the value of the last column, above `low`
    steep: float  # data units per scene unit, the slope of the last row, > 0; the first row's is 0


def tabulated(
    transfer: Transfer, data_range: DataRange, steep: float, unit: float,
    shape: tuple[int, int] = (64, 4096),
    changed: Callable[[Floats, Floats], tuple[Floats, Floats]] | None = None,
) -> TransferTable:  # fmt: skip
    """Tabulate looks by value (K columns) and slope (G rows), changed by `changed`.

    Rows go from 0 to the slope above which looks do not change; `steep`: slope of a full surface.
    `unit` is the thickness that opacities refer to, scene units.
    """
    low, high = data_range
    end = transfer.steepest(steep)
    rows = shape[0] if transfer.needs_gradient else 1
    value, slope = np.linspace(low, high, shape[1]), np.linspace(0, end, rows, dtype=np.float32)
    values, slopes = np.tile(value, rows), np.repeat(slope, shape[1])
    color, opacity = transfer.classify(values, slopes, data_range, steep)
    if changed is not None:
        color, opacity = changed(color, opacity)
    columns = np.column_stack([color, extinction(opacity, unit)])
    least = max(1e-37, 1e-7 * abs(low))
    return TransferTable(
        np.ascontiguousarray(columns.reshape(rows, shape[1], 4)),
        low,
        (low + max(least, high - low) if high > low else low + max(1.0, least)),
        end if end > 0 else 1.0,
    )


def _every_value(dtype: np.dtype[Any]) -> NDArray[Any] | None:
    """Return all values of a type in the order of their bits, if few; otherwise None."""
    if dtype.kind not in "iu" or dtype.itemsize > 2:
        return None
    return np.arange(1 << (8 * dtype.itemsize)).astype(f"u{dtype.itemsize}").view(dtype)


def evaluated(
    function: Callable[[NDArray[Any], DataRange], Floats],
    values: NDArray[Any],
    data_range: DataRange,
) -> Floats:
    """Evaluate a function of values (N,), by a table for types of few values."""
    every = _every_value(values.dtype)
    if every is None:
        return function(values, data_range)
    return np.take(function(every, data_range), values.view(f"u{every.itemsize}"), axis=0)


def visible_places(
    transfer: Transfer, values: NDArray[Any], data_range: DataRange
) -> NDArray[np.int64]:
    """Return ascending indices of values (N,) with non-zero opacity at some slope."""
    every = _every_value(values.dtype)
    if every is None:
        return np.flatnonzero(transfer.opacities(values, data_range) > 0)
    is_seen = transfer.opacities(every, data_range) > 0
    if not is_seen.any():
        return np.zeros(0, np.int64)
    low, high = every[is_seen].min(), every[is_seen].max()
    place = np.flatnonzero((values >= low) & (values <= high))
    if is_seen[(every >= low) & (every <= high)].all():
        return place
    return place[np.take(is_seen, values[place].view(f"u{every.itemsize}"))]


def extinction(opacity: NDArray[Any], unit: float) -> Floats:
    """Return the optical depth per scene unit of opacities (N,) of a layer of `unit`."""
    share = np.minimum(np.asarray(opacity, np.float64), MOST_OPAQUE)
    with np.errstate(over="ignore"):
        depth = np.asarray(-np.log1p(-share) / unit, np.float32)
    if not np.isfinite(depth).all():
        raise ValueError(
            f"opacities over a length of {unit:g} scene units give infinite optical depths"
        )
    return depth


def from_points(
    points: Sequence[Point], *, opacity_unit: float | None = None, normalized: bool = False
) -> TransferFunction:
    """Make a transfer function of control points: value, color, opacity."""
    value, color, opacity = (np.array(part) for part in zip(*points, strict=True))
    return TransferFunction(value, color, opacity, opacity_unit, normalized)


def _check_shares(name: str, array: Doubles, when: str = "") -> None:
    for n, number in enumerate(array):
        if not np.all((number >= 0) & (number <= 1)):
            raise ValueError(f"points.{n}.{name}: must be between 0 and 1{when} (got {number})")


TINY = 1e-30  # opacity too small to affect color


@dataclass(frozen=True)
class Materials:
    """Several transfer functions at once.

    Light passes through all materials of a value, in any order: their transparencies multiply, and
    colors are averaged in linear light by opacity.
    """

    parts: tuple[Transfer, ...]
    opacity_unit: float | None = None  # scene units; None: cube root of a voxel's volume

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts:
            raise ValueError("materials: give at least one")
        units = {part.opacity_unit for part in self.parts}
        if self.opacity_unit is None and len(units) == 1:
            object.__setattr__(self, "opacity_unit", *units)
        elif self.opacity_unit is None:
            raise ValueError("materials must have the same opacity_unit; give one for all")

    @property
    def normalized(self) -> bool:
        return any(part.normalized for part in self.parts)

    @property
    def needs_gradient(self) -> bool:
        return any(part.needs_gradient for part in self.parts)

    def opacities(self, values: ArrayLike, data_range: DataRange) -> Floats:
        transparency = 1 - np.asarray(self.parts[0].opacities(values, data_range), np.float64)
        for part in self.parts[1:]:
            transparency *= 1 - part.opacities(values, data_range)
        return np.asarray(1 - transparency, np.float32)

    def classify(
        self, values: NDArray[Any], slopes: Floats | None, data_range: DataRange, steep: float
    ) -> tuple[Floats, Floats]:
        color = np.zeros((values.size, 3), np.float32)
        weight, transparency = np.zeros(values.size, np.float32), np.ones(values.size)
        for part in self.parts:
            own, opacity = part.classify(values, slopes, data_range, steep)
            color += opacity[:, np.newaxis] * own
            weight += opacity
            transparency *= 1 - opacity.astype(np.float64)
        color /= np.maximum(weight, TINY)[:, np.newaxis]
        return color, (1 - transparency).astype(np.float32)

    def steepest(self, steep: float) -> float:
        return max(part.steepest(steep) for part in self.parts)

    def thinned(self, share: float) -> "Materials":
        return replace(self, parts=tuple(part.thinned(share) for part in self.parts))

    def cut(self, low: float) -> "Materials":
        return replace(self, parts=tuple(part.cut(low) for part in self.parts))


@dataclass(frozen=True)
class Windowed:
    """A transfer function of fractions, rescaled to a given range of values."""

    transfer: Transfer
    span: DataRange
    opacity_unit: float | None = None  # scene units; None: the function's own
    steep: float | None = None  # data units per scene unit, of a full surface; None: the data's
    normalized: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.opacity_unit is None:
            object.__setattr__(self, "opacity_unit", self.transfer.opacity_unit)

    @property
    def needs_gradient(self) -> bool:
        return self.transfer.needs_gradient

    def opacities(self, values: ArrayLike, data_range: DataRange) -> Floats:
        del data_range
        return self.transfer.opacities(values, self.span)

    def classify(
        self, values: NDArray[Any], slopes: Floats | None, data_range: DataRange, steep: float
    ) -> tuple[Floats, Floats]:
        del data_range
        steep = steep if self.steep is None else self.steep
        return self.transfer.classify(values, slopes, self.span, steep)

    def steepest(self, steep: float) -> float:
        return self.transfer.steepest(steep if self.steep is None else self.steep)

    def thinned(self, share: float) -> "Windowed":
        return replace(self, transfer=self.transfer.thinned(share))

    def cut(self, low: float) -> "Windowed":
        return replace(self, transfer=self.transfer.cut(low))


def spread(transfer: Transfer, span: DataRange) -> Transfer:
    """Rescale a transfer function of fractions to a range in data units."""
    if not transfer.normalized:
        return transfer
    if isinstance(transfer, Materials):
        return replace(transfer, parts=tuple(spread(part, span) for part in transfer.parts))
    if isinstance(transfer, TransferFunction):
        return replace(transfer, value=transfer.placed(span), normalized=False)
    return Windowed(transfer, span)


TOLERANCE = 1 + 1e-6  # borders are inclusive
CHUNK = 1 << 20  # values processed together
LEAST = float(np.finfo(np.float64).tiny)

Range = tuple[float, float]


@dataclass(frozen=True)
class Region:
    """A rectangle over values and gradients with a color and an opacity.

    Borders are inclusive. With softness, opacity rises from 0 at the border to its full height at
    that distance inside. A range is open where it ends at a limit of the data (a gradient of 0,
    infinity, or 0 and 1 of a normalized range): that border is not soft, and values beyond it count
    as inside.
    """

    value: Range  # data units, or 0..1 of the data's range
    color: Color  # sRGB as displayed, 0..1
    opacity: float  # 0..1 of a layer that is one `opacity_unit` thick
    gradient: Range = (0.0, math.inf)  # data units per scene unit, or 0..1 of a full surface's
    softness: Range = (0.0, 0.0)  # along values and gradients, in their units; at most half a range


@dataclass(frozen=True)
class RegionTransfer:
    """Color and opacity by regions over values and gradient lengths.

    Where several overlap, light passes through all of them, in any order: transparencies multiply,
    and colors are averaged in linear light by opacity. Gradients are in data units per scene unit.
    If `normalized`, values are positions in the data's range, and gradients fractions of the 99th
    percentile of their lengths over all voxels that regions may show by value.
    """

    regions: tuple[Region, ...]
    opacity_unit: float | None = None  # scene units; None: cube root of a voxel's volume
    normalized: bool = False
    needs_gradient: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "regions", tuple(self.regions))
        if not self.regions:
            raise ValueError("a transfer function of regions needs at least one")
        if self.opacity_unit is not None and not 0 < self.opacity_unit < np.inf:
            raise ValueError(f"opacity_unit: must be greater than 0 (got {self.opacity_unit})")
        for n, region in enumerate(self.regions):
            where = f"regions.{n}"
            top = 1.0 if self.normalized else math.inf
            low, high = region.gradient
            gradient = (low, min(high, top) if math.isinf(high) else high)
            least = 0.0 if self.normalized else -math.inf
            spans = (("value", region.value, least), ("gradient", gradient, 0.0))
            for name, (low, high), limit in spans:
                if not limit <= low <= high <= top:
                    raise ValueError(
                        f"{where}.{name}: must be two numbers that ascend, from {limit:g} to "
                        f"{top:g} (got {low:g}, {high:g})"
                    )
            shares = [("opacity", region.opacity), *(("color", part) for part in region.color)]
            for name, share in shares:
                if not 0 <= share <= 1:
                    raise ValueError(f"{where}.{name}: must be between 0 and 1 (got {share})")
            for soft, span in zip(region.softness, (region.value, gradient), strict=True):
                if not 0 <= soft <= (span[1] - span[0]) / 2:
                    raise ValueError(
                        f"{where}.softness: must be from 0 to half the range's width (got {soft:g} "
                        f"for {span[0]:g} to {span[1]:g})"
                    )

    def opacities(self, values: ArrayLike, data_range: DataRange) -> Floats:
        """Return an upper bound of opacities (N,), for gradients within all regions."""
        place = self._places(np.asarray(values), data_range)
        transparency = np.ones(place.shape)
        for region in self.regions:
            share = _share(place, region.value, region.softness[0], self._limits)
            transparency *= 1 - region.opacity * share
        return np.asarray(1 - transparency, np.float32)

    def classify(
        self, values: NDArray[Any], slopes: Floats | None, data_range: DataRange, steep: float
    ) -> tuple[Floats, Floats]:
        if slopes is None:
            raise ValueError("regions over values and gradients need gradients")
        color = np.empty((values.size, 3), np.float32)
        opacity = np.empty(values.size, np.float32)
        for start in range(0, values.size, CHUNK):
            part = slice(start, start + CHUNK)
            place = self._places(values[part], data_range)
            slope = slopes[part].astype(np.float64)
            if self.normalized:
                slope = np.minimum(slope / max(steep, LEAST), 1)
            # Combine color and opacity of all regions
            transparency, weight = np.ones(place.shape), np.zeros(place.shape)
            mixed = np.zeros((*place.shape, 3))
            for region in self.regions:
                limits = (0.0, 1.0 if self.normalized else math.inf)
                inside = _share(place, region.value, region.softness[0], self._limits)
                inside = inside * _share(slope, region.gradient, region.softness[1], limits)
                share = region.opacity * inside
                transparency *= 1 - share
                weight += share
                mixed += share[:, np.newaxis] * from_srgb(np.array(region.color))
            mixed /= np.maximum(weight, LEAST)[:, np.newaxis]
            color[part], opacity[part] = mixed, 1 - transparency
        return color, opacity

    def steepest(self, steep: float) -> float:
        if self.normalized:
            return steep
        # Beyond these gradients a region does not change
        ends = [(one.gradient[0] + one.softness[1], one.gradient[1]) for one in self.regions]
        return max(end for pair in ends for end in pair if math.isfinite(end)) * TOLERANCE

    def thinned(self, share: float) -> "RegionTransfer":
        thinner = [replace(region, opacity=share * region.opacity) for region in self.regions]
        return replace(self, regions=tuple(thinner))

    def cut(self, low: float) -> "RegionTransfer":
        kept = []
        for region in self.regions:
            first, high = region.value
            if first < low <= high:
                soft = (min(region.softness[0], (high - low) / 2), region.softness[1])
                kept.append(replace(region, value=(low, high), softness=soft))
            elif low <= first:
                kept.append(region)
        return replace(self, regions=tuple(kept) or (replace(self.regions[0], opacity=0.0),))

    @property
    def _limits(self) -> Range:
        return (0.0, 1.0) if self.normalized else (-math.inf, math.inf)

    def _places(self, values: NDArray[Any], data_range: DataRange) -> Doubles:
        """Convert values to the units of the regions."""
        place = values.astype(np.float64)
        if not self.normalized:
            return place
        low, high = data_range
        if not low < high:
            return np.where(np.isnan(place), np.nan, 1.0)
        return np.clip((place - low) / (high - low), 0, 1)


@dataclass(frozen=True)
class Faded:
    """A transfer function with opacity that rises between two gradient lengths.

    They are fractions of the lengths' 99th percentile, so that only surfaces remain.
    """

    transfer: Transfer
    ramp: Range
    needs_gradient: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not 0 <= self.ramp[0] <= self.ramp[1] < np.inf:
            raise ValueError(
                f"gradient_opacity must be two fractions that ascend from 0 (got {self.ramp})"
            )

    @property
    def opacity_unit(self) -> float | None:
        return self.transfer.opacity_unit

    @property
    def normalized(self) -> bool:
        return self.transfer.normalized

    def opacities(self, values: ArrayLike, data_range: DataRange) -> Floats:
        return self.transfer.opacities(values, data_range)

    def classify(
        self, values: NDArray[Any], slopes: Floats | None, data_range: DataRange, steep: float
    ) -> tuple[Floats, Floats]:
        if slopes is None:
            raise ValueError("gradient_opacity needs gradients")
        color, opacity = self.transfer.classify(values, slopes, data_range, steep)
        share = np.interp(slopes, steep * np.array(self.ramp), [0, 1])
        return color, (opacity * share).astype(np.float32)

    def steepest(self, steep: float) -> float:
        return max(self.transfer.steepest(steep), self.ramp[1] * steep)

    def thinned(self, share: float) -> "Faded":
        return replace(self, transfer=self.transfer.thinned(share))

    def cut(self, low: float) -> "Faded":
        return replace(self, transfer=self.transfer.cut(low))


def _share(place: Doubles, span: Range, soft: float, limits: Range) -> Doubles:
    """Return the weights (N,) of values in a soft range, 0..1; 0 for NaN."""
    low, high = span
    rise = np.ones(place.shape)
    if low > limits[0]:
        rise = np.clip((place - low) / soft, 0, 1) if soft else (place >= low).astype(np.float64)
    fall = np.ones(place.shape)
    if high < limits[1]:
        fall = np.clip((high - place) / soft, 0, 1) if soft else (place <= high).astype(np.float64)
    return np.where(np.isnan(place), 0.0, rise * fall)


MOST = 14  # points
STEPS = 512  # samples of the range at which a transfer function is evaluated
CLOSE = 0.01  # of the full scale of colors and opacities
HIDDEN = 0.1  # weight of colors that are transparent
STEEP = 1e30  # any slope is less


def points_of(transfer: Transfer, data_range: DataRange) -> list[tuple[float, str, float]]:
    """Approximate a transfer function by ascending points: value, `#rrggbb` and opacity."""
    placed = spread(transfer, data_range)
    if isinstance(placed, TransferFunction) and placed.value.size <= MOST:
        value, curve = placed.value, np.column_stack([placed.color, placed.opacity])
    else:
        value = np.linspace(*data_range, STEPS)
        slope = np.full(STEPS, STEEP, np.float32)
        color, opacity = placed.classify(value, slope, data_range, 1.0)
        curve = np.column_stack([to_srgb(color), opacity])
        # Add the point farthest from the polyline of colors and opacities until all are close
        place, kept = np.arange(STEPS), [0, STEPS - 1]
        weight = np.maximum(HIDDEN, curve[:, 3:])
        while len(kept) < MOST:
            line = np.column_stack([np.interp(place, kept, curve[kept, c]) for c in range(4)])
            off = np.abs(line - curve)
            off[:, :3] *= weight
            worst = int(off.max(axis=1).argmax())
            if off[worst].max() < CLOSE:
                break
            kept = sorted([*kept, worst])
        value, curve = value[kept], curve[kept]
    levels = np.clip(np.rint(255 * curve[:, :3]), 0, 255).astype(int)
    rows: list[Any] = np.clip(curve[:, 3], 0, 1).tolist()
    return [
        (float(one), "#{:02x}{:02x}{:02x}".format(*level), float(opacity))
        for one, level, opacity in zip(value, levels, rows, strict=True)
    ]


def spelled(points: list[tuple[float, str, float]]) -> str:
    """Format control points for the option `transfer`."""
    return " ".join(f"{value:.6g},{color},{opacity:.4g}" for value, color, opacity in points)
