"""Predicted memory of commands, beside their measured peak.

    python -m benchmarks.memory            # sizes and modes of all applications
    python -m benchmarks.memory --only warp

Each command runs alone in a fresh process with compiled kernels (twice if they were not). The
prediction is the last one that `RESAMPLE_LOG=debug` prints before the work; the peak is that of the
operating system (VmHWM).
"""

import argparse
import contextlib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence

import numpy as np
from PIL import Image

from resample.memory import amount, bytes_of

WITHIN = 1.3  # times
NEEDED = re.compile(r" needs about ([\d.]+ [KMG]iB) of memory:")
HELD = re.compile(r"peak memory: ([\d.]+ [KMG]iB)")
COMPILING = "compiling kernels"
TURNED = ("--matrix", "0.7,0.2,10,-0.2,0.7,200")
EYE = ("--depth-scale", "1000", "--fov", "60")
MOVED = (*EYE, "--move", "0.1,0,0")
TEXTURE, WARP3D, VOLUME = "resample_texture", "resample_warp3d", "resample_volume"
POINTS = "resample_points"


def small() -> Iterator[tuple[str, ...]]:
    """Commands of one size: one or two of each application."""
    yield TEXTURE, "warp", "500.png", *TURNED, "--size", "500", "-o", "o.png"
    yield TEXTURE, "warp", "1500.png", *TURNED, "--size", "1500", "-o", "o.png"
    yield TEXTURE, "resize", "1500.png", "--size", "1000x1000", "-o", "o.png"
    yield WARP3D, "render", "500.png", "d500.png", *MOVED, "-o", "o.png"
    yield WARP3D, "render", "1500.png", "d1500.png", *MOVED, "-o", "o.png"
    yield VOLUME, "render", "checker-box:size=64", "--size", "1000", "-o", "o.png"
    yield VOLUME, "render", "checker-box:size=160", "-o", "o.png"


def more() -> Iterator[tuple[str, ...]]:
    """Commands of other sizes, types and modes."""
    warp = TEXTURE, "warp"
    for name in ("gray1500.png", "alpha1500.png", "1500.jpg", "deep1500.png"):
        yield *warp, name, *TURNED, "--size", "1500", "-o", "o.png"
    for name in ("o.exr", "o.tif"):
        yield *warp, "1500.png", *TURNED, "--size", "1500", "-o", name
    for method in ("paper", "bilinear", "splats", "oiio", "opencv-supersample:n=4"):
        yield *warp, "1500.png", *TURNED, "--size", "1500", "--method", method, "-o", "o.png"
    for words in (("--edge", "wrap"), ("--total",), ("--no-linear",)):
        yield *warp, "1500.png", *TURNED, "--size", "1500", *words, "-o", "o.png"
    yield *warp, "1500.png", *TURNED, "--size", "300", "-o", "o.png"
    yield *warp, "500.png", "--matrix", "4,0.2,0,0,4,0", "--size", "2000", "-o", "o.png"
    yield *warp, "4000.png", *TURNED, "--size", "4000", "-o", "o.png"
    yield TEXTURE, "rotate", "1500.png", "--degrees", "20", "-o", "o.png"
    corners = "100,50 1400,100 1300,1400 20,1300"
    yield TEXTURE, "rectify", "1500.png", "--corners", corners, "-o", "o.png"
    yield TEXTURE, "animate", "1500.png", "--frames", "2", "--size", "1000", "-o", "o.gif"
    yield TEXTURE, "mesh", "sample:knot", "--size", "1500", "-o", "o.png"
    for words in (("--size", "300"), ("--fill",), ("--filter", "gaussian:sigma=0.6")):
        yield WARP3D, "render", "1500.png", "d1500.png", *MOVED, *words, "-o", "o.png"
    for method in ("paper", "mesh", "splat", "ldi", "opencv"):
        yield WARP3D, "render", "1500.png", "d1500.png", *MOVED, "--method", method, "-o", "o.png"
    yield WARP3D, "render", "gray1500.png", "d1500.png", *MOVED, "-o", "o.png"
    yield WARP3D, "render", "1500.png", "d1500.png", *MOVED, "-o", "o.exr"
    yield WARP3D, "render", "500.png", "d500.png", *MOVED, "--size", "2000", "-o", "o.png"
    yield WARP3D, "stereo", "1500.png", "d1500.png", "--disparity-scale", "50", "-o", "o.png"
    yield WARP3D, "animate", "1500.png", "d1500.png", *EYE, "--frames", "2", "-o", "o.gif"
    yield POINTS, "render", "sample:knot-points", "--size", "1000", "-o", "o.png"
    yield from volumes()


def volumes() -> Iterator[tuple[str, ...]]:
    """Volumes of several sizes, types and modes."""
    for name in ("checker-box:size=128", "vessel-tree:size=200", "marschner-lobb:size=128"):
        yield VOLUME, "render", name, "-o", "o.png"
        yield VOLUME, "render", name, "--projection", "maximum", "-o", "o.png"
    yield VOLUME, "render", "checker-box:size=128", "--size", "1600", "-o", "o.exr"
    yield VOLUME, "render", "checker-box:size=128", "--method", "points", "-o", "o.png"
    yield VOLUME, "render", "checker-box:size=128", "--classify", "post", "-o", "o.png"
    yield VOLUME, "render", "deep.npy", "-o", "o.png"
    yield VOLUME, "animate", "checker-box:size=128", "--frames", "2", "-o", "o.gif"


def said_and_held(words: Sequence[str]) -> tuple[int, int]:
    """Predicted memory of a command in bytes, and its peak.

    Raises
    ------
    RuntimeError
        It failed, or printed nothing.
    """
    for _ in range(3):
        done = subprocess.run(
            [sys.executable, "-m", *words],
            capture_output=True,
            text=True,
            env=os.environ | {"RESAMPLE_LOG": "debug"},
            check=False,
        )
        needed, held = NEEDED.findall(done.stderr), HELD.findall(done.stderr)
        if done.returncode or not (needed and held):
            raise RuntimeError(f"{' '.join(words)}: {done.stderr[-600:]}")
        if COMPILING not in done.stderr:
            break
    return bytes_of(needed[-1].replace(" ", "")), bytes_of(held[-1].replace(" ", ""))


def inputs() -> None:
    """Write the commands' inputs to this folder."""
    rng = np.random.default_rng(1)
    for size in (500, 1500, 4000):
        rough = Image.fromarray(rng.integers(0, 255, (size // 4, size // 4, 3), np.uint8))
        picture = rough.resize((size, size), Image.Resampling.BICUBIC)
        picture.save(f"{size}.png")
        if size == 1500:
            picture.convert("L").save("gray1500.png")
            picture.convert("RGBA").save("alpha1500.png")
            picture.save("1500.jpg")
        y, x = np.mgrid[:size, :size] / size
        steps = (np.floor(4 * x) + np.floor(4 * y)) % 2
        depth = 1000 + 200 * np.sin(9 * x) * np.cos(7 * y) + 500 * steps
        Image.fromarray(depth.astype(np.uint16)).save(f"d{size}.png")
    import cv2

    levels = rng.integers(0, 1 << 16, (1500, 1500, 3), np.uint16)
    cv2.imwrite("deep1500.png", cv2.GaussianBlur(levels, (0, 0), 3))
    np.save("deep.npy", rng.normal(size=(128, 128, 128)).astype(np.float32))


def table(commands: Iterator[tuple[str, ...]], only: str) -> int:
    """Print a line per command; returns how many are not within the factor."""
    beyond = 0
    for words in commands:
        if only not in " ".join(words):
            continue
        needed, held = said_and_held(words)
        is_within = held / WITHIN <= needed <= held * WITHIN
        beyond += not is_within
        mark = "" if is_within else "  BEYOND"
        told = f"{amount(needed):>10} {amount(held):>10} {needed / held:5.2f}{mark}"
        sys.stdout.write(f"{told}  {' '.join(words)}\n")
        sys.stdout.flush()
    return beyond


def main(arguments: Sequence[str]) -> int:
    """Run all; returns 1 if a prediction is too high or too low."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.memory", description=__doc__)
    parser.add_argument("--only", default="", help="commands with this in their words")
    parser.add_argument("--small", action="store_true", help="one or two of each application")
    choices = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="memory-") as folder, contextlib.chdir(folder):
        inputs()
        beyond = table(small(), choices.only)
        beyond += 0 if choices.small else table(more(), choices.only)
    sys.stdout.write(f"{beyond} beyond {WITHIN} times\n")
    return int(beyond > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
