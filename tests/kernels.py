"""What is known of compiled kernels."""

from collections.abc import Callable
from typing import Any

import numba
import pytest

compiled_only = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="plain Python is not compiled for types"
)


def specialisations(kernel: Callable[..., Any]) -> int:
    """For how many types of arguments a kernel has machine code in this process."""
    return len(kernel.compiled.signatures)
