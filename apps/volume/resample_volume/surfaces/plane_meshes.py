"""Convert image planes to meshes with the field's colors at their vertices."""

import math

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_volume.surfaces.image_planes import ImagePlane, outline
from resample_volume.surfaces.meshes import SceneMesh
from resample_volume.types import Volume
from resample_volume.voxels.gathered import Gathered
from resample_volume.voxels.tints import PAD

FINEST = 8  # vertices per voxel along each axis of a plane, at most
MOST = 1 << 18  # quadrangles of a plane
CHUNK = 1 << 18  # points interpolated at a time


def plane_mesh(plane: ImagePlane, volume: Volume, field: Gathered) -> SceneMesh:
    """Make a mesh without normals, so that colors are not shaded."""
    place, face = _grid(outline(volume, plane.numbers))
    face = face[_is_known(field, place[face].mean(axis=1))]
    color = plane.palette.colors(values_at(field, place), plane.window or (0.0, 1.0)).astype(
        np.float64
    )
    corner = np.asarray(volume.origin, np.float64) + place @ field.lattice.T
    return SceneMesh(corner, np.zeros_like(corner), color.astype(np.float64), face, plane.opacity)


def values_at(field: Gathered, place: Doubles) -> Doubles:
    """Interpolate a field at points (N, 3), voxels along x, y and z, at most 1/2 outside."""
    from scipy.ndimage import map_coordinates

    spline = field.spline
    padded = [count + 2 * PAD for count in spline.shape]
    coefficient = spline.coefficient.reshape(padded)
    found = np.empty(len(place))
    for start in range(0, len(place), CHUNK):
        part = slice(start, start + CHUNK)
        at = place[part, ::-1].T + PAD
        map_coordinates(coefficient, at, found[part], order=3, prefilter=False)
    return np.clip(spline.zero + spline.scale * found, spline.floor, spline.ceiling)


def _is_known(field: Gathered, place: Doubles) -> NDArray[np.bool_]:
    """Return whether the voxels that contain points (N, 3) have values."""
    if not field.known.size:
        return np.ones(len(place), bool)
    known = field.known.reshape([count + 2 * PAD for count in field.spline.shape])
    x, y, z = np.floor(place + 0.5).astype(np.int64).T + PAD
    return np.asarray(known[z, y, x] > 0)


def _grid(corner: Doubles) -> tuple[Doubles, NDArray[np.int64]]:
    """Triangulate a convex polygon (N, 3), voxels, by vertices (V, 3) and triangles (T, 3)."""
    if len(corner) == 4 and np.allclose(corner[0] + corner[2], corner[1] + corner[3]):
        first, right, both, down = corner
        patches = [np.array([first, right, down, both])]
    else:
        middle = corner.mean(axis=0)
        after = np.roll(corner, -1, axis=0)
        patches = [np.array([middle, middle, *pair]) for pair in zip(corner, after, strict=True)]
    per = _per_voxel(patches)
    deepest = max(_steps(patch, per)[0] for patch in patches)
    places, faces, start = [], [], 0
    for patch in patches:
        place, face = _patch(patch, (deepest, _steps(patch, per)[1]))
        places.append(place)
        faces.append(face + start)
        start += len(place)
    return np.concatenate(places), np.concatenate(faces)


def _per_voxel(patches: list[Doubles]) -> float:
    """Return the vertices per voxel, within the limit of all together."""
    area = sum(math.prod(_lengths(patch)) for patch in patches)
    return min(FINEST, math.sqrt(MOST / max(area, 1e-9)))


def _lengths(patch: Doubles) -> tuple[float, float]:
    """Return its greatest lengths down and right, voxels."""
    first, right, down, both = patch
    deep = max(np.linalg.norm(down - first), np.linalg.norm(both - right))
    wide = max(np.linalg.norm(right - first), np.linalg.norm(both - down))
    return float(deep), float(wide)


def _steps(patch: Doubles, per: float) -> tuple[int, int]:
    deep, wide = _lengths(patch)
    return max(1, math.ceil(per * deep - 1e-6)), max(1, math.ceil(per * wide - 1e-6))


def _patch(patch: Doubles, steps: tuple[int, int]) -> tuple[Doubles, NDArray[np.int64]]:
    """Return vertices and triangles between four corners: first, right, down and both."""
    down, right = (np.linspace(0, 1, count + 1) for count in steps)
    v, u = (part[..., np.newaxis] for part in np.meshgrid(down, right, indexing="ij"))
    place = (1 - v) * ((1 - u) * patch[0] + u * patch[1]) + v * ((1 - u) * patch[2] + u * patch[3])
    number = np.arange(v.size).reshape(steps[0] + 1, steps[1] + 1)
    a, b, c, d = (
        part.ravel()
        for part in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
    )
    face = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
    return place.reshape(-1, 3), face
