"""Paint ellipsoids for cameras with arbitrary rays: panoramas, fisheyes, lenses."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera
from resample.cameras.pixels import (
    Equirectangular,
    check_panorama,
    directions,
    rays_at,
    undistorted_places,
)
from resample.messages import check_size
from resample.painting.ellipsoids import (
    Ellipsoids,
    EllipsoidSource,
    InMemory,
    ShapedOrder,
    ShapedPicture,
    ShapedScene,
    ShapedStyle,
    check_ellipsoids,
    empty_canvas,
)
from resample.painting.scenes import Clock
from resample.progress import Progress
from resample.types import Doubles, Floats, Indices, Statistics, View

if TYPE_CHECKING:
    from resample.engine.shaped.all_around import PlacedTiles
    from resample.engine.shaped.lists import TileLists

STRIP = 1 << 22  # sub-pixels with rays in memory together, at most
BLOCK = 4  # tiles along a side of a block listed first

# Rotations from camera axes to faces' axes: ahead, right, behind, left, below, above.
FACES = np.array(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    ],
    np.float64,
)

Number = TypeVar("Number", np.float32, np.int8)
RaysAt = Callable[[Doubles], Doubles]


class RayDirections(NamedTuple):
    """A camera by the directions of its rays."""

    world_to_camera: Doubles  # (4, 4) or (3, 4)
    rays: RaysAt  # directions (..., 3) at places (..., 2), px; NaN without a ray


def ray_directions(camera: Camera | Equirectangular, size: tuple[int, int]) -> RayDirections:
    """Return the rays of a panorama or of a camera with a lens, for a picture (height, width)."""
    if isinstance(camera, Equirectangular):
        check_panorama(size)
        return RayDirections(camera.world_to_camera, lambda place: rays_at(place, size))

    def through_lens(place: Doubles) -> Doubles:
        flat = directions(camera, undistorted_places(camera, place))
        return np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)

    return RayDirections(camera.world_to_camera, through_lens)


def paint_around(
    shapes: Ellipsoids | EllipsoidSource,
    camera: RayDirections,
    size: tuple[int, int],
    style: ShapedStyle | None = None,
    *,
    progress: Progress | None = None,
) -> ShapedPicture:
    """Paint ellipsoids, nearest first by their distance, for a camera of any kind.

    Parameters
    ----------
    shapes, size, style, progress
        As `paint_ellipsoids` takes them; ordered by distance.
    camera
        By its rays, see `ray_directions`. Depths are distances from the eye.

    Raises
    ------
    ValueError
        As `paint_ellipsoids` does; or another order is asked for.
    """
    check_size(*size)
    chosen = style or ShapedStyle(order=ShapedOrder.DISTANCE)
    if ShapedOrder(chosen.order) is not ShapedOrder.DISTANCE or chosen.is_affine:
        raise ValueError(
            "panoramas and pictures through a lens are ordered by distance and exact; take the"
            " order distance"
        )
    chosen = chosen._replace(order=ShapedOrder.DISTANCE)
    source = InMemory(check_ellipsoids(shapes)) if isinstance(shapes, Ellipsoids) else shapes
    clock, rays = Clock(), camera.rays
    # Faces of a cube around the eye, with as many px per unit as the picture's middle.
    middle = np.array([[size[1] / 2 - 0.5, size[0] / 2], [size[1] / 2 + 0.5, size[0] / 2]])
    one, two = (ray / np.linalg.norm(ray) for ray in rays(middle))
    angle = float(np.linalg.norm(one - two))
    per_unit = 1.0 / angle if np.isfinite(angle) and angle > 0 else float(max(size))
    pose, side = np.asarray(camera.world_to_camera, np.float64), 2 * int(np.ceil(per_unit))
    on_face = np.full(2, per_unit), np.full(2, side / 2)
    parts = []
    for turn in FACES:
        rotation = np.ascontiguousarray(turn @ pose[:3, :3])
        view = View(rotation, turn @ pose[:3, 3], *on_face, 0.0, perspective=True)
        parts.append(ShapedScene(source, view, (side, side), chosen, nearest=chosen.near))
    held = [part.records() for part in parts]
    scene = parts[0].measured(face.records for face in held)
    fine = scene.finest()
    clock.lap("project")
    from resample.engine.shaped.all_around import paint_all_around
    from resample.engine.shaped.canvas import SIDE, PaintedShapes
    from resample.engine.shaped.lists import TileLists

    offset = np.cumsum([0, *(face.count for face in held)])
    members = [
        face.front_to_back().astype(np.int64) + first
        for face, first in zip(held, offset, strict=False)
    ]
    joined = np.concatenate([face.records for face in held])
    del held
    start = np.cumsum([0, *(len(member) for member in members)])
    whole = TileLists(start, np.concatenate(members).astype(np.int32))
    canvas, side = empty_canvas(size), SIDE // fine
    step = max(1, STRIP // (size[1] * fine * fine * side)) * side
    for first in range(0, size[0], step):
        last = min(first + step, size[0])
        strip = _strip(rays, (first, last), size[1], fine, per_unit)
        part = PaintedShapes(*(array[first:last] for array in canvas))
        lists = _lists(joined, whole, strip)
        opacity = scene.opacity()
        paint_all_around(joined, lists, strip, fine, 0.0, opacity, part)
        if progress is not None:
            progress(last / size[0])
    clock.lap("paint")
    count = sum(source.sizes())
    counts = Statistics(count, 0, min(len(joined), count), 0, fine, clock.seconds)
    return ShapedPicture(*canvas, counts)


def _strip(
    rays: RaysAt, rows: tuple[int, int], width: int, fine: int, per_unit: float
) -> "PlacedTiles":
    """Place the sub-pixels of rows of a picture on faces, tile by tile."""
    from resample.engine.shaped.all_around import PlacedTiles
    from resample.engine.shaped.canvas import PLANE, SIDE

    side = SIDE // fine
    down, columns = -(-(rows[1] - rows[0]) // side), -(-width // side)
    # Sub-pixels from tile to tile; those beyond a tile's own are on no face.
    offset = (np.arange(SIDE) + 0.5) / fine
    x = (np.arange(columns)[:, None] * side + offset).reshape(-1)
    y = (rows[0] + np.arange(down)[:, None] * side + offset).reshape(-1)
    place = np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=2)
    ray = rays(place)
    used = np.arange(SIDE) < side * fine
    is_used = np.tile(used, down)[:, None] & np.tile(used, columns)
    is_used &= (place[..., 0] < width) & (place[..., 1] < rows[1]) & np.isfinite(ray).all(axis=2)
    along = np.nan_to_num(ray) @ FACES[:, 2].T  # how far ahead of each face
    face = along.argmax(axis=2)
    ahead = np.take_along_axis(along, face[..., None], 2)[..., 0]
    turned = np.einsum("hwij,hwj->hwi", FACES[face], np.nan_to_num(ray))
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = turned[..., :2] / ahead[..., None]
    middle = np.ceil(per_unit)
    length = np.sqrt(1 + np.square(flat).sum(axis=2))
    planes = np.stack([flat[..., 0] * per_unit + middle, flat[..., 1] * per_unit + middle, length])
    face = np.where(is_used & (ahead > 0), face, -1).astype(np.int8)

    def by_tile(array: NDArray[Number]) -> NDArray[Number]:
        """Split planes (..., down SIDE, columns SIDE) into tiles (T, ..., PLANE)."""
        shape = *array.shape[:-2], down, SIDE, columns, SIDE
        tiles = np.moveaxis(array.reshape(shape), (-4, -2), (0, 1))
        return np.ascontiguousarray(tiles.reshape(down * columns, *array.shape[:-2], PLANE))

    return PlacedTiles(by_tile(planes.astype(np.float32)), by_tile(face), columns)


def _lists(records: Floats, whole: "TileLists", strip: "PlacedTiles") -> "TileLists":
    """List each tile's candidates per face: for blocks of tiles first, then for tiles."""
    # Bounds (T, faces, 4) of the sub-pixels of each tile on each face; least above most: none.
    boxes = np.empty((len(strip.at), len(FACES), 4))
    for number in range(len(FACES)):
        is_here = strip.face == number
        for axis in range(2):
            place = strip.at[:, axis]
            boxes[:, number, axis] = np.where(is_here, place, np.inf).min(axis=1)
            boxes[:, number, 2 + axis] = np.where(is_here, place, -np.inf).max(axis=1)
    tile = np.arange(len(boxes))
    row, column = tile // strip.columns // BLOCK, tile % strip.columns // BLOCK
    block = row * (-(-strip.columns // BLOCK)) + column
    around = np.empty((block.max() + 1, len(FACES), 4))
    around[..., :2], around[..., 2:] = np.inf, -np.inf
    np.minimum.at(around[..., :2], block, boxes[..., :2])
    np.maximum.at(around[..., 2:], block, boxes[..., 2:])
    faces = np.arange(len(FACES))
    coarse = _meeting(records, whole, np.tile(faces, len(around)), around.reshape(-1, 4))
    of = (block[:, None] * len(FACES) + faces).reshape(-1)
    return _meeting(records, coarse, of, boxes.reshape(-1, 4))


def _meeting(records: Floats, lists: "TileLists", of: Indices, boxes: Doubles) -> "TileLists":
    """List the records of a list that meet each box."""
    from resample.engine.shaped.all_around import deal_to_boxes
    from resample.engine.shaped.lists import TileLists

    count = np.zeros(len(of), np.int64)
    deal_to_boxes(records, lists, of, boxes, count, np.zeros(0, np.int32))
    start = np.concatenate([[0], np.cumsum(count)])
    member = np.empty(start[-1], np.int32)
    if member.size:
        deal_to_boxes(records, lists, of, boxes, start[:-1].copy(), member)
    return TileLists(start, member)
