"""Compositing orders: what is painted when, and what is summed first (paper, section 4.1)."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np

from resample.types import Doubles, Layers, View

THINNEST = 1e-3  # voxels; thinner slabs change nothing and take as many times as long


class Summing(IntEnum):
    """What is summed before it is composited."""

    POINTS = 0  # points of a sheet; splats are composited one by one
    SHEETS = 1  # all samples of a sheet
    SLABS = 2  # all that lies between two planes parallel to the screen, which cut splats
    RAYS = 3  # nothing: a field on a lattice is gathered along rays


QUALITIES = ("best", "usual", "fast")  # of rays
MONOTONE = "monotone"
INTERPOLATIONS = (MONOTONE, "spline")  # of largest and least values
OF_FIELDS = (Summing.SLABS, Summing.RAYS)  # what orders sum that classify values


class CompositingOrder(Protocol):
    """Role of an order plugin. It gives a few numbers; painting is the kernels' work."""

    @property
    def thickness(self) -> float:
        """Of the layer that is summed before it is composited, in voxels."""

    @property
    def summing(self) -> Summing:
        """What is summed."""

    def __call__(self, view: View, lattice: Doubles) -> Layers:
        """Layers of samples with a lattice (3, 3); of `Summing.SLABS` they are those of depth."""


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

    def __call__(self, view: View, lattice: Doubles) -> Layers:
        layers = of_depth(view, thickness_of(lattice, self.thickness))
        if self.key == "distance" and view.perspective:
            return layers._replace(axis=(0.0, 0.0, 0.0), offset=0.0, is_around=True)
        return layers


@dataclass(frozen=True)
class AxisSheets:
    """Sheets of the lattice along that of its axes which is nearest to the view axis.

    Westover, Splatting: A Parallel, Feed-Forward Volume Rendering Algorithm, 1991. Colors of a
    sheet do not bleed; pictures pop where another axis becomes the nearest, at 45 degrees.
    """

    thickness = 1.0
    summing = Summing.SHEETS

    def __call__(self, view: View, lattice: Doubles) -> Layers:
        steps = lattice / np.linalg.norm(lattice, axis=0)
        cosine = view.rotation[2] @ steps
        nearest = int(np.argmax(np.abs(cosine)))
        to_lattice = np.linalg.inv(lattice)[nearest]
        if not view.perspective:
            to_lattice = np.sign(cosine[nearest]) * to_lattice
        eye = float(-view.rotation.T @ view.translation @ to_lattice)
        return Layers(
            _vector(to_lattice),
            0.0,  # a lattice may begin between whole numbers
            1.0,
            eye if view.perspective else -np.inf,
            begins_at_first=True,
        )


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

    def __call__(self, view: View, lattice: Doubles) -> Layers:
        return of_depth(view, thickness_of(lattice, self.thickness))


@dataclass(frozen=True)
class Rays:
    """Fields gathered along rays, the other way round: pixels look for samples.

    Where samples grow, this is quicker than summing their splats slab by slab. The field is a cubic
    B-spline that passes through the samples, and looks of values are integrated over steps
    (Engel, Kraus and Ertl, High-Quality Pre-Integrated Volume Rendering, 2001).

    Parameters
    ----------
    step
        Longest step along a ray, voxels; where the field bends, its middle is looked at, too.
    sharpness
        1: the field passes through the samples; 0: it is the smooth one whose coefficients they
        are; between them it is a mixture.
    quality
        How many rays a pixel gets: `best`, as many as voxels that are smallest on screen ask for;
        `usual`, as many as those at the field's middle do, and fewer where the picture is even;
        `fast`, one.
    interpolation
        `monotone`: maxima and minima stay within the eight samples around a place, so that no value
        is shown which no sample has; and applications may make thick slices thin. `spline`: the
        spline through the samples, and nothing else.
    """

    step: float = 1.0
    sharpness: float = 1.0
    quality: str = "best"
    interpolation: str = MONOTONE

    summing = Summing.RAYS

    def __post_init__(self) -> None:
        if not 0.01 <= self.step <= 4:
            raise ValueError(f"a step of {self.step} voxels; 0.01 to 4 are allowed")
        if not 0 <= self.sharpness <= 1:
            raise ValueError(f"the sharpness is {self.sharpness}; 0 to 1 is allowed")
        if self.quality not in QUALITIES:
            known = ", ".join(QUALITIES)
            raise ValueError(f"rays of quality {self.quality!r}; {known} are known")
        if self.interpolation not in INTERPOLATIONS:
            known = ", ".join(INTERPOLATIONS)
            raise ValueError(f"interpolation {self.interpolation!r} of rays; {known} are known")

    @property
    def thickness(self) -> float:
        """Longest step along a ray, voxels."""
        return self.step

    def __call__(self, view: View, lattice: Doubles) -> Layers:
        return of_depth(view, thickness_of(lattice, self.step))


def of_depth(view: View, thickness: float) -> Layers:
    """Layers of even depth; `thickness` in scene units."""
    return Layers(_vector(view.rotation[2]), float(view.translation[2]), thickness)


def thickness_of(lattice: Doubles, voxels: float) -> float:
    """Scene units of a thickness in voxels."""
    return float(abs(np.linalg.det(lattice)) ** (1 / 3) * voxels)


def _vector(array: Doubles) -> tuple[float, float, float]:
    return (float(array[0]), float(array[1]), float(array[2]))


def _check_thickness(thickness: float) -> None:
    if not 0 < thickness < np.inf:
        raise ValueError(f"a layer's thickness must be above 0 voxels, not {thickness}")
