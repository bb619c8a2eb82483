"""Measure the time to the first picture: `python tools/first_pictures.py dist/*.whl`.

The wheel is installed into an empty environment with the locked versions of its dependencies.
There, with an empty cache, each application makes two pictures with the wheel's kernel library;
then the same without the library. The table has CPU seconds (all threads and the system) and peak
memory. With `--without numba` these packages are removed first.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PICTURES = {
    "warp": "resample-texture warp photo.png --matrix 0.5,0,8,0.1,0.5,8,0,0,1 -o warp.png",
    "volume": "resample-volume render checker-box:size=32 --size 64 -o volume.png",
    "depth": "resample-warp3d render photo.png depth.npy --fov 60 --move 0.1,0,0 -o depth.png",
}
HELP = "resample-volume --help"
INPUT = """
import numpy as np, cv2
noise = np.random.default_rng(7).integers(0, 255, (64, 64, 3)).astype(np.uint8)
cv2.imwrite("photo.png", noise)
np.save("depth.npy", np.full((64, 64), 2.0, np.float32))
"""


class Cost(NamedTuple):
    """Resources that a process used."""

    seconds: float  # CPU seconds
    wall: float  # wall seconds
    memory: float  # peak, MB


def cost(command: list[str], environment: dict[str, str], folder: Path) -> Cost:
    """Run a command to its end and measure it.

    Raises
    ------
    subprocess.CalledProcessError
        It failed.
    """
    begin = time.perf_counter()
    process = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    assert process.stdout is not None
    said = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command, said)
    wall = time.perf_counter() - begin
    return Cost(used.ru_utime + used.ru_stime, wall, used.ru_maxrss / 1000)


def install(wheel: Path, venv: Path, without: list[str]) -> float:
    """Install a wheel into a new environment; returns the environment's size in MB."""
    uv = Path(sys.executable).with_name("uv")
    python = venv / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(venv)], check=True)
    pip = [str(uv), "pip", "install", "-q", "--compile-bytecode", "--python", str(python)]
    lock = str(ROOT / "requirements" / "run.txt")
    subprocess.run([*pip, "--require-hashes", "-r", lock], check=True)
    subprocess.run([*pip, "--no-deps", str(wheel)], check=True)
    if without:
        remove = [str(uv), "pip", "uninstall", "-q", "--python", str(python), *without]
        subprocess.run(remove, check=True)
    return sum(file.stat().st_size for file in venv.rglob("*") if file.is_file()) / 1e6


def timed(venv: Path, folder: Path, kernels: str, rounds: int) -> list[str]:
    """Rows of a table: the first picture with an empty cache, and the median of later ones."""
    rows = []
    for name, line in {**PICTURES, "--help": HELP}.items():
        with tempfile.TemporaryDirectory() as cache:
            environment = {
                **os.environ,
                "PATH": f"{venv / 'bin'}{os.pathsep}{os.environ['PATH']}",
                "HYBRID_RESAMPLE_CACHE": cache,
                "RESAMPLE_KERNELS": kernels,
            }
            environment.pop("NUMBA_CACHE_DIR", None)
            command = line.split()
            command[0] = str(venv / "bin" / command[0])
            first = cost(command, environment, folder)
            later = sorted(cost(command, environment, folder) for _ in range(rounds))
        middle = later[rounds // 2]
        row = (name, kernels, f"{first.seconds:.2f}", f"{first.wall:.2f}", f"{middle.seconds:.2f}")
        rows.append(f"| {' | '.join((*row, f'{middle.memory:.0f}'))} |")
    return rows


def main() -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="python tools/first_pictures.py", description=__doc__)
    parser.add_argument("wheel", type=Path)
    parser.add_argument(
        "--without", nargs="*", default=[], help="packages to remove, such as numba"
    )
    parser.add_argument(
        "--rounds", type=int, default=5, help="number of later pictures, for the median"
    )
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        size = install(asked.wheel.resolve(), folder / "venv", asked.without)
        subprocess.run([str(folder / "venv/bin/python"), "-c", INPUT], cwd=folder, check=True)
        out = [
            f"environment: {size:.0f} MB, wheel {asked.wheel.stat().st_size / 1e6:.1f} MB",
            "| picture | library | first, CPU s | first, s | later, CPU s | later, MB |",
            "|---|---|---|---|---|---|",
            *timed(folder / "venv", folder, "on", asked.rounds),
        ]
        if not asked.without:
            out += timed(folder / "venv", folder, "off", asked.rounds)
    sys.stdout.write("\n".join(out) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
