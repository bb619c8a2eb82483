"""Geometry of a warp: homographies, forward maps and backward maps, and their derivatives.

Continuous pixel coordinates: pixel (row i, column j) has its center at (j + 0.5, i + 0.5), in the
source as in the target. OpenCV counts from pixel centers; its maps are converted here, its matrices
in `matrices`. Files of maps do not say whether their numbers are coordinates in the source or
displacements of texels; the caller decides by the class that it makes of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.files.images import read_channels
from resample.memory.mapped import contiguous
from resample.types import Doubles

Size = tuple[int, int]  # height and width

LARGEST_CONDITION = 1e12  # of a balanced matrix; beyond, its inverse has no 4 correct digits
LARGEST_EXPONENT = 690.0  # of e in a determinant, as kernels divide by it

FIXED_POINT_STEPS = 32  # per pixel, of OpenCV's integer maps
FLOW_MAGIC = 202021.25  # the first number of a .flo file
UNKNOWN_FLOW = 1e9  # px; larger flow means unknown, Baker et al. 2011
NAMES = (("X", "Y"), ("x", "y"), ("U", "V"), ("u", "v"), ("map_x", "map_y"), ("R", "G"))
TOLERANCE = 1e-3  # px by which an inverse's value may miss its place
MOST_STEPS = 20
LONGEST_STEP = 8.0  # px
BEYOND = 2.0  # px beyond the map's edges where it is still inverted
MARGIN = 20  # pixels by which a map is extended; a spline forgets its ends by 0.27 per pixel


def read_map(path: str | Path) -> NDArray[Any]:
    """Read x and y per pixel, (H, W, 2), of .npy, .npz, Middlebury's .flo, or any picture."""
    suffix = Path(path).suffix.lower()
    if suffix == ".flo":
        data = Path(path).read_bytes()
        if len(data) < 12 or np.frombuffer(data, "<f4", 1)[0] != FLOW_MAGIC:
            raise ValueError(f"{path} is not a .flo file: it does not begin with {FLOW_MAGIC}")
        width, height = (int(number) for number in np.frombuffer(data, "<i4", 2, 4))
        if width < 1 or height < 1 or len(data) != 12 + 8 * width * height:
            raise OSError(f"{path} is damaged: {len(data)} bytes for {width} × {height} vectors")
        flow = np.frombuffer(data, "<f4", -1, 12).reshape(height, width, 2).astype(np.float64)
        is_known = (np.abs(flow) <= UNKNOWN_FLOW).all(axis=2, keepdims=True)
        return np.where(is_known, flow, np.nan)
    if suffix in (".npy", ".npz"):
        loaded = read_arrays(path)
        if isinstance(loaded, dict):
            return _two_of(loaded, path)
        return checked_pairs(loaded, f"{path}: a map")
    return _two_of(dict(read_channels(path)), path)


def places_by_map(
    pairs: NDArray[Any], shift: float = 0.0
) -> Callable[[Doubles, Doubles], tuple[Doubles, Doubles]]:
    """Return a function from a rectangle of pixel centers to a map's values (H, W, 2) + shift."""

    def places(x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
        left, top = int(x[0, 0]), int(y[0, 0])
        part = pairs[top : top + x.shape[0], left : left + x.shape[1]].astype(np.float64)
        return part[..., 0] + shift, part[..., 1] + shift

    return places


def read_arrays(path: str | Path) -> NDArray[Any] | dict[str, NDArray[Any]]:
    """Read the array of a .npy file, or the arrays of a .npz file by name."""
    from resample.reading.arrays import is_npy, read_npy, read_npz

    file = Path(path)
    # Only the parts that are used are read.
    return read_npy(file, mapped=True) if is_npy(file) else read_npz(file)


def checked_pairs(array: ArrayLike, name: str) -> NDArray[Any]:
    """Return checked numbers (H, W, 2), unconverted; `name` begins error messages."""
    pairs = np.asarray(array)
    if pairs.ndim != 3 or pairs.shape[2] != 2 or pairs.size == 0:
        raise ValueError(f"{name} holds two numbers per pixel, (H, W, 2), not {pairs.shape}")
    if pairs.dtype.kind not in "fiu":
        raise ValueError(f"{name} holds real numbers, not {pairs.dtype}")
    return pairs


def from_fixed_point(whole: NDArray[Any], fraction: NDArray[Any]) -> Doubles:
    """Return coordinates (h, w, 2) of whole pixels (h, w, 2) and fractions (h, w): 32 y + x."""
    places = checked_pairs(whole, "a fixed-point map").astype(np.float64)
    if fraction.shape != whole.shape[:2]:
        raise ValueError(f"{fraction.shape} fractions do not fit a map of {whole.shape[:2]} pixels")
    if whole.dtype != np.int16 or fraction.dtype not in (np.uint16, np.int16):
        raise ValueError(
            f"a fixed-point map is of int16 and uint16, not of {whole.dtype} and {fraction.dtype}"
        )
    y, x = np.divmod(fraction.astype(np.int64), FIXED_POINT_STEPS)
    return places + np.stack([x, y % FIXED_POINT_STEPS], axis=2) / FIXED_POINT_STEPS


def _two_of(channel: dict[str, NDArray[Any]], path: str | Path) -> NDArray[Any]:
    """Return the channels x and y, by name, or because there are only two."""
    known = [pair for pair in NAMES if all(name in channel for name in pair)]
    if not known and len(channel) != 2:
        names = ", ".join(channel) or "none"
        raise ValueError(f"{path}: a map has two channels, or channels X and Y; here are {names}")
    x, y = (channel[name] for name in (known[0] if known else channel))
    if x.shape != y.shape or x.ndim != 2:
        raise ValueError(f"{path}: x of {x.shape} and y of {y.shape} are not pictures of one size")
    return checked_pairs(np.stack([x, y], axis=2), f"{path}: a map")


@dataclass(frozen=True, eq=False)
class Homography:
    """Projective map from source to target.

    Parameters
    ----------
    matrix
        (3, 3); (u, v, 1) of the source maps to d (x, y, 1); the last row gives d.
    is_signed
        True: points with d > 0 are in front of the camera. False: the sign of `matrix` has no
        meaning and the source's center is in front, see `oriented`.
    region
        Part of a larger target that this maps to; methods that support it give the same bits for
        it as for the whole.

    Raises
    ------
    ValueError
        The matrix has another shape, is not finite or has no inverse.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Homography, warp
    >>> twice = Homography(np.diag([2.0, 2.0, 1.0]))
    >>> warp(np.ones((20, 30)), twice, (40, 60))
    WarpedMeans(40 × 60 float64, 100 % covered)
    >>> (twice.inverse() @ (60, 40, 1)).tolist()  # where the target's last corner comes from
    [30.0, 20.0, 1.0]
    """

    matrix: Doubles
    is_signed: bool = False
    region: "TargetRegion | None" = None  # of a larger target, to which this maps

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, np.float64)
        if matrix.shape != (3, 3):
            raise ValueError(f"a homography is a matrix of shape (3, 3), not {matrix.shape}")
        if not np.isfinite(matrix).all():
            raise ValueError(f"a homography's numbers must be finite, not {matrix.tolist()}")
        is_singular = not abs(np.linalg.slogdet(matrix).logabsdet) < LARGEST_EXPONENT
        bare = matrix if is_singular else matrix / np.abs(matrix).max()
        if not (is_singular or float(np.linalg.cond(bare)) < LARGEST_CONDITION):
            for _ in range(8):  # balance rows and columns, which may be in different units
                bare = bare / np.sqrt(np.abs(bare).max(axis=1, keepdims=True))
                bare = bare / np.sqrt(np.abs(bare).max(axis=0, keepdims=True))
            is_singular = not float(np.linalg.cond(bare)) < LARGEST_CONDITION
        if is_singular:
            raise ValueError(f"the homography {matrix.tolist()} has no inverse in float64")
        object.__setattr__(self, "matrix", matrix)

    def inverse(self) -> Doubles:
        """Matrix (3, 3) from target to source."""
        return np.asarray(np.linalg.inv(self.matrix), np.float64)

    def oriented(self, source_shape: Size = (1, 1)) -> Doubles:
        """Return ± the matrix (3, 3), so that points in front of the camera have d > 0."""
        return self.matrix if self.is_signed else oriented(self.matrix, source_shape)

    def normalized(self, source_shape: Size) -> Doubles:
        """Return the oriented matrix (3, 3), scaled so that d is at most 1 in the source."""
        matrix, (height, width) = self.oriented(source_shape), source_shape
        corners = np.array([[u, v, 1.0] for u in (0, width) for v in (0, height)])
        return np.ascontiguousarray(matrix / np.abs(corners @ matrix[2]).max())


class TargetRegion(NamedTuple):
    """A rectangle of a larger target, bit-identical to the whole's pixels."""

    whole: Homography  # from the source to that target
    left: int  # px
    top: int
    shape: Size  # of the target: height, width
    size: Size | None = None  # of the source, if only a part of it is given
    first: tuple[int, int] = (0, 0)  # column and row of the source at which that part begins


@dataclass(frozen=True, eq=False)
class ForwardMap:
    """Target coordinates of each texel's center.

    Parameters
    ----------
    x, y
        (H, W) of the source, px; not a number where a texel is dropped.

    Raises
    ------
    ValueError
        They are not two arrays (H, W) of the same shape.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import ForwardMap, warp
    >>> flow = np.zeros((16, 16, 2))
    >>> flow[..., 0] = 2.5  # px to the right
    >>> moved = warp(np.ones((16, 16)), ForwardMap.from_flow(flow), (16, 16))
    >>> moved.coverage[8, :4].round(3).tolist()
    [0.0, 0.0, 0.5, 1.0]
    """

    x: Doubles
    y: Doubles

    def __post_init__(self) -> None:
        _keep_pair(self, "forward map")

    @classmethod
    def from_flow(cls, flow: ArrayLike) -> "ForwardMap":
        """Return a map that moves each texel by a vector (x, y) of `flow`, (H, W, 2) px."""
        moves = checked_pairs(flow, "a flow").astype(np.float64)
        x, y = pixel_centers(moves.shape[:2])
        return cls(x + moves[..., 0], y + moves[..., 1])

    def inverse(self, shape: Size, *, tolerance: float = 1e-3) -> "BackwardMap":
        """Return the inverse of a smooth map: the source position of each target pixel.

        Parameters
        ----------
        shape
            Height and width of the target, px.
        tolerance
            Distance, px in the target, at most, between a pixel's center and where the map, a cubic
            spline between centers, leads from its place. Not a number where there is no such place,
            up to 2 px beyond the source; where a fold has two, it is one of them.

        Examples
        --------
        >>> import numpy as np
        >>> from resample_texture import ForwardMap
        >>> y, x = np.mgrid[:24, :32] + 0.5
        >>> bent = ForwardMap(x + 2 * np.sin(y / 9), 1.1 * y)
        >>> back = bent.inverse((26, 32))
        >>> [round(float(one), 2) for one in (back.x[13, 16], back.y[13, 16])]  # of (16.5, 13.5)
        [14.54, 12.27]
        """
        return BackwardMap(*inverse_of(self.x, self.y, shape, tolerance))


@dataclass(frozen=True, eq=False)
class BackwardMap:
    """Source coordinates of each pixel's center.

    Parameters
    ----------
    x, y
        (h, w) of the target, px; not a number where a pixel shows nothing.

    Raises
    ------
    ValueError
        They are not two arrays (h, w) of the same shape.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import BackwardMap, warp
    >>> image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    >>> x, y = np.meshgrid(np.arange(4), np.arange(3))  # as for `cv2.remap`
    >>> warp(image, BackwardMap.from_opencv(3 - x, y), (3, 4)).image[0].tolist()
    [3, 2, 1, 0]
    """

    x: Doubles
    y: Doubles

    def __post_init__(self) -> None:
        _keep_pair(self, "backward map")

    @classmethod
    def from_opencv(cls, map_x: ArrayLike, map_y: ArrayLike | None = None) -> "BackwardMap":
        """Return the map of arrays as `cv2.remap` takes them, in any form.

        Parameters
        ----------
        map_x, map_y
            Two pictures (h, w); or (h, w, 2) alone; or OpenCV's fixed-point pair, int16 (h, w, 2)
            and uint16 (h, w). Pixel centers are at integers.

        Raises
        ------
        ValueError
            The shapes do not fit each other.
        """
        first = np.asarray(map_x)
        second = None if map_y is None else np.asarray(map_y)
        if second is None or second.size == 0:
            both = checked_pairs(first, "a single OpenCV map").astype(np.float64)
            return cls(both[..., 0] + 0.5, both[..., 1] + 0.5)
        if first.ndim == 3:
            both = from_fixed_point(first, second)
            return cls(both[..., 0] + 0.5, both[..., 1] + 0.5)
        _check_pictures(first, second, "OpenCV map")
        return cls(first + np.float64(0.5), second + np.float64(0.5))

    @classmethod
    def from_function(
        cls, function: Callable[[Any, Any], Any], shape: Size, *, first: float = 0.5
    ) -> "BackwardMap":
        """Return the map of a function from x and y of pixels to x and y of the source.

        Parameters
        ----------
        function
            Takes and returns two arrays of the target's shape.
        shape
            Height and width of the target, px.
        first
            Coordinate of the first pixel's center: 0.5 (corner) or 0 (OpenCV).

        Raises
        ------
        ValueError
            The function returns anything else.
        """
        x, y = np.meshgrid(np.arange(shape[1]) + first, np.arange(shape[0]) + first)
        given = function(x, y)
        if len(given) != 2:
            raise ValueError(f"the function returned {len(given)} arrays; it must return x and y")
        u, v = (np.broadcast_to(np.asarray(a), x.shape) for a in given)
        _check_pictures(u, v, "function")
        return cls(u + (0.5 - first), v + (0.5 - first))

    @classmethod
    def from_grid_sample(
        cls, grid: ArrayLike, source_shape: Size, *, align_corners: bool = False
    ) -> "BackwardMap":
        """Return the map of a grid as `torch.nn.functional.grid_sample` takes it.

        Parameters
        ----------
        grid
            (h, w, 2) or (1, h, w, 2): x and y from −1 to 1 over the source.
        source_shape
            Height and width of the source, px.
        align_corners
            True: −1 and 1 are the centers of the outermost texels; false: their outer edges.

        Raises
        ------
        ValueError
            The grid has another shape.
        """
        given = np.asarray(grid)
        if given.ndim == 4 and given.shape[0] == 1:
            given = given[0]
        pairs = checked_pairs(given, "a grid of one picture").astype(np.float64)
        share = (pairs + 1.0) / 2.0
        size = np.array(source_shape[::-1], np.float64)
        places = share * (size - 1.0) + 0.5 if align_corners else share * size
        return cls(places[..., 0], places[..., 1])

    def inverse(self, source_shape: Size, *, tolerance: float = 1e-3) -> ForwardMap:
        """Return target positions of texels (height, width); see `ForwardMap.inverse`."""
        return ForwardMap(*inverse_of(self.x, self.y, source_shape, tolerance))


Geometry = Homography | ForwardMap | BackwardMap


def oriented(matrix: Doubles, source_shape: Size = (1, 1)) -> Doubles:
    """Return ± the matrix, so that the source's center is in front of the camera: d > 0."""
    height, width = source_shape
    center = np.array([width / 2, height / 2, 1.0])
    d = float(matrix[2] @ center)
    if abs(d) <= 1e-9 * float(np.abs(matrix[2]) @ center):
        # The horizon passes through the center: the corner farthest from it decides.
        corner = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]], float)
        distance = corner @ matrix[2]
        d = float(distance[np.argmax(np.abs(distance))])
    return -matrix if d < 0 else matrix


def source_coordinates(
    geometry: Geometry, shape: Size, source_shape: Size = (1, 1)
) -> tuple[Doubles, Doubles]:
    """Return x and y in the source of a target's (height, width) pixel centers, or NaN."""
    if isinstance(geometry, ForwardMap):
        raise ValueError(
            "a forward map gathers nothing; give a matrix, a backward map, or its inverse(shape)"
        )
    if isinstance(geometry, BackwardMap):
        if geometry.x.shape != tuple(shape):
            raise ValueError(f"a map of {geometry.x.shape} pixels does not fit a target of {shape}")
        return geometry.x, geometry.y
    # H (u, v, 1) = d (x, y, 1), hence H⁻¹ (x, y, 1) = (u, v, 1) / d: its last number has d's sign.
    inverse = np.linalg.inv(geometry.oriented(source_shape))
    x, y = pixel_centers(shape)
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in inverse)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        u, v = u / w, v / w
    is_seen = (w > 0) & np.isfinite(u) & np.isfinite(v)
    return np.where(is_seen, u, np.nan), np.where(is_seen, v, np.nan)


def pixel_centers(shape: tuple[int, ...]) -> tuple[Doubles, Doubles]:
    """Return the pixel centers of a frame (height, width): x as a row, y as a column."""
    height, width = shape
    if height < 1 or width < 1:
        raise ValueError(f"a picture of {width} × {height} pixels is empty; give it at least one")
    return np.arange(0.5, width), np.arange(0.5, height)[:, None]


def _keep_pair(given: ForwardMap | BackwardMap, name: str) -> None:
    """Store a map's arrays as float64, with NaN in both or in neither."""
    x, y = np.asarray(given.x), np.asarray(given.y)
    _check_pictures(x, y, name)
    x, y = contiguous(x, np.float64), contiguous(y, np.float64)
    is_somewhere = np.isfinite(x) & np.isfinite(y)
    if not is_somewhere.all():
        x, y = np.where(is_somewhere, x, np.nan), np.where(is_somewhere, y, np.nan)
    object.__setattr__(given, "x", x)
    object.__setattr__(given, "y", y)


def _check_pictures(x: NDArray[Any], y: NDArray[Any], name: str) -> None:
    if x.shape != y.shape or x.ndim != 2 or x.size == 0:
        raise ValueError(
            f"the {name}'s x and y must be pictures of one size, not of {x.shape} and {y.shape}"
        )
    if not (x.dtype.kind in "fiu" and y.dtype.kind in "fiu"):
        raise ValueError(f"the {name} must hold real numbers, not {x.dtype} and {y.dtype}")


def places_of(geometry: BackwardMap, shape: Size) -> Doubles:
    """Return (6, h, w): x, y, their change per column, and their change per row."""
    x, y = source_coordinates(geometry, shape)
    return np.stack([x, y, _step(x, 1), _step(y, 1), _step(x, 0), _step(y, 0)])


def _step(position: Doubles, axis: int) -> Doubles:
    """Return a coordinate's change per pixel along an axis; 0 without valid neighbours."""
    step = np.diff(position, axis=axis)
    none = np.full_like(position.take([0], axis), np.nan)
    before, after = np.concatenate([none, step], axis), np.concatenate([step, none], axis)
    before, after = (
        np.where(np.isnan(before), after, before),
        np.where(np.isnan(after), before, after),
    )
    # The mean of both steps; at the seam of a panorama or the edge of a fold the smaller one.
    smaller = np.where(abs(before) < abs(after), before, after)
    is_smooth = abs(before - after) <= 1.0 + abs(smaller)
    return np.nan_to_num(np.where(is_smooth, (before + after) / 2, smaller))


def inverse_of(
    x: Doubles, y: Doubles, shape: Size, tolerance: float = TOLERANCE
) -> tuple[Doubles, Doubles]:
    """Return positions where a map (h, w) has the value of each pixel center, or NaN."""
    from scipy import ndimage

    if not tolerance > 0.0:
        raise ValueError(f"a tolerance lies above 0 px, not at {tolerance}")
    is_known = np.isfinite(x) & np.isfinite(y)
    if not is_known.any():
        return np.full(shape, np.nan), np.full(shape, np.nan)
    wanted = np.stack([a.ravel() for a in np.meshgrid(*(np.arange(n) + 0.5 for n in shape[::-1]))])
    # Start at the map's pixel with the value nearest to each pixel's center.
    row, column = np.nonzero(is_known)
    there = np.floor(np.stack([y[row, column], x[row, column]]))
    high = np.array(shape)[:, None] - 1
    with np.errstate(invalid="ignore"):
        index = np.clip(there, 0, high).astype(np.int64)
    order = np.argsort(-np.abs(there - index).max(axis=0), kind="stable")  # those within come last
    index, row, column = index[:, order], row[order], column[order]
    found = np.zeros((3, *shape), np.int64)
    found[:, index[0], index[1]] = np.ones_like(row), row, column
    own = ndimage.distance_transform_edt(found[0] == 0, return_distances=False, return_indices=True)
    place = np.asarray(found[:0:-1, own[0], own[1]].reshape(2, -1) + 0.5)
    u, v = _found(x, y, place, wanted, tolerance).reshape(2, *shape)
    return u, v


def points_back(x: Doubles, y: Doubles, wanted: Doubles) -> Doubles:
    """Return positions where a map (h, w) has the values (2, N); NaN if nowhere."""
    from scipy.spatial import cKDTree

    row, column = np.nonzero(np.isfinite(x))
    if not row.size:
        return np.full(wanted.shape, np.nan)
    tree, is_given = cKDTree(np.stack([x, y])[:, row, column].T), np.isfinite(wanted).all(axis=0)
    _, nearest = tree.query(np.where(is_given, wanted, 0.0).T)
    place = np.stack([column + 0.5, row + 0.5])[:, nearest].astype(np.float64)
    return np.where(is_given, _found(x, y, place, wanted, TOLERANCE), np.nan)


def points_along(x: Doubles, y: Doubles, place: Doubles) -> Doubles:
    """Return the values of a map (h, w) at places (2, N), px; NaN beyond its edges."""
    is_known = np.isfinite(x)
    if not is_known.any():
        return np.full(place.shape, np.nan)
    values, _, known = _spline(np.stack([x, y]), is_known)
    size = np.array(x.shape[::-1])[:, None]
    is_within = ((place >= 0.0) & (place <= size)).all(axis=0)
    here = np.where(is_within, place, 0.0)
    is_within &= _sampled(known, here, 1) > 1.0 - 1e-6
    return np.where(is_within, _sampled(values, here, 3), np.nan)


def _found(x: Doubles, y: Doubles, place: Doubles, wanted: Doubles, tolerance: float) -> Doubles:
    """Return positions where a map has the wanted values, from places (2, N) nearby, or NaN."""
    values, steps, known = _spline(np.stack([x, y]), np.isfinite(x) & np.isfinite(y))
    # Move places to where the map has the wanted values, by Newton's method.
    miss = np.full(place.shape[1], np.inf)
    left = np.arange(place.shape[1])
    for _ in range(MOST_STEPS):
        here = place[:, left]
        off = wanted[:, left] - _sampled(values, here, 3)
        miss[left] = np.hypot(*off)
        (a, c), (b, d) = _sampled(steps, here, 1)
        area = a * d - b * c
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.stack([d * off[0] - b * off[1], a * off[1] - c * off[0]]) / area
            long = np.hypot(*step)
            step *= np.where(long > LONGEST_STEP, LONGEST_STEP / long, 1.0)
        is_left = (miss[left] > tolerance) & np.isfinite(step).all(axis=0)
        left = left[is_left]
        if not left.size:
            break
        place[:, left] += step[:, is_left]
    size = np.array(x.shape[::-1], np.float64)[:, None]
    is_found = (miss <= tolerance) & (place >= -BEYOND).all(axis=0)
    is_found &= (place <= size + BEYOND).all(axis=0)
    is_found &= _sampled(known, place, 1) > 1.0 - 1e-6
    return np.where(is_found, place, np.nan)


def _spline(places: Doubles, is_known: NDArray[np.bool_]) -> tuple[Doubles, Doubles, Doubles]:
    """Return spline coefficients (2, h, w), steps (2, 2, h, w), and 1 where a map is known."""
    from scipy import ndimage

    if not is_known.all():
        own = ndimage.distance_transform_edt(~is_known, return_distances=False, return_indices=True)
        places = places[:, own[0], own[1]]
    # Beyond their sides values go on as they end there.
    wide = np.stack([np.pad(one, MARGIN, mode="reflect", reflect_type="odd") for one in places])
    steps = np.stack([np.gradient(wide, axis=axis) for axis in (2, 1)])
    values = np.stack([ndimage.spline_filter(one, 3, mode="mirror") for one in wide])
    return values, steps, np.pad(is_known.astype(np.float64), MARGIN, mode="edge")


def _sampled(values: Doubles, place: Doubles, order: int) -> Doubles:
    """Return values (..., h, w) of a spline at places (2, N), px."""
    from scipy import ndimage

    if values.ndim > 2:
        return np.stack([_sampled(one, place, order) for one in values])
    where = place[::-1] - 0.5 + MARGIN
    return np.asarray(
        ndimage.map_coordinates(values, where, order=order, mode="nearest", prefilter=False)
    )
