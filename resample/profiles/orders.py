"""Compositing orders: what is painted when, and what is summed first (paper, section 4.1)."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats, Seen, Sheets

THINNEST = 1e-3  # voxels; thinner slabs change nothing and take as many times as long
LAST_SHEET = 2e9  # sheets are numbered by 32 bits


class Summing(IntEnum):
    """What is summed before it is composited."""

    POINTS = 0  # points of a sheet; splats are composited one by one
    SHEETS = 1  # all samples of a sheet
    SLABS = 2  # all that lies between two planes parallel to the screen, which cut splats


class CompositingOrder(Protocol):
    """Role of an order plugin. It returns indices only; painting is the kernels' work."""

    @property
    def thickness(self) -> float:
        """Of the layer that is summed before it is composited, in voxels."""

    @property
    def summing(self) -> Summing:
        """What is summed."""

    def __call__(self, seen: Seen) -> Sheets:
        """Order of N samples; under `Summing.SLABS` the key must be their depth."""


@dataclass(frozen=True)
class EverySample:
    """Strict depth order: splats are composited one by one, points in layers of depth.

    Westover, Interactive Volume Rendering, 1989. Colors bleed a little where kernels overlap.

    Parameters
    ----------
    thickness
        Depth range over which points are summed, voxels ("e.g., 1 unit"; paper, section 4.1).
    key
        What samples are ordered by: `depth` along the view axis, or `distance` from the eye.
    """

    thickness: float = 1.0
    key: str = "depth"

    summing = Summing.POINTS

    def __post_init__(self) -> None:
        _check_thickness(self.thickness)
        if self.key not in ("depth", "distance"):
            raise ValueError(f"samples are ordered by depth or distance, not by {self.key!r}")

    def __call__(self, seen: Seen) -> Sheets:
        view = seen.view
        key = np.ascontiguousarray(seen.footprints["depth"])
        if self.key == "distance" and view.perspective:
            away = seen.position - (-view.rotation.T @ view.translation)
            key = np.sqrt(np.einsum("nd,nd->n", away, away)).astype(np.float32)
        return Sheets(key, _numbered(key / seen.layer))


@dataclass(frozen=True)
class AxisSheets:
    """Sheets of the lattice along that of its axes which is nearest to the view axis.

    Westover, Splatting: A Parallel, Feed-Forward Volume Rendering Algorithm, 1991. Colors of a
    sheet do not bleed; pictures pop where another axis becomes the nearest, at 45 degrees.
    """

    thickness = 1.0
    summing = Summing.SHEETS

    def __call__(self, seen: Seen) -> Sheets:
        forward = seen.view.rotation[2]
        steps = seen.lattice / np.linalg.norm(seen.lattice, axis=0)
        axis = int(np.argmax(np.abs(forward @ steps)))
        to_lattice = np.linalg.inv(seen.lattice)[axis]
        place = seen.position @ to_lattice
        first = place.min() if place.size else 0.0  # a lattice may begin between whole numbers
        number = np.rint(place - first)
        if not seen.view.perspective:
            ahead = np.sign(forward @ steps[:, axis]) * number
            return Sheets(ahead.astype(np.float32), _numbered(number))
        eye = -seen.view.rotation.T @ seen.view.translation @ to_lattice - first
        away = np.abs(number - eye).astype(np.float32)
        # An eye between sheets has some on both sides, which must not mix where they are as far.
        key = np.where(number < eye, np.nextafter(away, np.float32(np.inf)), away)
        return Sheets(key, _numbered(number))


@dataclass(frozen=True)
class ImageSheets:
    """Slabs of even depth, which cut splats in parts.

    Mueller, Shareef, Huang and Crawfis, High-Quality Splatting on Rectilinear Grids with Efficient
    Culling of Occluded Voxels, 1999. Nothing bleeds and nothing pops; every splat is painted once
    for each slab that it lies in. Thinner slabs come nearer to the integral along the ray.

    Parameters
    ----------
    thickness
        Of a slab, voxels.
    """

    thickness: float = 1.0

    summing = Summing.SLABS

    def __post_init__(self) -> None:
        _check_thickness(self.thickness)
        if self.thickness < THINNEST:
            raise ValueError(f"slabs of {self.thickness} voxels; {THINNEST} is the least")

    def __call__(self, seen: Seen) -> Sheets:
        depth = np.ascontiguousarray(seen.footprints["depth"])
        return Sheets(depth, _numbered(depth / seen.layer))


def _numbered(layers: Doubles | Floats) -> NDArray[np.int32]:
    """Whole numbers of layers; those of samples that cannot be seen mean nothing."""
    whole = np.floor(np.nan_to_num(layers, nan=0.0))
    number: NDArray[np.int32] = np.clip(whole, -LAST_SHEET, LAST_SHEET).astype(np.int32)
    return number


def _check_thickness(thickness: float) -> None:
    if not 0 < thickness < np.inf:
        raise ValueError(f"a layer's thickness must be above 0 voxels, not {thickness}")
