"""Small files under the names that the documents' commands speak of."""

import json
import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

from resample_points import Gaussians, write_gaussians
from tests import laser, snapshots, splats
from tests.commands import store

WIDE, HIGH = 96, 64
Maker = Callable[[str], None]
SIDE = np.linspace(-1, 1, 24)
CORNER = np.array(laser.CENTER)


def picture(name: str, high: int = HIGH, wide: int = WIDE, gray: bool = False) -> None:
    """Write waves of three colors, or numbers of one channel."""
    y, x = np.indices((high, wide))
    waves = np.stack([x * 255 // wide, y * 255 // high, 128 + 100 * np.sin(x / 5)], axis=2)
    levels = waves.astype(np.uint8)
    Image.fromarray(levels[..., 0] // 64 if gray else levels).save(name)


def depths(name: str, high: int = HIGH, wide: int = WIDE) -> None:
    """Write depth: mm in a PNG, metres in others; a step before a ramp."""
    depth = np.tile(np.linspace(3, 5, wide, dtype=np.float32), (high, 1))
    depth[high // 4 : high // 2, wide // 4 : wide // 2] = 2
    if name.endswith(".png"):
        Image.fromarray((depth * (20 if "disparity" in name else 1000)).astype(np.uint16)).save(
            name
        )
    elif name.endswith(".npy"):
        np.save(name, 1 / depth)
    elif name.endswith(".npz"):
        np.savez(name, depth=np.stack([1 / depth] * 3))
    else:
        store(name, depth[..., None])


def folder(name: str, make: Maker, names: tuple[str, ...]) -> None:
    """Write several files of a folder."""
    Path(name).mkdir(exist_ok=True)
    for one in names:
        make(f"{name}/{one}")


def film(name: str) -> None:
    """Write a film of three pictures."""
    import av

    with av.open(name, "w") as target:
        stream = target.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = WIDE, HIGH, "yuv420p"
        for n in range(3):
            levels = np.full((HIGH, WIDE, 3), 60, np.uint8)
            levels[20:40, 20 + 4 * n : 50 + 4 * n] = 220
            shot = av.VideoFrame.from_ndarray(levels, format="rgb24")
            target.mux(stream.encode(shot.reformat(format="yuv420p")))
        target.mux(stream.encode(None))


def volume(name: str, kind: str = "int16", counts: tuple[int, ...] = ()) -> None:
    """Write balls of values up to 1000, below them air, as a volume of any format of ITK."""
    import SimpleITK

    z, y, x = np.meshgrid(SIDE, SIDE, SIDE, indexing="ij")
    values = np.select(
        [np.hypot(np.hypot(x, y), z + 0.3) < 0.4, np.hypot(np.hypot(x, y), z) < 0.9],
        [900.0, 100.0], -1000.0,
    )  # fmt: skip
    if kind == "uint8":
        values = np.maximum(values, 0) / 4
    if "organs" in name or "labels" in name:
        values = np.select([values > 500, values > 0], [2, 1])
    values = np.stack([values] * counts[0]) if counts else values
    image = SimpleITK.GetImageFromArray(values.astype(kind), isVector=False)
    if not Path(name).suffix:
        Path(name).mkdir()
        writer = SimpleITK.ImageFileWriter()
        writer.KeepOriginalImageUIDOn()
        for n in range(len(SIDE)):
            plane = image[:, :, n]
            facts = {"0008|0060": "CT", "0008|0018": f"1.2.8.{n + 1}", "0020|000d": "1.2.9"}
            facts |= {"0020|000e": "1.2.3", "0020|0013": str(n)}
            facts["0020|0032"] = f"-12\\-12\\{n - 12}"
            for tag, value in facts.items():
                plane.SetMetaData(tag, value)
            writer.SetFileName(f"{name}/{n}.dcm")
            writer.Execute(plane)
    else:
        SimpleITK.WriteImage(image, name)


def array(name: str, low: float, high: float) -> None:
    """Write a field that falls from the middle."""
    z, y, x = np.meshgrid(SIDE, SIDE, SIDE, indexing="ij")
    share = np.exp(-4 * (x * x + y * y + z * z))
    np.save(name, (low + (high - low) * share).astype(np.float32))


def cells(name: str) -> None:
    """Write a stack of three channels."""
    import tifffile

    stack = np.random.default_rng(7).integers(0, 255, (12, 3, 20, 24), np.uint8)
    tifffile.imwrite(name, stack, imagej=True, metadata={"axes": "ZCYX"})


def zarr_store(name: str) -> None:
    """Write a volume with levels, or a picture of zarr."""
    from resample_volume import cli
    from tests.commands import ended

    assert ended(cli.app, "convert", "vessel-tree:size=80", name) == 0


def cloud(name: str) -> None:
    """Write points of a ball with colors, or as laser scanners do."""
    rng = np.random.default_rng(3)
    place = rng.normal(size=(900, 3))
    place *= 20 / np.linalg.norm(place, axis=1)[:, None]
    intensity, group = rng.integers(0, 900, 900), rng.choice([2, 5, 6], 900)
    if name.endswith(".bin"):
        np.column_stack([place, intensity / 900]).astype(np.float32).tofile(name)
    elif "copc" in name:
        x, y, z = (place + CORNER + 25).T
        part = {"x": x, "y": y, "z": z, "intensity": intensity, "classification": group}
        Path(name).write_bytes(laser.copc_of([part, part, part]))
    elif name.endswith(".laz"):
        corner = CORNER if "tile" in name or "next" in name else np.full(3, 50.0)
        x, y, z = (place + corner).T
        own = {"x": x, "y": y, "z": z, "intensity": intensity, "classification": group}
        own |= dict.fromkeys(("red", "green", "blue"), intensity * 60)
        Path(name).write_bytes(laser.las_of(own, packed=True, offsets=corner))
    else:
        head = "ply\nformat ascii 1.0\nelement vertex 900\n"
        head += "".join(f"property float {axis}\n" for axis in (*"xyz", "intensity"))
        rows = np.column_stack([place, intensity])
        body = "\n".join(" ".join(f"{value:.3f}" for value in row) for row in rows)
        Path(name).write_text(f"{head}end_header\n{body}\n")


def gaussians(name: str) -> None:
    """Write a scene of Gaussians in any format."""
    scene = splats.scene(60, 3)
    if name.endswith(".ksplat"):
        Path(name).write_bytes(splats.ksplat_of(scene, 1))
        return
    parts = [np.float32(part) for part in scene[:5]]
    write_gaussians(name, Gaussians(*parts))


def text(name: str, content: str) -> None:
    """Write a text."""
    Path(name).write_text(content)


POSE = "1 0 0 0.1\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
LENS = (
    "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [80., 0., 47.5, 0., 80., 31.5, 0., 0., 1.]\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 4\n   dt: d\n"
    "   data: [-0.05, 0.01, 0., 0.]\n"
)
TOML = "eye = [0, -750, 0]\ntarget = [0, 0, 0]\nfov = 22.62\n"
SHOT = {"id": 0, "img_name": "a", "width": 96, "height": 64, "position": [0, 0, -9], "fx": 90}
SHOT |= {"fy": 90, "rotation": np.eye(3).tolist()}
SHOTS = json.dumps([SHOT | {"id": n} for n in range(13)])
POSES = json.dumps({"frames": [{"transform_matrix": np.eye(4).tolist()}] * 9})
OBJ = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 0 0 1 1 1 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\n"
STENT = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
STENT += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
STENT += "-9 0 0\n9 0 0\n0 0 9\n3 0 1 2\n"


def mapping(name: str) -> None:
    """Write maps of where pixels come from."""
    y, x = np.indices((HIGH, WIDE), np.float32)
    np.savez(name, x=x + np.sin(y / 9), y=y)


def stack(name: str) -> None:
    """Write a picture of zarr in pieces."""
    import zarr

    target = zarr.open(name, mode="w", shape=(200, 300, 3), chunks=(64, 64, 3), dtype="u1")
    target[:] = np.indices((200, 300, 3))[1].astype(np.uint8)


FRAMES = ("1.png", "2.png", "3.png")
NUMBERS = ("1.npy", "2.npy", "3.npy")
SHOTS_OF = ("a.jpg", "b.jpg")
FACES = tuple(f"{n}.png" for n in range(2))
MAKERS: dict[str, Maker] = {
    "desk.jpg photo.jpg photo.png color.jpg a.jpg b.jpg map.png rings.png small.png left.png "
    "page.png": picture,
    "labels.png": partial(picture, gray=True),
    "pano.jpg": partial(picture, high=64, wide=128),
    "depth.png depth.npy rel.npy disparity.png z.exr": depths,
    "rel.npz": depths,
    "rays.exr": partial(depths, high=64, wide=128),
    "height.tif": depths,
    "map.tif color.exr render.exr": lambda name: store(name, np.full((HIGH, WIDE, 3), 0.4)),
    "film.mp4": film,
    "frames": partial(folder, make=picture, names=FRAMES),
    "rel": partial(folder, make=depths, names=NUMBERS),
    "z": partial(folder, make=depths, names=FRAMES),
    "shots photos": partial(folder, make=picture, names=SHOTS_OF),
    "faces": partial(folder, make=partial(picture, high=72, wide=96), names=FACES),
    "H.txt": partial(text, content="0.9 0.1 3\n-0.1 1 5\n0 0.0001 1\n"),
    "gopro.yml calibration.yml fisheye.yml": partial(text, content=LENS),
    "pose.txt T.txt origin.txt": partial(text, content=POSE),
    "poses.json traj.json": partial(text, content=POSES),
    "cameras.json": partial(text, content=SHOTS),
    "device.toml": partial(text, content=TOML),
    "cow.obj": partial(text, content=OBJ),
    "map.npz": mapping,
    "slide.zarr": stack,
    "ct.nii.gz ct.nrrd pet.nrrd labels.nii.gz organs.nrrd head.nii.gz a.nrrd b.nrrd ct": volume,
    "engine.nhdr lobster.nhdr aneurism.nhdr": partial(volume, kind="uint8"),
    "beat.nii.gz": partial(volume, counts=(2,)),
    "density.npy": partial(array, low=1e-29, high=1e-23),
    "velocity.npy": partial(array, low=-3, high=2),
    "scan_128x128x75_int16.raw": lambda name: np.zeros((75, 128, 128), np.int16).tofile(name),
    "cells.tif": cells,
    "engine.ome.zarr cells.ome.zarr": zarr_store,
    "stent.ply": partial(text, content=STENT),
    "scan.ply tile.laz next.laz tile.copc.laz a.laz b.laz scan.bin 000.bin 001.bin 002.bin": cloud,
    "gaussians.ply scene.ply scene.sog scene.spz scene.ksplat": gaussians,
    "snapshot.hdf5": lambda name: snapshots.swift(Path(name)) and None,
}


def make(name: str) -> None:
    """Write a file, unless it is there."""
    maker = next((maker for names, maker in MAKERS.items() if name in names.split()), None)
    if maker is not None and not Path(name).exists():
        maker(name)


def write_inputs(line: str) -> None:
    """Write what a command reads, as far as its name is known here."""
    words = shlex.split(line, comments=True)
    outputs = {words[n + 1] for n, word in enumerate(words[:-1]) if word in ("-o", "--output")}
    outputs |= set(words[3:4] if words[1] == "convert" else ())
    for word in words:
        if word in outputs:
            continue
        for part in word.replace("=", ",").replace(":", ",").split(","):
            make(part.partition("/")[0] if "*" in part else part.rstrip("/"))
