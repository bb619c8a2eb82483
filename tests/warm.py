"""Compile what most tests share, before they start: `python -m tests.warm`.

What a kernel calls is compiled once per process, so that a second form of it takes a third of the
time of the first. Workers of tests come to forms in any order, each in a process of its own; here
one process has all forms of a painter. Nothing is done where kernels are stored already.
"""

import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

SHEETS = ("field", "volume, axis", "volume, image")


def _is_of_slabs(name: str) -> bool:
    return name.startswith(SHEETS)


def _is_of_splats(name: str) -> bool:
    return name.startswith(("volume", "particles")) and not _is_of_slabs(name)


def _is_of_textures(name: str) -> bool:
    return name.startswith("texture")


def _is_of_depth(name: str) -> bool:
    return name.startswith(("depth image", "cloud"))


GROUPS: dict[str, Callable[[str], bool]] = {
    "splats": _is_of_splats,
    "slabs": _is_of_slabs,
    "textures": _is_of_textures,
    "depth images": _is_of_depth,
}


def _is_stored() -> bool:
    """Whether kernels of these sources have been compiled before."""
    from resample.engine.ellipsoids.deferred import paint_runs
    from resample.engine.jit import is_stored

    return is_stored(paint_runs)


def _paint(group: str) -> str:
    from tests.golden.scenes import SCENES

    for name in filter(GROUPS[group], SCENES):
        SCENES[name]()
    return group


def main() -> None:
    """Paint the golden pictures, a process for each group."""
    if _is_stored():
        return
    context, workers = get_context("spawn"), min(len(GROUPS), os.cpu_count() or 1)
    with ProcessPoolExecutor(workers, context, max_tasks_per_child=1) as pool:
        for group in pool.map(_paint, GROUPS):
            sys.stdout.write(f"compiled: kernels of {group}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
