"""Check that a volume fits in memory, before anything large is allocated."""

from typing import Any

from numpy.typing import NDArray

from resample import memory
from resample.memory.mapped import most_of

REMEDY = "take a smaller or downsampled volume"


def require_memory(count: int, what: str) -> None:
    """Reject a volume of `count` bytes that cannot fit, see `resample.memory.require_memory`."""
    memory.require_memory(count, what, REMEDY)


def require_beside(values: NDArray[Any], count: int, what: str) -> None:
    """Reject what needs `count` bytes beside values, of which those in a file have a limit."""
    most = most_of(values)
    if most is not None and count > most:
        raise ValueError(
            f"{what} need {memory.amount(count)} of memory, {memory.amount(most)} are left: give "
            "more memory, take a coarser level, or a look that rays show without them"
        )
    require_memory(count, what)
