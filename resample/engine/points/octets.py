"""Sums of eight numbers at once, where the compiler would not find the vectors itself."""

from resample.engine.jit import when_compiling
from resample.types import Doubles


def spread(
    cells: Doubles,
    layout: tuple[int, int],
    amount: Doubles,
    line: int,
    rounding: float,
    weight: Doubles,
    taps: tuple[int, int, int, int],
) -> None:
    """Add eight amounts to each cell of a square, times the weights of its row and column.

    `cells`, `layout`: flat; where the first cell begins, and how far rows of cells are apart.
    `amount`: eight numbers from `line` on. `rounding`: constant that is added to amounts times a
    row's weight and subtracted again, to round them. `weight`, `taps`: where those of columns
    begin, where those of rows do, how far they are apart, and the number of rows, and of columns.
    """
    (first, pitch), (across, down, step, count) = layout, taps
    for row in range(count):
        # Weigh by the row, and round to whole quanta.
        shares = (amount[line : line + 8] * weight[down + row * step] + rounding) - rounding
        for column in range(count):
            cell = first + row * pitch + 8 * column
            cells[cell : cell + 8] += shares * weight[across + column * step]


@when_compiling
def _compile_as_vectors() -> None:
    from resample.engine.points import octet_vectors

    octet_vectors.define(spread)
