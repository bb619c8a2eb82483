"""Composed transfer functions: several materials, or one rescaled to another range."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Floats
from resample_volume.classification.transfer import DataRange, Transfer, TransferFunction

TINY = 1e-30  # opacity too small to affect color


@dataclass(frozen=True)
class Materials:
    """Several transfer functions at once.

    Light passes through all materials of a value: their transparencies multiply. Color is their
    mean in linear light, weighted by their opacities. Their order does not matter.

    Raises ValueError: there is none, or opacities refer to different lengths.
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

    def __post_init__(self) -> None:
        if self.opacity_unit is None:
            object.__setattr__(self, "opacity_unit", self.transfer.opacity_unit)

    @property
    def normalized(self) -> bool:
        return False

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
        return self.transfer.classify(values, slopes, self.span, self._steep(steep))

    def steepest(self, steep: float) -> float:
        return self.transfer.steepest(self._steep(steep))

    def _steep(self, given: float) -> float:
        return given if self.steep is None else self.steep

    def thinned(self, share: float) -> "Windowed":
        return replace(self, transfer=self.transfer.thinned(share))

    def cut(self, low: float) -> "Windowed":
        return replace(self, transfer=self.transfer.cut(low))


def spread(transfer: Transfer, span: DataRange) -> Transfer:
    """Rescale a transfer function of fractions to a range in data units.

    `span`: values of the fractions 0 and 1, ascending.
    """
    if not transfer.normalized:
        return transfer
    if isinstance(transfer, Materials):
        return replace(transfer, parts=tuple(spread(part, span) for part in transfer.parts))
    if isinstance(transfer, TransferFunction):
        low, high = span
        place = np.clip(low * (1 - transfer.value) + high * transfer.value, low, high)
        return replace(transfer, value=np.maximum.accumulate(place), normalized=False)
    return Windowed(transfer, span)
