"""Commands and pictures that use the library's kernels: all methods and dtypes, small sizes.

`python -m tools.kernels.scenes volume` runs one group in an empty folder.
"""

import os
import shlex
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

DTYPES = ("uint8", "int8", "uint16", "int16", "int32", "float32", "float64")
VOLUME = "resample-volume render {} --size 40 -o out.png"
WARP = "resample-texture warp {} --corners '2,3 40,8 36,38 6,30' --size 44 -o out.tif"
GAUSSIANS = "resample-points render gaussians.ply -o out.png {}"
DEPTH = "resample-warp3d render {} --size 40 -o out.png"


def volumes() -> Iterator[str]:
    """Commands for volumes."""
    for dtype in DTYPES:
        for more in ("", "--classify pre", "--shading --light 1/-1/2", "--gradient sobel"):
            yield VOLUME.format(f"{dtype}.npy {more}")
    for dtype in ("uint8", "int16", "uint16", "float32"):
        for projection in ("maximum", "minimum", "average", "additive", "first-hit --iso 90"):
            for more in ("", "--camera 30/20/0.2"):
                yield VOLUME.format(f"{dtype}.npy --projection {projection} {more}")
    for method in ("hybrid", "points", "splats", "paper", "inflate", "ewa"):
        for more in (
            "",
            "--fov 0",
            "--camera 30/20/0.1",
            "--camera 30/20/6",
            "--color-by primitive",
        ):
            yield VOLUME.format(f"uint8.npy --method {method} {more}")
    for more in (
        *(f"--footprint {name}" for name in ("corrected", "projected", "affine")),
        *(f"--subpixels {count}" for count in (1, 2, 3)),
        "--classify pre --fov 0",
        "--classify pre --camera 30/20/0.2",
        "--kernel bspline",
        "--filter gaussian:sigma=0.6",
        "--opacity linear",
        "--transfer bone --window 90/120",
        "--gradient-opacity 0.1/0.5",
        "--labels labels.npy",
        "--labels labels.npy --classify pre",
        "--classify pre --depth-cue 0.4 --clip 1/0/-1",
        "--classify pre --gradient-opacity 0.1/0.5",
        "--classify pre --shadows --light 1/-1/2",
        "--classify post --camera 30/20/0.2",
        "--classify post --fov 0",
        "--classify post --light 1/-1/2 --shadows",
        "--shadows --light 1/-1/2",
        "--ambient-occlusion",
        "--no-shading",
        "--depth-cue 0.4",
        "--clip 1/0/-1",
        "--crop 4:20,:,2:",
        "--also uint16.npy",
        "--axes --box",
        "--transfer skin:opacity=0.1+bone --units hu",
    ):
        yield VOLUME.format(f"uint8.npy {more}")
    for name in ("checker-box:size=24", "vessel-tree:size=24", "marschner-lobb:size=24"):
        yield VOLUME.format(name)
        yield VOLUME.format(f"{name} --classify pre")
    yield "resample-volume generate checker-box:size=16 -o box.nrrd"
    yield "resample-volume info box.nrrd"
    yield VOLUME.format("box.nrrd --memory 300MiB")
    yield VOLUME.format("float32.zarr --memory 300MiB")
    yield "resample-volume animate uint8.npy --frames 2 --size 32 -o out.webp"
    yield "resample-volume demo --output demo"


def textures() -> Iterator[str]:
    """Commands for pictures and meshes."""
    pictures = [f"{name}.{kind}" for name in ("gray", "rgb", "rgba") for kind in ("png", "tif")]
    pictures += ["gray16.png", "rgb16.png"]
    for picture in pictures:
        for more in ("", "--method paper", "--no-linear", "--filter gaussian:sigma=0.6"):
            yield WARP.format(f"{picture} {more}")
        yield f"resample-texture resize {picture} --size 20 -o out.tif"
        yield f"resample-texture resize {picture} --size 90 -o out.tif"
        yield f"resample-texture rotate {picture} --degrees 10 -o out.tif"
        yield f"resample-texture scale {picture} --factor 0.4 -o out.tif"
        yield f"resample-texture warp {picture} --map map.npy -o out.tif"
        yield f"resample-texture warp {picture} --flow flow.npy -o out.tif"
        yield f"resample-texture undistort {picture} --lens 40,40,24,20,-0.2,0.05,0,0 -o out.tif"
    for method in (
        *("hybrid", "points", "supersample", "splats", "paper", "nearest", "majority"),
        *("bilinear", "cubic", "lanczos4", "area", "opencv-supersample:n=2"),
        "oiio",
    ):
        for picture in ("gray.png", "rgb.png"):
            yield WARP.format(f"{picture} --method {method}")
    for name in ("lanczos", "spline", "catmull-rom", "bilinear", "nearest", "gaussian"):
        yield WARP.format(f"rgb.png --interpolation {name}")
        yield WARP.format(f"gray.png --interpolation {name}")
    for more in (
        *(f"--edge {name}" for name in ("clamp", "wrap", "mirror")),
        *("--total", "--quality 8", "--background white", "--coverage cover.png", "--roi 3,4,9,8"),
    ):
        yield WARP.format(f"rgb.png {more}")
    yield "resample-texture warp rgb.png --matrix 0.2,0,0,0,0.2,0 -o out.tif"
    yield "resample-texture warp rgb.png --matrix 3,0,0,0,3,0 --size 90 -o out.tif"
    yield "resample-texture demo --output demo"


def depths() -> Iterator[str]:
    """Commands for depth images."""
    for method in (
        *("hybrid", "paper", "point", "preview", "splat", "mcmillan", "mcmillan-zbuffer"),
        *("mesh", "subsample", "ldi", "opencv"),
    ):
        for more in ("--move 0.1,0,0", "--move 0,0,1.5", "--move 0,0,-3"):
            yield DEPTH.format(f"sample:room --method {method} {more}")
    for picture in ("gray.png", "rgb.png", "rgba.png", "rgb.tif", "rgb16.png"):
        for depth in ("depth.npy", "depth.png --depth-scale 1000"):
            yield DEPTH.format(f"{picture} {depth} --fov 60 --move 0.1,0,0")
    yield DEPTH.format("rgb.png depth.npy --fov 60 --move 0.1,0,0 --filter gaussian:sigma=0.6")
    yield "resample-warp3d stereo rgb.png depth.npy --fov 60 --eye-distance 0.1 -o out.png"
    yield "resample-warp3d animate rgb.png depth.npy --fov 60 --frames 2 -o out.webp"
    yield "resample-warp3d demo --output demo"


def gaussians() -> Iterator[str]:
    """Commands for 3D Gaussians and particles."""
    yield "resample-points density particles.npz --size 40 -o out.png"
    for more in (
        "--size 40",
        "--size 40 --order rays",
        "--size 40 --look affine",
        "--panorama equirectangular --size 48x24",
    ):
        yield GAUSSIANS.format(more)


def documented() -> Iterator[str]:
    """Commands in README and docs that need no files of the user."""
    from tools.pages import commands, runs_as_it_stands

    yield from sorted({line for _, line in commands() if runs_as_it_stands(line)})


def painters() -> Iterator[Callable[[], Any]]:
    """Small pictures by every painter, through the Python API."""
    from tools.kernels.pictures import SCENES

    yield from SCENES.values()


GROUPS: dict[str, Callable[[], Iterator[str | Callable[[], Any]]]] = {
    "painters": painters,
    "volume": volumes,
    "texture": textures,
    "warp3d": depths,
    "gaussians": gaussians,
    "documented": documented,
}


def prepare() -> None:
    """Write the commands' input files."""
    import cv2

    axis = np.linspace(-1, 1, 24)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    ball = 120 * np.clip(1.2 - np.sqrt(x * x + y * y + z * z), 0, 1)
    for name in DTYPES:
        np.save(f"{name}.npy", ball.astype(name))
    np.save("labels.npy", (ball > 30).astype(np.uint8) + (ball > 70))
    _store("float32.zarr", ball.astype(np.float32))
    rng = np.random.default_rng(7)
    for name, channels in (("gray", ()), ("rgb", (3,)), ("rgba", (4,))):
        noise = rng.random((40, 48, *channels))
        cv2.imwrite(f"{name}.png", (255 * noise).astype(np.uint8))
        cv2.imwrite(f"{name}.tif", noise.astype(np.float32))
        cv2.imwrite(f"{name}16.png", (65535 * noise).astype(np.uint16))
    down, across = np.mgrid[:40, :48] + 0.5
    np.save("map.npy", np.stack([across + 0.1 * down, 0.9 * down], axis=-1).astype(np.float32))
    np.save("flow.npy", np.full((40, 48, 2), 0.7, np.float32))
    _gaussians("gaussians.ply", rng)
    np.savez("particles.npz", position=rng.random((60, 3)), mass=np.ones(60), h=np.full(60, 0.1))
    depth = 2 + 0.01 * across
    np.save("depth.npy", depth.astype(np.float32))
    cv2.imwrite("depth.png", (1000 * depth).astype(np.uint16))


def _gaussians(path: str, rng: np.random.Generator) -> None:
    """Write 3D Gaussians with harmonics of degree 1."""
    from resample_points import Gaussians, write_gaussians

    parts = (rng.normal(size=(40, n)).astype(np.float32) for n in (3, 4, 3))
    place, turn, color = parts
    opacity = rng.random(40).astype(np.float32)
    levels = rng.integers(-99, 99, (40, 3, 3)).astype(np.int16)
    size = np.full((40, 3), 0.1, np.float32)
    write_gaussians(path, Gaussians(place, size, turn, opacity, color, levels, 1e-3))


def _store(path: str, values: np.ndarray) -> None:
    """Write a chunked volume, if zarr is installed."""
    try:
        import zarr
    except ImportError:
        return
    zarr.create_array(path, data=values, chunks=(12, 12, 12))


def run(group: str) -> int:
    """Run all commands of a group; returns the number of failures."""
    from resample.command.session import run as answer

    lines = list(GROUPS[group]())
    failed, home = 0, Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        prepare()
        for line in lines:
            if callable(line):
                line()
                continue
            program, *words = shlex.split(line, comments=True)
            app = import_module(f"{program.replace('-', '_')}.cli").app
            try:
                answer(app, words)
            except SystemExit as end:
                if end.code:
                    failed += 1
                    print(f"{line}: status {end.code}", file=sys.stderr)
        os.chdir(home)
    return failed


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    sys.exit(min(1, sum(map(run, sys.argv[1:] or GROUPS))))
