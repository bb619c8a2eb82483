"""Compositing orders: what is painted when, and what is summed first (paper, section 4.1)."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from resample.types import Records, Sheets


class CompositingOrder(Protocol):
    """Role of an order plugin. It returns indices only; painting is the kernels' work."""

    @property
    def thickness(self) -> float:
        """Of the layer whose points are summed before they are composited, in voxels."""

    def __call__(self, footprints: Records, layer: float) -> Sheets:
        """Order of N footprints; `layer` is the thickness in scene units."""


@dataclass(frozen=True)
class EverySample:
    """Strict depth order: splats are composited one by one, points in layers of depth.

    Parameters
    ----------
    thickness
        Depth range over which points are summed, voxels ("e.g., 1 unit"; paper, section 4.1).
    """

    thickness: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.thickness < np.inf:
            raise ValueError(f"a layer's thickness must be above 0 voxels, not {self.thickness}")

    def __call__(self, footprints: Records, layer: float) -> Sheets:
        depth = np.ascontiguousarray(footprints["depth"])
        sheet = np.clip(np.floor(depth / layer), -2e9, 2e9).astype(np.int32)
        return Sheets(depth, sheet)
