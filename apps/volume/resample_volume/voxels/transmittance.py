"""Light that reaches voxels: shadows of a lamp, and ambient occlusion.

Light passes the volume slice by slice, in coordinates sheared along its direction, so that what a
slice absorbs is added once and read once, at any distance: shadows of far objects are as sharp as
those of near ones. (Slices toward the light as in Kniss, Premože, Hansen and Ebert, Interactive
Translucent Volume Rendering and Procedural Modeling, 2002.)
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Flags, Floats, Reached
from resample_volume.data.memory import require_memory
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light
from resample_volume.voxels.visible import Voxels, lattice_of

SKIPPED = 2  # slices next to a voxel that do not shadow it, so that surfaces are fully lit
FINEST = (
    320  # cells along the longest side of the grid of light; of larger volumes, voxels share cells
)
COARSE = 128  # the same for ambient light, which varies slowly
AROUND = 32  # directions of ambient light
REACH = 0.12  # of the visible diagonal: what is farther away occludes no ambient light
OPEN = 0.5  # fraction of all directions visible from a flat surface
BYTES_PER_CELL = 24

ALL = 255  # of the light
EXACT = 52  # bits for sums of optical depths

Extinctions = Iterable[Floats]


def light_transmittance(extinction: Floats, lattice: Doubles, light: Light) -> Flags:
    """Return fractions (Z, Y, X, 2) of the lamp's and of ambient light that reach cells.

    `extinction`: (Z, Y, X) optical depth per scene unit. `lattice`: (3, 3) columns are the steps to
    the next cell along x, y and z, scene units.
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


def optical_depths(
    extinction: Floats, lattice: Doubles, toward: Doubles, reach: float = math.inf
) -> Iterator[tuple[tuple[slice | int, ...], Floats]]:
    """Yield optical depths between the cells of each slice and a distant light.

    `extinction`: (Z, Y, X) optical depth per scene unit; 0 outside. `lattice`: (3, 3) columns are
    the steps to the next cell along x, y and z, scene units. `toward`: (3,) scene direction of the
    light. Yields: a slice's index in `extinction`, and the depths of its cells. The `SKIPPED`
    nearest slices do not count.
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
                shift = base - before * shear
                rows, columns = part.shape
                for down, right, weight in _parts(shift):
                    total[down : down + rows, right : right + columns] += weight * part
        place: tuple[slice | int, ...] = (*(slice(None),) * axis, index)
        yield place, np.maximum(0, _read(total, slices.shape[1:], base - n * shear))


def voxel_transmittance(voxels: Voxels, light: Light) -> Floats:
    """Return fractions (N, 2), 0 to 1, of lamp and ambient light that reach voxels."""
    if not len(voxels.position):
        return np.ones((0, 2), np.float32)
    to_index = np.linalg.inv(voxels.lattice)
    index = np.rint((voxels.position - voxels.position[0]) @ to_index.T).astype(np.int64)[:, ::-1]
    index = index - index.min(axis=0)
    size = index.max(axis=0) + 1
    per = cells_of(size)
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
    between = [
        map_coordinates(share[..., n], place, np.float32, order=1, mode="nearest") for n in (0, 1)
    ]
    return np.asarray(np.stack(between, axis=1) / np.float32(ALL))


def field_transmittance(
    scene: Volume, parts: Sequence[tuple[Volume, Extinctions]], clip: Doubles, light: Light
) -> list[Reached]:
    """Return the light that reaches the points of fields, dimmed by all of them.

    `scene`: covers all of them. `parts`: each volume, and its optical depths per scene unit of
    some slices at a time, in order. `clip`: (M, 4) planes; what they cut away takes no light.
    """
    size, lattice = np.array(scene.values.shape), lattice_of(scene)
    per = cells_of(size)
    total, pers = np.zeros(_grid_of(size, per), np.float32), []
    for volume, extinctions in parts:
        coarser = per * np.cbrt(abs(np.linalg.det(lattice) / np.linalg.det(lattice_of(volume))))
        pers.append(max(cells_of(volume.values.shape), round(coarser)))
        thick = _thickness(volume, extinctions, clip, pers[-1])
        total += _moved(thick, (volume, pers[-1]), (scene, per), total.shape, "grid-constant")
    share = light_transmittance(total, per * lattice, light)
    found = []
    for (volume, _), own in zip(parts, pers, strict=True):
        grid = _grid_of(np.array(volume.values.shape), own)
        each = [_moved(share[..., n], (scene, per), (volume, own), grid, "nearest") for n in (0, 1)]
        found.append(Reached(np.rint(np.stack(each, axis=-1)).astype(np.uint8), own))
    return found


def _moved(
    values: NDArray[Any],
    of: tuple[Volume, int],
    to: tuple[Volume, int],
    grid: tuple[int, ...],
    mode: str,
) -> NDArray[Any]:
    """Interpolate values of a volume's cells at those of another one; beyond them as of `mode`."""
    (given, per), (wanted, other) = of, to
    to_cell = np.linalg.inv(per * lattice_of(given))
    middles = [v.origin + lattice_of(v) @ np.full(3, (n - 1) / 2) for v, n in (of, to)]
    matrix, start = to_cell @ (other * lattice_of(wanted)), to_cell @ (middles[1] - middles[0])
    is_same = np.allclose(matrix, np.eye(3), atol=1e-9) and np.allclose(start, 0, atol=1e-6)
    if is_same and values.shape == grid:
        return values
    from scipy.ndimage import affine_transform

    return np.asarray(
        affine_transform(
            values.astype(np.float32), matrix[::-1, ::-1], start[::-1], grid, order=1, mode=mode
        )
    )


def _thickness(volume: Volume, extinctions: Extinctions, clip: Doubles, per: int) -> Floats:
    """Return mean optical depths (Z, Y, X) per scene unit of cells, `per` voxels a side."""
    thick = np.zeros(_grid_of(np.array(volume.values.shape), per), np.float32)
    first = 0
    for part in extinctions:
        z, y, x = np.ogrid[first : first + len(part), : part.shape[1], : part.shape[2]]
        kept = np.ones(part.shape, bool)  # what planes do not cut away
        for plane in clip:
            a, b, c = plane[:3] @ lattice_of(volume)
            kept &= a * x + b * y + c * z + plane[:3] @ volume.origin >= -plane[3]
        across = _merged(np.where(kept, part, np.float32(0)), (1, per, per))
        for n, row in enumerate(across, first):
            thick[n // per] += row / np.float32(per)
        first += len(part)
    return thick


def _grid_of(size: NDArray[np.int64], per: int) -> tuple[int, ...]:
    """Return the number of cells along z, y and x."""
    grid = tuple((-(-size // per)).tolist())
    require_memory(BYTES_PER_CELL * math.prod(grid), "the grid of light")
    return grid


def cells_of(size: NDArray[np.int64] | tuple[int, ...]) -> int:
    """Return the samples per side of a cell of light, for a volume's size."""
    return math.ceil(max(size) / FINEST)


def _parts(shift: Doubles) -> Iterator[tuple[int, int, np.float32]]:
    """Return the four integer shifts around a shift, with their weights."""
    whole = np.floor(shift).astype(int)
    part = shift - whole
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = (part[0] if down else 1 - part[0]) * (part[1] if right else 1 - part[1])
        if weight > 0:
            yield whole[0] + down, whole[1] + right, np.float32(weight)


def _read(total: Floats, size: tuple[int, ...], shift: Doubles) -> Floats:
    """Read a slice from the sheared buffer."""
    rows, columns = size
    found = np.zeros((rows, columns), np.float32)
    for down, right, weight in _parts(shift):
        found += weight * total[down : down + rows, right : right + columns]
    return found
