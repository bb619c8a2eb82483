"""Samples of individual sizes: how footprints grow with them, and points that stand alone."""

import math

import numpy as np

from resample.engine.ellipsoids.footprints import in_camera
from resample.engine.ellipsoids.outlines import (
    AREA,
    BATCH,
    CUT,
    EXTINCTION,
    OPACITY,
    SIZE,
    SPACING,
    OutlineSetup,
)
from resample.engine.jit import kernel
from resample.engine.lookup import absorbed, unit_lookup
from resample.engine.mixtures.models import POINT
from resample.engine.sorting import Pairs, member_of
from resample.engine.vectors import dot, multiply, vector_at
from resample.types import Floats

# Gauss-Legendre nodes and weights to integrate footprints over squared distances 0..1
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(12)
NODE, WEIGHT = 0.5 + 0.5 * _NODE, 0.5 * _WEIGHT
FAINTEST = 1e-30  # least opacity of a point, as it is divided by


@kernel
def gather_sizes(room: Floats, ready: Pairs, scale: Floats | None) -> Floats | None:
    """Gather sizes (BATCH,) of samples, if they have any; scale extinctions by them."""
    if scale is None:
        return None
    # Line integrals grow in proportion to the size.
    for n in range(ready.size):
        k = np.uint64(n)
        room[k + SIZE] = scale[np.uint64(member_of(ready[n]))]
        room[k + EXTINCTION] *= room[k + SIZE]
    return room[SIZE : SIZE + np.uint64(BATCH)]


@kernel
def resize(room: Floats, scale: Floats | None, count: int) -> None:
    """Scale spacings and areas that were measured for size 1."""
    if scale is not None:
        for n in range(count):
            k, size = np.uint64(n), scale[np.uint64(n)]
            room[k + SPACING] *= size
            room[k + AREA] *= size * size


@kernel
def match_splat_opacity(
    room: Floats,
    position: Floats,
    scale: Floats | None,
    count: int,
    sight: OutlineSetup,
    subpixels: int,
    table: Floats,
) -> None:
    """Give points of individual sizes the opacity that their splats would have.

    Points of a lattice have the opacity of a layer of them, as their neighbours fill it.
    """
    if scale is None:
        return
    # Integrate the footprint over its area.
    eye, shape, _ = sight.optics
    t, far, total = shape.to_unit, eye.perspective, 0.0
    parallel = 1.0 / math.sqrt(t[0][2] * t[0][2] + t[1][2] * t[1][2] + t[2][2] * t[2][2])
    for m in range(NODE.size):
        total += WEIGHT[m] * unit_lookup(table, np.float32(NODE[m]))
    # Only points are affected.
    for n in range(count):
        k = np.uint64(n)
        if room[k + CUT] != POINT:
            continue
        # Factor of line integrals along the central ray.
        center = in_camera(eye, vector_at(position, k))
        unit, squared = multiply(t, center), dot(center, center)
        along = shape.scale * (math.sqrt(squared / dot(unit, unit)) if far else parallel)
        # Integrate the opacity over the footprint, by quadrature.
        lost, grown = 0.0, scale[k] * subpixels / (center[2] if far else 1.0)
        for m in range(NODE.size):
            integral = along * unit_lookup(table, np.float32(NODE[m]))
            lost += WEIGHT[m] * absorbed(room[k + EXTINCTION] * integral)
        # Scale by the footprint's area on the screen, in sub-pixels.
        oblique = math.sqrt(squared) / center[2] if far else 1.0
        mass = shape.volume * oblique * eye.fx * eye.fy * grown * grown
        room[k + OPACITY] = np.float32(max(FAINTEST, mass / (along * total) * lost))
