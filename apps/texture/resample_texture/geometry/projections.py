"""Projections of all directions to pictures: panoramas, cube maps, fisheyes, flat views.

Directions are (x, y, z) with x to the right, y down and z ahead. Places are px, the first pixel's
center at (0.5, 0.5).
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from resample.cameras.pixels import places_of, rays_at
from resample.types import Doubles

FACES = (  # of a cube: axes of directions along x and y of the face, and out of it
    ((0, 0, -1), (0, 1, 0), (1, 0, 0)),  # right
    ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),  # left
    ((1, 0, 0), (0, 0, 1), (0, -1, 0)),  # up
    ((1, 0, 0), (0, 0, -1), (0, 1, 0)),  # down
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),  # front
    ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),  # back
)
LAYOUTS = {  # column and row of each face
    "row": ((0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (5, 0)),
    "column": ((0, 0), (0, 1), (0, 2), (0, 3), (0, 4), (0, 5)),
    "cross": ((2, 1), (0, 1), (1, 0), (1, 2), (1, 1), (3, 1)),
    "3x2": ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)),
}
CAP = 8  # rows of a panorama around each pole that a picture of the pole shows, ...
PIXELS = 4.0  # ... or so many pixels of the target, if that is more
FINE = 2  # texels of the pole's picture per row
EXTRA = 8  # texels around it
AROUND = 2.0  # px around a fisheye's circle with known directions
FISHEYES: dict[str, tuple[float, Callable[[Any], Any], Callable[[Any], Any]]] = {
    # Widest circle, degrees; the distance of an angle, rad, in focal lengths; and the way back.
    "equidistant": (360.0, lambda angle: angle, lambda distance: distance),
    "equisolid": (
        360.0,
        lambda angle: 2.0 * np.sin(angle / 2.0),
        lambda distance: 2.0 * np.arcsin(np.minimum(distance / 2.0, 1.0)),
    ),
    "stereographic": (
        359.0,
        lambda angle: 2.0 * np.tan(angle / 2.0),
        lambda distance: 2.0 * np.arctan(distance / 2.0),
    ),
    "orthographic": (180.0, np.sin, lambda distance: np.arcsin(np.minimum(distance, 1.0))),
}


class Tile(NamedTuple):
    """A part of a picture that shows directions without a seam."""

    left: int  # px
    top: int
    width: int
    height: int


class PictureProjection(Protocol):
    """Mapping of directions to a picture (height, width)."""

    def check(self, shape: tuple[int, int]) -> None:
        """Reject an impossible size by a `ValueError`."""

    def tiles(self, shape: tuple[int, int]) -> list[Tile]:
        """Return the smooth parts of the picture."""

    def shows(self, place: Doubles, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Whether places (..., 2) belong to the picture, not the margin of a fisheye's circle."""

    def rays(self, place: Doubles, shape: tuple[int, int], tile: int) -> Doubles:
        """Directions (..., 3) of places (..., 2) on and around a part; NaN: no direction."""

    def places(self, ray: Doubles, shape: tuple[int, int], tile: int) -> Doubles:
        """Places (..., 2) of directions (..., 3), on and around a part; NaN: nowhere."""


class _Whole:
    """A projection that fills its picture, by default in one part."""

    def check(self, shape: tuple[int, int]) -> None:
        """Accept any size."""

    def tiles(self, shape: tuple[int, int]) -> list[Tile]:
        """Return the whole picture."""
        return [Tile(0, 0, shape[1], shape[0])]

    def shows(self, place: Doubles, shape: tuple[int, int]) -> NDArray[np.bool_]:  # noqa: ARG002
        """Accept all places."""
        return np.ones(place.shape[:-1], np.bool_)


@dataclass(frozen=True)
class EquirectangularPicture(_Whole):
    """Longitude by latitude, twice as wide as high: ahead in the middle, up in the first row."""

    def check(self, shape: tuple[int, int]) -> None:
        height, width = shape
        if width != 2 * height:
            raise ValueError(
                f"an equirectangular picture is twice as wide as high, not {width} x {height} px"
            )

    def rays(self, place: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        return rays_at(place, shape)

    def places(self, ray: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        return places_of(ray, shape)


@dataclass(frozen=True)
class CubeMap(_Whole):
    """Six square faces: right, left, up, down, front, back, as OpenGL has them seen from inside.

    Parameters
    ----------
    layout
        `row`, `column`, `3x2` (right, left, up over down, front, back) or `cross`, four faces wide
        and three high with up and down over and under the front.
    """

    layout: str = "row"

    def __post_init__(self) -> None:
        if self.layout not in LAYOUTS:
            raise ValueError(f"layout {self.layout!r}; known: {', '.join(LAYOUTS)}")

    @property
    def _count(self) -> tuple[int, int]:
        """Columns and rows of faces."""
        columns, rows = zip(*LAYOUTS[self.layout], strict=True)
        return max(columns) + 1, max(rows) + 1

    def check(self, shape: tuple[int, int]) -> None:
        (columns, rows), (height, width) = self._count, shape
        if height % rows or width % columns or height // rows != width // columns:
            raise ValueError(
                f"a cube map as {self.layout} is {columns} x {rows} square faces, not {width} x"
                f" {height} px; give {columns * (height // rows)} x {height // rows * rows}"
            )

    def tiles(self, shape: tuple[int, int]) -> list[Tile]:
        side = shape[0] // self._count[1]
        return [Tile(x * side, y * side, side, side) for x, y in LAYOUTS[self.layout]]

    def rays(self, place: Doubles, shape: tuple[int, int], tile: int) -> Doubles:
        left, top, side, _ = self.tiles(shape)[tile]
        right, down, out = np.array(FACES[tile], np.float64)
        x, y = (
            2.0 * (place[..., n, None] - first) / side - 1.0 for n, first in ((0, left), (1, top))
        )
        return np.asarray(x * right + y * down + out)

    def places(self, ray: Doubles, shape: tuple[int, int], tile: int) -> Doubles:
        left, top, side, _ = self.tiles(shape)[tile]
        right, down, out = np.array(FACES[tile], np.float64)
        ahead = ray @ out
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = np.where(ahead > 0.0, ahead, np.nan)
            x, y = (ray @ axis / ahead for axis in (right, down))
        return np.stack([(x + 1.0) * 0.5 * side + left, (y + 1.0) * 0.5 * side + top], axis=-1)


def face_of(ray: Doubles) -> NDArray[np.int64]:
    """Return the face of a cube that shows each direction (..., 3)."""
    outward = np.array([face[2] for face in FACES], np.float64)
    return np.asarray((ray @ outward.T).argmax(axis=-1))


@dataclass(frozen=True)
class FisheyePicture(_Whole):
    """A circle around the direction ahead, as wide as the picture's shorter side.

    Parameters
    ----------
    fov
        Degrees across the circle; up to 360, `orthographic` up to 180.
    model
        How far from the middle an angle lies: `equidistant` (its own length), `equisolid` (sin of
        half of it), `stereographic` (tan of half of it) or `orthographic` (its sin).
    """

    fov: float = 180.0
    model: str = "equidistant"

    def __post_init__(self) -> None:
        if self.model not in FISHEYES:
            raise ValueError(f"model {self.model!r}; known: {', '.join(FISHEYES)}")
        widest = FISHEYES[self.model][0]
        if not 0.0 < self.fov <= widest:
            raise ValueError(
                f"a {self.model} fisheye shows more than 0 and up to {widest:g} degrees, not"
                f" {self.fov:g}"
            )

    def shows(self, place: Doubles, shape: tuple[int, int]) -> NDArray[np.bool_]:
        x, y = self._from_middle(place, shape)
        return np.asarray(np.hypot(x, y) <= 0.5 * min(shape))

    def rays(self, place: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        (x, y), radius = self._from_middle(place, shape), 0.5 * min(shape)
        _, distance_of, angle_of = FISHEYES[self.model]
        distance = np.hypot(x, y) / radius
        with np.errstate(invalid="ignore"):
            angle = angle_of(distance * distance_of(math.radians(self.fov / 2.0)))
            angle = np.where(
                (distance <= 1.0 + AROUND / radius) & (angle <= math.pi), angle, np.nan
            )
            around = np.sin(angle) / np.maximum(np.hypot(x, y), 1e-30)
        return np.stack([x * around, y * around, np.cos(angle)], axis=-1)

    def places(self, ray: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        x, y, z = np.moveaxis(ray, -1, 0)
        flat, most = np.hypot(x, y), math.radians(self.fov / 2.0)
        angle, distance_of = np.arctan2(flat, z), FISHEYES[self.model][1]
        reach = 0.5 * min(shape) * distance_of(angle) / distance_of(most)
        share = np.where(angle <= most, reach / np.maximum(flat, 1e-30), np.nan)
        return np.stack([share * x + 0.5 * shape[1], share * y + 0.5 * shape[0]], axis=-1)

    @staticmethod
    def _from_middle(place: Doubles, shape: tuple[int, int]) -> tuple[Doubles, Doubles]:
        return place[..., 0] - 0.5 * shape[1], place[..., 1] - 0.5 * shape[0]


@dataclass(frozen=True)
class StereographicPicture(_Whole):
    """The whole picture stereographic: `little planets`, as wide as asked for.

    Parameters
    ----------
    fov
        Degrees across the picture's shorter side, below 360.
    """

    fov: float = 240.0

    def __post_init__(self) -> None:
        if not 0.0 < self.fov < 360.0:
            raise ValueError(f"a stereographic view shows 0 to 360 degrees, not {self.fov:g}")

    def _focal(self, shape: tuple[int, int]) -> float:
        return 0.25 * min(shape) / math.tan(math.radians(self.fov / 4.0))

    def rays(self, place: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        x, y = (place[..., n] - 0.5 * shape[1 - n] for n in (0, 1))
        x, y = x / (2.0 * self._focal(shape)), y / (2.0 * self._focal(shape))
        square = x * x + y * y
        parts = 2.0 * x / (1.0 + square), 2.0 * y / (1.0 + square), (1.0 - square) / (1.0 + square)
        return np.stack(parts, axis=-1)

    def places(self, ray: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        x, y, z = np.moveaxis(ray, -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 2.0 * self._focal(shape) / (np.sqrt(x * x + y * y + z * z) + z)
            place = np.stack([share * x + 0.5 * shape[1], share * y + 0.5 * shape[0]], axis=-1)
        return np.where(np.isfinite(place), place, np.nan)


@dataclass(frozen=True)
class CylindricalPicture(_Whole):
    """Longitude by height on a cylinder: verticals stay straight.

    Parameters
    ----------
    fov
        Degrees across the picture's width, up to 360; px are square ahead.
    """

    fov: float = 360.0

    def __post_init__(self) -> None:
        if not 0.0 < self.fov <= 360.0:
            raise ValueError(
                f"a cylinder shows more than 0 and up to 360 degrees, not {self.fov:g}"
            )

    def rays(self, place: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        focal = shape[1] / math.radians(self.fov)
        longitude = (place[..., 0] - 0.5 * shape[1]) / focal
        down = (place[..., 1] - 0.5 * shape[0]) / focal
        return np.stack([np.sin(longitude), down, np.cos(longitude)], axis=-1)

    def places(self, ray: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        x, y, z = np.moveaxis(ray, -1, 0)
        focal, flat = shape[1] / math.radians(self.fov), np.hypot(x, z)
        with np.errstate(divide="ignore", invalid="ignore"):
            down = np.where(flat > 0.0, y / flat, np.nan)
        column = np.arctan2(x, z) * focal + 0.5 * shape[1]
        return np.stack([column, down * focal + 0.5 * shape[0]], axis=-1)


@dataclass(frozen=True)
class PerspectivePicture(_Whole):
    """A flat view, as a pinhole camera has it.

    Parameters
    ----------
    fov
        Degrees across the picture's shorter side, below 180.
    """

    fov: float = 90.0

    def __post_init__(self) -> None:
        if not 0.0 < self.fov < 180.0:
            raise ValueError(f"a flat view shows 0 to 180 degrees, not {self.fov:g}")

    def _focal(self, shape: tuple[int, int]) -> float:
        return 0.5 * min(shape) / math.tan(math.radians(self.fov / 2.0))

    def rays(self, place: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        x, y = ((place[..., n] - 0.5 * shape[1 - n]) / self._focal(shape) for n in (0, 1))
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def places(self, ray: Doubles, shape: tuple[int, int], tile: int) -> Doubles:  # noqa: ARG002
        x, y, z = np.moveaxis(ray, -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(z > 0.0, self._focal(shape) / z, np.nan)
        return np.stack([share * x + 0.5 * shape[1], share * y + 0.5 * shape[0]], axis=-1)


def rotation(turn: tuple[float, float, float]) -> Doubles:
    """Matrix (3, 3) from the directions of a target that looks right, up and clockwise, degrees."""
    if len(turn) != 3 or not np.isfinite(turn).all():
        raise ValueError(f"turn is three angles in degrees (right, up, clockwise), not {turn}")
    yaw, pitch, roll = np.radians(turn)
    right = [[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]]
    up = [[1, 0, 0], [0, math.cos(pitch), -math.sin(pitch)], [0, math.sin(pitch), math.cos(pitch)]]
    around = [[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]]
    return np.asarray(np.array(right) @ np.array(up) @ np.array(around))


class SourceTile(NamedTuple):
    """A part of a picture, continued into its neighbours."""

    image: NDArray[Any]
    places: Callable[[Doubles], Doubles]  # in it, of directions on it and a little beyond
    shows: Callable[[Doubles], NDArray[np.bool_]]  # whether it, not another part, shows directions
    is_endless: bool = False  # it repeats beyond its edges


def source_tiles(
    image: NDArray[Any], projection: PictureProjection, step: float
) -> Iterator[SourceTile]:
    """Yield the parts of a picture, for pixels of a target at most a step, rad, apart."""
    shape = image.shape[0], image.shape[1]
    if isinstance(projection, EquirectangularPicture):
        yield from _panorama_tiles(image, max(CAP * math.pi / shape[0], PIXELS * step))
        return
    tiles = projection.tiles(shape)
    if len(tiles) == 1:
        yield SourceTile(
            image,
            lambda ray: projection.places(ray, shape, 0),
            lambda ray: np.ones(ray.shape[:-1], np.bool_),
        )
        return
    for n, (left, top, width, _) in enumerate(tiles):
        # A face with texels of its neighbours around, the nearest ones on its plane.
        margin = max(1, width // 4)
        first = np.array([left, top]) - margin
        columns = np.arange(-margin, width + margin) + 0.5
        rays = projection.rays(
            np.stack(np.meshgrid(columns + left, columns + top), axis=-1), shape, n
        )
        owner = face_of(rays)
        padded = np.empty((*owner.shape, *image.shape[2:]), image.dtype)
        for other, (x0, y0, across, down) in enumerate(tiles):
            is_there = owner == other
            x, y = np.floor(projection.places(rays[is_there], shape, other)).astype(np.int64).T
            x, y = np.clip(x, x0, x0 + across - 1), np.clip(y, y0, y0 + down - 1)
            padded[is_there] = image[y, x]

        def places(ray: Doubles, n: int = n, first: NDArray[Any] = first) -> Doubles:
            return np.asarray(projection.places(ray, shape, n) - first)

        def shows(ray: Doubles, n: int = n) -> NDArray[np.bool_]:
            return np.asarray(face_of(ray) == n)

        yield SourceTile(padded, places, shows)


def _panorama_tiles(image: NDArray[Any], radius: float) -> Iterator[SourceTile]:
    """Yield a panorama, and round pictures of both poles up to `radius`, rad."""
    height, width = image.shape[:2]
    # Beyond a pole the picture continues at the opposite longitude: one period has both.
    beyond = np.roll(image[::-1], width // 2, axis=1)
    join: Any = np.ma if isinstance(image, np.ma.MaskedArray) else np
    both, radius = join.concatenate([image, beyond]), min(radius, math.pi / 4)

    def from_pole(ray: Doubles) -> Doubles:
        return np.asarray(np.arctan2(np.hypot(ray[..., 0], ray[..., 2]), np.abs(ray[..., 1])))

    yield SourceTile(
        both,
        lambda ray: places_of(ray, (height, width)),
        lambda ray: np.asarray(from_pole(ray) >= radius),
        is_endless=True,
    )
    side = 2 * math.ceil(FINE * radius * height / math.pi)
    cap = FisheyePicture(math.degrees(2.0 * radius) * (1.0 + 2.0 * EXTRA / side))
    size = side + 2 * EXTRA, side + 2 * EXTRA
    # Directions of its places, also beyond the circle.
    y, x = np.mgrid[: size[0], : size[1]] + 0.5 - 0.5 * size[0]
    distance = np.hypot(x, y)
    angle = distance / (0.5 * min(size)) * math.radians(cap.fov / 2.0)
    around = np.sin(angle) / np.maximum(distance, 1e-30)
    rays = np.stack([x * around, y * around, np.cos(angle)], axis=-1)
    for sign in (-1.0, 1.0):  # up, down
        axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, sign], [0.0, -sign, 0.0]])

        def places(ray: Doubles, axes: Doubles = axes) -> Doubles:
            turned: Doubles = ray @ axes
            return cap.places(turned, size, 0)

        def shows(ray: Doubles, sign: float = sign) -> NDArray[np.bool_]:
            return np.asarray((from_pole(ray) < radius) & (sign * ray[..., 1] > 0.0))

        texels = _between_texels(both, places_of(rays @ axes.T, (height, width)))
        yield SourceTile(texels, places, shows)


def _between_texels(image: NDArray[Any], place: Doubles) -> NDArray[Any]:
    """Interpolate linearly at places (h, w, 2) of a picture that repeats beyond its edges."""
    height, width = image.shape[:2]
    values = np.ma.getdata(image)
    low = np.floor(place - 0.5).astype(np.int64)
    part = (place - 0.5 - low).reshape(*place.shape, *(1,) * (values.ndim - 2))
    total = np.zeros((*place.shape[:2], *values.shape[2:]))
    for down, across in ((0, 0), (0, 1), (1, 0), (1, 1)):
        texels = values[(low[..., 1] + down) % height, (low[..., 0] + across) % width]
        x, y = part[:, :, 0], part[:, :, 1]
        total += (x if across else 1.0 - x) * (y if down else 1.0 - y) * texels
    made = (np.rint(total) if values.dtype.kind in "iu" else total).astype(values.dtype)
    if not isinstance(image, np.ma.MaskedArray):
        return np.asarray(made)
    nearest = np.floor(place).astype(np.int64)
    mask = np.ma.getmaskarray(image)[nearest[..., 1] % height, nearest[..., 0] % width]
    return np.ma.MaskedArray(made, mask, fill_value=image.fill_value)
