"""Prepare meshes for ray casting: sort triangles spatially and build a tree of boxes."""

import numpy as np

from resample.types import Doubles, Indices, Triangles

STEPS = 2**20  # along each axis, to which centers of triangles are quantised
WIDER = 1e-9  # fraction of the extent by which boxes are enlarged


def mesh_of(
    corner: Doubles, normal: Doubles, color: Doubles, face: Indices, opacity: Doubles
) -> Triangles:
    """Build triangles for ray casting.

    `corner`: (V, 3) scene units. `normal`: (V, 3) of any length; where zero, a surface is not lit
    and shows its own color. `color`: (V, 3) straight linear RGB. `face`: (T, 3) indices of corners.
    `opacity`: (T,) 0..1.
    """
    if not np.isfinite(corner).all():
        raise ValueError("a mesh has corners that are not finite numbers; take them out")
    if face.size and not (face.min() >= 0 and face.max() < len(corner)):
        raise ValueError(f"a mesh of {len(corner)} corners has triangles with other indices")
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    unit = np.divide(normal, length, out=np.zeros(normal.shape), where=length > 0)
    # Indices in Morton order, which keeps neighbours together.
    middle = corner[face].mean(axis=1)
    low = middle.min(axis=0, initial=np.inf)
    extent = max(float((middle.max(axis=0, initial=-np.inf) - low).max()), 1e-300)
    step = np.minimum((middle - low) * (STEPS / extent), STEPS - 1).astype(np.uint64)
    code = np.zeros(len(middle), np.uint64)
    for bit in range(20):
        for axis in range(3):
            here = (step[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= here << np.uint64(3 * bit + axis)
    order = np.argsort(code, kind="stable")
    face, opacity = face[order], opacity[order]
    return Triangles(
        np.ascontiguousarray(corner, np.float64),
        np.ascontiguousarray(unit, np.float64),
        np.ascontiguousarray(color, np.float64),
        np.ascontiguousarray(face, np.int64),
        np.ascontiguousarray(opacity, np.float64),
        _boxes(corner[face]),
    )


def _boxes(triangle: Doubles) -> Doubles:
    """Tree of boxes (2 L, 6) around triangles (T, 3, 3), in their order."""
    from resample.engine.rays.meshes import LEAF

    if not len(triangle):
        return np.zeros((0, 6))
    leaves = 1
    while leaves * LEAF < len(triangle):
        leaves *= 2
    slack = WIDER * float(np.abs(triangle).max())
    low = np.full((leaves * LEAF, 3), np.inf)
    high = -low
    low[: len(triangle)] = triangle.min(axis=1) - slack
    high[: len(triangle)] = triangle.max(axis=1) + slack
    box = np.empty((2 * leaves, 6))
    low, high = low.reshape(leaves, LEAF, 3).min(axis=1), high.reshape(leaves, LEAF, 3).max(axis=1)
    while True:
        box[leaves : 2 * leaves] = np.hstack([low, high])
        if leaves == 1:
            box[0] = box[1]
            return box
        leaves //= 2
        low, high = low.reshape(leaves, 2, 3).min(axis=1), high.reshape(leaves, 2, 3).max(axis=1)
