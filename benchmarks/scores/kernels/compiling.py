"""Decorators of loops; the product's own are not used, since truths share no code with it."""

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit  # noqa: TID251  the product's kernels are what is judged

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a loop."""
    compiled: Function = njit(cache=True)(function)
    return compiled


def parallel_kernel(function: Function) -> Function:
    """Compile a loop over `prange`."""
    compiled: Function = njit(cache=True, parallel=True)(function)
    return compiled
