"""Warp with OpenCV: one sample per pixel, or the mean of many.

OpenCV is used only for its correct cases; everything else is converted to these first:

- A matrix goes to `cv2.warpPerspective` if a whole tile is in front of the camera. Otherwise, and
  for maps and for wrapped and mirrored sources, coordinates are folded into the source here and
  `cv2.remap` reads there. OpenCV 5's own borders give wrong texels beyond one period (cubic),
  saturate at 16 bits (lanczos4) and never return (mirror, 10⁹ texels away).
- Channels go in fours, threes and ones: for two or five, bilinear samples at steps of 1/32 texel.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_comparisons.texture.common import (
    check_count,
    check_name,
    finished,
    refuse_forward_map,
)
from resample_texture.geometry.mappings import (
    BackwardMap,
    Geometry,
    Homography,
    places_of,
    source_coordinates,
)
from resample_texture.scenes import shrunk
from resample_texture.types import Edge, Warped

TILE = 2048  # sub-pixels per side and call of OpenCV
HORIZON_TILE = 512  # the same if the horizon or far places are in the frame
FARTHEST = 1e6  # texels from the source's origin up to which OpenCV gets a matrix
LARGEST_SOURCE = 32750  # texels per side; OpenCV's maps end at 32767, some places lie outside
BEYOND = 8.0  # texels outside the source, beyond the reach of all kernels
HALF_PIXEL = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])  # from OpenCV's pixel centers
INTERPOLATIONS = {
    "linear": "INTER_LINEAR",
    "cubic": "INTER_CUBIC",
    "lanczos4": "INTER_LANCZOS4",
    "area": "INTER_AREA",
}
BORDERS = {
    Edge.TRANSPARENT: "BORDER_CONSTANT",
    Edge.CLAMP: "BORDER_REPLICATE",
    Edge.WRAP: "BORDER_WRAP",
    Edge.MIRROR: "BORDER_REFLECT",
}


@dataclass(frozen=True)
class InterLinear:
    """OpenCV's bilinear interpolation at the pixel's center; aliases where texels shrink."""

    compiles = False

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        refuse_forward_map("bilinear", geometry)
        return _OpenCV("linear")(source, geometry, shape, edge)


@dataclass(frozen=True)
class Cubic:
    """OpenCV's bicubic interpolation (a = −0.75) at the pixel's center."""

    compiles = False

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        refuse_forward_map("cubic", geometry)
        return _OpenCV("cubic")(source, geometry, shape, edge)


@dataclass(frozen=True)
class Lanczos4:
    """OpenCV's Lanczos interpolation of 8 × 8 texels at the pixel's center, in 1/32 texel."""

    compiles = False

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        refuse_forward_map("lanczos4", geometry)
        return _OpenCV("lanczos4")(source, geometry, shape, edge)


@dataclass(frozen=True)
class InterArea:
    """OpenCV's INTER_AREA, which in a warp is bilinear, despite its name."""

    compiles = False

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        refuse_forward_map("area", geometry)
        return _OpenCV("area")(source, geometry, shape, edge)


@dataclass(frozen=True)
class Supersampled:
    """Supersampling with OpenCV: warp at n × n times the size, then average.

    A backward map is taken to be linear within each pixel.
    """

    compiles = False

    n: int = 4
    kernel: str = "cubic"  # or linear, lanczos4

    def __post_init__(self) -> None:
        check_count("n", self.n, 16)
        check_name("kernel", self.kernel, ("cubic", "linear", "lanczos4"))

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        refuse_forward_map("opencv-supersample", geometry)
        return _OpenCV(self.kernel, self.n)(source, geometry, shape, edge)


class _Tile(NamedTuple):
    """A part of the target, px."""

    top: int
    left: int
    height: int
    width: int

    @property
    def place(self) -> tuple[slice, slice]:
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)


class _ByMatrix(NamedTuple):
    """Reader of a tile that is wholly in front of the camera."""

    matrix: Doubles  # (3, 3) from the source to the tile's sub-pixels
    shape: tuple[int, int]  # of the tile, sub-pixels

    def read(self, texels: Floats, interpolation: int, border: int) -> Floats:
        import cv2

        matrix = np.linalg.inv(HALF_PIXEL) @ self.matrix @ HALF_PIXEL
        size = self.shape[::-1]
        drawn = cv2.warpPerspective(texels, matrix, size, flags=interpolation, borderMode=border)
        return np.reshape(drawn, (*self.shape, -1))

    def coverage(self, n: int) -> Floats:
        return np.ones((self.shape[0] // n, self.shape[1] // n, 1), np.float32)


class _ByMap(NamedTuple):
    """Reader of a tile at coordinates in the source or close to it."""

    x: Floats  # (h, w) of the sub-pixels, from the center of the first texel
    y: Floats
    is_visible: NDArray[np.bool_]  # (h, w)

    def read(self, texels: Floats, interpolation: int, border: int) -> Floats:
        import cv2

        drawn = cv2.remap(texels, self.x, self.y, interpolation, borderMode=border)
        drawn[~self.is_visible] = 0.0
        return np.reshape(drawn, (*self.x.shape, -1))

    def coverage(self, n: int) -> Floats:
        return _mean(self.is_visible[..., None].astype(np.float32), n)


@dataclass(frozen=True)
class _OpenCV:
    """Sample with OpenCV at n × n places per pixel, and average."""

    interpolation: str  # of `INTERPOLATIONS`
    n: int = 1

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        import cv2

        flags = getattr(cv2, INTERPOLATIONS[self.interpolation]), getattr(cv2, BORDERS[edge])
        parts = [(part, np.ascontiguousarray(source[..., part])) for part in _parts(source)]
        ones = np.ones((*source.shape[:2], 1), np.float32)  # the source of the coverage
        image = np.empty((*shape, source.shape[2]), np.float32)
        coverage = np.empty((*shape, 1), np.float32)
        for tile, reader in self._readers(source, geometry, shape, edge):
            for part, texels in parts:
                image[(*tile.place, part)] = _mean(reader.read(texels, *flags), self.n)
            if edge is Edge.TRANSPARENT:
                coverage[tile.place] = _mean(reader.read(ones, *flags), self.n)
            else:
                coverage[tile.place] = reader.coverage(self.n)
        return finished(image, coverage[..., 0])

    def _readers(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Iterator[tuple[_Tile, _ByMatrix | _ByMap]]:
        """Yield the tiles of a target with their readers."""
        size = source.shape[0], source.shape[1]
        if self.interpolation == "lanczos4":
            _check_size(size)
        if isinstance(geometry, Homography):
            matrix = geometry.oriented(size)
            side = TILE if _is_near(matrix, shape) else HORIZON_TILE
            for tile in _tiles(shape, side // self.n):
                yield tile, self._through_matrix(matrix, tile, size, edge)
        elif isinstance(geometry, BackwardMap):
            places = places_of(geometry, shape)
            for tile in _tiles(shape, TILE // self.n):
                x, y = _subpixels(places[(slice(None), *tile.place)], self.n)
                yield tile, _by_map(x, y, size, edge)

    def _through_matrix(
        self, matrix: Doubles, tile: _Tile, source_shape: tuple[int, int], edge: Edge
    ) -> _ByMatrix | _ByMap:
        to_tile = np.array([[1, 0, -tile.left], [0, 1, -tile.top], [0, 0, 1.0]])
        to_subpixels = np.diag([self.n, self.n, 1.0]) @ to_tile @ matrix
        shape = tile.height * self.n, tile.width * self.n
        if edge in (Edge.TRANSPARENT, Edge.CLAMP) and _is_near(to_subpixels, shape):
            return _ByMatrix(to_subpixels, shape)
        x, y = source_coordinates(Homography(to_subpixels, is_signed=True), shape, source_shape)
        return _by_map(x, y, source_shape, edge)


def _mean(drawn: Floats, n: int) -> Floats:
    """Average n × n sub-pixels to pixels (h, w, C)."""
    height, width = drawn.shape[:2]
    return drawn if n == 1 else shrunk(drawn, height // n, width // n)


def _by_map(x: Doubles, y: Doubles, source_shape: tuple[int, int], edge: Edge) -> _ByMap:
    """Return a reader for source coordinates, folded into or close to the source."""
    _check_size(source_shape)
    height, width = source_shape
    is_seen = np.isfinite(x) & np.isfinite(y)
    return _ByMap(_settled(x, is_seen, width, edge), _settled(y, is_seen, height, edge), is_seen)


def _settled(position: Doubles, is_seen: NDArray[np.bool_], size: int, edge: Edge) -> Floats:
    """Fold coordinates into or near 0..size, keeping what they show; in OpenCV's convention."""
    settled = np.where(is_seen, position, 0.0)
    if edge is Edge.WRAP:
        settled %= size
    elif edge is Edge.MIRROR:
        settled = size - np.abs(settled % (2 * size) - size)
    else:
        settled = settled.clip(-BEYOND, size + BEYOND)
    return (settled - 0.5).astype(np.float32)


def _is_near(matrix: Doubles, shape: tuple[int, int]) -> bool:
    """Whether a whole picture is in front of the camera and shows no far places."""
    height, width = shape
    corner = np.array([[0, width, width, 0], [0, 0, height, height], [1, 1, 1, 1.0]])
    u, v, w = np.linalg.inv(matrix) @ corner
    return bool((w > 0).all() and (np.maximum(abs(u), abs(v)) < FARTHEST * w).all())


def _subpixels(places: Doubles, n: int) -> tuple[Doubles, Doubles]:
    """Return source coordinates (h n, w n) of n × n sub-pixels per pixel."""
    offset = (np.arange(n) + 0.5) / n - 0.5
    x, y, across_x, across_y, down_x, down_y = places[:, :, None, :, None]
    shape = places.shape[1] * n, places.shape[2] * n
    right, down = offset, offset[:, None, None]
    return (
        (x + across_x * right + down_x * down).reshape(shape),
        (y + across_y * right + down_y * down).reshape(shape),
    )


def _parts(source: Floats) -> list[slice]:
    """Split channels into groups that OpenCV interpolates precisely: 4, 3 and 1."""
    ends, channels = [0], source.shape[2]
    while ends[-1] < channels:
        rest = channels - ends[-1]
        ends.append(ends[-1] + (4 if rest >= 4 else 3 if rest == 3 else 1))
    return [slice(first, last) for first, last in pairwise(ends)]


def _tiles(shape: tuple[int, int], side: int) -> Iterator[_Tile]:
    height, width = shape
    for top in range(0, height, side):
        for left in range(0, width, side):
            yield _Tile(top, left, min(side, height - top), min(side, width - left))


def _check_size(shape: tuple[int, int]) -> None:
    height, width = shape
    if max(height, width) > LARGEST_SOURCE:
        raise ValueError(
            f"OpenCV cannot read {width} × {height} texels in this way, {LARGEST_SOURCE} a side is"
            " its limit; use hybrid or a smaller source"
        )
