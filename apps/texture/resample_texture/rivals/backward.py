"""The ways to warp that people use today, each as its library or graphics card does it.

OpenCV is asked only for what it does right; the rest is brought into that form first:

- A matrix goes to `cv2.warpPerspective` where a whole tile is in front of the eye. Elsewhere, for
  maps and for wrapped and mirrored sources, coordinates are brought into the source here and
  `cv2.remap` reads there. OpenCV 5's own borders give wrong texels beyond one period (cubic),
  saturate at 16 bits (lanczos4) and never come to an end (mirror, 10⁹ texels away).
- Channels go in fours, threes and ones: of two or five, bilinear reads in steps of 1/32 texel.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_texture.geometry.mappings import (
    BackwardMap,
    ForwardMap,
    Geometry,
    Homography,
    source_coordinates,
)
from resample_texture.texels.pyramid import pyramid, shrunk
from resample_texture.types import Edge, Warped

TILE = 2048  # sub-pixels per side that OpenCV gets at once
HORIZON_TILE = 512  # the same where the horizon or what is far away is in the frame
FARTHEST = 1e6  # texels from the source's origin that a matrix may lead OpenCV to
LARGEST_SOURCE = 32750  # texels per side; OpenCV counts to 32767 in maps, and some lie beyond
BEYOND = 8.0  # texels outside of the source; no kernel reaches back from there
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
OIIO_WRAPS = {
    Edge.TRANSPARENT: "black",
    Edge.CLAMP: "clamp",
    Edge.WRAP: "periodic",
    Edge.MIRROR: "mirror",
}
OIIO_FILTERS = (
    *("box", "triangle", "gaussian", "sharp-gaussian", "catmull-rom", "blackman-harris", "sinc"),
    *("lanczos3", "radial-lanczos3", "nuke-lanczos6", "mitchell", "bspline", "disk", "cubic"),
    *("keys", "simon", "rifman"),
)


@dataclass(frozen=True)
class Bilinear:
    """OpenCV's bilinear interpolation at the pixel's center; aliases where texels shrink."""

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        _refuse_forward_map("bilinear", geometry)
        return _OpenCV("linear")(source, geometry, shape, edge)


@dataclass(frozen=True)
class Cubic:
    """OpenCV's bicubic interpolation (a = −0.75) at the pixel's center."""

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        _refuse_forward_map("cubic", geometry)
        return _OpenCV("cubic")(source, geometry, shape, edge)


@dataclass(frozen=True)
class Lanczos4:
    """OpenCV's Lanczos interpolation of 8 × 8 texels at the pixel's center, in 1/32 texel."""

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        _refuse_forward_map("lanczos4", geometry)
        return _OpenCV("lanczos4")(source, geometry, shape, edge)


@dataclass(frozen=True)
class Area:
    """OpenCV's INTER_AREA, which means bilinear in a warp, whatever the name promises."""

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        _refuse_forward_map("area", geometry)
        return _OpenCV("area")(source, geometry, shape, edge)


@dataclass(frozen=True)
class Supersampled:
    """OpenCV at n × n times the size, then the mean of each n × n: what careful people do.

    A backward map is taken to be linear within each pixel.
    """

    n: int = 4
    kernel: str = "cubic"  # or linear, lanczos4

    def __post_init__(self) -> None:
        _check_count("n", self.n, 16)
        _check_name("kernel", self.kernel, ("cubic", "linear", "lanczos4"))

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        _refuse_forward_map("opencv-supersample", geometry)
        return _OpenCV(self.kernel, self.n)(source, geometry, shape, edge)


@dataclass(frozen=True)
class Mipmap:
    """Trilinear mip mapping: box means as wide as the pixel is long in the source.

    Around a transparent source there is nothing, in every level.
    """

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        _refuse_forward_map("mipmap", geometry)
        return _through_pyramid(source, geometry, shape, edge, 1)


@dataclass(frozen=True)
class Anisotropic:
    """Anisotropic filtering as graphics cards do it, with up to `taps` readings per pixel.

    Around a transparent source there is nothing, in every level.
    """

    taps: int = 16

    def __post_init__(self) -> None:
        _check_count("taps", self.taps, 32)

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        _refuse_forward_map("anisotropic", geometry)
        return _through_pyramid(source, geometry, shape, edge, self.taps)


@dataclass(frozen=True)
class Warp:
    """OpenImageIO's `ImageBufAlgo.warp`; takes minutes where the horizon is in the frame."""

    filter: str = "lanczos3"

    def __post_init__(self) -> None:
        _check_name("filter", self.filter, OIIO_FILTERS)

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        if not isinstance(geometry, Homography):
            raise ValueError("oiio takes a matrix; for maps use bilinear or hybrid")
        is_hidden = np.isnan(source_coordinates(geometry, shape, source.shape[:2])[0])
        ones = np.ones((*source.shape[:2], 1), np.float32)
        texels = np.concatenate([source, ones], axis=2) if edge is Edge.TRANSPARENT else source
        picture = self._warp(texels, geometry, shape, edge)
        picture[is_hidden] = 0.0
        if edge is Edge.TRANSPARENT:
            return _finished(picture[..., :-1], picture[..., -1])
        return Warped(picture, (~is_hidden).astype(np.float32))

    def _warp(
        self, texels: Floats, geometry: Homography, shape: tuple[int, int], edge: Edge
    ) -> Floats:
        import OpenImageIO

        result = OpenImageIO.ImageBufAlgo.warp(
            OpenImageIO.ImageBuf(texels),
            tuple(geometry.matrix.T.ravel()),
            filtername=self.filter,
            wrap=OIIO_WRAPS[edge],
            roi=OpenImageIO.ROI(0, shape[1], 0, shape[0], 0, 1, 0, texels.shape[2]),
        )
        if result.has_error:
            raise ValueError(f"OpenImageIO cannot warp this: {result.geterror()}")
        return np.asarray(result.get_pixels(OpenImageIO.FLOAT)).reshape(*shape, -1)


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
    """How to read a tile that is wholly in front of the eye."""

    matrix: Doubles  # (3, 3) from the source to the tile's sub-pixels
    shape: tuple[int, int]  # of the tile, sub-pixels

    def read(self, texels: Floats, interpolation: int, border: int) -> Floats:
        import cv2

        matrix = np.linalg.inv(HALF_PIXEL) @ self.matrix @ HALF_PIXEL
        size = self.shape[::-1]
        drawn = cv2.warpPerspective(texels, matrix, size, flags=interpolation, borderMode=border)
        return np.reshape(drawn, (*self.shape, -1))

    def seen(self, n: int) -> Floats:
        return np.ones((self.shape[0] // n, self.shape[1] // n, 1), np.float32)


class _ByMap(NamedTuple):
    """How to read a tile at places in the source or close to it."""

    x: Floats  # (h, w) of the sub-pixels, from the center of the first texel
    y: Floats
    is_seen: NDArray[np.bool_]  # (h, w)

    def read(self, texels: Floats, interpolation: int, border: int) -> Floats:
        import cv2

        drawn = cv2.remap(texels, self.x, self.y, interpolation, borderMode=border)
        drawn[~self.is_seen] = 0.0
        return np.reshape(drawn, (*self.x.shape, -1))

    def seen(self, n: int) -> Floats:
        return _mean(self.is_seen[..., None].astype(np.float32), n)


@dataclass(frozen=True)
class _OpenCV:
    """Read by OpenCV at n × n places per pixel and take their mean."""

    interpolation: str  # of `INTERPOLATIONS`
    n: int = 1

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        import cv2

        flags = getattr(cv2, INTERPOLATIONS[self.interpolation]), getattr(cv2, BORDERS[edge])
        parts = [(part, np.ascontiguousarray(source[..., part])) for part in _parts(source)]
        ones = np.ones((*source.shape[:2], 1), np.float32)  # what coverage is read from
        image = np.empty((*shape, source.shape[2]), np.float32)
        coverage = np.empty((*shape, 1), np.float32)
        for tile, reader in self._readers(source, geometry, shape, edge):
            for part, texels in parts:
                image[(*tile.place, part)] = _mean(reader.read(texels, *flags), self.n)
            if edge is Edge.TRANSPARENT:
                coverage[tile.place] = _mean(reader.read(ones, *flags), self.n)
            else:
                coverage[tile.place] = reader.seen(self.n)
        return _finished(image, coverage[..., 0])

    def _readers(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Iterator[tuple[_Tile, _ByMatrix | _ByMap]]:
        """Tiles of a target and how to read each of them."""
        size = source.shape[0], source.shape[1]
        if self.interpolation == "lanczos4":
            _check_size(size)
        if isinstance(geometry, Homography):
            matrix = geometry.oriented(size)
            side = TILE if _is_near(matrix, shape) else HORIZON_TILE
            for tile in _tiles(shape, side // self.n):
                yield tile, self._through_matrix(matrix, tile, size, edge)
        elif isinstance(geometry, BackwardMap):
            places = _places(geometry, shape)
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
    """Pixels (h, w, C) from n × n sub-pixels each."""
    height, width = drawn.shape[:2]
    return drawn if n == 1 else shrunk(drawn, height // n, width // n)


def _by_map(x: Doubles, y: Doubles, source_shape: tuple[int, int], edge: Edge) -> _ByMap:
    """Reader for source coordinates, which are brought close to the source."""
    _check_size(source_shape)
    height, width = source_shape
    is_seen = np.isfinite(x) & np.isfinite(y)
    return _ByMap(_settled(x, is_seen, width, edge), _settled(y, is_seen, height, edge), is_seen)


def _settled(position: Doubles, is_seen: NDArray[np.bool_], size: int, edge: Edge) -> Floats:
    """Coordinates in or near 0..size that show what the given ones show, counted OpenCV's way."""
    settled = np.where(is_seen, position, 0.0)
    if edge is Edge.WRAP:
        settled %= size
    elif edge is Edge.MIRROR:
        settled = size - np.abs(settled % (2 * size) - size)
    else:
        settled = settled.clip(-BEYOND, size + BEYOND)
    return (settled - 0.5).astype(np.float32)


def _is_near(matrix: Doubles, shape: tuple[int, int]) -> bool:
    """Whether all of a picture is in front of the eye and shows places not too far away."""
    height, width = shape
    corner = np.array([[0, width, width, 0], [0, 0, height, height], [1, 1, 1, 1.0]])
    u, v, w = np.linalg.inv(matrix) @ corner
    return bool((w > 0).all() and (np.maximum(abs(u), abs(v)) < FARTHEST * w).all())


def _places(geometry: BackwardMap, shape: tuple[int, int]) -> Doubles:
    """Map (6, h, w): x, y, their change from column to column, and from row to row."""
    x, y = source_coordinates(geometry, shape)
    return np.stack([x, y, _step(x, 1), _step(y, 1), _step(x, 0), _step(y, 0)])


def _step(position: Doubles, axis: int) -> Doubles:
    """Change of a coordinate from pixel to pixel along an axis; 0 where no neighbour has one.

    It is the mean of the steps to both neighbours unless they disagree much: at the seam of a
    panorama or the edge of a fold the smaller one counts.
    """
    step = np.diff(position, axis=axis)
    none = np.full_like(position.take([0], axis), np.nan)
    before, after = np.concatenate([none, step], axis), np.concatenate([step, none], axis)
    before, after = (
        np.where(np.isnan(before), after, before),
        np.where(np.isnan(after), before, after),
    )
    smaller = np.where(abs(before) < abs(after), before, after)
    is_smooth = abs(before - after) <= 1.0 + abs(smaller)
    return np.nan_to_num(np.where(is_smooth, (before + after) / 2, smaller))


def _subpixels(places: Doubles, n: int) -> tuple[Doubles, Doubles]:
    """Source coordinates (h n, w n) of n × n sub-pixels per pixel."""
    offset = (np.arange(n) + 0.5) / n - 0.5
    x, y, across_x, across_y, down_x, down_y = places[:, :, None, :, None]
    shape = places.shape[1] * n, places.shape[2] * n
    right, down = offset, offset[:, None, None]
    return (
        (x + across_x * right + down_x * down).reshape(shape),
        (y + across_y * right + down_y * down).reshape(shape),
    )


def _through_pyramid(
    source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge, taps: int
) -> Warped:
    """Read box means with up to `taps` taps per pixel."""
    from resample_texture.rivals.kernels.anisotropic import Reading, read_homography, read_map

    image = np.zeros((*shape, source.shape[2]), np.float32)
    coverage = np.zeros(shape, np.float32)
    reading = Reading(taps, list(Edge).index(edge))
    if isinstance(geometry, Homography):
        inverse = np.linalg.inv(geometry.oriented(source.shape[:2])).astype(np.float64)
        read_homography(*pyramid(source), inverse, reading, image, coverage)
    elif isinstance(geometry, BackwardMap):
        places = _places(geometry, shape)
        read_map(*pyramid(source), places, reading, image, coverage)
    return Warped(image, coverage)


def _finished(image: Floats, coverage: Floats) -> Warped:
    """Picture with its coverage brought into 0..1, both by the same factor.

    At a transparent edge, negative lobes of a kernel take the warp of ones out of that range.
    """
    if coverage.min() < 0.0 or coverage.max() > 1.0:
        bounded = coverage.clip(0.0, 1.0)
        scale = np.divide(bounded, coverage, out=np.zeros_like(bounded), where=coverage > 0.0)
        image, coverage = image * scale[..., None], bounded
    return Warped(np.ascontiguousarray(image), np.ascontiguousarray(coverage))


def _parts(source: Floats) -> list[slice]:
    """Channels in groups of sizes that OpenCV interpolates precisely: 4, 3 and 1."""
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


def _refuse_forward_map(method: str, geometry: Geometry) -> None:
    if isinstance(geometry, ForwardMap):
        raise ValueError(f"{method} takes a matrix or a backward map; for forward maps use hybrid")


def _check_size(shape: tuple[int, int]) -> None:
    height, width = shape
    if max(height, width) > LARGEST_SOURCE:
        raise ValueError(
            f"OpenCV cannot read {width} × {height} texels in this way, {LARGEST_SOURCE} a side is"
            " its limit; use hybrid, anisotropic or a smaller source"
        )


def _check_count(name: str, count: Any, most: int) -> None:
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= most:
        raise ValueError(f"{name} is a whole number from 1 to {most}, not {count}")


def _check_name(name: str, given: str, known: tuple[str, ...]) -> None:
    if given not in known:
        raise ValueError(f"unknown {name} {given!r}; known are {', '.join(known)}")
