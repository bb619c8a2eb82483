"""Build the kernel library, or list compiled kernels: `python -m tools.kernels [--list]`.

Kernels in the user's cache are reused; the others are compiled first.
"""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from resample.engine.compiled import entries
from resample.engine.compiled.library import VARIABLE
from tools.kernels import platforms
from tools.kernels.outlines import home, outline
from tools.kernels.scenes import GROUPS

ROOT = Path(__file__).parents[2]
COMPILED = "resample.engine.compiled"  # the compiler, which counts whole
LIBRARY = ROOT / "resample" / "engine" / "compiled" / platforms.file_name()


def used(*logs: Path) -> set[Path]:
    """Kernel files named in logs of RESAMPLE_KERNELS_LOG."""
    return {Path(file) for log in logs if log.exists() for file in log.read_text().splitlines()}


def compiled_for_scenes(folder: Path) -> set[Path]:
    """Run all groups of scenes and collect the kernels that they use.

    Raises
    ------
    subprocess.CalledProcessError
        A command of a group failed.
    """
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        logs = list(pool.map(lambda group: _run(group, folder), GROUPS))
    return used(*logs)


def _run(group: str, folder: Path) -> Path:
    log = folder / group
    environment = {
        **os.environ,
        VARIABLE: "off",
        "RESAMPLE_KERNELS_LOG": str(log),
        "RESAMPLE_LOG": "warning",
    }
    command = [sys.executable, "-m", "tools.kernels.scenes", group]
    subprocess.run(command, cwd=ROOT, env=environment, check=True, stdout=subprocess.DEVNULL)
    return log


def listed(files: Iterable[Path]) -> list[str]:
    """Lines with the number of specialisations of each kernel, and their differences."""
    keys = defaultdict(set)
    for file in files:
        entry = entries.read(file)
        if entry is not None and entry.kernel.startswith(("resample", "benchmarks.")):
            keys[entry.kernel].add(entry.key)
    lines = []
    for kernel, forms in sorted(keys.items()):
        lines.append(f"{len(forms):3d}  {kernel}")
        lines += [
            f"       {part}" for part in (differences(sorted(forms)) if len(forms) > 1 else ())
        ]
    return [*lines, f"{sum(map(len, keys.values())):3d}  specialisations of {len(keys)} kernels"]


def differences(keys: list[str]) -> list[str]:
    """Parts in which keys differ, without common prefix and suffix."""
    begin = _common_prefix(keys)
    end = _common_prefix([key[:begin:-1] for key in keys])
    return sorted(key[begin : len(key) - end] or "nothing there" for key in keys)


def _common_prefix(texts: list[str]) -> int:
    """Length of the common prefix of all texts."""
    columns = enumerate(zip(*texts, strict=False))
    return next((n for n, letters in columns if len(set(letters)) > 1), min(map(len, texts)))


def edits(files: Iterable[Path]) -> list[str]:
    """Lines with the fraction of compile time that an edit of each function or constant causes.

    They are all functions, classes and constants of modules that kernels are compiled from.
    """
    known = [entry for entry in map(entries.read, files) if entry is not None]
    total = sum(entry.seconds for entry in known)
    modules = {part.rpartition(".")[0] for entry in known for part in entry.parts} - {COMPILED}
    share = {f"{module}.{name}": 0.0 for module in modules for name in outline(module).defined}
    for entry in known:
        for part in {home(part) for part in entry.parts} & share.keys():
            share[part] += entry.seconds / total
    shares = sorted(share.values())
    return [
        *(
            f"{each:6.1%}  {part}"
            for part, each in sorted(share.items(), key=lambda item: -item[1])
        ),
        f"{shares[-1]:6.1%}  of {total:.0f} s at worst",
        f"{shares[len(shares) // 2]:6.1%}  in the median",
        f"{sum(shares) / len(shares):6.1%}  in the mean over {len(shares)} functions and constants",
    ]


def main() -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.kernels", description=__doc__)
    parser.add_argument(
        "--list", action="store_true", help="list kernels and their specialisations"
    )
    parser.add_argument(
        "--edits", action="store_true", help="show what edits of functions and constants recompile"
    )
    parser.add_argument(
        "--log", type=Path, help="use the kernels in this log of RESAMPLE_KERNELS_LOG"
    )
    asked = parser.parse_args()
    if not (asked.list or asked.edits) and platforms.level() is None:
        print(f"no library of kernels is built for {sys.platform} on {platform.machine()}")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        files = used(asked.log) if asked.log else compiled_for_scenes(Path(folder))
    if asked.list:
        print("\n".join(listed(files)))
        return 0
    if asked.edits:
        print("\n".join(edits(files)))
        return 0
    from tools.kernels.link import build

    begin = time.perf_counter()
    parts = build(files, LIBRARY)
    size = LIBRARY.stat().st_size / 1e6
    kernels = len({part.kernel for part in parts})
    spent = time.perf_counter() - begin
    print(
        f"{LIBRARY.relative_to(ROOT)}: {len(parts)} specialisations of {kernels} kernels,", end=""
    )
    print(f" {size:.1f} MB, linked in {spent:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
