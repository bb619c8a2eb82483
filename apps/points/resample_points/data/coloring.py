"""Color clouds by the columns of their files."""

import logging
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb, mapped
from resample.types import Doubles, Floats
from resample_points.data.cloud import AXES, Cloud, columns_of, part_of
from resample_points.data.fields import COLORS, white_of
from resample_points.data.parts import quantile_of, rows_of, span_in, zeros_beside

LOG = logging.getLogger("resample")
UNKNOWN = 0.2  # linear gray of points without a value
LEVELS = 1024  # colors of a scale
SCANNED = ("intensity", "classification")  # columns to color points by if they have no colors
BRIGHT = 0.98  # quantile of the intensities that becomes white
CLASSES = 20  # colors of classes, of the colormap tab20; most of a bar
MEANINGS = dict(  # of the American Society for Photogrammetry and Remote Sensing, LAS 1.4
    enumerate(
        (
            *("never classified", "unassigned", "ground", "low vegetation", "medium vegetation"),
            *("high vegetation", "building", "low noise", "reserved", "water", "rail", "road"),
            *("overlap", "wire guard", "conductor", "tower", "connector", "bridge", "high noise"),
        )
    )
)

Range = tuple[float, float]


class Scale(NamedTuple):
    """Mapping between values and colors."""

    name: str  # of the column
    colormap: str
    span: Range  # values of the first and the last color
    classes: tuple[int, ...] = ()  # all values within the span, if they are few and whole

    def colors(self) -> Floats:
        """Return linear colors (`LEVELS`, 3) at even values over the span."""
        return mapped(self.colormap, (np.arange(LEVELS) + 0.5) / LEVELS)

    def class_colors(self) -> Floats:
        """Return the linear colors (N, 3) of the classes."""
        return mapped(self.colormap, _share(np.array(self.classes, np.float64), self.span))

    def class_names(self) -> list[str]:
        """Return the names of the classes: numbers, and what they mean in LAS files."""
        meanings = MEANINGS if self.name == SCANNED[1] else {}
        return [f"{number} {meanings.get(number, '')}".strip() for number in self.classes]


def colored(
    cloud: Cloud, column: str, *, colormap: str = "viridis", span: str | Range | None = None
) -> tuple[Cloud, Scale]:
    """Color a cloud by a column of its file; also return the scale.

    `span`: values at the ends of the colormap; values beyond get the color of the end. Two numbers,
    or text `low,high`, each of which may be a quantile: `2%,98%`. Default: the least and the
    greatest value.
    """
    value = _column(cloud, column)
    whole = span_in(value)
    if whole is None:
        raise ValueError(f"column {column!r} has no finite value")
    low, high = span_of(span, value, whole)

    def color_of(rows: slice) -> Floats:
        part = np.asarray(value[rows], np.float64)
        known = np.isfinite(part)
        color = mapped(colormap, np.where(known, _share(part, (low, high)), 0.0))
        color[~known] = UNKNOWN
        return color

    color = _per_point(cloud, color_of)
    classes = tuple(number for number in _classes(value) if low <= number <= high)
    return cloud._replace(color=color), Scale(column, colormap, (low, high), classes)


def _share(value: Doubles, span: Range) -> Doubles:
    """Return where values lie in a span, from 0 to 1; 0.5 in an empty one."""
    low, high = span
    if not low < high:
        return np.full_like(value, 0.5)
    return np.asarray(np.clip((value - low) / (high - low), 0.0, 1.0))


def _classes(values: NDArray[Any]) -> list[int]:
    """Return the distinct values, if they are at most `CLASSES` whole numbers; else nothing."""
    found = set[float]()
    for rows in rows_of(values):
        part = np.unique(values[rows])
        found.update(part[: CLASSES + 1].tolist())
        if len(found) > CLASSES or not all(float(value).is_integer() for value in found):
            return []
    return sorted(map(int, found))


def colored_as_scanned(cloud: Cloud) -> Cloud:
    """Color a laser scan by its red, green and blue columns, which are removed.

    Levels have 16 bits, or 8 if none is above 255. If there are none, or all are black, points are
    gray by their intensity, of which the 98 % quantile is white and 0, or the least where that is
    negative, black; or else get a color per class.
    """
    rest = {name: column for name, column in cloud.columns.items() if name not in COLORS[0]}
    levels = [cloud.columns[name] for name in COLORS[0] if name in cloud.columns]
    intensity, number = (rest.get(name, np.zeros(1, np.uint8)) for name in SCANNED)
    cloud = cloud._replace(columns=rest)
    most = max((int(level.max(initial=0)) for level in levels), default=0)
    white = np.float32(white_of(np.dtype(np.uint16), most))

    def light(rows: slice) -> Floats:
        level = np.stack([each[rows] for each in levels], axis=1)
        return np.asarray(from_srgb(level.astype(np.float32) / white))

    def gray(rows: slice) -> Floats:
        share = np.minimum((intensity[rows].astype(np.float32) - dark) / brightest, np.float32(1))
        return np.repeat(share[:, None], 3, axis=1)

    def by_class(rows: slice) -> Floats:
        return mapped("tab20", (number[rows].astype(np.int64) % CLASSES + 0.5) / CLASSES)

    if most:
        return cloud._replace(color=_per_point(cloud, light))
    if len(cloud.color):
        return cloud
    span = span_in(intensity)
    if span is not None and span[0] < span[1]:
        dark = np.float32(min(span[0], 0.0))
        bright = np.float32(quantile_of(intensity, BRIGHT))
        brightest = np.float32(span[1] if bright <= dark else bright) - dark
        return cloud._replace(color=_per_point(cloud, gray))
    if number.min() < number.max():
        return cloud._replace(color=_per_point(cloud, by_class))
    return cloud


def _per_point(cloud: Cloud, color_of: Callable[[slice], Floats]) -> Floats:
    """Compute colors (N, 3) of all points, block by block."""
    color: Floats = zeros_beside(cloud.position, (len(cloud.position), 3), np.float32)
    for rows in rows_of(color):
        color[rows] = color_of(rows)
    return color


def _column(cloud: Cloud, name: str) -> NDArray[Any]:
    if name in cloud.columns:
        values, count = np.asarray(cloud.columns[name]), len(part_of(cloud, "position"))
        if values.shape != (count,):
            raise ValueError(f"column {name!r} has the shape {values.shape}; it must be ({count},)")
        return values
    if name not in AXES:
        raise ValueError(f"there is no column {name!r}; known: {', '.join(columns_of(cloud))}")
    return np.asarray(part_of(cloud, "position")[:, AXES.index(name)])


def span_of(given: str | Range | None, values: NDArray[Any], whole: Range) -> Range:
    """Return a span in numbers, from text, numbers, or None for the whole range."""
    if given is None:
        return whole
    words = (
        given.replace("..", ",").split(",")
        if isinstance(given, str)
        else [str(float(end)) for end in given]
    )
    try:
        first, last = (_end(word.strip(), values) for word in words)
    except ValueError:
        raise ValueError(f"a range of {given!r}; give low,high, such as 0,255 or 2%,98%") from None
    if first == last:
        raise ValueError(
            f"a range of {given!r}, which is from {first:g} to {last:g}; give a wider one"
        )
    if not first < last:
        raise ValueError(
            f"a range from {first:g} to {last:g}; give the smaller first, and a colormap with _r "
            "for reversed colors"
        )
    if last < whole[0] or first > whole[1]:
        LOG.warning(
            "the range from %g to %g holds no value; they go from %g to %g", first, last, *whole
        )
    return first, last


def _end(word: str, values: NDArray[Any]) -> float:
    """Return one end of a span."""
    if word.endswith("%"):
        return quantile_of(values, float(word[:-1]) / 100.0)
    number = float(word)
    if not np.isfinite(number):
        raise ValueError
    return number
