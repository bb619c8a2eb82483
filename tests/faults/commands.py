"""Commands of all applications on small files of their own, for trials under bad conditions."""

import os
import re
import struct
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from resample.files.formats import WriteOptions
from resample.files.pictures import Kind, Picture
from resample.files.saving import write_picture
from tests.processes import PATIENCE

COMMANDS: Mapping[str, str] = {  # by what they write, whose name goes at the end
    "volume.png": "resample_volume render ct.npy --size 96 -o",
    "volume.exr": "resample_volume render ct.npy --size 96 --camera 30,20,1.5 -o",
    "volume.gif": "resample_volume animate ct.npy --size 48 --frames 4 -o",
    "store.ome.zarr": "resample_volume convert --chunk 16 ct.npy",
    "tree.nii.gz": "resample_volume generate vessel-tree:size=32 -o",
    "turned.jpg": "resample_texture rotate photo.png --degrees 7 --background white -o",
    "small.tif": "resample_texture resize photo.png --size 61x47 -o",
    "flight.webp": "resample_texture animate photo.png --size 64x48 --frames 3 -o",
    "moved.png": "resample_warp3d render photo.png z.npy --fov 60 --move .1,0,0 -o",
    "eye.png": "resample_warp3d stereo photo.png z.npy --fov 60 -o",
    "sway": "resample_warp3d animate photo.png z.npy --fov 60 --frames 3 -o",
    "cloud.png": "resample_points render cloud.ply --size 96 -o",
    "same.png": "resample compare photo.png -R photo.png -o",
}
WRITTEN = re.compile(rb"20\d\d:\d\d:\d\d \d\d:\d\d:\d\d")  # the date in TIFF and EXR
Tree = dict[str, bytes | None]  # content of files by their path, None for folders


def write_inputs(folder: Path) -> None:
    """Write what the commands read."""
    rng = np.random.default_rng(7)
    np.save(folder / "ct.npy", rng.normal(0, 400, (20, 24, 28)).astype(np.int16))
    shades = rng.random((96, 128, 3), np.float32)
    write_picture(
        folder / "photo.png",
        Picture(shades, Kind(("R", "G", "B"), 8, is_encoded=True)),
        WriteOptions(),
    )
    np.save(folder / "z.npy", (2 + rng.random((96, 128))).astype(np.float32))
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 500\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    points = b"".join(struct.pack("<3f", *point) for point in rng.random((500, 3)))
    (folder / "cloud.ply").write_bytes(head.encode() + points)


def began(
    folder: Path, target: str, command: str = "", within: Sequence[str] = (), **how: Any
) -> "subprocess.Popen[str]":
    """Begin a command in a folder."""
    how = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True, **how}
    words = [*within, sys.executable, "-m", *COMMANDS[command or target].split(), target]
    return subprocess.Popen(words, cwd=folder, stdin=subprocess.DEVNULL, **how)


def run(folder: Path, target: str, **how: Any) -> "subprocess.CompletedProcess[str]":
    """Run a command in a folder to its end."""
    command = began(folder, target, **how)
    printed, said = command.communicate(timeout=PATIENCE)
    return subprocess.CompletedProcess(command.args, command.returncode, printed, said)


def content(path: Path) -> Tree:
    """A file, or a folder with all that is in it, but for the date of writing."""
    inner = path.rglob("*") if path.is_dir() else ()
    return {
        os.path.relpath(each, path): WRITTEN.sub(b"", each.read_bytes()) if each.is_file() else None
        for each in (path, *inner)
        if each.exists()
    }


def hidden(folder: Path) -> list[str]:
    """Names of hidden files and folders."""
    return sorted(path.name for path in folder.iterdir() if path.name.startswith("."))


def whole_of(make_folder: Callable[[], Path], target: str) -> Tree:
    """What a command writes when nothing is in its way."""
    folder = make_folder()
    write_inputs(folder)
    ended = run(folder, target)
    assert ended.returncode == 0, ended.stderr
    return content(folder / target)
