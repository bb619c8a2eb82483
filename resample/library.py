"""Scattered 2-D measurements resampled to a grid, and particles as samples.

A measurement covers a parallelogram, the unit square under its Jacobian J, or a disc.
Its area in px² is its mass.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from resample.messages import check_size, check_threads, doubles_of, pair_of
from resample.painting.ellipsoids import Ellipsoids, check_ellipsoids
from resample.painting.scenes import check_samples
from resample.profiles.filters import Area, PixelFilter, profile_table
from resample.profiles.reconstruction import GaussianKernel, Reconstruction, footprint_table
from resample.registry import plugin_of
from resample.showable import array_of
from resample.types import Doubles, Floats, Samples

THRESHOLD = {"hybrid": 1.0, "points": math.inf, "splats": -1.0}  # px; longer samples are splats
# Points are axis-aligned boxes, which cover rotated samples unevenly. Samples with bounds above
# the first factor times their area become splats from the second factor times a pixel on.
UPRIGHT, TURNED = 1.02, 0.5
# Standard deviation of a splat in units of its sample: a lattice of them sums to 1 within 0.5 %.
SIGMA = 0.6
FILTER_SIGMA = 0.5  # px, of the filter applied to splats
LARGEST = 1e6  # px that a unit of a sample may cover at most
TILE = 32  # px; neighbours are summed together
MOST = 1024  # samples summed in one go, so that float32 suffices


class Scattering(NamedTuple):
    """Scattered samples resampled to a grid.

    Examples
    --------
    >>> import numpy as np
    >>> from resample import Scatter
    >>> one = Scatter()([[2.5, 1.5]], [7.0], jacobian=np.eye(2)[np.newaxis], shape=(3, 4))
    >>> one.value.shape, float(one.value[1, 2]), float(one.coverage.sum())
    ((3, 4), 7.0, 1.0)
    """

    value: Floats  # (H, W) or (H, W, C) mean of the samples' values; NaN where there is none
    coverage: Floats  # (H, W) px² that samples cover in each pixel, summed

    def __array__(
        self, dtype: DTypeLike | None = None, *, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return `value`."""
        return array_of(self.value, dtype, copy)


class _VisibleSamples(NamedTuple):
    """N samples with footprints that meet the grid."""

    place: Doubles  # (N, 2) px
    jacobian: Doubles  # (N, 2, 2)
    value: Floats  # (C, N)
    is_splat: NDArray[np.bool_]  # (N,)
    low: Doubles  # (N, 2) px, bounds of the footprint
    high: Doubles


@dataclass(frozen=True)
class Scatter:
    """Resampler of scattered samples to a grid; call it with the samples.

    Parameters
    ----------
    method
        `hybrid`: samples longer than one pixel, or than half a pixel if not axis-aligned, are
        splats, the others points; `points`: all are points, with gaps where they lie apart;
        `splats`: all are elliptical Gaussians.
    pixel_filter
        Filter that spreads points: a plugin's name with parameters, or an object. The area filter
        makes boxes as large as the samples, divided among the pixels that they overlap.

    Raises
    ------
    LookupError, ValueError
        The method or filter does not exist.

    Examples
    --------
    >>> import numpy as np
    >>> from resample import Scatter
    >>> place, value = np.array([[2.5, 1.5], [5.0, 2.0]]), np.array([1.0, 3.0])
    >>> found = Scatter()(place, value, jacobian=np.tile(np.eye(2), (2, 1, 1)), shape=(4, 8))
    >>> found.coverage[1].round(2)
    array([0.  , 0.  , 1.  , 0.  , 0.25, 0.25, 0.  , 0.  ], dtype=float32)
    """

    method: Literal["hybrid", "points", "splats"] = "hybrid"
    pixel_filter: PixelFilter | str = "area"

    def __post_init__(self) -> None:
        if self.method not in THRESHOLD:
            raise ValueError(f"unknown method {self.method!r}; known are {', '.join(THRESHOLD)}")
        _ = self._filter

    def __call__(
        self,
        position: ArrayLike,
        value: ArrayLike,
        *,
        shape: tuple[int, int],
        jacobian: ArrayLike | None = None,
        radius: ArrayLike | None = None,
        plane: ArrayLike | None = None,
        threads: int | None = None,
    ) -> Scattering:
        """Resample to a grid; the result depends on neither the samples' order nor the threads.

        Parameters
        ----------
        position
            (N, 2) x and y, px: pixel (row i, column j) covers [j, j + 1) × [i, i + 1); or
            coordinates of `plane`. Samples beyond the grid contribute where they reach into it.
        value
            (N,) or (N, C). A sample with a non-finite value is missing and has no weight.
        shape
            Height and width of the grid, px.
        jacobian
            (2, 2) or (N, 2, 2), px or units of the plane, up to 1e6: its columns are the sides of
            the parallelogram that a sample covers. Give this or `radius`.
        radius
            Number or (N,), px or units of the plane: samples are discs of area π radius².
        plane
            (3, 3) homography from the plane to pixels, the third coordinate positive in front of
            the eye; samples behind it, or magnified beyond 1e6 px, are skipped. None: pixels.
        threads
            Number of threads at most.

        Raises
        ------
        ValueError
            Arrays do not fit together, or positions or extents are not finite.
        """
        from resample.engine.jit import threads as limited

        check_threads(threads)
        shape = pair_of("shape", shape, "height and width")
        check_size(*shape)
        place, values = _samples(position, value)
        place, sides = _on_screen(place, _jacobians(jacobian, radius, len(place)), plane)
        # Samples with a weight that may reach into the grid (height, width).
        from resample.engine.surfaces import RIM

        squared = (sides**2).sum(axis=2)  # (N, 2) along x and y
        area = np.abs(np.linalg.det(sides)) if len(sides) else np.zeros(0)
        total = squared.sum(axis=1)
        twist = np.sqrt(np.maximum(total**2 - 4 * area**2, 0))
        is_turned = np.abs(sides).sum(axis=2).prod(axis=1) > UPRIGHT * area
        threshold = THRESHOLD[self.method] * np.where(is_turned, TURNED, 1 + 1e-9)
        is_splat = np.sqrt(0.5 * (total + twist)) > threshold
        splat_reach = np.sqrt(RIM * (SIGMA**2 * squared + FILTER_SIGMA**2))
        reach = np.where(is_splat[:, None], splat_reach, max(1.0, 0.5 * self._taps))
        low, high = place - reach, place + reach
        kept = (low < np.array(shape[::-1])).all(axis=1) & (high > 0).all(axis=1)
        kept &= (area > 0) & np.isfinite(values).all(axis=0)
        seen = _VisibleSamples(
            place[kept], sides[kept], values[:, kept], is_splat[kept], low[kept], high[kept]
        )
        sums = np.zeros((*shape, values.shape[0] + 1), np.float32)
        if seen.place.size:
            with limited(threads):
                # Sort samples independently of their input order: by tile, position, properties.
                (x, y), tile = seen.place.T, _tile(seen.place)
                order = np.lexsort((x, y, tile))
                if (np.diff(seen.place[order], axis=0) == 0).all(axis=1).any():
                    order = np.lexsort((*seen.value, *seen.jacobian.reshape(-1, 4).T, x, y, tile))
                by_sample = {
                    name: np.ascontiguousarray(getattr(seen, name)[order])
                    for name in ("place", "jacobian", "is_splat", "low", "high")
                }
                self._add(seen._replace(value=seen.value[:, order], **by_sample), sums)
        coverage = sums[..., -1].copy()
        filled = coverage > 0
        mean = np.full((*shape, values.shape[0]), np.nan, np.float32)
        np.divide(sums[..., :-1], coverage[..., None], out=mean, where=filled[..., None])
        return Scattering(mean[..., 0] if np.ndim(value) == 1 else mean, coverage)

    @cached_property
    def _filter(self) -> PixelFilter:
        return cast(PixelFilter, plugin_of("filters", self.pixel_filter, "pixel_filter"))

    @property
    def _taps(self) -> int:
        """Pixels per side that a point covers; 0 for the area filter."""
        is_area = isinstance(self._filter, Area)
        return 0 if is_area else max(1, math.ceil(2.0 * self._filter.radius))

    def _add(self, seen: _VisibleSamples, sums: Floats) -> None:
        """Add samples to sums (H, W, C + 1), neighbours together."""
        from resample.engine.cells.bands import collect
        from resample.engine.cells.parts import (
            Scattered,
            batches,
            channel_groups,
            parts_of,
            scatter_parts,
        )
        from resample.engine.cells.taps import FilterTaps

        spread = FilterTaps(self._taps, False, profile_table(self._filter, self._taps))
        # First sample (B + 1,) of each batch: at most `MOST` of one tile.
        begins = np.ones(len(seen.place), bool)
        begins[1:] = np.diff(_tile(seen.place)) != 0
        start = np.flatnonzero(begins)
        within = np.arange(len(seen.place)) - np.repeat(
            start, np.diff(np.append(start, len(seen.place)))
        )
        first = np.append(np.flatnonzero(within % MOST == 0), len(seen.place))
        # Bounds (B, 4) in px of the footprints of batches; splats are clipped to the grid.
        shape = (sums.shape[0], sums.shape[1])
        limit = np.array(shape[::-1], np.float64)
        is_splat = seen.is_splat[:, None]
        low = np.where(is_splat, np.maximum(seen.low, 0.0), seen.low)
        high = np.where(is_splat, np.minimum(seen.high, limit), seen.high + 2.0)
        low = np.floor(np.minimum.reduceat(low, first[:-1], axis=0))
        high = np.ceil(np.maximum.reduceat(high, first[:-1], axis=0))
        bounds = np.concatenate([low, high], axis=1).astype(np.int64)
        for channel, count in channel_groups(seen.value.shape[0]):
            values = np.ascontiguousarray(seen.value[channel : channel + count])
            picture = np.zeros((*sums.shape[:2], count + 1), np.float32)
            for batch in batches(bounds, count + 1):
                starts = first[batch.start : batch.stop + 1]
                variances = SIGMA**2, FILTER_SIGMA**2
                source = Scattered(*seen[:2], seen.is_splat, values, starts, variances)
                parts = parts_of(bounds[batch], count + 1)
                scatter_parts(source, spread, parts)
                collect(*parts, picture)
            sums[..., channel : channel + count] = picture[..., :-1]
            sums[..., -1] = picture[..., -1]


def _samples(position: ArrayLike, value: ArrayLike) -> tuple[Doubles, Floats]:
    """Positions (N, 2) and values (C, N), checked to fit together."""
    place = doubles_of("positions", position, "numbers (N, 2)")
    with np.errstate(over="ignore"):
        values = np.asarray(value).astype(np.float32)
    if place.size == 0 and values.shape[:1] == (0,):
        place = place.reshape(0, 2)
    if place.ndim != 2 or place.shape[1] != 2:
        raise ValueError(f"positions are (N, 2), x and y of each sample, not {place.shape}")
    if values.ndim not in (1, 2) or len(values) != len(place) or 0 in values.shape[1:]:
        raise ValueError(
            f"values {values.shape} do not fit {len(place)} positions; they are (N,) or (N, C)"
        )
    if not np.isfinite(place).all():
        raise ValueError("a position is not finite; a missing sample has a value of NaN instead")
    return place, values.reshape(len(place), -1 if values.size else max(1, values.shape[-1])).T


def _jacobians(jacobian: ArrayLike | None, radius: ArrayLike | None, count: int) -> Doubles:
    """Jacobian of each sample (N, 2, 2); for a disc, of a square of equal area."""
    if (jacobian is None) == (radius is None):
        raise ValueError("a sample has a jacobian or a radius; give one of them")
    if radius is not None:
        sides = np.asarray(radius, np.float64)
        if sides.shape not in ((), (count,)) or not (sides >= 0).all():
            raise ValueError(f"a radius is a number of 0 or more, one or {count} of them")
        sides = math.sqrt(math.pi) * sides[..., None, None] * np.eye(2)
    else:
        sides = np.asarray(jacobian, np.float64)
    if sides.shape not in ((2, 2), (count, 2, 2)):
        raise ValueError(f"a jacobian is (2, 2) or ({count}, 2, 2), not {sides.shape}")
    if not (np.abs(sides) <= LARGEST).all():
        raise ValueError(f"a sample covers more than {LARGEST:g} units, or is not finite")
    return np.broadcast_to(sides, (count, 2, 2))


def _on_screen(place: Doubles, sides: Doubles, plane: ArrayLike | None) -> tuple[Doubles, Doubles]:
    """Positions and Jacobians in px; invisible samples get infinite positions."""
    if plane is None:
        return place, sides
    matrix = np.asarray(plane, np.float64)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise ValueError(f"a plane is a finite homography (3, 3) to pixels, not {matrix.shape}")
    with np.errstate(all="ignore"):
        x, y, depth = (place @ matrix[:, :2].T + matrix[:, 2]).T
        on = np.stack([x / depth, y / depth], axis=1)
        local = (matrix[:2, :2] - on[:, :, None] * matrix[2, :2]) / depth[:, None, None]
        sides = local @ sides
        is_seen = (depth > 0) & (np.abs(sides) <= LARGEST).all(axis=(1, 2))
    on = np.where(is_seen[:, None], on, np.inf)
    return on, np.where(is_seen[:, None, None], sides, 0.0)


def _tile(place: Doubles) -> NDArray[np.int64]:
    """Tile numbers of positions (N, 2), row by row; those outside the grid have numbers too."""
    column, row = np.floor(np.clip(place / TILE, -(2.0**20), 2.0**20)).astype(np.int64).T
    return np.asarray(row * 2**22 + column)


def particles(
    position: ArrayLike,
    color: ArrayLike,
    opacity: ArrayLike,
    radius: ArrayLike,
    *,
    reconstruction: Reconstruction | None = None,
    rotation: ArrayLike | None = None,
) -> Samples | Ellipsoids:
    """Create spheres or ellipsoids for a `Resampler`; size, color and opacity may vary.

    Parameters
    ----------
    position
        (N, 3) scene units.
    color
        (3,) or (N, 3) linear light, straight.
    opacity
        Number or (N,), 0 to below 1: fraction of light lost along a ray through the center; of an
        ellipsoid, along one that is as long in it as in a sphere of its volume.
    radius
        Number or (N,), above 0, scene units: where a sphere ends; it fades from its center as the
        kernel does. Or (N, 3): half axes of ellipsoids; one or two of three may be 0.
    reconstruction
        Kernel of the resampler; None: a `GaussianKernel`.
    rotation
        (4,) or (N, 4) quaternions w, x, y, z from the ellipsoids' axes to the scene's, of any
        length; None: these axes are alike.

    Returns
    -------
    Samples; or, where radii are (N, 3) or rotations are given, `Ellipsoids`, which a `Resampler`
    composites one by one.

    Raises
    ------
    ValueError
        Arrays do not fit together or a number is out of range.

    Examples
    --------
    >>> from resample import Camera, Resampler, particles
    >>> balls = particles([[0, 0, 4], [0, 0, 6]], [[1, 0, 0], [0, 1, 0]], 0.8, [0.5, 1.0])
    >>> frame = Resampler()(balls, Camera.from_fov(60, 481, 641), height=481, width=641)
    >>> round(float(frame.rgba[240, 320, 3]), 2)  # through both centers: 1 - 0.2 * 0.2
    0.96
    """
    kernel = reconstruction or GaussianKernel()
    place = doubles_of("positions", position, "numbers (N, 3)")
    if place.ndim != 2 or place.shape[1] != 3:
        raise ValueError(f"positions are (N, 3), not {place.shape}")
    share = _per_particle("opacity", opacity, len(place))
    if rotation is not None or np.shape(radius) == (len(place), 3):
        # Ellipsoids with a shape each.
        count, half = len(place), np.asarray(radius, np.float32)
        half = half[:, np.newaxis] if half.shape == (count,) else half
        turn = np.asarray((1.0, 0.0, 0.0, 0.0) if rotation is None else rotation, np.float32)
        parts = (half, (count, 3)), (turn, (count, 4)), (np.asarray(color, np.float32), (count, 3))
        try:
            axes, turns, colors = (np.broadcast_to(given, shape) for given, shape in parts)
        except ValueError:
            raise ValueError(
                f"radii {half.shape}, rotations {turn.shape} and colors {np.shape(color)} do not "
                f"fit {count} particles; they are (N, 3), (N, 4) and (N, 3)"
            ) from None
        places, shares = place.astype(np.float32), share.astype(np.float32)
        return check_ellipsoids(Ellipsoids(places, axes, turns, shares, colors, kernel))
    if not ((share >= 0) & (share < 1)).all():
        raise ValueError("an opacity must be at least 0 and below 1")
    radii = _per_particle("radius", radius, len(place))
    if not (radii > 0).all():
        raise ValueError("a radius is a number of scene units above 0")
    colors = np.asarray(color, np.float32)
    colors = np.broadcast_to(colors, place.shape) if colors.shape == (3,) else colors
    usual = float(np.median(radii)) if radii.size else 1.0
    spacing = usual / kernel.radius
    peak = float(footprint_table(kernel).values[0]) / kernel.radius**3 * radii  # scene units
    with np.errstate(over="ignore", divide="ignore"):  # overflow is rejected below
        extinction = (-np.log1p(-share) / peak).astype(np.float32)
        scale = (radii / usual).astype(np.float32)
        position = place.astype(np.float32)
    return check_samples(Samples(position, colors, extinction, spacing * np.eye(3), scale))


def _per_particle(name: str, given: ArrayLike, count: int) -> Doubles:
    """One number for each of `count` particles."""
    numbers = np.asarray(given, np.float64)
    if numbers.shape not in ((), (count,)) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} is one finite number or {count} of them, not {numbers.shape}")
    return np.broadcast_to(numbers, (count,))
