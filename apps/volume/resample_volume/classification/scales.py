"""Logarithmic scales of values, for fields that span decades."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import array_like
from resample.types import Doubles
from resample_volume.classification.transfer import (
    Faded,
    Materials,
    RegionTransfer,
    Transfer,
    TransferFunction,
)
from resample_volume.classification.value_statistics import findings, survey, without_padding
from resample_volume.data.values import as_array, slabs
from resample_volume.types import Volume

LINEAR, LOG, SYMLOG = "linear", "log", "symlog"
FORMS = "linear, log, or symlog:linear=0.01, which is linear from -0.01 to 0.01"
NEAR = 1 / (1 - 1 / 10)  # decades of the linear part of symlog on each side of 0
MANTISSAS: tuple[tuple[float, ...], ...] = ((1, 2, 5), (1,))


@dataclass(frozen=True)
class LogScale:
    """Logarithms to the base 10, or matplotlib's `SymLogNorm` in units of its threshold.

    Examples
    --------
    >>> import numpy as np
    >>> LogScale().scaled(np.array([0.0, 1.0, 1000.0]))
    array([nan,  0.,  3.])
    >>> LogScale(0.01).value(LogScale(0.01).scaled(np.array([-5.0, 0.002]))).round(6).tolist()
    [-5.0, 0.002]
    """

    linear: float | None = None  # values up to this one, either side of 0, are linear; None: log

    def scaled(self, values: NDArray[Any]) -> NDArray[Any]:
        """Convert values to this scale; NaN for those without logarithm."""
        given = np.asarray(values, np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.linear is None:
                return np.log10(np.where(given > 0, given, np.nan))
            away = np.abs(given) / self.linear
            far = np.sign(given) * (NEAR + np.log10(away))
            return np.where(away <= 1, given / self.linear * NEAR, far)

    def value(self, scaled: NDArray[Any]) -> NDArray[Any]:
        """Convert from this scale to values."""
        given = np.asarray(scaled, np.float64)
        if self.linear is None:
            return np.asarray(10.0**given)
        away = np.abs(given)
        far = np.sign(given) * 10.0 ** (np.maximum(away, NEAR) - NEAR)
        return np.where(away <= NEAR, given / NEAR, far) * self.linear

    def place(self, value: float, what: str) -> float:
        """Convert one value; ValueError if it has no logarithm."""
        place = float(self.scaled(np.array(value)))
        if not math.isfinite(place):
            raise ValueError(
                f"{what} {value:g} has no logarithm; on the scale log give values above 0, or "
                "take the scale symlog"
            )
        return place

    def ticks(self, span: tuple[float, float], most: float) -> dict[float, str]:
        """Return decades between two positions on this scale, and their labels."""
        from resample.measuring.color_bars import ticks_of

        low, high = self.value(np.array(span)).tolist()
        found: dict[float, float] = {}
        ends = (low if self.linear is None else self.linear, max(abs(low), abs(high)))
        first, last = (math.floor(math.log10(end)) for end in ends)
        for mantissas in MANTISSAS:  # positions of round values in the range
            powers = range(first, last + 1)
            above = [float(f"{m:g}e{power}") for power in powers for m in mantissas]
            every = above if self.linear is None else [*(-one for one in above), 0.0, *above]
            inside = [one for one in every if low <= one <= high]
            found = {float(self.scaled(np.array(one))): one for one in inside}
            if len(found) <= max(2.0, most):
                break
        step = math.ceil(len(found) / max(2.0, most))
        places = sorted(found)
        middle = places.index(0.0) if 0.0 in found and self.linear is not None else 0
        kept = [place for n, place in enumerate(places) if (n - middle) % step == 0]
        if len(kept) < 2:
            even = ticks_of((low, high), most)
            return {float(self.scaled(np.array(at))): text for at, text in even.items()}
        return {place: f"{found[place]:g}".replace("-", "−") for place in kept}


def scale_named(text: str) -> LogScale | None:
    """Parse a scale; None: linear."""
    name, _, rest = text.partition(":")
    if not rest and name in ("", LINEAR):
        return None
    if not rest and name == LOG:
        return LogScale()
    key, _, given = rest.partition("=")
    try:
        threshold = float(given)
    except ValueError:
        threshold = math.nan
    if name != SYMLOG or key != LINEAR or not 0 < threshold < math.inf:
        raise ValueError(f"the scale {text!r}; give {FORMS}")
    return LogScale(threshold)


def scaled(volume: Volume, scale: str) -> Volume:
    """Convert a volume to logarithms, which are interpolated, classified and shaded.

    Padding and values without logarithm become NaN; `note` says so. Looks given as text refer to
    the original values, fractions to the scaled range.
    """
    by = scale_named(scale)
    if by is None:
        return volume
    if volume.colors is not None or volume.scale:
        what = "colors" if volume.colors is not None else f"the scale {volume.scale}"
        raise ValueError(f"{volume.name} has {what}; leave the scale {scale} out")
    known = survey(volume)
    given = as_array(without_padding(volume, known))
    values = array_like(given.values, given.values.shape, np.dtype(np.float32), volume.name)
    lost, kept = 0, 0
    for slab, raw in zip(slabs(values), slabs(given.values), strict=True):
        slab[:] = by.scaled(raw)
        left_out = np.isnan(slab)
        lost += int(left_out.sum()) - int(np.isnan(raw).sum())
        kept += slab.size - int(left_out.sum())
    if lost and not kept:
        raise ValueError(f"{volume.name} has no value above 0; take the scale symlog or linear")
    words = [volume.note] * bool(volume.note)
    words += [line for line in findings(known) if "padding" in line]
    if lost:
        words.append(f"{lost} voxels of 0 or below have no logarithm and are left out")
    return given._replace(values=values, units="none", note="; ".join(words), scale=scale)


def on_scale(transfer: Transfer, scale: str) -> Transfer:
    """Convert a look in data units to a scale."""
    by = scale_named(scale)
    if by is None or transfer.normalized:
        return transfer
    if isinstance(transfer, Materials):
        return replace(transfer, parts=tuple(on_scale(part, scale) for part in transfer.parts))
    if isinstance(transfer, TransferFunction) and transfer.value.size > 1:
        places = [by.place(float(value), "the look's value") for value in transfer.value]
        return replace(transfer, value=np.array(places))
    if isinstance(transfer, Faded):
        return Faded(on_scale(transfer.transfer, scale), transfer.ramp)
    if isinstance(transfer, RegionTransfer):
        raise ValueError(
            f"regions in data units are of values and gradients that the scale {scale} changes; "
            "give normalized ones, or points"
        )
    return transfer


def value_at(place: Any, scale: str) -> Doubles:
    """Convert positions on a volume's scale to the original values."""
    by = scale_named(scale)
    return np.asarray(place if by is None else by.value(place), np.float64)


def edges_of(span: tuple[float, float], count: int, scale: str) -> list[float]:
    """Return the edges of bins of equal width on a scale."""
    by, (low, high) = scale_named(scale), span
    if by is not None:
        low, high = by.scaled(np.array(span)).tolist()
    edges = [low + (high - low) * n / count for n in range(count + 1)]
    return [float(edge) for edge in value_at(edges, scale)]
