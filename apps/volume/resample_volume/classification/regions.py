"""Transfer functions of two variables: value and gradient length.

Kniss, Kindlmann and Hansen, Multidimensional Transfer Functions for Interactive Volume Rendering,
2002. A boundary between two materials is an arch over their values, whose gradient is highest in
the middle; so a region of high gradients shows a surface whose values also occur elsewhere.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.colors import from_srgb
from resample.types import Doubles, Floats
from resample_volume.classification.transfer import Color, DataRange, Transfer

TOLERANCE = 1 + 1e-6  # borders are inclusive
CHUNK = 1 << 20  # values processed together
TINY = float(np.finfo(np.float64).tiny)

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

    @property
    def needs_gradient(self) -> bool:
        return True

    def opacities(self, values: ArrayLike, data_range: DataRange) -> Floats:
        """Return an upper bound of opacities (N,), for gradients within all regions."""
        place = self._places(np.asarray(values), data_range)
        transparency = np.ones(place.shape)
        for region in self.regions:
            transparency *= 1 - region.opacity * self._share_by_value(region, place)
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
                slope = np.minimum(slope / max(steep, TINY), 1)
            # Combine color and opacity of all regions
            transparency, weight = np.ones(place.shape), np.zeros(place.shape)
            mixed = np.zeros((*place.shape, 3))
            for region in self.regions:
                limits = (0.0, 1.0 if self.normalized else math.inf)
                inside = self._share_by_value(region, place) * _share(
                    slope, region.gradient, region.softness[1], limits
                )
                share = region.opacity * inside
                transparency *= 1 - share
                weight += share
                mixed += share[:, np.newaxis] * from_srgb(np.array(region.color))
            mixed /= np.maximum(weight, TINY)[:, np.newaxis]
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

    def _places(self, values: NDArray[Any], data_range: DataRange) -> Doubles:
        """Convert values to the units of the regions."""
        place = values.astype(np.float64)
        if not self.normalized:
            return place
        low, high = data_range
        if not low < high:
            return np.where(np.isnan(place), np.nan, 1.0)
        return np.clip((place - low) / (high - low), 0, 1)

    def _share_by_value(self, region: Region, place: Doubles) -> Doubles:
        limits = (0.0, 1.0) if self.normalized else (-math.inf, math.inf)
        return _share(place, region.value, region.softness[0], limits)


@dataclass(frozen=True)
class Faded:
    """A transfer function whose opacity rises between two gradient lengths.

    They are fractions of the lengths' 99th percentile, so that only surfaces remain.
    """

    transfer: Transfer
    ramp: Range

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

    @property
    def needs_gradient(self) -> bool:
        return True

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
