"""Color and choose the points of a cloud by its columns, and join clouds."""

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb, mapped
from resample.memory.mapped import is_in_file
from resample.types import Doubles, Floats
from resample_points.data.cloud import (
    AXES,
    COLORS,
    Cloud,
    columns_of,
    part_of,
    rows_in,
    some_of,
    white_of,
)
from resample_points.data.parts import (
    CloudBuilder,
    quantile_of,
    rows_of,
    span_in,
    storage_for,
    zeros_beside,
)

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
        """Return the names of the classes: numbers, and their meaning in LAS files."""
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
    # Few whole numbers are classes.
    found = set[float]()
    for rows in rows_of(value):
        found.update(np.unique(value[rows])[: CLASSES + 1].tolist())
        if len(found) > CLASSES or not all(float(number).is_integer() for number in found):
            found = set()
            break
    classes = tuple(number for number in sorted(map(int, found)) if low <= number <= high)
    return cloud._replace(color=color), Scale(column, colormap, (low, high), classes)


def _share(value: Doubles, span: Range) -> Doubles:
    """Return positions of values in a span, from 0 to 1; 0.5 in an empty one."""
    low, high = span
    if not low < high:
        return np.full_like(value, 0.5)
    return np.asarray(np.clip((value - low) / (high - low), 0.0, 1.0))


def colored_as_scanned(cloud: Cloud) -> Cloud:
    """Color a laser scan by its red, green and blue columns, which are removed.

    Levels have 16 bits, or 8 if none is above 255. If there are none, or all are black, points are
    gray by their intensity: its 98 % quantile is white and 0, or the least where that is
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
    if isinstance(given, str):
        words = given.replace("..", ",").split(",")
    else:
        words = [str(float(end)) for end in given]
    ends = list[float]()
    with suppress(ValueError):
        ends = [
            quantile_of(values, float(word[:-1]) / 100.0) if word.endswith("%") else float(word)
            for word in map(str.strip, words)
        ]
    if len(ends) != 2 or not np.isfinite(ends).all():
        raise ValueError(f"a range of {given!r}; give low,high, such as 0,255 or 2%,98%")
    first, last = ends
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


GRAY = 0.8  # linear color of points without one, beside points that have colors


class Wanted(NamedTuple):
    """Values of a column to keep."""

    column: str
    ranges: tuple[Range, ...]

    @property
    def text(self) -> str:
        """The condition as text."""
        spans = (f"{a:g}" if a == b else f"{a:g}:{b:g}" for a, b in self.ranges)
        return f"{self.column}={','.join(spans).replace('-inf', '').replace('inf', '')}"

    def holds(self, values: NDArray[Any]) -> NDArray[np.bool_]:
        """Mark the values (N,) to keep."""
        kept = np.zeros(len(values), np.bool_)
        for low, high in self.ranges:
            kept |= (values >= low) & (values <= high)
        return kept


def select_points(cloud: Cloud, only: Sequence[str] = (), crop: str | None = None) -> Cloud:
    """Select points of a cloud by the values of columns, and by a box.

    Parameters
    ----------
    cloud
        The cloud.
    only
        Conditions, all of which a point must meet: a column, or x, y or z, and values or ranges,
        such as `classification=2`, `classification=2,5:6` or `intensity=100:`.
    crop
        Ranges of x, y and z in the cloud's coordinates, such as `0:10,:,-2:3`.

    Raises
    ------
    ValueError
        A condition cannot be read, its column is missing, or no point meets all of them.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, select_points
    >>> place, nothing = np.arange(12.0).reshape(4, 3), np.empty((0, 3))
    >>> cloud = Cloud(place, nothing, nothing, np.empty(0), {"class": np.array([2, 2, 5, 6])})
    >>> select_points(cloud, ["class=2,6"], crop=":5,:,:").position.tolist()
    [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    """
    conditions = [wanted_of(text) for text in only] + box_of(crop)
    if not conditions:
        return cloud
    kept: NDArray[np.bool_] = zeros_beside(cloud.position, (len(cloud.position),), np.bool_)
    kept[:] = True
    for wanted in conditions:
        values = _column(cloud, wanted.column)
        for rows in rows_of(values):
            kept[rows] &= wanted.holds(np.asarray(values[rows]))
        if not kept.any():
            ends = "{} goes from {:g} to {:g}".format
            span = span_in(values)
            told = "nothing is known" if span is None else ends(wanted.column, *span)
            raise ValueError(f"no point is left by {wanted.text}: {told}")
    if not is_in_file(cloud.position):
        return some_of(cloud, kept)
    chosen = CloudBuilder(storage_for(int(np.count_nonzero(kept)), "the selection"))
    for rows in rows_of(kept):
        chosen.add(some_of(rows_in(cloud, rows), np.asarray(kept[rows])))
    return chosen.cloud()


def join_clouds(clouds: Sequence[Cloud]) -> Cloud:
    """Join clouds of the same coordinates to one.

    Points are gray where others have colors, and have no normal where others have some. Columns
    and radii are kept that all clouds have.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, join_clouds
    >>> nothing = np.empty((0, 3))
    >>> gray = Cloud(np.zeros((1, 3)), nothing, nothing, np.empty(0))
    >>> red = Cloud(np.ones((1, 3)), nothing, np.array([[1.0, 0, 0]]), np.empty(0))
    >>> print(join_clouds([gray, red]).color.round(1))
    [[0.8 0.8 0.8]
     [1.  0.  0. ]]
    """
    if len(clouds) == 1:
        return clouds[0]
    names = [set(cloud.columns) for cloud in clouds]
    shared = sorted(set.intersection(*names)) if names else []
    count = sum(len(cloud.position) for cloud in clouds)
    joined = CloudBuilder(storage_for(count, "the joined cloud"))
    kind = np.result_type(*(cloud.position for cloud in clouds))
    has = {name: any(len(getattr(cloud, name)) for cloud in clouds) for name in ("normal", "color")}
    has_radii = all(len(cloud.radius) for cloud in clouds)
    for cloud in clouds:
        for rows in rows_of(cloud.position):
            part = rows_in(cloud, rows)
            size = len(part.position)
            normal = part.normal if len(part.normal) else np.zeros((size, 3), np.float32)
            color = part.color if len(part.color) else np.full((size, 3), GRAY, np.float32)
            joined.add(
                Cloud(
                    part.position.astype(kind),
                    normal if has["normal"] else part.normal,
                    color if has["color"] else part.color,
                    part.radius if has_radii else np.zeros(0, np.float32),
                    {name: part.columns[name] for name in shared},
                )
            )
    return joined.cloud()


def wanted_of(text: str) -> Wanted:
    """Read a condition such as `classification=2,5:6`."""
    column, _, values = text.partition("=")
    spans = [_range(word) for word in values.split(",")]
    if not column.strip() or None in spans:
        raise ValueError(
            f"{text!r:.60} selects no points; give a column and values or ranges, such as "
            "classification=2,5:6 or intensity=100:"
        )
    return Wanted(column.strip(), tuple(span for span in spans if span is not None))


def box_of(text: str | None) -> list[Wanted]:
    """Read ranges of x, y and z such as `0:10,:,-2:3`."""
    if text is None:
        return []
    spans = [_range(word) if ":" in word else None for word in text.split(",")]
    if len(spans) != len(AXES) or None in spans:
        raise ValueError(f"crop {text!r:.60}; give ranges of x, y and z, such as 0:10,:,-2:3")
    given = zip(AXES, spans, strict=True)
    return [Wanted(axis, (span,)) for axis, span in given if span is not None]


def corners_of(crop: str | None) -> Doubles:
    """Read the lowest and highest corner (2, 3) of a box as `box_of` does; infinite where open."""
    corners = np.array([[-np.inf] * 3, [np.inf] * 3])
    for wanted in box_of(crop):
        corners[:, AXES.index(wanted.column)] = wanted.ranges[0]
    return corners


def _range(word: str) -> Range | None:
    """Read a value or a range low:high; either end may be missing."""
    first, colon, last = word.strip().partition(":")
    try:
        low = float(first) if first or not colon else -np.inf
        high = low if not colon else float(last) if last else np.inf
    except ValueError:
        return None
    return (low, high) if low <= high else None
