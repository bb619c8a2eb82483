"""The data dictionary: what travels between the parts, with shapes and units and no behaviour.

Conventions, stated once and kept everywhere:

- The pixel in row i, column j covers [j, j + 1) × [i, i + 1); its center is at (j + 0.5, i + 0.5).
- A camera looks along +z with x to the right and y down (OpenCV, COLMAP); poses map world to camera.
- Images are float32, linear light, premultiplied RGBA, shape (H, W, 4).
- Depth is z-depth: the distance along the viewing axis, in scene units.
- Extinction is optical depth per scene unit of length.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Records = NDArray[np.void]


class Samples(NamedTuple):
    """N samples of an object in the scene; all of them share one reconstruction ellipsoid."""

    position: Floats  # (N, 3) scene units
    color: Floats  # (N, 3) linear light, not multiplied by the opacity
    extinction: Floats  # (N,) optical depth per scene unit; 0 is transparent
    lattice: Doubles  # (3, 3) columns are the steps from a sample to its neighbours, scene units


class RadialTable(NamedTuple):
    """A function of one distance, tabulated at equal steps of its argument from 0 to `extent`."""

    values: Floats  # (K + 1,) the last entry is the value at `extent`
    extent: float  # px for pixel filters; 1 for footprints, whose argument is the squared index


class CorrectionTable(NamedTuple):
    """Flat index and cone angle to true distance (paper, section 4.2)."""

    distance: Floats  # (A, K) in radii of the reconstruction sphere
    largest_cone: float  # rad; beyond it kernels evaluate the formula


class Frame(NamedTuple):
    """A picture with what is known about its pixels."""

    rgba: Floats  # (H, W, 4) premultiplied, linear light
    depth: Floats  # (H, W) z-depth weighted by opacity, scene units; inf where nothing is
    first_depth: Floats  # (H, W) z-depth of the nearest visible sample; inf where nothing is
    coverage: Floats  # (H, W) share of the pixel that samples cover, however transparent, 0..1
