"""Voxels' own colors, prepared for ray casting."""

from collections.abc import Callable, Iterator
from math import prod
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.types import Flags, Floats, Tint
from resample_volume.classification.transfer import TransferTable
from resample_volume.data.memory import require_memory
from resample_volume.data.recordings import linear_colors
from resample_volume.types import Volume

if TYPE_CHECKING:
    from resample_volume.classification.labels import Labels

PAD = 2  # voxels by which colors and flags are padded on each side, as coefficients are
FULL = 65535  # type of a color channel


def tint_of(volume: Volume, looks: TransferTable, labels: "Labels | None") -> Tint:
    """Return the colors of a volume that has some; for labels, the colors of their rules.

    Colors are interpolated, so invisible voxels take the mean color of visible ones around them.

    Parameters
    ----------
    volume
        With colors (Z, Y, X, 3 or 4).
    labels
        Labels of its voxels.
    """
    assert volume.colors is not None
    deep, down, across = volume.values.shape
    padded = (deep + 2 * PAD, down + 2 * PAD, across + 2 * PAD)
    require_memory(6 * prod(padded), f"colors of {volume.name}")
    most = _brightest(volume.colors)
    found = np.empty((*padded, 3), np.uint16)
    for z, plane in enumerate(_filled(volume, looks, labels)):
        levels = np.rint(np.clip(plane / most, 0, 1) * FULL).astype(np.uint16)
        found[z + PAD] = np.pad(levels, ((PAD, PAD), (PAD, PAD), (0, 0)), mode="edge")
    found[:PAD], found[-PAD:] = found[PAD], found[-PAD - 1]
    return Tint(found.reshape(-1, 3), most)


def _brightest(colors: NDArray[np.generic]) -> float:
    """Return the linear light of the brightest channel of any voxel, at least 1."""
    if colors.dtype.kind != "f":
        return 1.0
    return max(1.0, *(float(linear_colors(plane).max(initial=0.0)) for plane in colors))


def _filled(volume: Volume, looks: TransferTable, labels: "Labels | None") -> Iterator[Floats]:
    """Yield planes (Y, X, 3) of linear light; invisible voxels get colors from around them."""
    import cv2

    thick = looks.table[..., 3].max(axis=0) > 0
    thick = thick.reshape(1 if labels is None else 1 + len(labels.rules), -1)

    def plane_at(z: int) -> tuple[Floats, Floats]:
        values = volume.values[z].astype(np.float64)
        column = (values - looks.low) / (looks.high - looks.low) * (thick.shape[1] - 1)
        column = np.rint(np.clip(np.nan_to_num(column), 0, thick.shape[1] - 1))
        number = np.zeros(values.shape, np.uint8)
        assert volume.colors is not None
        light = linear_colors(volume.colors[z])
        if labels is not None:
            number = labels.numbers(slice(z, z + 1))[0] - 1
            for n, rule in enumerate(labels.rules.values()):
                if rule.color is not None:
                    light[number == n + 1] = from_srgb(np.array(rule.color))
        seen = thick[number, column.astype(np.int64)] & np.isfinite(values)
        return light, seen.astype(np.float32)

    planes = {z: plane_at(z) for z in range(min(2, len(volume.values)))}
    for z in range(len(volume.values)):
        light, seen = planes[z]
        if not seen.all():
            near = [planes[n] for n in (z - 1, z, z + 1) if n in planes]
            total = sum(cv2.blur(part * mask[..., None], (3, 3)) for part, mask in near)
            count = np.asarray(sum(cv2.blur(mask, (3, 3)) for _, mask in near))
            mean = total / np.maximum(count, 1e-9)[..., None]
            light = np.where(((seen == 0) & (count > 1e-6))[..., None], mean, light)
        yield np.asarray(light, np.float32)
        planes.pop(z - 1, None)
        if z + 2 < len(volume.values):
            planes[z + 2] = plane_at(z + 2)


def numbered(known: Flags, numbers: Callable[[slice], Flags], shape: tuple[int, ...]) -> Flags:
    """Return the look index of voxels as in `LatticeField.known`: 0 where missing.

    Parameters
    ----------
    known
        Which are not missing, in the same form; or (0,): all.
    numbers
        Returns the indices of some slices' voxels, from 1.
    shape
        (Z, Y, X) of these.
    """
    found = np.empty([count + 2 * PAD for count in shape], np.uint8)
    for z in range(shape[0]):
        found[z + PAD] = np.pad(numbers(slice(z, z + 1))[0], PAD, mode="edge")
    found[:PAD], found[-PAD:] = found[PAD], found[-PAD - 1]
    flat = found.reshape(-1)
    return np.where(known > 0, flat, np.uint8(0)) if known.size else flat
