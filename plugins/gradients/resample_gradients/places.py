"""Footprints of pixels in the source, and their gradients by a matrix or a map.

A pixel's footprint is about a parallelogram: (h, w, 6) holds u and v of its center, the step of
both to the next pixel to the right, and the step down.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.cameras.models import AnyConvention
from resample.types import Doubles
from resample_texture.arguments import check_shape, whole_pair
from resample_texture.geometry.mappings import BackwardMap, oriented, pixel_centers
from resample_texture.geometry.matrices import homography
from resample_texture.texels.kernels.gather import FARTHEST, TORN, TWELFTH

MOVED = {"corner": 0.0, "opencv": 0.5}  # offset of a convention's pixel centers


@dataclass(frozen=True, eq=False)
class MatrixPlaces:
    """Footprints of a target's pixels under a homography.

    Parameters
    ----------
    matrix
        (3, 3) from source to target; or (2, 3) if it is affine.
    shape
        Height and width of the target, px.
    source_shape
        Height and width of the source, px; it decides which side faces the camera.
    convention
        `corner`: pixel centers at + 0.5. `opencv`: `matrix` counts from pixel centers.
    inverse
        True: `matrix` maps target to source.

    Raises
    ------
    ValueError
        The matrix has no inverse or another shape, or a size is invalid.
    """

    matrix: ArrayLike
    shape: tuple[int, int]
    source_shape: tuple[int, int]
    convention: AnyConvention = "corner"
    inverse: bool = False
    _back: Doubles = field(init=False, repr=False)  # (3, 3) target to source, oriented

    def __post_init__(self) -> None:
        shape = whole_pair(self.shape, "height", "width")
        check_shape(shape)
        given = homography(self.matrix, convention=self.convention, inverse=self.inverse)
        back = np.linalg.inv(oriented(given.matrix, self.source_shape))
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "_back", back)

    def places(self) -> Doubles:
        """Return the pixels' footprints, (h, w, 6); not a number beyond the horizon."""
        x, y = pixel_centers(self.shape)
        a, places = self._back, np.empty((*self.shape, 6))
        _, share = self._depth(x, y)
        u, v = ((row[0] * x + row[1] * y + row[2]) * share for row in a[:2])
        # The center is the mean of the pixel's points, to second order.
        bend_x, bend_y = a[2, 0] * share * TWELFTH, a[2, 1] * share * TWELFTH
        for axis, place in enumerate((u, v)):
            along_x = (a[axis, 0] - place * a[2, 0]) * share
            along_y = (a[axis, 1] - place * a[2, 1]) * share
            places[..., axis] = place - along_x * bend_x - along_y * bend_y
            places[..., 2 + axis], places[..., 4 + axis] = along_x, along_y
        return places

    def gradient(self, by_places: Doubles) -> Doubles:
        """Convert a gradient (h, w, 6) by footprints to one by the matrix, in its shape."""
        by_back = self._by_back(by_places)
        given = np.asarray(self.matrix, np.float64)
        to, fro = _shifts(MOVED[self.convention])
        if self.inverse:
            full = _full(given)
            sign = 1.0 if np.vdot(to @ full @ fro, self._back) >= 0.0 else -1.0
            return np.asarray((sign * (to.T @ by_back @ fro.T))[: given.shape[0]])
        forward = -self._back.T @ by_back @ self._back.T
        sign = 1.0 if np.vdot(to @ _full(given) @ fro, np.linalg.inv(self._back)) >= 0.0 else -1.0
        return np.asarray((sign * (to.T @ forward @ fro.T))[: given.shape[0]])

    def _depth(self, x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
        """Return the depth of pixels, and its inverse; not a number beyond the horizon."""
        a = self._back
        depth = a[2, 0] * x + a[2, 1] * y + a[2, 2]
        share = np.full(np.broadcast(x, y).shape, np.nan)
        np.divide(1.0, depth, out=share, where=depth > 0.0)
        return depth, share

    def _by_back(self, by_places: Doubles) -> Doubles:
        """Return the gradient (3, 3) by the matrix from target to source."""
        x, y = pixel_centers(self.shape)
        a, result = self._back, np.zeros((3, 3))
        _, share = self._depth(x, y)
        is_seen = np.isfinite(share)
        share = np.where(is_seen, share, 0.0)
        gradient = np.where(is_seen[..., None], by_places, 0.0)
        slant_x, slant_y = a[2, 0] * share, a[2, 1] * share
        by_share = np.zeros(self.shape)
        for axis in (0, 1):
            from_start = a[axis, 0] * x + a[axis, 1] * y + a[axis, 2]
            place = from_start * share
            along_x, along_y = (a[axis, n] * share - place * a[2, n] * share for n in (0, 1))
            by_middle = gradient[..., axis]
            by_x = gradient[..., 2 + axis] - TWELFTH * slant_x * by_middle
            by_y = gradient[..., 4 + axis] - TWELFTH * slant_y * by_middle
            by_slant_x, by_slant_y = (-TWELFTH * by_middle * along for along in (along_x, along_y))
            by_slant_x, by_slant_y = by_slant_x - by_x * place, by_slant_y - by_y * place
            by_place = by_middle - by_x * slant_x - by_y * slant_y
            result[axis, 0] += (by_x * share).sum()
            result[axis, 1] += (by_y * share).sum()
            result[2, 0] += (by_slant_x * share).sum()
            result[2, 1] += (by_slant_y * share).sum()
            by_share += by_x * a[axis, 0] + by_y * a[axis, 1] + by_place * from_start
            by_share += by_slant_x * a[2, 0] + by_slant_y * a[2, 1]
            by_start = by_place * share
            result[axis] += _sums(by_start, x, y)
        result[2] += _sums(-by_share * share * share, x, y)
        return result


@dataclass(frozen=True, eq=False)
class MapPlaces:
    """Footprints of a target's pixels under a backward map, from its differences.

    Parameters
    ----------
    x, y
        (h, w) source coordinates of pixel centers, px; not a number where a pixel shows nothing.

    Raises
    ------
    ValueError
        They are not two arrays (h, w) of the same shape.
    """

    x: Doubles
    y: Doubles

    def __post_init__(self) -> None:
        kept = BackwardMap(self.x, self.y)
        object.__setattr__(self, "x", kept.x)
        object.__setattr__(self, "y", kept.y)

    def places(self) -> Doubles:
        """Return the pixels' footprints, (h, w, 6)."""
        places = np.empty((*self.x.shape, 6))
        for axis, place in enumerate((self.x, self.y)):
            across, down = _steps(place, 1), _steps(place, 0)
            bend = across.after - across.before + down.after - down.before
            places[..., axis] = place + 0.5 * TWELFTH * bend
            places[..., 2 + axis] = 0.5 * (across.before + across.after)
            places[..., 4 + axis] = 0.5 * (down.before + down.after)
        return _squared(places)

    def gradient(self, by_places: Doubles) -> Doubles:
        """Convert a gradient (h, w, 6) by footprints to one (h, w, 2) by x and y."""
        is_seen = np.isfinite(self.x)
        gradient = np.where(is_seen[..., None], by_places, 0.0)
        steps = [(_steps(place, 1), _steps(place, 0)) for place in (self.x, self.y)]
        sides = np.empty((*self.x.shape, 4))
        for axis, pair in enumerate(steps):
            for n, step in enumerate(pair):
                sides[..., 2 * n + axis] = 0.5 * (step.before + step.after)
        gradient = _unsquared(gradient, sides)
        result = gradient[..., :2].copy()
        for axis, pair in enumerate(steps):
            for n, step in enumerate(pair):
                half, bend = (
                    0.5 * gradient[..., 2 + 2 * n + axis],
                    0.5 * TWELFTH * gradient[..., axis],
                )
                result[..., axis] += step.back(half - bend, half + bend)
        return result


@dataclass(frozen=True, eq=False)
class _Steps:
    """Steps of a map to both neighbours of a pixel; a missing or torn one copies the other."""

    axis: int
    before: Doubles
    after: Doubles
    keeps_before: NDArray[np.bool_]
    keeps_after: NDArray[np.bool_]
    is_known: NDArray[np.bool_]

    def back(self, by_before: Doubles, by_after: Doubles) -> Doubles:
        """Convert a gradient by steps to one by coordinates."""
        by_before, by_after = (np.where(self.is_known, a, 0.0) for a in (by_before, by_after))
        by_before = by_before + np.where(self.keeps_after, 0.0, by_after)
        by_after = np.where(self.keeps_after, by_after, 0.0)
        by_after = by_after + np.where(self.keeps_before, 0.0, by_before)
        by_before = np.where(self.keeps_before, by_before, 0.0)
        first, last = (np.moveaxis(a, self.axis, 0) for a in (by_before, by_after))
        result = np.zeros(first.shape)
        if len(result) > 1:
            by_step = first[1:] + last[:-1]
            by_step[0] += first[0]
            by_step[-1] += last[-1]
            result[1:] += by_step
            result[:-1] -= by_step
        return np.moveaxis(result, 0, self.axis)


def _steps(place: Doubles, axis: int) -> _Steps:
    """Return the steps along an axis."""
    step = np.diff(place, axis=axis)
    if place.shape[axis] == 1:
        step = np.zeros_like(place)
        before = after = step
    else:
        before = np.concatenate([step.take([0], axis), step], axis)
        after = np.concatenate([step, step.take([-1], axis)], axis)
    with np.errstate(invalid="ignore"):
        keeps_before = (abs(before) <= FARTHEST) & ~(abs(before) > TORN * abs(after) + TORN)
        before = np.where(keeps_before, before, after)
        keeps_after = (abs(after) <= FARTHEST) & ~(abs(after) > TORN * abs(before) + TORN)
        after = np.where(keeps_after, after, before)
        is_known = abs(before) <= FARTHEST
    before, after = np.where(is_known, before, 0.0), np.where(is_known, after, 0.0)
    return _Steps(axis, before, after, keeps_before, keeps_after, is_known)


def _known_sides(sides: Doubles) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell which sides (h, w, 4) of the footprints are known from neighbours."""
    return (sides[..., :2] != 0.0).any(axis=-1), (sides[..., 2:] != 0.0).any(axis=-1)


def _squared(places: Doubles) -> Doubles:
    """Make footprints square where one side is unknown, and one texel where both are."""
    along_x, along_y = places[..., 2:4], places[..., 4:6]
    is_known_x, is_known_y = _known_sides(places[..., 2:])
    lacks_y, lacks_x = is_known_x & ~is_known_y, is_known_y & ~is_known_x
    along_y[lacks_y] = along_x[lacks_y][:, ::-1] * (-1.0, 1.0)
    along_x[lacks_x] = along_y[lacks_x][:, ::-1] * (1.0, -1.0)
    places[~is_known_x & ~is_known_y, 2:] = 1.0, 0.0, 0.0, 1.0
    return places


def _unsquared(gradient: Doubles, sides: Doubles) -> Doubles:
    """Apply the transpose of `_squared` to a gradient (h, w, 6), given the known sides."""
    is_known_x, is_known_y = _known_sides(sides)
    lacks_y, lacks_x = is_known_x & ~is_known_y, is_known_y & ~is_known_x
    by_x, by_y = gradient[..., 2:4], gradient[..., 4:6]
    by_x[lacks_y] += (by_y[lacks_y] * (-1.0, 1.0))[:, ::-1]
    by_y[lacks_x] += (by_x[lacks_x] * (1.0, -1.0))[:, ::-1]
    by_y[~is_known_y], by_x[~is_known_x] = 0.0, 0.0
    return gradient


def _sums(value: Doubles, x: Doubles, y: Doubles) -> Doubles:
    """Return the sums of a picture times x, times y, and of the picture itself."""
    return np.array([(value * x).sum(), (value * y).sum(), value.sum()])


def _shifts(distance: float) -> tuple[Doubles, Doubles]:
    """Return matrices that shift by a distance along both axes, and back."""
    to, fro = np.eye(3), np.eye(3)
    to[:2, 2], fro[:2, 2] = distance, -distance
    return to, fro


def _full(matrix: Doubles) -> Doubles:
    """Return a (2, 3) or (3, 3) matrix as (3, 3)."""
    full = np.eye(3)
    full[: matrix.shape[0]] = matrix
    return full
