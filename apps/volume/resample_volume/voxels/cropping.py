"""Crop and clip a volume: planes of a box of voxels and planes given by normals."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resample.messages import parts_of
from resample.types import Doubles, Floats
from resample_volume.types import Volume
from resample_volume.voxels.shading import along
from resample_volume.voxels.visible import Voxels, lattice_of

CUT = 3.0  # voxels that a cut is thick
STEEPER = 1e-3  # of the steepest gradient: above the threshold for homogeneous regions

PER_VOXEL = {"position", "color", "extinction", "value", "gradient", "reached"}
CROP_FORM = "give ranges of voxels along x, y and z, such as 64:192,:,10:"
CLIP_FORM = "give a normal, perhaps with an offset from the center, such as 1,0,-1 or 1,0,-1,20"


def planes(
    volume: Volume, crop: str | None = None, clip: Sequence[str] = (), name: str = "clip"
) -> Doubles:
    """Return the planes that bound the shown part of a volume.

    `crop`: ranges of voxels along x, y and z as in NumPy, `64:192,:,10:`: the end is excluded, and
    negative numbers count from the end. Voxel i extends from i - 1/2 to i + 1/2. A range that ends
    with the volume cuts nothing there. `clip`: each `nx/ny/nz` or `nx/ny/nz/offset`: a plane
    through the volume's center with that normal in scene axes, shifted along it by the offset in
    scene units. The side that the normal points to is kept. Result: (M, 4) normals n of length 1
    and distances d; a point p is kept where n·p + d >= 0 for all.
    """
    rows = [] if crop is None else _box(volume, crop)
    rows += [_plane(volume, text, name) for text in clip]
    return np.array(rows, np.float64).reshape(-1, 4)


def inside(position: Floats, lattice: Doubles, planes: Doubles, radius: float) -> NDArray[np.bool_]:
    """Return whether voxels may extend into what planes keep, (N,).

    `position`: (N, 3) scene units. `lattice`: (3, 3) columns are the steps to the neighbours, scene
    units. `planes`: (M, 4) as from `planes`. `radius`: radius of the kernels, voxels.
    """
    is_near = np.ones(len(position), bool)
    for plane in planes:
        normal = plane[:3]
        reach = radius * np.linalg.norm(normal @ lattice)  # of an ellipsoid along the normal
        is_near &= along(position, normal) + plane[3] > -reach
    return is_near


def keep(voxels: Voxels, planes: Doubles, radius: float = 2.0) -> Voxels:
    """Remove voxels that are wholly cut away; see `inside`."""
    if not len(planes):
        return voxels
    return chosen(voxels, np.flatnonzero(inside(voxels.position, voxels.lattice, planes, radius)))


def chosen(voxels: Voxels, index: NDArray[np.int64]) -> Voxels:
    """Return the voxels of the given indices, in their order."""
    of_each = voxels._asdict().keys() & PER_VOXEL
    parts = {name: array[index] for name in of_each if len(array := getattr(voxels, name))}
    return voxels._replace(**parts)


def faced(voxels: Voxels, planes: Doubles) -> Voxels:
    """Replace gradients near a cut by the cut's normal, keeping their lengths.

    A cut through homogeneous tissue meets only noise, whose gradients would make it look rough. So
    it is shaded as a plane: Weiskopf, Engel and Ertl, Interactive Clipping Techniques for
    Texture-Based Volume Visualization and Volume Shading, 2003.

    `planes`: (M, 4) as from `planes`.
    """
    if not len(planes) or not len(voxels.gradient):
        return voxels
    normal, (near, nearest) = planes[:, :3], _near(voxels, planes)
    length = np.linalg.norm(voxels.gradient, axis=1)
    # Homogeneous regions have no normal.
    least = np.float32(STEEPER) * length.max()
    gradient = voxels.gradient.copy()
    gradient[near] = normal[nearest[near]] * np.maximum(length[near], least)[:, np.newaxis]
    return voxels._replace(gradient=gradient)


def _near(voxels: Voxels, planes: Doubles) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the voxels near a plane, and the nearest plane (N,) of each voxel."""
    normal = planes[:, :3]
    away = np.column_stack([along(voxels.position, one) for one in normal]).astype(np.float64)
    away += planes[:, 3]
    away /= np.linalg.norm(normal @ voxels.lattice, axis=1)
    return np.flatnonzero(away.min(axis=1) < CUT), away.argmin(axis=1)


def _box(volume: Volume, text: str) -> list[Doubles]:
    """Return the planes of a crop box."""
    parts = text.split(",")
    if len(parts) != 3:
        raise ValueError(f"crop {text!r}; {CROP_FORM}")
    to_index = np.linalg.inv(lattice_of(volume))
    rows = []
    for axis, part in enumerate(parts):
        size = volume.values.shape[2 - axis]
        start, stop = _range(part, size, f"crop {text!r}, {'xyz'[axis]}")
        if start > 0:
            rows.append(_side(to_index[axis], start - 0.5, volume.origin))
        if stop < size:
            rows.append(_side(-to_index[axis], 0.5 - stop, volume.origin))
    return rows


def _range(text: str, size: int, where: str) -> tuple[int, int]:
    """Parse a range to its first voxel and the one after the last."""
    words = text.split(":")
    try:
        numbers = [int(word) if word.strip() else None for word in words]
    except ValueError:
        numbers = []
    if len(numbers) == 1 and numbers[0] is not None:
        only = numbers[0]
        numbers = [only, only + 1 if only != -1 else None]
    if len(numbers) != 2:
        raise ValueError(f"{where}: {text!r} is not a range; {CROP_FORM}")
    start, stop, _ = slice(*numbers).indices(size)
    if start >= stop:
        raise ValueError(f"{where}: {text!r} holds none of the {size} voxels")
    return start, stop


def _side(axis: Doubles, least: float, origin: Doubles) -> Doubles:
    """Return the plane where the index, `axis` times p - origin, is at `least`."""
    return np.append(axis, -axis @ origin - least) / np.linalg.norm(axis)


def _plane(volume: Volume, text: str, name: str) -> Doubles:
    """Parse a plane through the volume's center, or shifted from it."""
    try:
        numbers = [float(part) for part in parts_of(text)]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 4) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} {text!r}; {CLIP_FORM}")
    largest = max(map(abs, numbers[:3]))
    if not largest:
        raise ValueError(f"{name} {text!r}: the normal must not be 0,0,0; {CLIP_FORM}")
    normal = np.array(numbers[:3]) / largest
    normal /= np.linalg.norm(normal)
    last = np.array(volume.values.shape[::-1]) - 1.0
    middle = volume.origin + lattice_of(volume) @ last / 2
    offset = numbers[3] if len(numbers) == 4 else 0.0
    return np.append(normal, -normal @ middle - offset)
