"""Eight numbers at once, where a compiler would not see that it may take them so."""

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
    """Add eight amounts to cells of eight, times the weights of rows and columns.

    Parameters
    ----------
    cells
        The first begins at `first`, and rows of them are `pitch` apart.
    amount
        Eight numbers from `line` on.
    rounding
        Added to amounts times a row's weight, and taken away again.
    weight
        Of columns from `across` on and of rows from `down` on, each `step` after the last.
    taps
        Rows, and columns.
    """
    for row in range(taps):
        shares = (amount[line : line + 8] * weight[down + row * step] + rounding) - rounding
        for column in range(taps):
            cell = first + row * pitch + 8 * column
            cells[cell : cell + 8] += shares * weight[across + column * step]


@when_compiling
def _compile_as_vectors() -> None:
    from resample.engine.points import vectors_of_eight

    vectors_of_eight.define(spread)
