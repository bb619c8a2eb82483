"""Shade voxels, with gradients as surface normals."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.memory.mapped import array_like
from resample.messages import check_numbers
from resample.types import Doubles, Flags, Floats, Lamp, Reached, Samples, Tint
from resample_volume.classification.transfer import TransferTable
from resample_volume.data.recordings import linear_colors
from resample_volume.data.values import require_memory
from resample_volume.types import Volume
from resample_volume.voxels.visible import Voxels, lattice_of

if TYPE_CHECKING:
    from resample.cameras.models import AnyCamera
    from resample.cameras.viewpoints import Sphere
    from resample_volume.classification.labels import Labels

FLAT = 1e-6  # of the steepest gradient: smaller ones are rounding and give no normal
PAD = 2  # voxels by which colors and flags are padded on each side, as coefficients are
FULL = 65535  # type of a color channel


@dataclass(frozen=True)
class Light:
    """A distant white light, and Blinn-Phong shading.

    Raises
    ------
    ValueError
        A direction of no length, or a number outside its range.

    Examples
    --------
    >>> from resample_volume import Appearance, Light
    >>> Light((1, -1, 2), shadows=True).ambient
    0.3
    >>> Appearance("bone", light=None).light is None  # colors as they are
    True
    """

    direction: tuple[float, float, float] | None = None  # toward the light; None: at the eye
    ambient: float = 0.3  # ambient share of the voxel's color, >= 0
    diffuse: float = 0.7  # diffuse share (depends on the angle to the light), >= 0
    specular: float = 0.2  # strength of the specular highlight, white, >= 0
    shininess: float = 32.0  # the greater, the smaller the highlight, > 0
    shadows: bool = False  # whether voxels cast shadows; needs a direction
    occlusion: bool = False  # whether ambient light is dimmed where the surroundings are dense

    def __post_init__(self) -> None:
        check_numbers(self, "ambient", "diffuse", "specular", "shininess")
        if self.direction is not None:
            _vector("light direction", self.direction, is_unit=True)
        for name in ("ambient", "diffuse", "specular"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be 0 or more (got {getattr(self, name)})")
        if not 0 < self.shininess < math.inf:
            raise ValueError(f"shininess must be greater than 0 (got {self.shininess})")
        if self.shadows and self.direction is None:
            raise ValueError(
                "a light at the eye casts no visible shadows; give it a direction, such as "
                "1,-1,2, or leave shadows out"
            )

    @property
    def is_blocked(self) -> bool:
        """Whether there are shadows or ambient occlusion."""
        return self.shadows or self.occlusion


@dataclass(frozen=True)
class DepthCue:
    """Fading of light with depth, so that near parts stand out."""

    share: float = 0.5  # fraction of light lost at the far end of the visible part, 0..1

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise ValueError(f"a depth cue takes a share from 0 to 1 (got {self.share})")


def cue_range(camera: "AnyCamera", sphere: "Sphere") -> tuple[float, float]:
    """Return the depths of a sphere's ends (or of the near plane), where cueing begins and ends."""
    view = camera.view()
    depth = float(view.rotation[2] @ sphere.center + view.translation[2])
    near = max(depth - sphere.radius, view.near)
    return near, max(depth, near) + sphere.radius


def along(position: Floats, axis: Floats | Doubles) -> Floats | Doubles:
    """Return products (N,) of positions (N, 3) and an axis, with rounding independent of N."""
    x, y, z = position.T
    return np.asarray(x * axis[0] + y * axis[1] + z * axis[2])


def cued(samples: Samples, camera: "AnyCamera", cue: DepthCue, near: float, far: float) -> Samples:
    """Fade shaded samples linearly with depth: not at `near`, by the share at `far`."""
    view = camera.view()
    forward, ahead = view.rotation[2].astype(np.float32), np.float32(view.translation[2] - near)
    depth = (along(samples.position, forward) + ahead) / np.float32(far - near)
    light = 1 - np.float32(cue.share) * np.clip(depth, 0, 1)
    return samples._replace(color=samples.color * light[:, np.newaxis])


def shade(
    voxels: Voxels, light: Light | None, eye: Sequence[float] | Doubles | None = None, *,
    view: Sequence[float] | Doubles | None = None,
) -> Samples:  # fmt: skip
    """Shade voxels: return samples with the light that they send to the viewer.

    Shading is two-sided; a voxel without gradient is shaded as if it faced the light. The viewer is
    at the `eye` (3,), or looks along the direction `view` (3,) of a parallel camera.
    """
    if light is None:
        return Samples(voxels.position, voxels.color, voxels.extinction, voxels.lattice)
    from resample_volume.kernels.voxels import shade_voxels

    if len(voxels.gradient) != len(voxels.position):
        raise ValueError("light needs gradients; classify with gradient='central' or 'sobel'")
    is_dimmed = len(voxels.reached) > 0  # by shadows and ambient occlusion
    source = replace(light, ambient=0.0) if is_dimmed else light
    lamp = lamp_of(source, viewer_of(eye, view), voxels.gradient)
    flat = [part.reshape(-1) for part in (voxels.position, voxels.color, voxels.gradient)]
    color = np.empty(voxels.color.shape, np.float32)
    shade_voxels(flat[0], flat[1], flat[2], lamp, color.reshape(-1))
    if is_dimmed:
        everywhere = np.float32(light.ambient) * voxels.color
        color = voxels.reached[:, :1] * color + voxels.reached[:, 1:] * everywhere
    return Samples(voxels.position, color, voxels.extinction, voxels.lattice)


def viewer_of(
    eye: Sequence[float] | Doubles | None = None, view: Sequence[float] | Doubles | None = None
) -> Doubles:
    """Return the viewer for a `Lamp`, (4,): position and 1, or direction to the viewer and 0."""
    if eye is not None and view is None:
        return np.append(_vector("eye", eye), 1.0)
    if view is not None and eye is None:
        return np.append(-_vector("view", view, is_unit=True), 0.0)
    raise ValueError("light needs the eye of a perspective or the view of a parallel camera")


def lamp_of(light: Light, viewer: Doubles, gradient: Floats) -> Lamp:
    """Convert a light for kernels; gradients far below the steepest of (N, 3) give no normal."""
    # The greatest component is at least 1 / √3 of the greatest length.
    steepest = max(float(gradient.max()), -float(gradient.min())) if gradient.size else 0.0
    toward = np.zeros(3)
    if light.direction is not None:
        toward = _vector("light direction", light.direction, is_unit=True)
    numbers = (light.ambient, light.diffuse, light.specular, light.shininess, FLAT * steepest)
    return Lamp(toward, viewer, *map(float, numbers))


def _vector(name: str, vector: Sequence[float] | Doubles, *, is_unit: bool = False) -> Doubles:
    array = np.asarray(vector, np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be three finite numbers (got {vector})")
    length = np.linalg.norm(array) if is_unit else 1.0
    if not length:
        raise ValueError(f"{name} must not be of length 0")
    return np.asarray(array / length)


def tint_of(volume: Volume, looks: TransferTable, labels: "Labels | None") -> Tint:
    """Return a volume's own colors; for labels, the colors of their rules.

    Colors are interpolated, so invisible voxels take the mean color of visible ones around them.
    """
    import cv2

    colors, deep = np.asarray(volume.colors), len(volume.values)
    padded = tuple(count + 2 * PAD for count in volume.values.shape)
    require_memory(6 * prod(padded), f"colors of {volume.name}")
    most = 1.0  # linear light of the brightest channel of any voxel, at least 1
    if colors.dtype.kind == "f":
        most = max(most, *(float(linear_colors(plane).max(initial=0.0)) for plane in colors))
    thick = looks.table[..., 3].max(axis=0) > 0
    thick = thick.reshape(1 if labels is None else 1 + len(labels.rules), -1)

    def plane_at(z: int) -> tuple[Floats, Floats]:
        """Return the linear light (Y, X, 3) of a slice, and which of its voxels are visible."""
        values = volume.values[z].astype(np.float64)
        column = (values - looks.low) / (looks.high - looks.low) * (thick.shape[1] - 1)
        column = np.rint(np.clip(np.nan_to_num(column), 0, thick.shape[1] - 1))
        number, light = np.zeros(values.shape, np.uint8), linear_colors(colors[z])
        if labels is not None:
            number = labels.numbers(slice(z, z + 1))[0] - 1
            for n, rule in enumerate(labels.rules.values()):
                if rule.color is not None:
                    light[number == n + 1] = from_srgb(np.array(rule.color))
        seen = thick[number, column.astype(np.int64)] & np.isfinite(values)
        return light, seen.astype(np.float32)

    found = np.empty((*padded, 3), np.uint16)
    planes = {z: plane_at(z) for z in range(min(2, deep))}
    for z in range(deep):
        light, seen = planes[z]
        if not seen.all():
            near = [planes[n] for n in (z - 1, z, z + 1) if n in planes]
            total = sum(cv2.blur(part * mask[..., None], (3, 3)) for part, mask in near)
            count = np.asarray(sum(cv2.blur(mask, (3, 3)) for _, mask in near))
            mean = total / np.maximum(count, 1e-9)[..., None]
            light = np.where(((seen == 0) & (count > 1e-6))[..., None], mean, light)
        levels = np.clip(np.asarray(light, np.float32) / most, 0, 1)
        levels = np.rint(levels * FULL).astype(np.uint16)
        found[z + PAD] = np.pad(levels, ((PAD, PAD), (PAD, PAD), (0, 0)), mode="edge")
        planes.pop(z - 1, None)
        if z + 2 < deep:
            planes[z + 2] = plane_at(z + 2)
    found[:PAD], found[-PAD:] = found[PAD], found[-PAD - 1]
    return Tint(found.reshape(-1, 3), most)


def numbered(known: Flags, numbers: Callable[[slice], Flags], values: NDArray[np.generic]) -> Flags:
    """Return look indices of voxels, from 1, as in `LatticeField.known`: 0 if missing."""
    padded = tuple(count + 2 * PAD for count in values.shape)
    found = array_like(values, padded, np.uint8, "the numbers of looks")
    for z in range(len(values)):
        found[z + PAD] = np.pad(numbers(slice(z, z + 1))[0], PAD, mode="edge")
    found[:PAD], found[-PAD:] = found[PAD], found[-PAD - 1]
    if known.size:
        for plane, is_known in zip(found, known.reshape(padded), strict=True):
            plane[is_known == 0] = 0
    return found.reshape(-1)


SKIPPED = 2  # slices next to a voxel that do not shadow it, so that surfaces are fully lit
FINEST = 320  # cells along the longest side of the grid of light; in larger ones, voxels share them
COARSE = 128  # the same for ambient light, which varies slowly
AROUND = 32  # directions of ambient light
REACH = 0.12  # of the visible diagonal: matter farther away occludes no ambient light
OPEN = 0.5  # fraction of all directions visible from a flat surface
BYTES_PER_CELL = 24

ALL = 255  # of the light
EXACT = 52  # bits for sums of optical depths


def light_transmittance(extinction: Floats, lattice: Doubles, light: Light) -> Flags:
    """Return fractions (Z, Y, X, 2) of the lamp's and of ambient light at cells.

    `lattice`: (3, 3) columns are the steps to the next cell along x, y and z, scene units.
    """
    share = np.full((*extinction.shape, 2), ALL, np.uint8)
    if light.shadows and light.direction is not None:
        toward = np.asarray(light.direction, np.float64)
        for place, depth in optical_depths(extinction, lattice, toward):
            share[place][..., 0] = np.rint(ALL * np.exp(-depth))
    if light.occlusion:
        # Ambient light varies slowly: it is found for merged cells, and interpolated.
        per = math.ceil(max(extinction.shape) / COARSE)
        coarse, steps = _merged(extinction, (per, per, per)), per * lattice
        reach = REACH * float(np.linalg.norm(steps @ np.array(coarse.shape[::-1])))
        total = np.zeros(coarse.shape, np.float32)
        # Directions (N, 3), evenly distributed on a sphere by the golden angle
        n = np.arange(AROUND) + 0.5
        z, turn = 1 - 2 * n / AROUND, n * math.pi * (3 - math.sqrt(5))
        across = np.sqrt(1 - z**2)
        for toward in np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1):
            for place, depth in optical_depths(coarse, steps, toward, reach):
                total[place] += np.exp(-depth)
        opened = np.minimum(1, total / np.float32(OPEN * AROUND))
        if per > 1:
            from scipy.ndimage import zoom

            fine = zoom(opened, per, order=1, mode="nearest", grid_mode=True)
            opened = fine[tuple(map(slice, extinction.shape))]
        share[..., 1] = np.rint(ALL * opened)
    return share


def _merged(values: Floats, per: tuple[int, int, int]) -> Floats:
    """Average blocks of cells along z, y and x; beyond the end there are zeros."""
    if max(per) == 1:
        return values
    beyond = [(0, -size % count) for size, count in zip(values.shape, per, strict=True)]
    wide = np.pad(values, beyond)
    z, y, x = (size // count for size, count in zip(wide.shape, per, strict=True))
    return np.asarray(wide.reshape(z, per[0], y, per[1], x, per[2]).mean(axis=(1, 3, 5)))


def _around(shift: Doubles, size: tuple[int, ...]) -> list[tuple[tuple[slice, slice], np.float32]]:
    """Return where a slice of a size lies at the four integer shifts around one, and weights."""
    whole = np.floor(shift).astype(int)
    part, found = shift - whole, []
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = (part[0] if down else 1 - part[0]) * (part[1] if right else 1 - part[1])
        if weight > 0:
            top, left = whole[0] + down, whole[1] + right
            at = slice(top, top + size[0]), slice(left, left + size[1])
            found.append((at, np.float32(weight)))
    return found


def optical_depths(
    extinction: Floats, lattice: Doubles, toward: Doubles, reach: float = math.inf
) -> Iterator[tuple[tuple[slice | int, ...], Floats]]:
    """Yield an index and optical depths of each slice of cells to a distant light.

    `extinction`: (Z, Y, X) optical depth per scene unit; 0 outside. `toward`: (3,) direction of the
    light. The `SKIPPED` nearest slices do not count.
    """
    along = np.linalg.solve(lattice, toward)[::-1]  # cells along z, y and x
    axis = int(np.argmax(np.abs(along)))
    step = -along / abs(along[axis])  # away from the light, to the next slice
    length = float(np.linalg.norm(lattice @ step[::-1]))
    slices = np.moveaxis(extinction, axis, 0)
    count, order = len(slices), range(len(slices))
    if step[axis] < 0:
        order = range(count - 1, -1, -1)
    shear = np.delete(step, axis)
    base = np.maximum(0.0, shear) * (count - 1)
    size = slices.shape[1:] + np.ceil(np.abs(shear) * (count - 1)).astype(int) + 1
    total = np.zeros(size, np.float32)
    first_out = SKIPPED + (count if reach == math.inf else max(1, round(reach / length)))
    for n, index in enumerate(order):
        for before, sign in ((n - SKIPPED, length), (n - first_out, -length)):
            if before >= 0:
                part = sign * slices[order[before]]
                for at, weight in _around(base - before * shear, part.shape):
                    total[at] += weight * part
        found = np.zeros(slices.shape[1:], np.float32)  # the slice in the sheared buffer
        for at, weight in _around(base - n * shear, found.shape):
            found += weight * total[at]
        place: tuple[slice | int, ...] = (*(slice(None),) * axis, index)
        yield place, np.maximum(0, found)


def voxel_transmittance(voxels: Voxels, light: Light) -> Floats:
    """Return fractions (N, 2), 0 to 1, of lamp and ambient light that reach voxels."""
    if not len(voxels.position):
        return np.ones((0, 2), np.float32)
    to_index = np.linalg.inv(voxels.lattice)
    index = np.rint((voxels.position - voxels.position[0]) @ to_index.T).astype(np.int64)[:, ::-1]
    index = index - index.min(axis=0)
    size = index.max(axis=0) + 1
    per = math.ceil(max(size) / FINEST)  # voxels along the sides of a cell
    grid = _grid_of(size, per)
    depth, densest = voxels.extinction.astype(np.float64), float(voxels.extinction.max())
    if per > 1 and densest > 0:
        # Rounded, sums in a cell are exact and so the same in any order. The error is below 2⁻²⁸ of
        # the densest voxel for each voxel of a cell, and mostly zero.
        bits = math.frexp(densest)[1] + math.ceil(3 * math.log2(per))
        unit = 2.0 ** (bits - EXACT)
        depth = np.rint(depth / unit) * unit
    cell = np.ravel_multi_index((index // per).T, grid)
    mean = np.bincount(cell, depth, math.prod(grid)) / per**3
    share = light_transmittance(mean.astype(np.float32).reshape(grid), per * voxels.lattice, light)
    if per == 1:
        return np.asarray(share.reshape(-1, 2)[cell] / np.float32(ALL))
    from scipy.ndimage import map_coordinates

    place = (index.T - (per - 1) / 2) / per
    how = {"order": 1, "mode": "nearest"}
    between = [map_coordinates(share[..., n], place, np.float32, **how) for n in (0, 1)]
    return np.asarray(np.stack(between, axis=1) / np.float32(ALL))


def field_transmittance(
    scene: Volume, parts: Sequence[tuple[Volume, Iterable[Floats]]], clip: Doubles, light: Light
) -> list[Reached]:
    """Return the light at the points of fields, dimmed by all of them.

    `scene` covers the volumes of `parts`; optical depths come in slabs. Parts cut away by planes
    `clip` (M, 4) take no light.
    """
    size, lattice = np.array(scene.values.shape), lattice_of(scene)
    per = math.ceil(max(size) / FINEST)
    total, pers = np.zeros(_grid_of(size, per), np.float32), []
    for volume, extinctions in parts:
        coarser = per * np.cbrt(abs(np.linalg.det(lattice) / np.linalg.det(lattice_of(volume))))
        pers.append(max(math.ceil(max(volume.values.shape) / FINEST), round(coarser)))
        # Mean optical depths of cells, without the parts cut away
        thick, first = np.zeros(_grid_of(np.array(volume.values.shape), pers[-1]), np.float32), 0
        for part in extinctions:
            z, y, x = np.ogrid[first : first + len(part), : part.shape[1], : part.shape[2]]
            kept = np.ones(part.shape, bool)
            for plane in clip:
                a, b, c = plane[:3] @ lattice_of(volume)
                kept &= a * x + b * y + c * z + plane[:3] @ volume.origin >= -plane[3]
            across = _merged(np.where(kept, part, np.float32(0)), (1, pers[-1], pers[-1]))
            for n, row in enumerate(across, first):
                thick[n // pers[-1]] += row / np.float32(pers[-1])
            first += len(part)
        total += _moved(thick, (volume, pers[-1]), (scene, per), total.shape, "grid-constant")
    share = light_transmittance(total, per * lattice, light)
    found = []
    for (volume, _), own in zip(parts, pers, strict=True):
        grid = _grid_of(np.array(volume.values.shape), own)
        each = [_moved(share[..., n], (scene, per), (volume, own), grid, "nearest") for n in (0, 1)]
        found.append(Reached(np.rint(np.stack(each, axis=-1)).astype(np.uint8), own))
    return found


def _moved(
    values: NDArray[Any], of: tuple[Volume, int], to: tuple[Volume, int], grid: tuple[int, ...],
    mode: str,
) -> NDArray[Any]:  # fmt: skip
    """Interpolate one volume's cell values at the cells of another; `mode`: beyond its border."""
    (given, per), (wanted, other) = of, to
    to_cell = np.linalg.inv(per * lattice_of(given))
    middles = [v.origin + lattice_of(v) @ np.full(3, (n - 1) / 2) for v, n in (of, to)]
    matrix, start = to_cell @ (other * lattice_of(wanted)), to_cell @ (middles[1] - middles[0])
    is_same = np.allclose(matrix, np.eye(3), atol=1e-9) and np.allclose(start, 0, atol=1e-6)
    if is_same and values.shape == grid:
        return values
    from scipy.ndimage import affine_transform

    values, turned = values.astype(np.float32), matrix[::-1, ::-1]
    return np.asarray(affine_transform(values, turned, start[::-1], grid, order=1, mode=mode))


def _grid_of(size: NDArray[np.int64], per: int) -> tuple[int, ...]:
    """Return the number of cells along z, y and x."""
    grid = tuple((-(-size // per)).tolist())
    require_memory(BYTES_PER_CELL * math.prod(grid), "the grid of light")
    return grid
