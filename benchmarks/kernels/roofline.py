"""A loop of fused multiply-adds, to measure the machine's peak rate."""

from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats

CHAIN = 16  # consecutive multiply-adds on each number


@intrinsic  # type: ignore[untyped-decorator]
def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:  # noqa: ARG001
    """Fused multiply-add: a × b + c, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001
        return builder.fma(*arguments)

    single = types.float32
    return single(single, single, single), generate


@kernel
def _multiply_add_often(numbers: Floats, factor: float, summand: float, times: int) -> None:
    a, b = np.float32(factor), np.float32(summand)
    for _ in range(times):
        for n in range(numbers.size):
            value = numbers[n]
            for _ in range(CHAIN):
                value = _fma(value, a, b)
            numbers[n] = value


@parallel_kernel
def multiply_add(
    counter: Counter, numbers: Floats, factor: float, summand: float, times: int
) -> None:
    """Do `CHAIN` × `times` multiply-adds on each number of the rows (threads, count)."""
    for row in tasks(counter, numbers.shape[0]):
        _multiply_add_often(numbers[row], factor, summand, times)
