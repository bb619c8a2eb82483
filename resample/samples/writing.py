"""Write samples to standard file formats, byte for byte the same on every machine."""

import struct
import zlib
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from resample.samples import SampleFiles


@runtime_checkable
class Storable(Protocol):
    """Interface of a sample that can write itself; plugins may implement it."""

    def stored(self, folder: Path, name: str) -> SampleFiles:
        """Write the sample to files in an existing folder."""


def store(sample: Any, folder: Path, name: str) -> SampleFiles:
    """Write a sample.

    `sample`: a picture (H, W) or (H, W, 3 or 4) of bytes, a volume, or a `Storable`.
    """
    if isinstance(sample, Storable):
        return sample.stored(folder, name)
    if isinstance(sample, np.ndarray):
        write_png(folder / f"{name}.png", sample)
        return SampleFiles([f"{name}.png"])
    if hasattr(sample, "values") and hasattr(sample, "spacing"):
        write_nrrd(folder / f"{name}.nrrd", sample)
        return SampleFiles([f"{name}.nrrd"])
    raise TypeError(f"sample {name} is of {type(sample).__name__}, which has no method `stored`")


def write_png(path: Path, levels: NDArray[Any]) -> None:
    """Write levels as they are, (H, W) or (H, W, 3 or 4)."""
    if levels.dtype != np.uint8 or levels.ndim not in (2, 3):
        raise TypeError(f"{path.name}: a picture is of bytes, not {levels.dtype}{levels.shape}")
    kinds = {1: 0, 3: 2, 4: 6}
    height, width = levels.shape[:2]
    channels = 1 if levels.ndim == 2 else levels.shape[2]
    head = struct.pack(">2I5B", width, height, 8, kinds[channels], 0, 0, 0)
    rows = levels.reshape(height, -1)
    above = np.vstack([np.zeros_like(rows[:1]), rows[:-1]])
    lines = np.hstack([np.full((height, 1), 2, np.uint8), rows - above])  # minus the row above
    parts = [(b"IHDR", head), (b"sRGB", b"\0"), (b"IDAT", zlib.compress(lines.tobytes(), 6))]
    with path.open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, data in (*parts, (b"IEND", b"")):
            file.write(struct.pack(">I", len(data)) + kind + data)
            file.write(struct.pack(">I", zlib.crc32(kind + data)))


def write_npy(path: Path, values: NDArray[Any]) -> None:
    """Write an array as NPY; NumPy does not notice a full disk."""
    stored = BytesIO()
    np.save(stored, values)
    path.write_bytes(stored.getbuffer())


def write_nrrd(path: Path, volume: Any) -> None:
    """Write a volume with `values` (Z, Y, X), `spacing` and `origin` (x, y, z)."""
    values = np.ascontiguousarray(volume.values)
    kind = values.dtype.name.replace("float32", "float").replace("float64", "double")
    steps = [", ".join(f"{s if n == axis else 0.0!r}" for n in range(3))
             for axis, s in enumerate(map(float, volume.spacing))]  # fmt: skip
    lines = (
        "NRRD0004",
        f"type: {kind}",
        "dimension: 3",
        "space dimension: 3",
        f"sizes: {' '.join(map(str, values.shape[::-1]))}",
        f"space directions: {' '.join(f'({step})' for step in steps)}",
        "kinds: domain domain domain",
        "endian: little",
        "encoding: raw",
        f"space origin: ({', '.join(repr(float(place)) for place in volume.origin)})",
    )
    data = values.astype(values.dtype.newbyteorder("<"), copy=False)
    path.write_bytes("\n".join(lines).encode() + b"\n\n" + data.tobytes())


def write_obj(path: Path, mesh: Any) -> None:
    """Write textured triangles; material and picture are beside the file."""
    write_png(path.with_suffix(".png"), mesh.texture)
    path.with_suffix(".mtl").write_text(
        f"newmtl {path.stem}\nKd 1 1 1\nmap_Kd {path.stem}.png\n", "utf-8"
    )
    corner = mesh.triangle + 1
    lines = [f"mtllib {path.stem}.mtl", f"usemtl {path.stem}"]
    lines += ["v {:.6f} {:.6f} {:.6f}".format(*place) for place in mesh.position.tolist()]
    lines += ["vt {:.6f} {:.6f}".format(*place) for place in mesh.place.tolist()]
    lines += ["vn {:.5f} {:.5f} {:.5f}".format(*way) for way in mesh.normal.tolist()]
    lines += ["f {0}/{0}/{0} {1}/{1}/{1} {2}/{2}/{2}".format(*three) for three in corner.tolist()]
    path.write_text("\n".join(lines) + "\n", "utf-8")


def write_ply(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write points with columns of floats or bytes, binary."""
    kinds = {np.dtype(np.float32): ("float", "<f4"), np.dtype(np.uint8): ("uchar", "u1")}
    stored = [(name, kinds[values.dtype][1]) for name, values in columns.items()]
    table = np.empty(len(next(iter(columns.values()))), stored)
    for name, values in columns.items():
        table[name] = values
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n"
    named = ((kinds[values.dtype][0], name) for name, values in columns.items())
    head += "".join(f"property {kind} {name}\n" for kind, name in named) + "end_header\n"
    path.write_bytes(head.encode() + table.tobytes())
