"""Compositing orders: sequence of painting, sums before compositing, layers of samples.

See the paper, section 4.1.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np

from resample.messages import number
from resample.types import LAST_SHEET, Doubles, Floats, Layers, Sheets, View

QUALITIES = ("best", "usual", "fast")  # of rays
MONOTONE = "monotone"
INTERPOLATIONS = (MONOTONE, "spline")  # for maxima and minima


class Summing(IntEnum):
    """Samples that are summed before compositing."""

    POINTS = 0  # points of a sheet; splats are composited one by one
    SHEETS = 1  # all samples of a sheet
    SLABS = 2  # everything between two planes parallel to the screen, which cut splats
    RAYS = 3  # nothing: a field on a lattice is sampled along rays


class CompositingOrder(Protocol):
    """Interface of an order plugin. It returns a few numbers; kernels do the painting."""

    @property
    def thickness(self) -> float:
        """Thickness in voxels of the layer that is summed before compositing."""

    @property
    def summing(self) -> Summing:
        """Kind of sums; orders of sheets and slabs have a `painter`, made of all choices."""

    def __call__(self, view: View, lattice: Doubles) -> Layers:
        """Layers of samples with a lattice (3, 3); for `Summing.SLABS`, layers of depth."""


@dataclass(frozen=True)
class EverySample:
    """Strict depth order: splats are composited one by one, points in layers of depth.

    Westover, Interactive Volume Rendering, 1989. Colors bleed slightly where kernels overlap.

    Parameters
    ----------
    thickness
        Depth range over which points are summed, voxels ("e.g., 1 unit"; paper, section 4.1).
    key
        Sort key of samples: `depth` along the view axis, or `distance` from the eye.
    """

    thickness: float = 1.0
    key: str = "depth"

    summing = Summing.POINTS

    def __post_init__(self) -> None:
        check_thickness(self.thickness)
        if self.key not in ("depth", "distance"):
            raise ValueError(f"samples are ordered by depth or distance, not by {self.key!r}")

    def __call__(self, view: View, lattice: Doubles) -> Layers:
        layers = of_depth(view, thickness_of(lattice, self.thickness))
        if self.key == "distance" and view.perspective:
            return layers._replace(axis=(0.0, 0.0, 0.0), offset=0.0, is_around=True)
        return layers


@dataclass(frozen=True)
class Rays:
    """Rays cast through a field: pixels gather samples instead of samples being splatted.

    Where samples grow, this is faster than summing their splats slab by slab. The field is an
    interpolating cubic B-spline, and classified values are integrated over steps (Engel, Kraus and
    Ertl, High-Quality Pre-Integrated Volume Rendering, 2001).

    Parameters
    ----------
    step
        Longest step along a ray, voxels; where the field bends, its middle is sampled as well.
    sharpness
        1: the field interpolates the samples; 0: it is smoothed, with the samples as spline
        coefficients; in between it is a blend.
    quality
        Number of rays per pixel: `best`, as needed for the voxels smallest on screen; `usual`, as
        needed for those at the field's center, and fewer where the picture is uniform; `fast`,
        one.
    interpolation
        `monotone`: maxima and minima stay within the eight samples around a position, so that no
        value is shown that no sample has; and applications may thin thick slices. `spline`: the
        interpolating spline, and nothing else.
    """

    step: float = 1.0
    sharpness: float = 1.0
    quality: str = "best"
    interpolation: str = MONOTONE

    summing = Summing.RAYS

    def __post_init__(self) -> None:
        if not 0.01 <= number("step", self.step) <= 4:
            raise ValueError(f"a step of {self.step} voxels; 0.01 to 4 are allowed")
        if not 0 <= number("sharpness", self.sharpness) <= 1:
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
    x, y, z = view.rotation[2].tolist()
    return Layers((x, y, z), float(view.translation[2]), thickness)


def thickness_of(lattice: Doubles, voxels: float) -> float:
    """Scene units of a thickness in voxels."""
    return float(abs(np.linalg.det(lattice)) ** (1 / 3) * voxels)


def check_thickness(thickness: float) -> None:
    """Reject a layer without thickness."""
    if not 0 < number("thickness", thickness) < np.inf:
        raise ValueError(f"a layer's thickness must be above 0 voxels, not {thickness}")


def layers_of(order: CompositingOrder, position: Floats, view: View, lattice: Doubles) -> Layers:
    """Layers of an order; the first begins at the first of the samples (N, 3)."""
    layers = order(view, lattice)
    if not layers.begins_at_first:
        return layers
    begin = float(_places(layers, position, view).min(initial=np.inf)) if len(position) else 0.0
    begin -= 0.5 * layers.thickness
    return layers._replace(
        offset=float(layers.offset - begin),
        eye=float(layers.eye - begin),
        begins_at_first=False,
    )


def sheets_of(layers: Layers, summing: Summing, position: Floats, view: View) -> Sheets:
    """Keys and sheets of samples (N, 3), as painters compute them (`engine.compositing`)."""
    place = _places(layers, position, view)
    number = np.floor(place.astype(np.float32) / np.float32(layers.thickness))
    sheet = np.clip(number.astype(np.float64), -LAST_SHEET, LAST_SHEET).astype(np.int32)
    if summing is not Summing.SHEETS:
        key = np.abs(place - layers.eye) if layers.eye > -np.inf else place
        return Sheets(key.astype(np.float32), sheet)
    if layers.eye == -np.inf:
        return Sheets(sheet.astype(np.float32), sheet)
    # No two sheets have the same key: an eye between sheets has some on both sides.
    ahead = sheet + 0.5 - layers.eye / layers.thickness
    away = np.abs(ahead).astype(np.float32)
    return Sheets(np.where(ahead < 0.0, np.nextafter(away, np.float32(np.inf)), away), sheet)


def _places(layers: Layers, position: Floats, view: View) -> Doubles:
    """Places (N,) of samples (N, 3), by which layers are numbered."""
    x, y, z = position.T.astype(np.float64)
    if layers.is_around:
        eye = -view.rotation.T @ view.translation
        x, y, z = x - eye[0], y - eye[1], z - eye[2]
        return np.asarray(np.sqrt(x * x + y * y + z * z), np.float64)
    a, b, c = layers.axis
    return np.asarray(layers.offset + (a * x + b * y + c * z), np.float64)
