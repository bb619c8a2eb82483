"""Pack a mesh's textures, colors and light for the kernels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.profiles.interpolation import Interpolation, prefilter
from resample.types import Doubles, Floats, View
from resample_texture.mesh.kernels.sampling import BLEND, MASK, OPAQUE, Skin
from resample_texture.mesh.kernels.surfaces import Ints
from resample_texture.mesh.shapes import AlphaMode, Cover, Mesh
from resample_texture.texels.forward import EDGES, tap_table
from resample_texture.texels.plates import filtered
from resample_texture.texels.pyramid import Pyramid
from resample_texture.types import Edge

MODES = {AlphaMode.OPAQUE: OPAQUE, AlphaMode.MASK: MASK, AlphaMode.BLEND: BLEND}
CREASE = 40.0  # degrees; beyond this angle, adjacent triangles are shaded flat


def skin(mesh: Mesh, interpolation: Interpolation, view: View, *, shading: bool) -> Skin:
    """Return everything that gives triangles their colors."""
    light = headlight(mesh, view) if shading else np.zeros((0, 3), np.float32)
    edges = [(cover.along_u, cover.along_v) for cover in mesh.covers]
    texel, level, levels = _packed(_ready(mesh.pyramids, edges, interpolation))
    alpha = _packed(_ready(mesh.alphas, edges, interpolation))[0]
    return Skin(
        corner_places(mesh),
        mesh.color[mesh.triangle],
        light,
        mesh.texture,
        texel,
        level,
        levels,
        tap_table(interpolation),
        np.array([[EDGES[edge] for edge in both] for both in edges], np.int64).reshape(-1, 2),
        np.array([_mode(*one) for one in zip(mesh.textures, mesh.covers, strict=True)], np.int64),
        np.array([cover.cutoff for cover in mesh.covers], np.float32),
        alpha,
    )


def corner_places(mesh: Mesh) -> Doubles:
    """Return texture coordinates (T, 3, 2) of all corners, v downward from the top edge."""
    uv = mesh.uv[mesh.triangle]
    uv[..., 1] = 1.0 - uv[..., 1]
    return uv


def _mode(texture: Floats, cover: Cover) -> int:
    return MODES[cover.alpha] if texture.shape[2] == 4 else OPAQUE


def _ready(
    pyramids: tuple[Pyramid, ...], edges: list[tuple[Edge, Edge]], interpolation: Interpolation
) -> list[Pyramid]:
    return [
        coefficients(*one, interpolation=interpolation)
        for one in zip(pyramids, edges[: len(pyramids)], strict=True)
    ]


def coefficients(
    pyramid: Pyramid, edges: tuple[Edge, Edge], interpolation: Interpolation
) -> Pyramid:
    """Prefilter a pyramid's levels for an interpolation; as given if none is needed."""
    weights, one = prefilter(interpolation), np.ones(1, np.float32)
    if weights.size == 1:
        return pyramid
    texel = np.empty_like(pyramid.texel)
    ends = [*pyramid.levels[1:, 0], texel.size]
    for (first, height, width), end in zip(pyramid.levels, ends, strict=True):
        level = pyramid.texel[first:end].reshape(height, width, -1)
        across = filtered(level, weights, one, edges[0])
        texel[first:end] = filtered(across, one, weights, edges[1]).ravel()
    return Pyramid(texel, pyramid.levels)


def _packed(pyramids: list[Pyramid]) -> tuple[Floats, Ints, Ints]:
    """Concatenate all levels of all textures; return texels, offsets and sizes, counts."""
    count = np.array([len(pyramid.levels) for pyramid in pyramids] or [0])
    level = np.zeros((len(count), int(count.max()), 3), np.int64)
    first = 0
    for n, (texel, levels) in enumerate(pyramids):
        level[n, : len(levels)] = levels
        level[n, : len(levels), 0] += first
        first += texel.size
    texels = [pyramid.texel for pyramid in pyramids] or [np.zeros(0, np.float32)]
    return texels[0] if len(texels) == 1 else np.concatenate(texels), level, count


def headlight(mesh: Mesh, view: View) -> Floats:
    """Return the cosine between normal and view direction at triangle corners, (T, 3)."""
    corner = mesh.position[mesh.triangle]
    face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    _, same = np.unique(mesh.position, axis=0, return_inverse=True)
    place = same.reshape(-1)[mesh.triangle]
    smooth = np.stack(
        [np.bincount(place.ravel(), np.repeat(face[:, c], 3), place.max() + 1) for c in range(3)],
        axis=1,
    )
    normal, flat = _unit(smooth[place]), _unit(face)[:, None]
    is_crease = (normal * flat).sum(axis=2, keepdims=True) < np.cos(np.radians(CREASE))
    normal = np.where(is_crease, flat, normal)
    eye = -view.rotation.T @ view.translation
    toward = _unit(eye - corner) if view.perspective else view.rotation[2]
    cosine: Floats = np.abs((normal * toward).sum(axis=2)).astype(np.float32)
    return cosine


def _unit(vector: NDArray[Any]) -> Doubles:
    """Normalize vectors; zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    unit: Doubles = np.divide(vector, length, out=np.zeros(vector.shape), where=length > 0)
    return unit
