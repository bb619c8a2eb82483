"""Pick the voxel that a pixel shows."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.painting.choices import Projection
from resample.profiles.reconstruction import footprint_table
from resample.resampler import Resampler
from resample.scene import lines_of
from resample.types import Doubles, View
from resample_volume.classification.scales import value_at
from resample_volume.image_planes import settled
from resample_volume.rendering import Subject
from resample_volume.types import Volume
from resample_volume.voxels.gathered import Gathered
from resample_volume.voxels.thin import SAME, of_samples, voxels_of
from resample_volume.voxels.visible import Voxels, lattice_of

if TYPE_CHECKING:
    from resample_volume.kernels.voxels import PickingRays

HALF = 0.5  # accumulated opacity at which a voxel counts as the visible one

Indices = NDArray[np.int64]
PICKED = (Projection.COMPOSITE, Projection.MAXIMUM, Projection.MINIMUM, Projection.FIRST_HIT)


class Picked(NamedTuple):
    """A picked voxel."""

    voxel: tuple[int, int, int]  # index into the values: z, y, x
    value: float  # data units
    position: Doubles  # (3,) scene units


def voxels_at(
    subject: Subject, volume: Volume, camera: AnyCamera, resampler: Resampler, pixels: Doubles,
    level: float = HALF,
) -> tuple[Indices, Doubles]:  # fmt: skip
    """Return flat indices (N,) of the voxels behind points, and their transmittance (N,).

    `pixels`: (N, 2) right and down, px; centers are at halves. It is the voxel at which the
    accumulated opacity exceeds the level; in a field, the one around the point where the ray
    reaches the level, the surface, a more opaque plane, or its extreme; -1 if there is none.
    """
    from resample.engine.rays.coefficients import bundled
    from resample_volume.kernels.voxels import (
        PickedField,
        SplattedVoxels,
        pick_in_field,
        pick_voxels,
    )

    voxels, projection, view = subject.voxels, resampler.projection, camera.view()
    if projection not in PICKED or not isinstance(voxels, Voxels | Gathered):
        raise ValueError(
            f"the projection {projection} of {volume.name} shows no single voxel; take composite, "
            "maximum, minimum or first-hit, the last three along rays"
        )
    scene = subject.placed(volume)
    reach = resampler.reconstruction.radius if isinstance(voxels, Voxels) else 0.5
    thin = voxels.thin if isinstance(voxels, Gathered) else SAME
    samples = of_samples(scene, thin)
    rays = _rays(view, samples, pixels, subject.cuts(camera), reach)
    voxel, kept = np.full(len(pixels), -1, np.int64), np.ones(len(pixels))
    if isinstance(voxels, Voxels):
        lattice, (width, height, deep) = lattice_of(scene), scene.values.shape[::-1]
        place = (voxels.position - scene.origin) @ np.linalg.inv(lattice).T
        x, y, z = np.rint(place).astype(np.int64).T
        thickness = np.zeros(scene.values.size, np.float32)
        thickness[(z * height + y) * width + x] = voxels.extinction
        toward, kernel = view.rotation[2], resampler.reconstruction
        x_deeper, y_deeper, z_deeper = (toward @ lattice).tolist()
        splatted = SplattedVoxels(
            thickness,
            (width, height, deep),
            float(toward @ scene.origin + view.translation[2]),
            (x_deeper, y_deeper, z_deeper),
            footprint_table(kernel).values,
            float(kernel.radius),
        )
        pick_voxels(splatted, rays, level, voxel, kept)
    else:
        depth, shown = _on_planes(subject, volume, view, pixels, level)
        rays = rays._replace(last=np.maximum(rays.first, np.minimum(rays.last, depth)))
        coefficient: Any = bundled(voxels.spline.coefficient)
        field = PickedField(
            voxels.spline._replace(coefficient=coefficient),
            voxels.known,
            voxels.each,
            *voxels.table,
            np.ascontiguousarray(np.linalg.inv(voxels.lattice).T),
            PICKED.index(projection),
            float(resampler.iso or 0.0),
        )
        pick_in_field(field, rays, level, voxel, kept)
        voxel = voxels_of(voxel, scene.values.shape, thin)
        is_plane = (voxel < 0) & np.isfinite(depth)
        voxel[is_plane], kept[is_plane] = shown[is_plane], 0.0
    return voxel, kept


def _on_planes(
    subject: Subject, volume: Volume, view: View, pixels: Doubles, level: float
) -> tuple[Doubles, Indices]:
    """Return depths (N,) at which rays meet planes of values, or inf, and the voxels there."""
    depth, voxel = np.full(len(pixels), np.inf), np.full(len(pixels), -1, np.int64)
    eye, way = lines_of(view, pixels)
    eye, to_lattice = eye + subject.middle, np.linalg.inv(lattice_of(volume)).T
    shape = volume.values.shape
    for plane in subject.appearance.planes:
        if plane.opacity <= level:
            continue
        *numbers, distance = settled(plane, volume).numbers
        normal = np.array(numbers)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = (distance - eye @ normal) / (way @ normal)
            place = (eye + at[:, np.newaxis] * way - volume.origin) @ to_lattice
            is_nearer = (at >= view.near) & (at < np.minimum(depth, view.far))
        near = np.flatnonzero(is_nearer & np.isfinite(place).all(axis=1))
        x, y, z = np.floor(place[near] + 0.5).astype(np.int64).T
        inside = (x >= 0) & (y >= 0) & (z >= 0) & (x < shape[2]) & (y < shape[1]) & (z < shape[0])
        near, found = near[inside], (z[inside] * shape[1] + y[inside]) * shape[2] + x[inside]
        is_known = np.isfinite(volume.values.reshape(-1)[found])
        depth[near[is_known]], voxel[near[is_known]] = at[near[is_known]], found[is_known]
    return depth, voxel


def picked(volume: Volume, voxel: int) -> Picked:
    """Return position and value of a voxel, by its flat index."""
    place = np.unravel_index(voxel, volume.values.shape)
    index = np.array(place[::-1], np.float64)
    value = float(value_at(volume.values[place], volume.scale))
    z, y, x = map(int, place)
    return Picked((z, y, x), value, np.asarray(volume.origin + lattice_of(volume) @ index))


def _rays(view: View, scene: Volume, pixels: Doubles, clip: Doubles, reach: float) -> "PickingRays":
    """Return the rays of pixels, clipped to a volume's box and to planes."""
    from resample_volume.kernels.voxels import PickingRays

    eye, direction = lines_of(view, pixels)
    to_lattice = np.linalg.inv(lattice_of(scene)).T
    origin, speed = (eye - scene.origin) @ to_lattice, direction @ to_lattice
    first = np.full(len(pixels), view.near if view.perspective else -np.inf)
    last = np.full(len(pixels), view.far)
    size = np.array(scene.values.shape[::-1])
    # Clip to depths where linear functions are positive, as they are inside
    inside = [*(origin + reach).T, *(size - 1 + reach - origin).T]
    inside += [eye @ plane[:3] + plane[3] for plane in clip]
    growth = [*speed.T, *-speed.T, *(direction @ plane[:3] for plane in clip)]
    for at, per in zip(inside, growth, strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            where = -at / per
        np.maximum(first, where, out=first, where=per > 0)
        np.minimum(last, where, out=last, where=per < 0)
        last[(per == 0) & (at < 0)] = -np.inf
    length = np.linalg.norm(direction, axis=1)
    arrays = (origin, np.ascontiguousarray(speed), length, first, np.maximum(last, first))
    return PickingRays(*(np.ascontiguousarray(array, np.float64) for array in arrays))
