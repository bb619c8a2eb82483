"""Try an installed wheel as a user would: `python tools/try_wheel.py`, outside of the checkout.

Commands of all applications run in an empty folder with an empty cache. With `--library`, pictures
have to come from the wheel's kernel library, and to have the bits of kernels that numba compiles.
"""

import argparse
import importlib
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

PACKAGES = ("resample", "resample_points", "resample_texture", "resample_volume", "resample_warp3d")
WARP = "resample-texture warp file.png --corners '4,2 28,4 30,30 2,28' -o {}"
COMMANDS = (
    "resample --version",
    "resample-volume generate checker-box:size=16 -o box.nrrd",
    "resample-volume render box.nrrd --size 32 -o file.png",
    "resample-volume render checker-box:size=16 --size 32 -o name.png",
    "resample compare file.png -R name.png",
    WARP.format("warped.png"),
    "resample-texture demo -o demo",
    "resample-warp3d animate file.png depth.npy --fov 60 --frames 2 -o sway.webp",
    "resample-points render sample:knot-points --size 64 -o points.png",
)


def run(line: str, folder: Path, **environment: str) -> str:
    """Run a command of the wheel and return what it printed.

    Raises
    ------
    SystemExit
        The command failed, or is not there.
    """
    name, *words = shlex.split(line)
    program = shutil.which(name, path=sysconfig.get_path("scripts"))
    if program is None:
        sys.exit(f"{name} is not installed")
    done = subprocess.run(
        [program, *words],
        cwd=folder,
        env={**os.environ, "HYBRID_RESAMPLE_CACHE": str(folder / "cache"), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{line}: exit status {done.returncode}\n{done.stderr}")
    return done.stdout


def come_from_the_wheel() -> None:
    """Check that what is imported is what was installed."""
    for package in PACKAGES:
        file = importlib.import_module(package).__file__
        home = Path(file or "").resolve()
        if Path(sys.prefix).resolve() not in home.parents or "site-packages" not in home.parts:
            sys.exit(f"{home} is not what the wheel installed")


def main() -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="python tools/try_wheel.py", description=__doc__)
    parser.add_argument(
        "--library", action="store_true", help="the wheel has to have a kernel library"
    )
    asked = parser.parse_args()
    come_from_the_wheel()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        import numpy as np

        np.save(folder / "depth.npy", np.full((32, 32), 2.0))
        if "broken:" in run("resample plugins", folder):
            sys.exit("a plugin of the wheel is broken")
        for line in COMMANDS:
            run(line, folder)
        if asked.library:
            if list(folder.glob("cache/kernels/*")):
                sys.exit("numba has compiled kernels that the wheel should hold")
            run(WARP.format("again.png"), folder, RESAMPLE_KERNELS="off")
            first, again = ((folder / file).read_bytes() for file in ("warped.png", "again.png"))
            if first != again:
                sys.exit("a picture of the library differs from numba's")
    sys.stdout.write(f"the wheel's commands run with Python {sys.version.split()[0]}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
