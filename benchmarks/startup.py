"""Time to the first picture: imports, with stored kernels and without."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.contest import Options
from benchmarks.measure import Spread, wall_seconds
from benchmarks.tables import Row, Section

# Prints the seconds of the import, without the interpreter's start.
IMPORT = "import time; a = time.perf_counter(); import resample; print(time.perf_counter() - a)"
PICTURE = """
import numpy as np
from resample import Camera, Resampler, Samples
position = np.random.default_rng(7).uniform(-4, 4, (500, 3)) + [0, 0, 30]
samples = Samples(position, np.ones((500, 3)), np.full(500, 0.5), np.eye(3))
frame = Resampler()(samples, Camera.from_intrinsics(60, 60, 16, 16), height=32, width=32)
assert frame.rgba.max() > 0.1
"""
NOTHING = "pass"
IMPORT_GOAL, WARM_GOAL, COLD_GOAL = 0.15, 2.0, 20.0  # s


def sections(options: Options) -> Iterator[Section]:
    """Imports, then commands with and without stored kernels."""
    with tempfile.TemporaryDirectory(prefix="benchmark-") as name:
        folder = Path(name)
        _write_inputs(folder)
        yield _imports(options)
        yield _pictures(folder, options)


def _imports(options: Options) -> Section:
    section = Section("Import", "Fresh processes, files in the system’s cache. Seconds.")
    rounds = max(3, options.rounds)
    for what, code in (("an interpreter that does nothing", NOTHING), ("import resample", IMPORT)):
        _python(code)
        section.rows.append(
            {"": what, "process": Spread.of([_python(code) for _ in range(rounds)])}
        )
    alone = Spread.of([_inner_seconds() for _ in range(rounds)])
    met = "yes" if alone.median <= IMPORT_GOAL else "no"
    section.rows[-1] |= {"import alone": alone, "target": f"≤ {IMPORT_GOAL} s", "met": met}
    return section


def _inner_seconds() -> float:
    ended = subprocess.run(
        [sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True
    )
    return float(ended.stdout)


def _python(code: str) -> float:
    return wall_seconds([sys.executable, "-c", code])


def _write_inputs(folder: Path) -> None:
    """A picture and a depth image for the commands."""
    import cv2

    y, x = np.mgrid[0:240, 0:320] / 320
    color = np.stack([x, y, 0.5 + 0.5 * np.sin(60 * x)], axis=-1)
    cv2.imwrite(str(folder / "in.png"), (255 * color).astype(np.uint8))
    np.save(folder / "depth.npy", np.where(x < 0.5, 2.0, 4.0))


def _commands(folder: Path, options: Options) -> dict[str, Sequence[str]]:
    """Commands to time, by their name in the table."""
    scripts = Path(sys.executable).parent
    volume, texture, depth = (
        str(scripts / f"resample-{name}") for name in ("volume", "texture", "warp3d")
    )
    picture, out = str(folder / "in.png"), ["-o", str(folder / "out.png")]
    corners = "10,5 300,20 310,230 20,220"
    depth_image = [depth, "render", picture, str(folder / "depth.npy"), "--fov", "60"]
    commands: dict[str, Sequence[str]] = {
        "500 samples from Python": [sys.executable, "-c", PICTURE],
        "resample-volume render checker-box": [volume, "render", "checker-box", *out],
        "resample-texture warp": [texture, "warp", picture, "--corners", corners, *out],
        "resample-warp3d render": [*depth_image, "--move", "0.2,0,0.1", *out],
    }
    engine = options.volumes / "engine.nhdr"
    if engine.is_file() and not options.quick:
        commands["resample-volume render engine.nhdr"] = [volume, "render", str(engine), *out]
    return commands


def _pictures(folder: Path, options: Options) -> Section:
    section = Section(
        "First pictures",
        "Whole commands, in seconds. *Cold*: with an empty folder of kernels (NUMBA_CACHE_DIR), "
        "as after an install, once.\n*Warm*: the next processes, which find the kernels stored.",
        notes=["PyVista, from the start of Python to its first picture: 4.5 s (not measured here)"],
    )
    for n, (name, command) in enumerate(_commands(folder, options).items()):
        kept = None if options.quick else {"NUMBA_CACHE_DIR": str(folder / f"cache-{n}")}
        try:
            first = wall_seconds(command, kept)
            cold = None if options.quick else first
            warm = Spread.of(
                [wall_seconds(command, kept) for _ in range(max(2, options.rounds // 2))]
            )
        except (RuntimeError, OSError) as error:
            section.notes.append(f"{name}: left out, {error}")
            continue
        row: Row = {"": name, "cold": cold, "warm": warm, "target": ""}
        row |= {"target": f"cold ≤ {COLD_GOAL:g}, warm ≤ {WARM_GOAL:g}", "met": _met(cold, warm)}
        section.rows.append(row)
    section.notes.append(f"{len(os.sched_getaffinity(0))} cores; compilation uses one")
    return section


def _met(cold: float | None, warm: Spread) -> str:
    missed = []
    if cold is not None and cold > COLD_GOAL:
        missed.append("cold")
    if warm.median > WARM_GOAL:
        missed.append("warm")
    return f"no: {', '.join(missed)}" if missed else "yes"
