"""Fields along rays in plain NumPy: a spline of SciPy's, and a loop of short steps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from resample.cameras.models import AnyCamera
from resample.types import Classifier, LatticeField
from tests import naive

BEYOND = 20  # samples of mirror images around the field
SHORT = 1 / 32  # voxels, a step

Array = NDArray[Any]


@dataclass
class Along:
    """What rays meet: (H, W, K) steps, or (H, W, K, 3)."""

    depth: Array
    length: Array  # (H, W) scene units of a step
    value: Array
    gradient: Array  # data units per scene unit
    place: Array  # scene axes
    inside: Array  # whether there is a field, and neither a cut nor a gap


def filtered(values: Array) -> Array:
    """Coefficients of a cubic spline through samples that are mirrored half a sample away."""
    wide = np.pad(values.astype(np.float64), BEYOND, mode="symmetric")
    return np.asarray(spline_filter(wide, 3))


def at(coefficient: Array, index: Array) -> Array:
    """Values at places (..., 3) that count samples along x, y and z."""
    order = np.moveaxis(index[..., ::-1], -1, 0) + BEYOND
    return np.asarray(map_coordinates(coefficient, order, order=3, prefilter=False))


def along_rays(
    values: Array, field: LatticeField, camera: AnyCamera, size: tuple[int, int], clip: Array
) -> Along:
    """Field in short steps on rays through pixels' centers; values may miss some (NaN)."""
    view, lattice = camera.view(), field.lattice
    eye, way = naive.rays(camera, *size)
    eye = np.broadcast_to(eye, (*size, 3))
    corner = np.stack(np.meshgrid(*[(-0.5, n - 0.5) for n in values.shape[::-1]]), axis=-1)
    corner = (field.origin + corner.reshape(-1, 3) @ lattice.T) @ view.rotation.T + view.translation
    near = max(corner[:, 2].min(), view.near)
    slope = np.linalg.norm(way, axis=-1)
    step = SHORT * np.linalg.norm(lattice, axis=0).min() / slope.max()
    depth = near + step * (np.arange(max(1, int((corner[:, 2].max() - near) / step) + 1)) + 0.5)
    seen = eye[..., None, :] + way[..., None, :] * depth[:, None]
    place = (seen - view.translation) @ view.rotation
    index = (place - field.origin) @ np.linalg.inv(lattice).T
    inside = ((index > -0.5) & (index < np.array(values.shape[::-1]) - 0.5)).all(axis=-1)
    for plane in np.reshape(clip, (-1, 4)):
        inside &= place @ plane[:3] + plane[3] >= 0
    known = np.isfinite(values)
    nearest = np.clip(np.rint(index).astype(int), 0, np.array(values.shape[::-1]) - 1)
    inside &= known[nearest[..., 2], nearest[..., 1], nearest[..., 0]]
    coefficient = filtered(filled(values))
    bump, gradient, met = 1e-3, np.zeros(index.shape), index[inside]
    for axis in range(3):
        move = bump * np.eye(3)[axis]
        gradient[inside, axis] = (at(coefficient, met + move) - at(coefficient, met - move)) / (
            2 * bump
        )
    gradient = gradient @ np.linalg.inv(lattice)
    value = np.zeros(index.shape[:-1])
    value[inside] = at(coefficient, met)
    full = np.broadcast_to(depth, index.shape[:-1])
    return Along(full, step * slope, value, gradient, place, inside)


def filled(values: Array) -> Array:
    """Samples with the nearest one that is known where there is none."""
    from scipy.ndimage import distance_transform_edt

    gaps = ~np.isfinite(values)
    if not gaps.any():
        return values
    nearest = distance_transform_edt(gaps, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def shine(look: Classifier, gradient: Array, place: Array, depth: Array) -> tuple[Array, Array]:
    """Factor of a place's own color, and its white highlight: Blinn and Phong, and depth."""
    lamp = look.lamp
    length = np.linalg.norm(gradient, axis=-1)
    normal = gradient / np.maximum(length, 1e-300)[..., None]
    eye = lamp.viewer[:3] - lamp.viewer[3] * place
    eye = eye / np.linalg.norm(eye, axis=-1, keepdims=True)
    light = eye if not lamp.toward.any() else np.broadcast_to(lamp.toward, eye.shape)
    halfway = eye + light
    halfway = halfway / np.maximum(np.linalg.norm(halfway, axis=-1, keepdims=True), 1e-30)
    own = lamp.ambient + lamp.diffuse * abs((normal * light).sum(axis=-1))
    high = lamp.specular * abs((normal * halfway).sum(axis=-1)) ** lamp.shininess
    has_surface = length > lamp.flat
    own = np.where(has_surface, own, lamp.ambient + lamp.diffuse)
    high = np.where(has_surface, high, 0.0)
    kept = 1 - look.dimmed * np.clip((depth - look.near) / (look.far - look.near), 0, 1)
    return kept * own, kept * high


def faced(met: Along, field: LatticeField, clip: Array) -> Array:
    """Gradients, which lead across the nearest cut where that is within three voxels."""
    slope = np.linalg.norm(met.gradient, axis=-1)
    nearest, found = np.full(slope.shape, 3.0), met.gradient
    for plane in np.reshape(clip, (-1, 4)):
        away = (met.place @ plane[:3] + plane[3]) / np.linalg.norm(plane[:3] @ field.lattice)
        length = np.maximum(slope, 2 * field.classifier.lamp.flat)
        across = length[..., None] * plane[:3] / np.linalg.norm(plane[:3])
        found = np.where((away < nearest)[..., None], across, found)
        nearest = np.minimum(nearest, away)
    return found


def composite(met: Along, field: LatticeField, clip: Array) -> Array:
    """Premultiplied picture (H, W, 4)."""
    return composite_several([(met, field)], clip)


def composite_several(fields: Sequence[tuple[Along, LatticeField]], clip: Array) -> Array:
    """Premultiplied picture (H, W, 4) of what rays meet of fields, in the order of depth."""
    places, colors, depths = [], [], []
    for met, field in fields:
        look, slope = field.classifier, np.linalg.norm(met.gradient, axis=-1)
        # Color and extinction (..., 4) of values and lengths of gradients, from the table
        rows, columns, _ = look.table.shape
        column = np.clip((met.value - look.low) / (look.high - look.low), 0, 1) * (columns - 1)
        row = np.clip(slope / look.steep, 0, 1) * (rows - 1)
        light = np.stack(
            [
                map_coordinates(look.table[..., n].astype(np.float64), [row, column], order=1)
                for n in range(4)
            ],
            axis=-1,
        )
        own, high = shine(look, faced(met, field, clip), met.place, met.depth)
        places.append(met.depth)
        colors.append(own[..., None] * light[..., :3] + high[..., None])
        depths.append(np.where(met.inside, light[..., 3], 0.0) * met.length[..., None])
    order = np.argsort(np.concatenate(places, axis=2), axis=2, kind="stable")
    color = np.take_along_axis(np.concatenate(colors, axis=2), order[..., None], axis=2)
    depth = np.take_along_axis(np.concatenate(depths, axis=2), order, axis=2)
    before = np.exp(-(np.cumsum(depth, axis=-1) - depth))
    share = before * -np.expm1(-depth)
    return np.concatenate(
        [(share[..., None] * color).sum(axis=2), share.sum(axis=2)[..., None]], axis=-1
    )
