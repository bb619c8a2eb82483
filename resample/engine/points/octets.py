"""Sums of eight numbers at once, where the compiler would not find the vectors itself."""

from resample.engine.jit import when_compiling
from resample.types import Doubles


def spread(
    cells: Doubles,
    first: int,
    pitch: int,
    amount: Doubles,
    line: int,
    rounding: float,
    weight: Doubles,
    across: int,
    down: int,
    step: int,
    taps: int,
) -> None:
    """Add eight amounts to each cell of a square, times the weights of its row and column.

    Parameters
    ----------
    cells
        Flat; the first cell begins at `first`, and rows of cells are `pitch` apart.
    amount
        Eight numbers from `line` on.
    rounding
        Constant that is added to amounts times a row's weight and subtracted again, to round them.
    weight
        Those of columns begin at `across`, those of rows at `down`, each `step` after the last.
    taps
        Number of rows, and of columns.
    """
    for row in range(taps):
        # Weigh by the row, and round to whole quanta.
        shares = (amount[line : line + 8] * weight[down + row * step] + rounding) - rounding
        for column in range(taps):
            cell = first + row * pitch + 8 * column
            cells[cell : cell + 8] += shares * weight[across + column * step]


@when_compiling
def _compile_as_vectors() -> None:
    from resample.engine.points import octet_vectors

    octet_vectors.define(spread)
