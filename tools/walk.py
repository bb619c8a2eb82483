"""Which modules a call enters before its first kernel: `python -m tools.walk`.

Opening ends before painting begins: given arrays, a call enters no reader of files. Methods that
records have from Python, and what modules do while they are imported, do not count.
"""

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np


def walk(call: Callable[[], Any]) -> list[tuple[str, str]]:
    """Return module and function of each of our calls up to the first kernel, in their order."""
    entered: list[tuple[str, str]] = []
    has_begun = False

    def enter(frame: FrameType, event: str, _: Any) -> None:
        nonlocal has_begun
        module, name = str(frame.f_globals.get("__name__", "")), frame.f_code.co_name
        is_own = module.startswith("resample") and frame.f_code.co_filename != "<string>"
        if has_begun or event != "call" or not is_own or _is_imported(frame):
            return
        has_begun = (module, name) == ("resample.engine.jit", "call")
        if not has_begun:
            entered.append((module, name))

    sys.setprofile(enter)
    try:
        call()
    finally:
        sys.setprofile(None)
    return entered


def _is_imported(frame: FrameType | None) -> bool:
    """Whether one of our modules is being imported."""
    while frame is not None and frame.f_code.co_filename != __file__:
        if frame.f_code.co_name == "<module>":
            return True
        frame = frame.f_back
    return False


def modules(entered: list[tuple[str, str]]) -> list[str]:
    """Return the modules of a walk, each once."""
    return list(dict.fromkeys(module for module, _ in entered))


def _main() -> None:
    from resample_texture.warping import warp
    from resample_volume.calls import render

    rng = np.random.default_rng(1)
    image, volume = (
        rng.integers(0, 256, (60, 80, 3), np.uint8),
        rng.random((24, 24, 24), np.float32),
    )
    matrix = [[0.9, -0.2, 10], [0.2, 0.9, 0], [0, 0.0005, 1]]
    calls = {"warp": lambda: warp(image, matrix), "render": lambda: render(volume)}
    for name, call in calls.items():
        for kind in ("first", "next"):
            entered = walk(call)
            rooms = modules(entered)
            sys.stdout.write(f"{name}, {kind}: {len(rooms)} modules, {len(entered)} calls\n")
            sys.stdout.write("".join(f"    {room}\n" for room in rooms))


if __name__ == "__main__":
    _main()
