"""Readers and renderers of 3D Gaussians, written from the equations."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.scores.judging import Floats
from benchmarks.scores.kernels.gaussians import composite, composite_rays
from benchmarks.scores.pictures import View

WIDENING = 0.3  # px², of training
ZERO = 0.28209479177387814  # spherical harmonic of degree 0
TYPES = {"float": "<f4", "uint": "<u4", "uchar": "u1"}


class Gaussians(NamedTuple):
    """Gaussians with one color each."""

    position: Floats  # (N, 3)
    scale: Floats  # (N, 3) standard deviations
    quaternion: Floats  # (N, 4) w, x, y, z
    opacity: Floats
    color: Floats  # (N, 3) display values


def read_compressed(path: Path) -> Gaussians:
    """Read SuperSplat's compressed PLY."""
    tables = _elements(path.read_bytes())
    vertex = tables["vertex"]
    chunk = tables["chunk"][np.arange(len(vertex)) // 256]

    def bits(name: str, shift: int, count: int) -> Floats:
        return np.asarray(((vertex[name] >> shift) & ((1 << count) - 1)) / float((1 << count) - 1))

    def vector(word: str, name: str) -> Floats:
        parts = zip("xyz", (bits(word, 21, 11), bits(word, 11, 10), bits(word, 0, 11)), strict=True)
        return np.stack(
            [chunk[f"min_{name}{k}"] * (1 - t) + chunk[f"max_{name}{k}"] * t for k, t in parts], 1
        )

    color = np.stack([bits("packed_color", shift, 8) for shift in (24, 16, 8)], 1)
    if "min_r" in (chunk.dtype.names or ()):
        low, high = (np.stack([chunk[f"{end}_{k}"] for k in "rgb"], 1) for end in ("min", "max"))
        color = low * (1 - color) + high * color
    return Gaussians(
        vector("packed_position", ""),
        np.exp(vector("packed_scale", "scale_")),
        _unpacked_quaternions(vertex["packed_rotation"]),
        bits("packed_color", 0, 8),
        np.maximum(color, 0),
    )


def _elements(raw: bytes) -> dict[str, NDArray[np.void]]:
    """Tables of a binary PLY, by name."""
    offset = raw.index(b"end_header\n") + 11
    listed: list[tuple[str, int, list[tuple[str, str]]]] = []
    for line in raw[:offset].decode().splitlines():
        words = line.split()
        if words[0] == "element":
            listed.append((words[1], int(words[2]), []))
        elif words[0] == "property":
            listed[-1][2].append((words[2], TYPES[words[1]]))
    tables: dict[str, NDArray[np.void]] = {}
    for name, count, fields in listed:
        tables[name] = np.frombuffer(raw, np.dtype(fields), count, offset)
        offset += tables[name].nbytes
    return tables


def _unpacked_quaternions(word: NDArray[np.uint32]) -> Floats:
    """Three components of 10 bits each; the fourth, whose index the top bits hold, is the rest."""
    small = [((word >> s & 1023) / 1023.0 - 0.5) * math.sqrt(2) for s in (20, 10, 0)]
    large = np.sqrt(np.maximum(0, 1 - sum(part * part for part in small)))
    quaternion = np.empty((len(word), 4))
    for which in range(4):
        rows, parts = (word >> 30) == which, [*small]
        parts.insert(which, large)
        quaternion[rows] = np.stack(parts, 1)[rows]
    return quaternion


def write_plain(path: Path, gaussians: Gaussians) -> None:
    """Write the PLY of trainers."""
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
    names += [f"scale_{n}" for n in range(3)] + [f"rot_{n}" for n in range(4)]
    opacity = np.clip(gaussians.opacity, 1e-6, 1 - 1e-6)
    color = (gaussians.color - 0.5) / ZERO
    logit = np.log(opacity / (1 - opacity))
    scale = np.log(gaussians.scale)
    table = np.c_[gaussians.position, color, logit, scale, gaussians.quaternion].astype("<f4")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n"
    head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    path.write_bytes(head.encode() + table.tobytes())


def matrices(quaternion: Floats) -> Floats:
    """Rotations (N, 3, 3) of quaternions."""
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, -1) for row in rows], 1)


def rasterized(
    gaussians: Gaussians, view: View, size: tuple[int, int], compensated: bool = False
) -> Floats:
    """The usual picture (H, W, 3), `size` being width and height.

    Affine projection, 0.3 px² of widening, order of depth, alpha below 1/255 left out and at most
    0.99 (Kerbl et al. 2023). `compensated`: opacities lessened as Mip-Splatting does.
    """
    camera = (gaussians.position - view.eye) @ view.turn.T
    seen = (camera[:, 2] > 0) & (gaussians.opacity > 1 / 255)
    g, (x, y, z) = Gaussians(*(part[seen] for part in gaussians)), camera[seen].T
    u, v = x / z, y / z

    # Covariances on screen, by the projection's derivative at the center.
    bound = [1.3 * 0.5 * n / view.focal for n in size]
    jacobian = np.zeros((len(z), 2, 3))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = view.focal / z
    jacobian[:, 0, 2] = -view.focal * np.clip(u, -bound[0], bound[0]) / z
    jacobian[:, 1, 2] = -view.focal * np.clip(v, -bound[1], bound[1]) / z
    axes = np.einsum("ij,njk->nik", view.turn, matrices(g.quaternion)) * g.scale[:, None, :]
    flat = jacobian @ axes
    covariance = flat @ flat.transpose(0, 2, 1)
    across, mixed, down = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    wide, high = across + WIDENING, down + WIDENING
    determinant = wide * high - mixed**2
    opacity = g.opacity
    if compensated:
        opacity = opacity * np.sqrt(np.maximum(across * down - mixed**2, 0) / determinant)

    image, light = np.zeros((size[1], size[0], 3)), np.ones((size[1], size[0]))
    deviations = np.sqrt(2 * np.log(np.maximum(255 * opacity, 1 + 1e-6)))[:, None]
    composite(
        np.argsort(z, kind="stable"),
        np.stack([view.focal * u + view.center[0], view.focal * v + view.center[1]], 1),
        np.stack([high, -mixed, wide], 1) / determinant[:, None],
        deviations * np.sqrt(np.stack([wide, high], 1)),
        opacity,
        g.color,
        image,
        light,
    )
    return image.clip(0, 1)


def along_rays(gaussians: Gaussians, view: View, pixels: NDArray[np.int64]) -> Floats:
    """Colors (N, 3) of single rays through the centers of `pixels` (N, 2: column, row).

    All Gaussians are sorted along each ray, by where their response is greatest.
    """
    camera = (gaussians.position - view.eye) @ view.turn.T
    widening = WIDENING * (camera[:, 2:] / view.focal) ** 2  # as in training
    scale = np.sqrt(gaussians.scale**2 + widening)
    turn = np.einsum("ij,njk->nik", view.turn, matrices(gaussians.quaternion))
    inverse = np.asarray(turn.transpose(0, 2, 1) / scale[:, :, None])
    way = np.asarray((pixels + 0.5 - view.center) / view.focal, np.float64)
    out = np.zeros((len(pixels), 3))
    local = np.einsum("nij,nj->ni", inverse, camera)
    composite_rays(way, local, inverse, gaussians.opacity, gaussians.color, out)
    return out.clip(0, 1)
