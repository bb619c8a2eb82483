"""Choose points by their columns and places, and join clouds."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import is_in_file
from resample.types import Doubles
from resample_points.data.cloud import AXES, Cloud, columns_of, part_of, rows_in, some_of
from resample_points.data.parts import CloudBuilder, rows_of, span_in, storage_for, zeros_beside

GRAY = 0.8  # linear color of points without one, beside points that have colors

Range = tuple[float, float]  # both ends included


class Wanted(NamedTuple):
    """Values of a column to keep."""

    column: str
    ranges: tuple[Range, ...]

    @property
    def text(self) -> str:
        """The condition as it is given."""
        spans = (f"{a:g}" if a == b else f"{_end(a)}:{_end(b)}" for a, b in self.ranges)
        return f"{self.column}={','.join(spans)}"

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
        values = _values(cloud, wanted.column)
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
    """Read a value or a range low:high, either of whose ends may be missing."""
    first, colon, last = word.strip().partition(":")
    try:
        low = float(first) if first or not colon else -np.inf
        high = low if not colon else float(last) if last else np.inf
    except ValueError:
        return None
    return (low, high) if low <= high else None


def _end(number: float) -> str:
    return f"{number:g}" if np.isfinite(number) else ""


def _values(cloud: Cloud, name: str) -> NDArray[Any]:
    if name in cloud.columns:
        return np.asarray(cloud.columns[name])
    if name not in AXES:
        raise ValueError(f"there is no column {name!r}; known: {', '.join(columns_of(cloud))}")
    return np.asarray(part_of(cloud, "position")[:, AXES.index(name)])
