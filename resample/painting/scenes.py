"""Scene to paint: samples are checked, projected, and assigned to tiles of the screen."""

import math
import time
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.memory.mapped import contiguous
from resample.messages import Window
from resample.profiles.orders import Summing
from resample.progress import Progress
from resample.types import (
    Doubles,
    Ellipsoid,
    Film,
    Floats,
    Lamp,
    LatticeField,
    Layers,
    Records,
    Samples,
    Screen,
    Statistics,
    Style,
    Tiles,
    View,
)

LENGTHS = (1e-12, 1e12)  # scene units; cubes of such lengths fit into float32
MOST_STRETCHED = 1e6  # largest ratio of lengths of a lattice's steps


def check_lattice(lattice: ArrayLike, what: str) -> Doubles:
    """Check a lattice (3, 3), the steps to a sample's neighbours."""
    steps = contiguous(lattice, np.float64)
    if steps.shape != (3, 3) or not (np.isfinite(steps).all() and np.linalg.cond(steps) < 1e12):
        raise ValueError(f"{what} must be a finite, regular matrix (3, 3)")
    length = np.linalg.norm(steps, axis=0)
    if not (LENGTHS[0] <= length.min() and length.max() <= LENGTHS[1]):
        raise ValueError(
            f"{what} has steps of {length.min():g} to {length.max():g} scene units; they lie within"
            f" {LENGTHS[0]:g} and {LENGTHS[1]:g}: choose another unit"
        )
    if length.max() > MOST_STRETCHED * length.min():
        raise ValueError(
            f"{what} has steps of {length.min():g} and of {length.max():g} scene units; one is at "
            f"most {MOST_STRETCHED:g} times as long as another"
        )
    return steps


def check_places(position: Floats | Doubles, what: str) -> None:
    """Reject positions beyond the range of kernels."""
    if not _is_finite(position):
        raise ValueError(f"{what} is not finite; leave such samples out")
    if position.size and max(position.max(), -position.min()) > LENGTHS[1]:
        raise ValueError(
            f"{what} lies more than {LENGTHS[1]:g} scene units away; choose another unit"
        )


def check_samples(samples: Samples) -> Samples:
    """Convert samples to contiguous float32 arrays and check that they fit together."""
    position, color, extinction = (contiguous(given, np.float32) for given in samples[:3])
    count = extinction.size
    if extinction.ndim != 1 or position.shape != (count, 3) or color.shape != (count, 3):
        raise ValueError(
            f"positions {position.shape}, colors {color.shape} and extinctions {extinction.shape} "
            "do not fit; they have shapes (N, 3), (N, 3) and (N,)"
        )
    lattice = check_lattice(samples.lattice, "the lattice")
    check_places(position, "a sample's position")
    for name, array in (("color", color), ("extinction", extinction)):
        if not _is_finite(array):
            raise ValueError(f"a sample's {name} is not finite; leave such samples out")
    if count and extinction.min() < 0:
        raise ValueError(f"an extinction is {extinction.min()}; it must be 0 or more")
    if samples.scale is None:
        return Samples(position, color, extinction, lattice)
    with np.errstate(over="ignore"):
        scale = contiguous(samples.scale, np.float32)
        if scale.shape != extinction.shape:
            raise ValueError(f"scales {scale.shape} do not fit {extinction.size} samples")
        if not (_is_finite(scale) and (scale > 0).all()):
            raise ValueError("a scale is a finite number above 0")
        if not _is_finite(scale * extinction):
            raise ValueError("a sample's scale times its extinction is not finite")
    return Samples(position, color, extinction, lattice, scale)


def _is_finite(array: Floats | Doubles) -> bool:
    """Whether all numbers are finite; usually their sum shows it, which is faster."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(array.sum()) or np.isfinite(array).all())


def kernel_field(field: LatticeField) -> LatticeField:
    """Field with the array and number types that kernels are compiled for."""
    look, lamp = field.classifier, field.classifier.lamp
    toward, viewer = contiguous(lamp.toward, np.float64), contiguous(lamp.viewer, np.float64)
    names = ("low", "high", "steep", "near", "far", "dimmed")
    classifier = look._replace(
        table=contiguous(look.table, np.float32),
        lamp=Lamp(toward, viewer, *map(float, lamp[2:])),
        **{name: float(getattr(look, name)) for name in names},
    )
    lattice, origin = (contiguous(each, np.float64) for each in (field.lattice, field.origin))
    return field._replace(lattice=lattice, origin=origin, classifier=classifier)


def ellipsoid_of(lattice: Doubles, view: View, radius: float) -> Ellipsoid:
    """Reconstruction ellipsoid of a lattice (3, 3) in camera axes; `radius` in voxels."""
    from_unit = view.rotation @ lattice * radius
    to_unit = np.linalg.inv(from_unit).astype(np.float64)
    return Ellipsoid(
        to_unit,
        to_unit[:, :2] / view.focal,
        np.ascontiguousarray(from_unit),
        from_unit @ from_unit.T,
        float(abs(np.linalg.det(lattice))),
        1 / radius**3,
        float(radius),
    )


def planes_of(clip: ArrayLike | None, view: View, ellipsoid: Ellipsoid) -> Doubles:
    """Convert clipping planes (M, 4) of the scene to `Screen`'s, (M, 5)."""
    given = np.asarray([] if clip is None else clip, np.float64)
    if given.size == 0 or given.shape == (4,):
        given = given.reshape(-1, 4)
    if given.ndim != 2 or given.shape[1] != 4:
        raise ValueError(f"clipping planes are arrays (M, 4), not {given.shape}")
    length = np.linalg.norm(given[:, :3], axis=1)
    if not (np.isfinite(given).all() and (length > 0).all()):
        raise ValueError("clipping planes are finite numbers (M, 4), normals of some length first")
    given = given / length[:, None]
    normal = given[:, :3] @ view.rotation.T
    offset = given[:, 3] - normal @ view.translation
    if view.far < math.inf:
        normal, offset = np.vstack([normal, [0.0, 0.0, -1.0]]), np.append(offset, view.far)
    reach = np.sqrt(np.einsum("ni,ij,nj->n", normal, ellipsoid.covariance, normal))
    return np.ascontiguousarray(np.column_stack([normal, offset, reach]))


def tiles_along(screen: Screen, size: int) -> tuple[int, int]:
    """Rows and columns of tiles of `size` px."""
    return -(-screen.height // size), -(-screen.width // size)


def dealt_to_tiles(footprints: Records, screen: Screen, size: int) -> Tiles:
    """Assign footprints to tiles of `size` px."""
    from resample.engine.tiles import CHUNKS, count_members, deal_members

    rows, columns = tiles_along(screen, size)
    count = np.zeros((CHUNKS, rows * columns), np.int64)
    count_members(footprints, screen, size, columns, count)
    start = np.concatenate([[0], np.cumsum(count.sum(axis=0))])
    position = start[:-1] + np.cumsum(count, axis=0) - count
    smallest = np.full(count.shape, np.inf, np.float32)
    tiles = Tiles(start, np.zeros(start[-1], np.int32), smallest[0], size, columns)
    deal_members(footprints, screen, tiles, position, smallest)
    return tiles._replace(spacing=smallest.min(axis=0))


class PaintTarget(NamedTuple):
    """Output of the painters."""

    film: Film
    value: Floats  # (H, W) measurements of projected fields; NaN where empty; or (0, 0)
    tally: NDArray[np.int64]  # (T, 4) per tile: points, splats, hidden, sub-pixels per side

    def statistics(self, samples: int, seconds: dict[str, float]) -> Statistics:
        """Statistics of a rendering of `samples` samples."""
        points, splats, hidden = (int(count) for count in self.tally[:, :3].sum(axis=0))
        return Statistics(samples, points, splats, hidden, int(self.tally[:, 3].max()), seconds)

    def cut(self, window: Window) -> "PaintTarget":
        """The part of a picture in a window."""
        x0, y0, x1, y1 = window
        part = slice(y0, y1), slice(x0, x1)
        film = Film(*(np.ascontiguousarray(layer[part]) for layer in self.film))
        value = self.value[part].copy() if self.value.size else self.value
        return self._replace(film=film, value=value)


def nothing_painted(
    height: int, width: int, tiles: int = 1, *, has_values: bool = False
) -> PaintTarget:
    """Empty picture, with counts for some number of tiles."""
    size = height, width
    film = Film(
        np.zeros((*size, 4), np.float32),
        np.full(size, np.inf, np.float32),
        np.full(size, np.inf, np.float32),
        np.zeros(size, np.float32),
    )
    value = np.full(size if has_values else (0, 0), np.nan, np.float32)
    return PaintTarget(film, value, np.zeros((tiles, 4), np.int64))


class Clock:
    """Seconds per stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Add the time since the last call to `stage`."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now


@dataclass(frozen=True)
class PreparedScene:
    """Samples seen by a camera, and all other inputs of the painters."""

    view: View
    ellipsoid: Ellipsoid
    screen: Screen
    style: Style
    summing: Summing
    layers: Layers

    def left_by_planes(
        self, samples: Samples, *, by_center: bool = False
    ) -> tuple[Samples, Doubles]:
        """Samples that clipping planes leave in part, or by center; and planes that cut them.

        These (M, 4) are `Screen`'s, and the near plane, or the eye's.
        """
        view, covariance = self.view, self.ellipsoid.covariance
        near = [0.0, 0.0, 1.0, -view.near, math.sqrt(covariance[2, 2])]
        size = np.ones(1, np.float32) if samples.scale is None else samples.scale
        size = size * np.float32(0.0 if by_center else 1.001)  # float32
        inside, cutting = np.ones(samples.extinction.size, np.bool_), []
        for plane in (*self.screen.planes, np.array(near)):
            offset = plane[:3] @ view.translation + plane[3]
            away = along(samples.position, plane[:3] @ view.rotation, offset)
            reach = np.float32(plane[4]) * size
            inside &= away > -reach
            if (abs(away) < reach).any():
                cutting.append(plane[:4])
        planes = np.array(cutting).reshape(-1, 4)
        if inside.all():
            return samples, planes
        parts = {name: getattr(samples, name)[inside] for name in ("position", "color")}
        scale = None if samples.scale is None else samples.scale[inside]
        return samples._replace(extinction=samples.extinction[inside], scale=scale, **parts), planes

    def tinted(self, color: Floats) -> Floats:
        """Colors (N, 3) of splats: their own, or equally bright in their tint."""
        tint = np.array(self.style.tint, np.float32)
        return color if tint[0] < 0 else color.max(axis=1, keepdims=True) * tint


def along(position: Floats, axis: ArrayLike, offset: float) -> Floats:
    """Places (N,) of positions (N, 3) along an axis; each depends on nothing but its position."""
    x, y, z = position.T
    a, b, c = np.asarray(axis, np.float32)
    return np.asarray(a * x + b * y + (c * z + np.float32(offset)), np.float32)


def spacing_of(view: View, samples: Samples) -> Floats:
    """Largest spacing (N,) of samples and their neighbours on the screen, px; inf behind the eye.

    The longest axis of J V Jᵀ, where J is the projection's Jacobian (`resample.hybrid.classify`).
    """
    step = view.rotation @ samples.lattice
    v = (step @ step.T).astype(np.float32)
    fx, fy = np.float32(view.focal[0]), np.float32(view.focal[1])
    x = y = np.zeros(1, np.float32)
    near: Floats = np.ones(1, np.float32)
    is_ahead = np.ones(samples.extinction.size, np.bool_)
    if view.perspective:
        across, down, z = (
            along(samples.position, view.rotation[n], float(view.translation[n])) for n in range(3)
        )
        is_ahead = z > max(view.near, 1e-30)
        near = np.asarray(1 / np.where(is_ahead, z, 1), np.float32)
        with np.errstate(over="ignore"):
            x, y = across * near, down * near
    # The longest axis of J V Jᵀ at a depth of 1; beside the eye it may overflow.
    with np.errstate(over="ignore", invalid="ignore"):
        xx = fx * fx * (v[0, 0] - 2 * x * v[0, 2] + x * x * v[2, 2])
        xy = fx * fy * (v[0, 1] - x * v[1, 2] - y * v[0, 2] + x * y * v[2, 2])
        yy = fy * fy * (v[1, 1] - 2 * y * v[1, 2] + y * y * v[2, 2])
        longest = np.sqrt(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy))
        apart = np.asarray(longest, np.float32) * near
    if samples.scale is not None:
        apart = apart * samples.scale
    return np.where(is_ahead & np.isfinite(apart), apart, np.float32(np.inf)).astype(np.float32)


class SamplePainter(Protocol):
    """Paints the samples of a prepared scene."""

    def paint(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        """Picture of samples."""
