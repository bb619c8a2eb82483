"""Colors of clouds by what was measured at their points."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import mapped
from resample.types import Floats
from resample_warp3d.clouds.cloud import Cloud, part_of

AXES = ("x", "y", "z")
UNKNOWN = 0.2  # linear gray of points at which nothing was measured
LEVELS = 1024  # colors of a scale

Range = tuple[float, float]


class Scale(NamedTuple):
    """Which color means which value."""

    name: str  # of the column
    colormap: str
    span: Range  # values that the first and the last color mean

    def colors(self) -> Floats:
        """Linear colors (`LEVELS`, 3) at even values over the span."""
        return mapped(self.colormap, (np.arange(LEVELS) + 0.5) / LEVELS)


class Colored(NamedTuple):
    """A cloud whose colors mean values."""

    cloud: Cloud
    scale: Scale


def colored(
    cloud: Cloud, column: str, *, colormap: str = "viridis", span: str | Range | None = None
) -> Colored:
    """Color a cloud by a column of its file.

    Parameters
    ----------
    cloud
        With columns, as `read_cloud` gives them.
    column
        Name of one, or x, y or z. Points where it is not finite become gray.
    colormap
        One of matplotlib's.
    span
        Values that the colormap's ends mean; what is beyond has the color of the end. Numbers, or
        `low,high` in words, of which each may be a share of the points: `2%,98%`. Left out, the
        least and the greatest value.

    Raises
    ------
    ValueError
        There is no such column or colormap, or the span is none.
    """
    value = np.asarray(_column(cloud, column), np.float64)
    known = np.isfinite(value)
    if not known.any():
        raise ValueError(f"column {column!r} has no finite value")
    low, high = span_of(span, value[known])
    share = (
        np.clip((value - low) / (high - low), 0.0, 1.0) if low < high else np.full_like(value, 0.5)
    )
    color = mapped(colormap, np.where(known, share, 0.0))
    color[~known] = UNKNOWN
    return Colored(cloud._replace(color=color), Scale(column, colormap, (low, high)))


def columns_of(cloud: Cloud) -> list[str]:
    """Names of what a cloud can be colored by."""
    return [*AXES, *(name for name in cloud.columns if name not in AXES)]


def _column(cloud: Cloud, name: str) -> NDArray[Any]:
    if name in cloud.columns:
        values, count = np.asarray(cloud.columns[name]), len(part_of(cloud, "position"))
        if values.shape != (count,):
            raise ValueError(f"column {name!r} has the shape {values.shape}; it must be ({count},)")
        return values
    if name not in AXES:
        raise ValueError(f"there is no column {name!r}; there are {', '.join(columns_of(cloud))}")
    return np.asarray(part_of(cloud, "position")[:, AXES.index(name)])


def span_of(given: str | Range | None, values: NDArray[Any]) -> Range:
    """Span in numbers, of words, of numbers, or of the least and the greatest of some values.

    Raises
    ------
    ValueError
        The words are none, a number is not finite, or the first is not below the last.
    """
    if given is None:
        return float(values.min()), float(values.max())
    words = given.split(",") if isinstance(given, str) else [str(float(end)) for end in given]
    try:
        first, last = (_end(word.strip(), values) for word in words)
    except ValueError:
        raise ValueError(f"a range of {given!r}; give low,high, such as 0,255 or 2%,98%") from None
    if first == last:
        raise ValueError(f"a range of {given!r}, which is from {first:g} to {last:g}; give a wider")
    if not first < last:
        raise ValueError(
            f"a range from {first:g} to {last:g}; give the smaller first, and a colormap with _r "
            "for the other way round"
        )
    return first, last


def _end(word: str, values: NDArray[Any]) -> float:
    """An end of a span."""
    if word.endswith("%"):
        return float(np.quantile(values, float(word[:-1]) / 100.0))
    number = float(word)
    if not np.isfinite(number):
        raise ValueError
    return number
