"""Transfer functions, pre-integrated over values that change linearly from one to another.

The mean of colors and extinctions between two values is a difference of prefix sums (Engel, Kraus
and Ertl, High-Quality Pre-Integrated Volume Rendering, 2001, without its table of pairs), so no
peak of a transfer function is stepped over.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_step
from resample.types import Doubles, Floats, Indices, Lamp

EVEN = 1e-3  # columns; values are at least as far apart where their difference divides

Light = tuple[float, float, float, float]  # red, green, blue, and extinction


class SummedClassifier(NamedTuple):
    """A classifier for rays; values are counted in columns."""

    column: Doubles  # (L K, 12) sums up to a column, their rise to the next, and its bend
    columns: int  # K, of each of L looks, which lie side by side
    visible: Indices  # (K + 1,) prefix count of columns that are visible in any look
    highlight: Doubles  # (N,) over the cosine 0..1 between normal and halfway vector
    table: Floats  # (G, L K, 4) as in `Classifier`, G = 1 where gradients do not matter
    low: float  # data units, the value of column 0
    per_column: float  # data units
    per_slope: float  # rows per data unit per scene unit
    lamp: Lamp
    # Depth cueing, as in `Classifier`.
    near: float
    far: float
    dimmed: float


@inner_step
def value_of(classifier: SummedClassifier, place: float) -> float:
    """Value of a column, data units."""
    return classifier.low + place * classifier.per_column


@inner_step
def clamped(classifier: SummedClassifier, place: float) -> float:
    """Column of a value, clamped to the table; NaN becomes a column too."""
    return float(min(max(0.0, place), classifier.columns - 1.0))


@inner_step
def highlight_of(classifier: SummedClassifier, cosine: float) -> float:
    """White highlight, interpolated in a table."""
    place = min(1.0, cosine) * (classifier.highlight.size - 1)
    n = np.uint64(min(int(place), classifier.highlight.size - 2))
    below = classifier.highlight[n]
    return float(below + (place - n) * (classifier.highlight[n + np.uint64(1)] - below))


@inner_step
def _sums_at(classifier: SummedClassifier, place: float) -> Light:
    """Integrals from column 0 to a place of color × extinction, and of extinction."""
    # Between columns the integrals are quadratic.
    k = np.uint64(min(int(place), classifier.column.shape[0] - 2))
    f, c = place - k, classifier.column
    return (
        c[k, 0] + f * (c[k, 4] + f * c[k, 8]),
        c[k, 1] + f * (c[k, 5] + f * c[k, 9]),
        c[k, 2] + f * (c[k, 6] + f * c[k, 10]),
        c[k, 3] + f * (c[k, 7] + f * c[k, 11]),
    )


@inner_step
def _apart(end: float, middle: float) -> float:
    """A value, moved where it is too close to another for their difference to be divided by."""
    if abs(end - middle) >= EVEN:
        return end
    return middle - EVEN if middle >= EVEN else middle + EVEN


@inner_step
def lights_between(
    classifier: SummedClassifier, number: int, values: tuple[float, float, float]
) -> Light:
    """Mean color × extinction and mean extinction over two intervals that share a value.

    `number`: of the look. `values`: of columns, clamped. Result: the mean of both.
    """
    # Differences of the integrals, over the distances.
    first, middle = float(number * classifier.columns), values[1]
    front, back = _apart(values[0], middle), _apart(values[2], middle)
    one, two, three = (
        _sums_at(classifier, first + front),
        _sums_at(classifier, first + middle),
        _sums_at(classifier, first + back),
    )
    before, behind = 0.5 / (middle - front), 0.5 / (back - middle)
    return (
        before * (two[0] - one[0]) + behind * (three[0] - two[0]),
        before * (two[1] - one[1]) + behind * (three[1] - two[1]),
        before * (two[2] - one[2]) + behind * (three[2] - two[2]),
        before * (two[3] - one[3]) + behind * (three[3] - two[3]),
    )


@inner_step
def _between_rows(
    classifier: SummedClassifier, rows: tuple[int, int], down: float, place: float, n: int
) -> float:
    # Interpolate along values in both rows, then between the rows of gradients.
    k = min(int(place), classifier.table.shape[1] - 2)
    right, upper, lower = place - k, rows[0], rows[1]
    above = classifier.table[upper, k, n] + right * (
        classifier.table[upper, k + 1, n] - classifier.table[upper, k, n]
    )
    below = classifier.table[lower, k, n] + right * (
        classifier.table[lower, k + 1, n] - classifier.table[lower, k, n]
    )
    return float(above + down * (below - above))


@inner_step
def classified(classifier: SummedClassifier, place: float, slope: float) -> Light:
    """Color and extinction, by value and gradient magnitude; bilinear in the table."""
    # Locate the two rows of gradients.
    last = classifier.table.shape[0] - 1
    row = min(float(last), slope * classifier.per_slope)
    r = min(int(row), max(0, last - 1))
    rows, down = (r, min(r + 1, last)), row - r
    return (
        _between_rows(classifier, rows, down, place, 0),
        _between_rows(classifier, rows, down, place, 1),
        _between_rows(classifier, rows, down, place, 2),
        _between_rows(classifier, rows, down, place, 3),
    )
