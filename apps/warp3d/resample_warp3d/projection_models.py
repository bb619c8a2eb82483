"""Projection of points to pixels, and back, for cameras of all models.

Points are homogeneous: (..., 3) in a camera's axes and a weight (...); the point is their quotient,
and a weight of 0 is infinitely far.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import (
    Equirectangular,
    directions,
    distorted_places,
    places_of,
    rays_at,
    undistorted_places,
)
from resample.types import Doubles, Floats
from resample_warp3d.depth.equation import between, lens_places
from resample_warp3d.types import DepthImage, Equation, Sheet

if TYPE_CHECKING:
    from resample_warp3d.sheet.kernels.screen import SheetScreen

CameraModel: TypeAlias = Camera | Orthographic | Equirectangular
Shape = tuple[int, int]  # height and width, px

NEAREST = 1e-6  # share of a point's distance: points less far ahead are beside the camera
ROWS = 64  # of a sheet's corners projected at a time
FARTHEST = 1e6  # px: positions farther out are dropped
MERGED = 60.0, 75.0  # degrees of latitude between which the eyes of a stereo panorama join
LATITUDES = 8  # steps of the latitude that depends on the eye, which depends on the latitude
STEP = 1e-4  # px, and share of a nearness, step of finite differences
STEEPEST = 1e3  # px on the screen per px of the source, where a surface ends
FARTHEST_END = 64.0  # px that an end may move on the screen
NO_CELL = -2  # in a sheet's index

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class StereoPanorama(Equirectangular):
    """One eye's panorama of an omnidirectional stereo pair: each column has its own eye position.

    The eyes are on a horizontal circle around the center, as of a turning head that faces
    each column (Peleg 1999). Toward the poles, where no such pair exists, the circle shrinks to a
    point, between `MERGED` of latitude.

    Parameters
    ----------
    world_to_camera
        As for `Equirectangular`.
    right
        Distance of the eye from the center to the right, scene units; negative: to the left.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import StereoPanorama
    >>> from resample_warp3d.projection_models import project
    >>> left, right = StereoPanorama(right=-0.5), StereoPanorama(right=0.5)
    >>> ahead = np.array([0.0, 0.0, 1.0]), np.array(1.0)  # one unit away
    >>> [project(eye, (180, 360), *ahead)[0].round(6).tolist() for eye in (left, right)]
    [[210.0, 90.0], [150.0, 90.0]]
    """

    right: float = 0.0

    def eye_of(self, ray: Doubles) -> Doubles:
        """Return the eye positions (..., 3) of rays (..., 3) of any length, in camera axes."""
        flat = np.hypot(ray[..., 0], ray[..., 2])
        reach = self._reach(np.abs(ray[..., 1]), flat)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(reach != 0.0, reach / flat, 0.0)
        return np.stack([ray[..., 2] * share, np.zeros_like(share), -ray[..., 0] * share], axis=-1)

    def from_eye(self, point: Doubles, weight: Doubles) -> Doubles:
        """Return rays (..., 3) from the eyes to points, times their weight; nan in the circle."""
        flat = np.hypot(point[..., 0], point[..., 2])
        high = np.abs(point[..., 1])
        along = flat
        for _ in range(LATITUDES):
            side = weight * self._reach(high, along)
            along = np.sqrt(np.maximum(flat * flat - side * side, 0.0))
        is_outside = (np.abs(side) <= flat) & (flat > 0.0)
        cosine, sine = along / flat, np.where(is_outside, side / flat, np.nan)
        x = point[..., 0] * cosine - point[..., 2] * sine
        z = point[..., 2] * cosine + point[..., 0] * sine
        is_kept = side == 0.0  # also for points above and below, with the flat length 0
        x, z = (
            np.where(is_kept, point[..., axis], each * cosine) for axis, each in ((0, x), (2, z))
        )
        return np.stack([x, point[..., 1], z], axis=-1)

    def _reach(self, high: Doubles, flat: Doubles) -> Doubles:
        """Return the distance of the eye for rays of this height and length in the plane."""
        first, last = np.radians(MERGED)
        share = np.clip((np.arctan2(high, flat) - first) / (last - first), 0.0, 1.0)
        return self.right * np.where(share < 1.0, np.cos(0.5 * math.pi * share), 0.0)


def stepped(move: Sequence[float], turn: Sequence[float] = (0.0, 0.0, 0.0)) -> Doubles:
    """Return the pose (4, 4) of a camera after a move and a turn, in its previous axes.

    `move`: to the right, down and forward, scene units. `turn`: to the right, up and clockwise,
    degrees; in this order, each about the camera's new axes.
    """
    turns = []
    for axis, angle in zip((1, 0, 2), np.radians(np.asarray(turn, np.float64)), strict=True):
        turned, pair = np.eye(3), [(axis + 1) % 3, (axis + 2) % 3]
        cosine, sine = math.cos(angle), math.sin(angle)
        turned[np.ix_(pair, pair)] = [[cosine, -sine], [sine, cosine]]
        turns.append(turned)
    axes = turns[0] @ turns[1] @ turns[2]  # columns: the new axes in the old
    pose = np.eye(4)
    pose[:3, :3] = axes.T
    pose[:3, 3] = -axes.T @ np.asarray(move, np.float64)
    return pose


def is_bent(target: CameraModel) -> bool:
    """Whether a target bends straight lines or has no center of projection."""
    return not isinstance(target, Camera) or target.distortion is not None


def project(
    camera: CameraModel, shape: Shape, point: Doubles, weight: Doubles
) -> tuple[Doubles, Doubles]:
    """Project points to px (..., 2), with 1 / z or 1 / ray length; nan if not visible."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(camera, StereoPanorama):
            point = camera.from_eye(point, weight)
        if isinstance(camera, Equirectangular):
            return places_of(point, shape), weight / np.linalg.norm(point, axis=-1)
        ahead = point[..., 2]
        far = np.where(ahead > NEAREST * np.abs(point).max(axis=-1), ahead, np.nan)
        nearness = weight / far
        if isinstance(camera, Orthographic):
            flat = point[..., :2] / np.where(weight > 0.0, weight, np.nan)[..., None]
            return flat * (camera.sx, camera.sy) + (camera.cx, camera.cy), nearness
        flat = point[..., :2] / far[..., None]
    on_screen = flat @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    if camera.distortion is not None:
        on_screen = distorted_places(camera, on_screen)
    return on_screen, nearness


def unproject(
    camera: CameraModel, shape: Shape, place: Doubles, nearness: Doubles
) -> tuple[Doubles, Doubles]:
    """Unproject places (..., 2) px with a nearness (...) to points; nan beyond the lens."""
    if isinstance(camera, Equirectangular):
        ray = rays_at(place, shape)
        if isinstance(camera, StereoPanorama):
            ray = ray + nearness[..., None] * camera.eye_of(ray)
        return ray, nearness
    if isinstance(camera, Orthographic):
        flat = (place - (camera.cx, camera.cy)) / (camera.sx, camera.sy)
        flat = flat * nearness[..., None]
    else:
        unbent = place if camera.distortion is None else undistorted_places(camera, place)
        flat = directions(camera, unbent)
    return np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1), nearness


def without_lens(camera: Camera) -> Camera:
    """Return the same camera without its lens."""
    return Camera(camera.matrix, camera.world_to_camera, near=camera.near)


def taken_by(camera: CameraModel, image: DepthImage) -> tuple[DepthImage, Camera | Orthographic]:
    """Undistort the positions of a depth image's samples; also return the camera.

    A parallel camera, also with nearness 1 / z, is moved along its axis to one picture width
    before the nearest point, where nearness resolves depths well.
    """
    shape = image.color.shape[0], image.color.shape[1]
    if isinstance(camera, Camera):
        return image._replace(place=lens_places(camera, shape)), camera
    if not isinstance(camera, Orthographic):
        raise ValueError(
            "depth images are taken by a Camera or an Orthographic one, not by"
            f" {type(camera).__name__}; sources of a panorama are made by"
            " resample_warp3d.panorama"
        )
    known = image.nearness > 0
    if not known.any():
        return image, camera
    depth = 1.0 / image.nearness[known].astype(np.float64)
    back = float(max(shape[1] / camera.sx, shape[0] / camera.sy) - depth.min())
    nearness = np.zeros(image.nearness.shape, np.float32)
    nearness[known] = 1.0 / (depth + back)
    pose = camera.world_to_camera.copy()
    pose[2, 3] += back
    return image._replace(nearness=nearness), camera.moved(pose)


@dataclass(frozen=True, eq=False)
class Passage:
    """Map from a source's samples to a target's pixels, and back."""

    source: Camera | Orthographic
    target: CameraModel
    shape: Shape
    frame: Doubles = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        if not isinstance(self.source, Camera | Orthographic):
            raise ValueError(
                "depth images are taken by a Camera or an Orthographic one, not by"
                f" {type(self.source).__name__}; split a panorama into faces"
            )
        if not isinstance(self.target, Camera | Orthographic | Equirectangular):
            raise ValueError(
                "depth images are rendered by Camera, Orthographic or Equirectangular, not by"
                f" {type(self.target).__name__}; give a camera"
            )

    def in_frame(self, matrix: Doubles) -> "Passage":
        """Return the map to a frame (3, 3) within this one's frame."""
        return replace(self, frame=matrix @ self.frame)

    def ahead(self, place: Doubles, nearness: Doubles) -> tuple[Doubles, Doubles]:
        """Map samples to px of the frame (..., 2), with nearness; nan if not visible."""
        source = without_lens(self.source) if isinstance(self.source, Camera) else self.source
        point, weight = unproject(source, self.shape, place, nearness)
        there, near = project(self.target, self.shape, *_moved(self._step(), point, weight))
        return there * np.diag(self.frame)[:2] + self.frame[:2, 2], near

    def back(self, place: Doubles, nearness: Doubles) -> tuple[Doubles, Doubles]:
        """Map places of the frame to the undistorted source, with nearness."""
        source = without_lens(self.source) if isinstance(self.source, Camera) else self.source
        whole = (place - self.frame[:2, 2]) / np.diag(self.frame)[:2]
        point, weight = unproject(self.target, self.shape, whole, nearness)
        step = np.asarray(np.linalg.inv(self._step()), np.float64)
        return project(source, self.shape, *_moved(step, point, weight))

    def laid(self, sheet: Sheet) -> "SheetScreen":
        """Project a sheet to the target, without cells cut by a panorama's seam or pole."""
        from resample_warp3d.sheet.kernels import screen

        height, width = sheet.torn.shape
        vertices = np.empty((3, height + 1, width + 1), np.float32)
        for n in range(0, height + 1, ROWS):
            rows = slice(n, min(n + ROWS, height + 1))
            nearness, place = sheet.vertex[rows], sheet.place[rows]
            if not sheet.place.size:
                row, column = np.indices(nearness.shape, np.float64)
                place = np.stack([column, row + n], axis=-1)
            vertices[:, rows] = self._corners(place, nearness)
        torn = self._corners(sheet.corner[..., :2], sheet.corner[..., 2])
        torn = np.ascontiguousarray(np.moveaxis(torn, 0, -1))
        if not isinstance(self.target, Equirectangular):  # its seam would disturb differences
            self._project_ends(sheet, torn)
        own = sheet.torn
        if isinstance(self.target, Equirectangular):
            most = 0.5 * self.shape[1] * self.frame[0, 0]
            x = vertices[0]
            around = [x[:-1, :-1], x[:-1, 1:], x[1:, :-1], x[1:, 1:]]
            own = np.where(_wide(around, most) & (own < 0), np.int32(NO_CELL), own)
            torn[_wide(list(np.moveaxis(torn[..., 0], 1, 0)), most), :, 2] = -1.0
        bounds = np.empty((height, screen.segment_count(width), 4), np.int32)
        screen.bound_segments(vertices, torn, own, bounds)
        return screen.SheetScreen(vertices, torn, own, bounds)

    @property
    def orientation(self) -> float:
        """Volume with a sign that tells whether the map mirrors the order of corners."""
        volume = float(np.linalg.det(self.frame))
        for camera in (self.source, self.target):
            if isinstance(camera, Camera):
                volume *= float(np.sign(camera.fx * camera.fy))
        return volume

    def _step(self) -> Doubles:
        """Return the pose (4, 4) of the target in the source's axes."""
        back = np.linalg.inv(self.source.world_to_camera)
        return np.asarray(self.target.world_to_camera @ back, np.float64)

    def _project_ends(self, sheet: Sheet, torn: Floats) -> None:
        """Move ends of surfaces as `corners.project_ends` does, by finite differences."""
        from resample_warp3d.sheet.kernels.corners import INSET, INSET_BY_NEARNESS, INSET_PX

        if not len(sheet.ends):
            return
        row, corner = sheet.ends.T
        x, y, near = sheet.corner[row, corner].astype(np.float64).T
        place, length = np.stack([x, y], axis=1), np.hypot(*sheet.roundness.T.astype(np.float64))
        out = sheet.roundness / length[:, None]
        side = np.stack([-out[:, 1], out[:, 0]], axis=1)
        here = self.ahead(place, near)[0]
        ahead, along = (
            (self.ahead(place + STEP * way, near)[0] - here) / STEP for way in (out, side)
        )
        nearer = (self.ahead(place, near * (1.0 + STEP))[0] - here) / (near * STEP)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            rise = 0.5 * length * _cross(nearer, along) / _cross(ahead, along)
            speed = np.maximum(np.hypot(*nearer.T), 1e-30)
        rise = np.where(np.isfinite(rise), rise, 0.0)
        least = np.minimum(np.sqrt(length * INSET), INSET_PX / speed)
        least = np.minimum(least, INSET_BY_NEARNESS * np.abs(rise))
        rise = np.clip(rise, least, np.sqrt(length))
        back = (rise**2 / length)[:, None] * out
        ends = self._corners(place - back, near + rise)
        # Differences beside invisible positions are not valid.
        is_even = np.hypot(*ahead.T) + np.hypot(*along.T) < STEEPEST
        is_even &= np.hypot(*(ends[:2].T - here).T) < FARTHEST_END
        is_seen = is_even & (torn[row, corner, 2] > 0) & (ends[2] > 0)
        torn[row[is_seen], corner[is_seen]] = ends.T[is_seen]

    def _corners(self, place: Doubles | Floats, nearness: Floats) -> Floats:
        """Project corners, (3, ...): x, y and nearness, −1 if not visible."""
        known = nearness > 0
        there, near = self.ahead(np.asarray(place, np.float64), np.asarray(nearness, np.float64))
        is_seen = known & (near > 0) & (np.abs(there) < FARTHEST).all(axis=-1)
        parts = there[..., 0], there[..., 1]
        flat = [np.where(is_seen, part, 0.0) for part in parts]
        return np.asarray([*flat, np.where(is_seen, near, -1.0)], np.float32)


def _cross(a: Doubles, b: Doubles) -> Doubles:
    """Return the cross products (N,) of vectors (N, 2)."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


Way = Equation | Passage


def mapping_between(source: CameraModel, target: CameraModel, shape: Shape) -> Way:
    """Return the map from a source to a target (height, width): an equation if possible.

    Raises
    ------
    ValueError
        The source is not a camera for depth images.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, DepthImage, Equirectangular
    >>> from resample_warp3d import prepare, render, mapping_between
    >>> color, nearness = np.ones((24, 32, 3), np.float32), np.full((24, 32), 0.5, np.float32)
    >>> source = prepare(DepthImage(color, nearness))
    >>> way = mapping_between(Camera.from_fov(90, 24, 32), Equirectangular(), (32, 64))
    >>> render(source, way, (32, 64), "hybrid")
    Warped(32 × 64 × 3 float32, 15.6 % covered)
    """
    if isinstance(source, Camera) and isinstance(target, Camera) and not is_bent(target):
        return between(source, target)
    return Passage(source, target, shape)  # type: ignore[arg-type]  # it refuses other types


def poles_rows(passage: Passage, sheet: Sheet) -> tuple[int, int]:
    """Return how far, px, the cells over a panorama's upper and lower pole extend."""
    found = [0.0, 0.0]
    screen = passage.laid(sheet)
    half = passage.shape[0] / 2.0

    def note(x: Floats, y: Floats) -> None:
        steps = np.diff(np.concatenate([x, x[:, :1]], axis=1), axis=1)
        wound = np.round(steps / passage.shape[1]).sum(axis=1) != 0
        for n, from_pole in enumerate((y, passage.shape[0] - y)):
            reach = from_pole[wound].max(axis=1, initial=0.0)
            found[n] = max(found[n], float(reach[reach < half].max(initial=0.0)))

    at = np.nonzero((screen.own == NO_CELL) & (sheet.torn != NO_CELL))
    ring = (0, 0), (0, 1), (1, 1), (1, 0)
    x, y, near = (
        np.stack([part[at[0] + down, at[1] + right] for down, right in ring], axis=1)
        for part in screen.vertex
    )
    is_seen = (near > 0).all(axis=1)
    note(x[is_seen], y[is_seen])
    cut = np.moveaxis(screen.torn[(screen.torn[..., 2] < 0).all(axis=1)], 2, 0)[:, :, (0, 1, 3, 2)]
    note(cut[0], cut[1])
    return math.ceil(found[0]), math.ceil(found[1])


def on_lattice(place: Doubles, at: Doubles) -> Doubles:
    """Map undistorted positions `at` (N, 2) to a distorted source's lattice, as kernels do."""
    height, width = place.shape[:2]
    found = np.clip(at, -1e6, 1e6)
    for _ in range(4):
        column = np.clip(np.floor(found[:, 0]), 0, width - 1).astype(np.int64)
        row = np.clip(np.floor(found[:, 1]), 0, height - 1).astype(np.int64)
        there = place[row, column]
        centers = np.stack([column, row], axis=1) + 0.5
        moved = np.clip(centers + at - there, -1e6, 1e6)
        found = np.where(np.isfinite(there), moved, found)
    return found


def _moved(step: Doubles, point: Doubles, weight: Doubles) -> tuple[Doubles, Doubles]:
    """Transform homogeneous points to another camera's axes."""
    return point @ step[:3, :3].T + weight[..., None] * step[:3, 3], weight


def _wide(corner: list[Floats], most: float) -> Mask:
    """Return the cells with corners farther apart than `most`."""
    low, high = np.minimum.reduce(corner), np.maximum.reduce(corner)
    return np.asarray(high - low > most)
