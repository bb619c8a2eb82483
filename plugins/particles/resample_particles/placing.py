"""Place particles on a picture: along an axis of a periodic box, or before a camera."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.cameras.models import Camera, Orthographic
from resample.reading.limits import check_free
from resample.types import Doubles
from resample_particles.particles import Particles
from resample_particles.smoothing import SmoothingKernel, plane_share, wrapped

AXES = {"x": (1, 2, 0), "y": (0, 2, 1), "z": (0, 1, 2)}  # to the right, up, and along
SMALLEST = 1e-6  # px, reach of a point
TINY = 0.5  # px, reach of kernels with outlines that are not followed
COPIES = 64  # most copies of a periodic box along an axis


@dataclass(frozen=True, eq=False)
class PlacedParticles:
    """Particles in the coordinates of a camera, x to the right, y down."""

    which: NDArray[np.int64]  # (N,) their numbers
    place: Doubles  # (N, 3) scene units
    mass: Doubles  # (N,)
    smoothing: Doubles  # (N,)
    value: Doubles  # (N,) of the quantity
    focal: Doubles  # (2,) px, or px per scene unit if parallel
    principal: Doubles  # (2,) px
    is_perspective: bool
    near: float  # depth from which particles are shown
    period: Doubles  # (3,) scene units; 0: none

    @property
    def period_px(self) -> Doubles:
        """Period of the picture (2,), px; 0: none."""
        return np.asarray(self.period[:2] * self.focal)


def along_axis(
    particles: Particles, axis: str, shape: tuple[int, int], region: ArrayLike | None
) -> PlacedParticles:
    """Place particles along an axis, so that a region fills the picture (height, width)."""
    if axis not in AXES:
        raise ValueError(f"a view of {axis!r}; give an axis x, y or z, or a camera")
    turn = list(AXES[axis])
    low, high = region_of(particles, region)[:, turn]
    box = particles.box
    period = np.zeros(3) if box is None else box[turn]
    place = particles.position if box is None else wrapped(particles.position, box)
    place = place[:, turn]
    which = np.flatnonzero(_within(place[:, 2], low[2], high[2], period[2]))
    if not len(which):
        raise ValueError(f"no particle is between {low[2]:g} and {high[2]:g} along {axis}")
    sides = np.where(high[:2] > low[:2], high[:2] - low[:2], 0.0)
    height, width = shape
    extent = max(sides[0] / width, sides[1] / height)
    per = 1.0 / extent if extent > 0 else 1.0
    signs = np.array([1.0, -1.0, 1.0])
    center = np.append((low + high)[:2] / 2, 0.0)
    return _placed(
        particles,
        which,
        (place[which] - center) * signs,
        focal=np.array([per, per]),
        principal=np.array([width / 2, height / 2]),
        period=period,
    )


def region_of(particles: Particles, given: ArrayLike | None) -> Doubles:
    """Return the lowest and highest corner (2, 3) of the region; infinite ends are as usual."""
    position = particles.position
    usual = np.stack([position.min(axis=0), position.max(axis=0)])
    if particles.box is not None:
        usual = np.stack([np.zeros(3), particles.box])
    if given is None:
        return usual
    region = np.asarray(given, np.float64)
    if region.shape != (2, 3) or not (region[0] <= region[1]).all():
        raise ValueError(
            f"a region of {region.tolist()!r:.100}; give its lowest and highest corner, (2, 3)"
        )
    return np.where(np.isfinite(region), region, usual)


def _within(depth: Doubles, low: float, high: float, period: float) -> NDArray[np.bool_]:
    if period > 0:
        return np.asarray(np.mod(depth - low, period) <= high - low)
    return np.asarray((depth >= low) & (depth <= high))


def before_camera(particles: Particles, camera: Camera | Orthographic) -> PlacedParticles:
    """Place particles before a camera without a lens."""
    view = camera.view()
    place = particles.position @ view.rotation.T + view.translation
    which = np.flatnonzero(place[:, 2] >= view.near)
    return _placed(
        particles,
        which,
        place[which],
        focal=view.focal,
        principal=view.principal,
        is_perspective=view.perspective,
        near=view.near,
    )


def _placed(
    particles: Particles, which: NDArray[np.int64], place: Doubles, **view: Any
) -> PlacedParticles:
    length = np.zeros(1) if particles.smoothing is None else particles.smoothing
    usual: dict[str, Any] = {"is_perspective": False, "near": 0.0, "period": np.zeros(3)}
    return PlacedParticles(
        which, place, particles.mass[which], length[which], np.zeros(len(which)), **(usual | view)
    )


def records_of(placed: PlacedParticles, kernel: SmoothingKernel, slice_at: float | None) -> Doubles:
    """Return the records (N, 15) of particles for `paint_columns`."""
    depth, radius = placed.place[:, 2], kernel.gamma * placed.smoothing
    away = np.zeros(len(depth))
    if slice_at is not None:
        away = _to_plane(depth, slice_at, placed.period[2])
        depth = np.full(len(depth), slice_at)
    kept = (abs(away) < radius) | (slice_at is None)
    if placed.is_perspective:  # no kernel reaches the eye's plane
        kept &= depth > (radius if slice_at is None else 0.0)
    across, depth, radius, away = placed.place[kept, :2].T, depth[kept], radius[kept], away[kept]
    per = placed.focal[:, None] * (1.0 / depth if placed.is_perspective else np.ones(len(depth)))
    radius = np.maximum(radius, SMALLEST / per.max(axis=0, initial=0.0))
    is_bent = placed.is_perspective and slice_at is None
    slope = across / depth if is_bent else np.zeros_like(across)
    longer = 1.0 + (slope * slope).sum(axis=0)
    form = (1.0 - slope * slope / longer) / (radius * per) ** 2
    mixed = -slope[0] * slope[1] / (longer * radius**2 * per[0] * per[1])
    root = 1.0 / (radius**2 * per[0] * per[1] * np.sqrt(longer))  # of the form's determinant
    square = (away / radius) ** 2
    reach = np.sqrt((1.0 - square) * form[::-1]) / root
    lean, bend = np.zeros_like(across), np.zeros_like(across)
    if is_bent:
        lean = 2.0 * slope / (longer * placed.focal[:, None])
        bend = 1.0 / (longer * placed.focal[:, None] ** 2)
        reach = np.where(reach < TINY, reach, _outline(slope, radius / depth, placed.focal))
    peak = placed.mass[kept] / radius ** (2 if slice_at is None else 3)
    whole = peak / root
    if slice_at is not None:
        whole = whole * plane_share(kernel.name, square)
    place = across * per + placed.principal[:, None]
    measured = (square, *reach, whole, peak, placed.value[kept], *lean, *bend)
    return np.stack((*place, form[0], mixed, form[1], *measured), axis=1)


def _outline(slope: Doubles, radius: Doubles, focal: Doubles) -> Doubles:
    """Return how far spheres at depth 1 reach from their centers on the screen (2, N), px."""
    outward = abs(slope)
    root = np.sqrt(np.maximum(1.0 + slope * slope - radius * radius, 0.0))
    farthest = (outward + radius * root) / (1.0 - radius * radius)
    return np.asarray((farthest - outward) * focal[:, None])


def _to_plane(depth: Doubles, plane: float, period: float) -> Doubles:
    away = depth - plane
    return np.asarray(away - period * np.round(away / period) if period > 0 else away)


def on_screen(records: Doubles, period: Doubles, shape: tuple[int, int]) -> Doubles:
    """Return the records that reach a picture, with their copies in a periodic box.

    `period`: (2,) px to the right and down; 0: none.
    """
    height, width = shape
    found = records
    for axis, side in ((0, width), (1, height)):
        place, reach = found[:, axis], found[:, 6 + axis]
        turns = [0]
        if period[axis] > 0 and len(found):
            first = int(np.ceil((-(place + reach) / period[axis]).min()))
            last = int(np.floor(((side - place + reach) / period[axis]).max()))
            if last - first > COPIES:
                raise ValueError(
                    f"the picture shows {last - first} copies of the periodic box; give a smaller "
                    "region, or particles without a box"
                )
            turns = list(range(first, last + 1))
        parts = []
        for turn in turns:
            moved = place + turn * period[axis]
            is_shown = (moved + reach > 0) & (moved - reach < side)
            check_free(
                "a map of many copies of a periodic box",
                2 * 8 * found.shape[1] * int(is_shown.sum()),
            )
            part = found[is_shown]
            part[:, axis] = moved[is_shown]
            parts.append(part)
        found = np.concatenate(parts) if parts else found[:0]
    return found
