"""The index correction for perspective splats (paper, section 4.2): formula and 2-D table."""

import numpy as np

from resample.types import LARGEST_CONE, Doubles, Floats


def true_distance(index: Doubles, cone: Doubles) -> Doubles:
    """Distance of a ray from the center of a sphere, in radii.

    Parameters
    ----------
    index
        Radius of the ray in the flat circle that the ellipse maps to, 0 center, 1 rim.
    cone
        Half angle α of the sphere's tangent cone, rad, above 0 and below π/2.

    Notes
    -----
    Yuan et al. 2003, section 4.2, print d = sin(arctan(i tan α)) / tan α. Their own OE = r / sin α
    gives the divisor sin α, with which the rim i = 1 comes out as d = 1.
    """
    return np.asarray(np.sin(np.arctan(index * np.tan(cone))) / np.sin(cone), dtype=np.float64)


def correction_table(cones: int = 64, indices: int = 256) -> Floats:
    """Table of `true_distance` over cone (rows, 0 to 15°) and index (columns, 0 to 1)."""
    cone = np.linspace(0, LARGEST_CONE, cones)[:, None]
    index = np.linspace(0, 1, indices)[None, :]
    distance = true_distance(index, np.maximum(cone, 1e-6))
    return distance.astype(np.float32)
