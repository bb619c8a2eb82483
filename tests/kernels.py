"""What is known of compiled kernels."""

from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest

from resample.engine import jit
from resample.engine.compiled import library

compiled_only = pytest.mark.skipif(
    jit.IS_PLAIN or library._native() is not None,
    reason="numba compiles nothing: plain Python, or the library of kernels",
)


def specialisations(kernel: Callable[..., Any]) -> int:
    """For how many types of arguments a kernel has machine code in this process."""
    return len(jit.dispatcher(kernel).signatures)


def run_in_python(monkeypatch: pytest.MonkeyPatch, *modules: ModuleType) -> None:
    """Let the kernels of modules be plain Python in a test: nothing is compiled for it."""
    for module in modules:
        for name, found in list(vars(module).items()):
            if hasattr(found, "dispatchers"):
                monkeypatch.setattr(module, name, found.__wrapped__)
