"""Camera models: perspective with any intrinsics and a lens, or parallel.

A camera looks along +z with x to the right and y down; poses map world to camera. The pixel in
row i, column j has its center at (j + 0.5, i + 0.5), so the center of a frame of W pixels is at
W / 2, not at (W − 1) / 2 as in OpenCV's matrices.
"""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Literal, NamedTuple, Protocol, TypedDict, Unpack

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from resample.calling import constructed, takes
from resample.cameras.poses import pose_of, rigid
from resample.messages import doubles_of, number
from resample.types import Doubles, View

COUNTS = (4, 5, 8, 12, 14)  # of coefficients
COUNT = 4  # of a fisheye's coefficients
STEPS = 30  # of Newton's method; most points need 2
TABLE = 1024  # radii or angles in the table of initial guesses
FARTHEST = 1e6  # radius at distance 1 beyond which nothing is visible
NEAR_AXIS = 1e-8  # radius below which the ratio of angle and radius is 1

Points = tuple[Doubles, Doubles]  # x and y


class Distortion(NamedTuple):
    """Coefficients of a lens, grouped by effect."""

    numerator: Doubles  # (4,) of the radial factor, in the squared radius
    denominator: Doubles  # (4,)
    tangential: Doubles  # (2,)
    prism: Doubles  # (4,)
    tilt: Doubles  # (3, 3) homography of the plane
    fold: float  # squared radius at which the distorted radius stops increasing

    def bend(self, x: Doubles, y: Doubles) -> Points:
        """Distort points; NaN beyond the fold."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            bent = _bend(self, x, y)
            is_single = _is_single(self, x, y, bent)
            x, y = project(self.tilt, bent.x, bent.y)
        return np.where(is_single, x, np.nan), np.where(is_single, y, np.nan)

    def unbend(self, x: Doubles, y: Doubles, tolerance: float) -> Points:
        """Undistort points by Newton's method; NaN where no solution exists.

        A solution is valid if distorting it reproduces the point to within `tolerance`, and if it
        lies on the axis's side of the fold.
        """
        x, y = project(np.asarray(np.linalg.inv(self.tilt), np.float64), np.ravel(x), np.ravel(y))
        # Initial guesses that invert only the radial part, read from a table.
        radius, fold = np.hypot(x, y), float(np.sqrt(self.fold))
        farthest = float(np.max(radius, initial=0.0, where=np.isfinite(radius)))
        reach = min(farthest, fold)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            while reach < min(fold, FARTHEST) and not _radial(self, np.array(reach)) >= farthest:
                reach = min(2.0 * reach, fold)
            table = np.linspace(0.0, reach, TABLE, endpoint=False)
            found = np.interp(radius, _radial(self, table), table)
            scale = np.where(radius > 0.0, found / radius, 1.0)
        u, v = x * scale, y * scale
        is_found, left = np.zeros(x.shape, bool), np.arange(x.size)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for _ in range(STEPS):
                bent = _bend(self, u[left], v[left])
                miss = x[left] - bent.x, y[left] - bent.y
                is_near = np.hypot(*miss) <= tolerance
                is_found[left] = is_near & _is_single(self, u[left], v[left], bent)
                # The last step is skipped: it concerns points that are found or have no solution.
                is_open = ~is_near & np.isfinite(miss[0] + miss[1])
                if not is_open.any():
                    break
                # A Newton step from the residual, never beyond the fold.
                determinant = bent.determinant()
                across = (miss[0] * bent.y_by_y - miss[1] * bent.x_by_y) / determinant
                down = (miss[1] * bent.x_by_x - miss[0] * bent.y_by_x) / determinant
                next_u, next_v = u[left] + across, v[left] + down
                if np.isfinite(self.fold):
                    radius = np.hypot(next_u, next_v)
                    half = 0.5 * (np.hypot(u[left], v[left]) + fold)
                    shrink = np.where(radius < fold, 1.0, half / radius)
                    next_u, next_v = next_u * shrink, next_v * shrink
                left = left[is_open]
                u[left], v[left] = next_u[is_open], next_v[is_open]
        return np.where(is_found, u, np.nan), np.where(is_found, v, np.nan)


class _Bent(NamedTuple):
    """Distorted points and their derivatives by the undistorted ones."""

    x: Doubles
    y: Doubles
    x_by_x: Doubles
    x_by_y: Doubles
    y_by_x: Doubles
    y_by_y: Doubles

    def determinant(self) -> Doubles:
        return self.x_by_x * self.y_by_y - self.x_by_y * self.y_by_x


def distortion(coefficients: Doubles) -> Distortion:
    """Distortion from 4, 5, 8, 12 or 14 coefficients in OpenCV's order; missing ones are 0."""
    k1, k2, p1, p2, k3, k4, k5, k6, *others = np.pad(coefficients, (0, 14 - coefficients.size))
    numerator, denominator = np.array([1, k1, k2, k3]), np.array([1, k4, k5, k6])
    tangential, prism = np.array([p1, p2]), np.array(others[:4])
    # The radius r n(s) / d(s), s = r², stops increasing where its derivative is 0, or has a pole.
    n, d, s = Polynomial(numerator), Polynomial(denominator), Polynomial([0, 1])
    growth = n * d + 2 * s * (n.deriv() * d - n * d.deriv())
    fold = _least(np.concatenate([growth.roots(), d.roots()]), np.inf)
    # Homography of a sensor tilted by τx and τy, rad.
    cos_x, cos_y, sin_x, sin_y = (turned(tau) for turned in (np.cos, np.sin) for tau in others[4:])
    turn = np.array([[cos_y, 0, -sin_y], [0, 1, 0], [sin_y, 0, cos_y]])
    turn = turn @ np.array([[1, 0, 0], [0, cos_x, sin_x], [0, -sin_x, cos_x]])
    back = np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1]])
    tilt = np.asarray(back @ turn, np.float64)
    return Distortion(numerator, denominator, tangential, prism, tilt, fold)


def _least(roots: NDArray[Any], most: float) -> float:
    """Least real root above 0 and below a limit, or the limit."""
    root = np.asarray(roots, np.complex128)
    is_real = (np.abs(root.imag) <= 1e-9 * np.abs(root)) & (root.real > 0.0)
    return float(np.min(root.real[is_real], initial=most))


def _radial(lens: Distortion, radius: Doubles) -> Doubles:
    """Distort a radius by the radial part of the lens."""
    s = radius * radius
    return radius * _horner(lens.numerator, s)[0] / _horner(lens.denominator, s)[0]


def _bend(lens: Distortion, x: Doubles, y: Doubles) -> _Bent:
    """Apply radial, tangential and thin-prism distortion, with derivatives."""
    (p1, p2), (s1, s2, s3, s4) = lens.tangential, lens.prism
    s = x * x + y * y
    above, below = _horner(lens.numerator, s), _horner(lens.denominator, s)
    factor = above[0] / below[0]
    slope = 2.0 * (above[1] - factor * below[1]) / below[0]  # twice d factor / ds
    prism_x, prism_y = 2.0 * (s1 + 2.0 * s2 * s), 2.0 * (s3 + 2.0 * s4 * s)
    crossed = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    return _Bent(
        x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x) + (s1 + s2 * s) * s,
        y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y + (s3 + s4 * s) * s,
        factor + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x,
        crossed + prism_x * y,
        crossed + prism_y * x,
        factor + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y,
    )


def _horner(c: Doubles, s: Doubles) -> tuple[Doubles, Doubles]:
    """Value and slope of a cubic polynomial."""
    return ((c[3] * s + c[2]) * s + c[1]) * s + c[0], (3.0 * c[3] * s + 2.0 * c[2]) * s + c[1]


def _is_single(lens: Distortion, x: Doubles, y: Doubles, bent: _Bent) -> NDArray[np.bool_]:
    """Whether points are on the axis's side of the fold."""
    return (x * x + y * y < lens.fold) & (bent.determinant() > 0)


def project(matrix: Doubles, x: Doubles, y: Doubles) -> Points:
    """Apply a homography to points; NaN behind the eye."""
    d = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
    d = np.where(d > 0, d, np.nan)
    return (
        (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) / d,
        (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) / d,
    )


class Fisheye(NamedTuple):
    """Distance from the center of the picture, as a polynomial of the angle."""

    distance: Polynomial
    slope: Polynomial
    fold: float  # rad: angle at which the distance stops increasing, or the plane ends

    def bend(self, x: Doubles, y: Doubles) -> Points:
        """Distort points; NaN beyond the fold."""
        radius = np.hypot(x, y)
        angle = np.arctan(radius)
        scale = _ratio(self.distance(angle), radius)
        scale[~(angle < self.fold)] = np.nan
        with np.errstate(invalid="ignore"):  # infinite values are beyond the fold
            return x * scale, y * scale

    def unbend(self, x: Doubles, y: Doubles, tolerance: float) -> Points:
        """Undistort points by Newton's method; NaN where no solution exists.

        A solution is valid if distorting it reproduces the point to within `tolerance`.
        """
        x, y = np.ravel(x), np.ravel(y)
        distance = np.hypot(x, y)
        table = np.linspace(0.0, self.fold, TABLE)
        angle = np.interp(distance, self.distance(table), table)
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(STEPS):
                miss = distance - self.distance(angle)
                if not (np.abs(miss) > 0.5 * tolerance).any():
                    break
                step = np.nan_to_num(miss / self.slope(angle), posinf=0.0, neginf=0.0)
                angle = np.clip(angle + step, 0.0, self.fold)
            is_found = (np.abs(distance - self.distance(angle)) <= tolerance) & (angle < self.fold)
            scale = _ratio(np.tan(angle), distance)
        scale[~is_found] = np.nan
        return x * scale, y * scale


def fisheye(coefficients: Doubles) -> Fisheye:
    """Fisheye lens with coefficients k1, k2, k3, k4."""
    distance = Polynomial(np.ravel([[0.0, k] for k in (1.0, *coefficients)]))
    slope = distance.deriv()
    return Fisheye(distance, slope, _least(slope.roots(), 0.5 * math.pi))


def _ratio(after: Doubles, before: Doubles) -> Doubles:
    """Ratio of radii; 1 at the axis."""
    is_away = before > NEAR_AXIS
    return np.divide(after, before, out=np.ones_like(before), where=is_away)


class Convention(StrEnum):
    """Position of the first pixel's center."""

    CORNER = "corner"  # at (0.5, 0.5): coordinates count from the corner of the picture
    OPENCV = "opencv"  # at (0, 0): they count from the center of its first pixel


class LensModel(StrEnum):
    """Meaning of a lens's coefficients, see OpenCV."""

    PINHOLE = "pinhole"  # radial, tangential and thin-prism distortion, tilt: most lenses
    FISHEYE = "fisheye"  # distance as a function of the angle: very wide lenses


AnyConvention = Convention | Literal["corner", "opencv"]
AnyLens = LensModel | Literal["pinhole", "fisheye"]


class IntrinsicsOptions(TypedDict, total=False):
    """Options of `Camera.from_intrinsics`."""

    skew: float  # px
    distortion: ArrayLike | None  # of a lens
    convention: AnyConvention  # origin of the principal point


class AnyCamera(Protocol):
    """Interface of a camera, perspective or parallel."""

    def view(self) -> View:
        """Pose and projection as arrays and numbers for kernels."""


@constructed()
@dataclass(frozen=True, eq=False)
class Camera:
    """Perspective camera with any intrinsics, a pose and a lens.

    Parameters
    ----------
    matrix
        (3, 3) intrinsics that map camera axes to px (x, y, 1), pixel centers at + 0.5: upper
        triangular with last entry 1; fx and fy may be negative, skew is allowed.
    world_to_camera
        (4, 4) or (3, 4) rigid pose. Rounding errors, as from text files, are corrected.
    distortion
        (4,), (5,), (8,), (12,) or (14,) OpenCV's k1, k2, p1, p2 [, k3 [, k4, k5, k6 [, s1, s2, s3,
        s4 [, τx, τy]]]]; None, or all 0: no distortion. For a fisheye k1, k2, k3, k4; None: all 0.
    near
        Depth of the near plane, scene units, 0 or more. Scenes are clipped in front of it; depth
        images are not.
    model
        Meaning of the coefficients: `pinhole` or `fisheye`.

    Raises
    ------
    ValueError
        The matrix is singular or not one of intrinsics, a number is not finite, the pose is not
        rigid (the message gives the deviation), the count of coefficients is wrong, or the model is
        unknown.

    Examples
    --------
    >>> from resample import Camera, look_at
    >>> camera = Camera.from_intrinsics(525, 525, 320, 240, look_at((0, -3, 1), (0, 0, 0)))
    >>> camera.fx, camera.cy
    (525.0, 240.0)
    >>> view = camera.view()
    >>> x, y, z = view.rotation @ [0, 0, 1] + view.translation  # 1 above the target
    >>> round(float(z), 3)  # how far ahead
    2.846
    """

    matrix: Doubles
    world_to_camera: Doubles = field(default_factory=lambda: np.eye(4))
    distortion: Doubles | None = None
    near: float = 0.0
    model: AnyLens = LensModel.PINHOLE

    def __post_init__(self) -> None:
        # Intrinsics as a checked matrix.
        matrix = np.array(self.matrix, np.float64)
        if matrix.shape != (3, 3):
            raise ValueError(f"intrinsics have shape (3, 3), not {matrix.shape}")
        if not np.isfinite(matrix).all():
            raise ValueError(f"intrinsics are finite numbers, not {matrix.tolist()}")
        if matrix[1, 0] or not np.array_equal(matrix[2], [0.0, 0.0, 1.0]):
            raise ValueError(
                f"intrinsics are [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], not {matrix.tolist()}"
            )
        if matrix[0, 0] == 0 or matrix[1, 1] == 0:
            raise ValueError(
                f"intrinsics with fx {matrix[0, 0]:g} and fy {matrix[1, 1]:g} are singular; "
                "neither can be 0"
            )
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "world_to_camera", rigid(self.world_to_camera))
        if self.model not in tuple(LensModel):
            raise ValueError(f"unknown lens model {self.model!r}; known: {', '.join(LensModel)}")
        # Coefficients of a lens; None if they have no effect.
        bends, is_fisheye = self.distortion, self.model == LensModel.FISHEYE
        given = np.zeros(COUNT) if bends is None else np.array(bends, np.float64).ravel()
        is_known = given.size in ((COUNT,) if is_fisheye else COUNTS) and np.isfinite(given).all()
        if not is_known:
            kind = f"fisheye lens has {COUNT}" if is_fisheye else f"lens has {COUNTS}"
            said = kind.replace("(", "").replace(")", "")
            raise ValueError(f"a {said} finite coefficients, not {given.tolist()}")
        object.__setattr__(self, "distortion", given if is_fisheye or given.any() else None)
        if not 0 <= self.near < math.inf:
            raise ValueError(f"the near plane at {self.near} must not lie behind the eye")

    @classmethod
    @takes(IntrinsicsOptions)
    def from_intrinsics(
        cls,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        world_to_camera: ArrayLike | None = None,
        near: float = 0.0,
        **options: Unpack[IntrinsicsOptions],
    ) -> "Camera":
        """Camera from focal lengths, principal point and skew, px.

        Parameters
        ----------
        fx, fy, cx, cy
            Entries of the matrix.
        world_to_camera, near
            As in the class.
        options
            `skew`, the matrix's remaining entry; `distortion`, as in the class; and `convention`,
            the origin of cx and cy.

        Raises
        ------
        ValueError
            As in the class; or the convention is unknown.
        """
        skew, distortion = options.get("skew", 0.0), options.get("distortion")
        convention = options.get("convention", Convention.CORNER)
        if convention not in tuple(Convention):
            raise ValueError(f"unknown convention {convention!r}; known: {', '.join(Convention)}")
        for name, given in {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "skew": skew}.items():
            number(name, given)
        offset = 0.5 if convention == Convention.OPENCV else 0.0
        matrix = np.array([[fx, skew, cx + offset], [0.0, fy, cy + offset], [0.0, 0.0, 1.0]])
        pose = np.eye(4) if world_to_camera is None else pose_of(world_to_camera)
        bends = None if distortion is None else np.asarray(distortion, np.float64)
        return cls(matrix, pose, bends, near)

    @classmethod
    def from_opencv(
        cls,
        matrix: ArrayLike,
        distortion: ArrayLike | None = None,
        *,
        model: AnyLens = LensModel.PINHOLE,
    ) -> "Camera":
        """Camera from the results of `cv2.calibrateCamera` or `cv2.fisheye.calibrate`.

        Parameters
        ----------
        matrix
            (3, 3), or the numbers fx, fy, cx, cy; px, with the first pixel's center at (0, 0).
        distortion, model
            As in the class.
        """
        given = doubles_of("intrinsics", matrix, "numbers (3, 3), or fx, fy, cx and cy").copy()
        if given.shape == (4,):
            fx, fy, cx, cy = given
            given = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        if given.shape == (3, 3):
            given[:2, 2] += 0.5
        bends = None if distortion is None else np.array(distortion)
        return cls(given, distortion=bends, model=model)

    @classmethod
    def from_fov(
        cls,
        fov: float,
        height: int,
        width: int,
        world_to_camera: ArrayLike | None = None,
        near: float = 0.0,
    ) -> "Camera":
        """Camera with square pixels and a field of view in degrees along the shorter side."""
        if not 0 < number("field of view", fov) < 180:
            raise ValueError(f"a field of view of {fov} degrees is not between 0 and 180")
        if not (number("height", height) > 0 and number("width", width) > 0):
            raise ValueError(f"a height of {height} and a width of {width} px; give both above 0")
        focal = min(height, width) / (2 * np.tan(np.radians(fov) / 2))
        return cls.from_intrinsics(focal, focal, width / 2, height / 2, world_to_camera, near)

    @property
    def fx(self) -> float:
        """Focal length along x, px."""
        return float(self.matrix[0, 0])

    @property
    def fy(self) -> float:
        """Focal length along y, px."""
        return float(self.matrix[1, 1])

    @property
    def cx(self) -> float:
        """X of the principal point, px."""
        return float(self.matrix[0, 2])

    @property
    def cy(self) -> float:
        """Y of the principal point, px."""
        return float(self.matrix[1, 2])

    def moved(self, world_to_camera: ArrayLike) -> "Camera":
        """Camera with another pose."""
        return replace(self, world_to_camera=pose_of(world_to_camera))

    def with_lens(self, distortion: ArrayLike, model: AnyLens = LensModel.PINHOLE) -> "Camera":
        """The same camera with a lens of these coefficients."""
        return replace(self, distortion=np.asarray(distortion, np.float64), model=model)

    def resized(self, old_shape: tuple[int, int], new_shape: tuple[int, int]) -> "Camera":
        """Camera of the same view for a frame of another (height, width), px."""
        (old_height, old_width), (height, width) = old_shape, new_shape
        if min(old_height, old_width, height, width) < 1:
            raise ValueError(f"a camera cannot be resized from {old_shape} to {new_shape} px")
        scale = np.diag([width / old_width, height / old_height, 1.0])
        return replace(self, matrix=scale @ self.matrix)

    def view(self) -> View:
        """Pose and projection as arrays and numbers for kernels.

        Raises
        ------
        ValueError
            The camera has a lens, skew or a negative focal length, which painters of scenes do
            not support.
        """
        if self.distortion is not None:
            raise ValueError(
                f"a lens ({', '.join(f'{k:g}' for k in self.distortion)}) distorts the view, which"
                " cannot be painted; give the camera without it and distort the picture by"
                " resample-texture warp --lens"
            )
        if self.matrix[0, 1] or self.fx < 0 or self.fy < 0:
            raise ValueError(
                f"scenes are painted with focal lengths above 0 and without skew, not with fx "
                f"{self.fx:g}, fy {self.fy:g} and skew {self.matrix[0, 1]:g}"
            )
        focal, principal = (self.fx, self.fy), (self.cx, self.cy)
        return _view(self.world_to_camera, focal, principal, self.near, perspective=True)


@dataclass(frozen=True, eq=False)
class Orthographic:
    """Parallel projection along the camera's axis.

    Parameters
    ----------
    sx, sy
        Scale, px per scene unit.
    cx, cy
        Where the camera's axis meets the frame, px.
    world_to_camera
        (4, 4) or (3, 4) rigid pose.
    near
        Depth of the near plane, scene units; may be negative.

    Raises
    ------
    ValueError
        A scale is not above 0, a number is not finite, or the pose is not rigid.

    Examples
    --------
    >>> from resample import Orthographic, Resampler, look_at, particles
    >>> camera = Orthographic(10, 10, 16, 12, look_at((0, -3, 0), (0, 0, 0)))  # px per unit
    >>> balls = particles([[0, 0, 0], [0, 50, 0]], (1, 1, 1), 0.5, 1)
    >>> frame = Resampler()(balls, camera, height=24, width=32)  # both in the middle, of one size
    >>> round(float(frame.first_depth[12, 16]), 3)
    3.0
    """

    sx: float
    sy: float
    cx: float
    cy: float
    world_to_camera: Doubles = field(default_factory=lambda: np.eye(4))
    near: float = 0.0

    def __post_init__(self) -> None:
        numbers = self.sx, self.sy, self.cx, self.cy, self.near
        if not np.isfinite(numbers).all():
            raise ValueError(f"a camera's numbers must be finite, not {numbers}")
        if self.sx <= 0 or self.sy <= 0:
            raise ValueError(f"a camera's scales must be above 0 px, not {self.sx}, {self.sy}")
        object.__setattr__(self, "world_to_camera", rigid(self.world_to_camera))

    def moved(self, world_to_camera: ArrayLike) -> "Orthographic":
        """Camera with another pose."""
        return replace(self, world_to_camera=pose_of(world_to_camera))

    def view(self) -> View:
        focal, principal = (self.sx, self.sy), (self.cx, self.cy)
        return _view(self.world_to_camera, focal, principal, self.near, perspective=False)


def _view(
    pose: Doubles,
    focal: tuple[float, float],
    principal: tuple[float, float],
    near: float,
    *,
    perspective: bool,
) -> View:
    """View of a camera; all numbers are float64, so that kernels are compiled once."""
    lens = np.array(focal, np.float64), np.array(principal, np.float64)
    return View(pose[:3, :3].copy(), pose[:3, 3].copy(), *lens, float(near), perspective)
