"""Scene to paint: samples are checked, projected, and assigned to tiles of the screen."""

import math
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.memory.mapped import contiguous
from resample.painting.scenes.plans import PicturePlan, Window
from resample.profiles.orders import Summing
from resample.types import (
    MOST_COLUMNS,
    Classifier,
    Doubles,
    Ellipsoid,
    Field,
    Film,
    Floats,
    Lamp,
    LatticeField,
    Layers,
    Records,
    Samples,
    Screen,
    Stage,
    Statistics,
    Style,
    Tables,
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
    return Samples(position, color, extinction, lattice, _checked_scale(samples.scale, extinction))


def _checked_scale(scale: ArrayLike | None, extinction: Floats) -> Floats | None:
    """Scales of samples with these extinctions, if given."""
    if scale is None:
        return None
    with np.errstate(over="ignore"):
        sizes = contiguous(scale, np.float32)
        if sizes.shape != extinction.shape:
            raise ValueError(f"scales {sizes.shape} do not fit {extinction.size} samples")
        if not (_is_finite(sizes) and (sizes > 0).all()):
            raise ValueError("a scale is a finite number above 0")
        if not _is_finite(sizes * extinction):
            raise ValueError("a sample's scale times its extinction is not finite")
    return sizes


def _is_finite(array: Floats | Doubles) -> bool:
    """Whether all numbers are finite; usually their sum shows it, which is faster."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(array.sum()) or np.isfinite(array).all())


def samples_of(field: Field) -> Samples:
    """Convert a field to samples for the painters.

    Gradients take the place of colors, and the values' positions between the classifier's low and
    high that of extinctions.
    """
    look = field.classifier
    table = np.asarray(look.table)
    if table.ndim != 3 or table.shape[2] != 4 or 0 in table.shape or table.dtype != np.float32:
        raise ValueError(f"a classifier's table is float32 (G, K, 4), not {table.shape}")
    if not np.isfinite(table).all() or table.min() < 0:
        raise ValueError("a classifier's colors and extinctions must be finite and 0 or more")
    spans = (look.high - look.low, look.steep, look.far - look.near)
    if not all(0 < span < np.inf for span in spans) or not 0 <= look.dimmed <= 1:
        raise ValueError(
            f"a classifier needs low {look.low} below high {look.high}, steep {look.steep} above "
            f"0, near {look.near} before far {look.far}, and dimmed {look.dimmed} from 0 to 1"
        )
    value = np.asarray(field.value, np.float64)
    if value.ndim != 1 or len(field.gradient) not in (0, value.size):
        raise ValueError(
            f"values {value.shape} and gradients {np.shape(field.gradient)} do not fit; they have "
            "shapes (N,) and (N, 3)"
        )
    gradient = field.gradient if len(field.gradient) else np.zeros((value.size, 3), np.float32)
    for name, array in (("value", value), ("gradient", gradient)):
        if not _is_finite(array):
            raise ValueError(f"a sample's {name} is not finite; leave such samples out")
    position = (value - look.low) / (look.high - look.low)
    samples = Samples(field.position, gradient, np.zeros(value.size, np.float32), field.lattice)
    return check_samples(samples)._replace(extinction=position.astype(np.float32))


def kernel_classifier(look: Classifier) -> Classifier:
    """Classifier with the array and number types that kernels are compiled for."""
    lamp = look.lamp
    toward, viewer = contiguous(lamp.toward, np.float64), contiguous(lamp.viewer, np.float64)
    return Classifier(
        contiguous(look.table, np.float32),
        float(look.low),
        float(look.high),
        float(look.steep),
        Lamp(toward, viewer, *map(float, lamp[2:])),
        float(look.near),
        float(look.far),
        float(look.dimmed),
    )


def kernel_field(field: LatticeField) -> LatticeField:
    """Field with the lattice and classifier types that kernels are compiled for."""
    return field._replace(
        lattice=contiguous(field.lattice, np.float64),
        origin=contiguous(field.origin, np.float64),
        classifier=kernel_classifier(field.classifier),
    )


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
    """Convert clipping planes (M, 4) of the scene to those of `Screen`, (M, 5)."""
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


def screen_of(width: int, height: int, margin: float, view: View, ellipsoid: Ellipsoid) -> Screen:
    """Screen of a size, with the planes outside of which an ellipsoid's center is invisible."""
    sides = np.zeros((4, 4))
    for side, (axis, edge) in enumerate(
        [(0, -margin), (0, width + margin), (1, -margin), (1, height + margin)]
    ):
        sign = -1.0 if side % 2 == 0 else 1.0
        offset = sign * (edge - view.principal[axis]) / view.focal[axis]
        sides[side, axis] = sign
        sides[side, 2 if view.perspective else 3] = -offset
        outward = sides[side, :3]
        sides[side, 3] -= np.sqrt(outward @ ellipsoid.covariance @ outward)
    return Screen(width, height, float(margin), sides)


def size_of_tiles(subpixels: int, margin: int = 0, columns: int = MOST_COLUMNS) -> int:
    """Side of a tile in px for up to `subpixels` per side of a pixel.

    A row of its sub-pixels, with a margin in px on both sides for the pixel filter, has at most
    `columns`, unless a single pixel has more.
    """
    return max(1, min(max(8, 32 // subpixels), columns // subpixels - 2 * margin))


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
    tables: Tables
    summing: Summing
    layers: Layers
    classifier: Classifier | None  # of a field; None: samples have colors
    plan: PicturePlan | None = None  # of the whole picture; None: computed from the samples

    @property
    def stage(self) -> Stage:
        """Data shared by all painters."""
        return Stage(self.view, self.ellipsoid, self.screen, self.style, self.tables, self.layers)
