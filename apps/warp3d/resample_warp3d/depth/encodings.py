"""Encodings: meaning of a depth file's numbers.

An encoding converts numbers, as `resample_warp3d.depth.files.read_depth` returns them, to nearness:

    nearness = PlanarDepth(scale=1000).nearness(read_depth("frame.png"))

No encoding guesses: integers need a scale. Each defines which of its numbers are unknown, which
become the nearness 0.
"""

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera
from resample.cameras.pixels import directions, pixel_centers, undistorted_places
from resample.types import Doubles, Floats

Raw = NDArray[Any]  # (H, W) integers or floats, as stored in a file

FARTHEST, NEAREST = 1000.0, 0.001  # m, of the median; outside, the scale is doubtful
NEAR, FAR = 1.0, 10.0  # scene units to which relative depth is mapped by default
STRAY = 1e-3  # share of outliers of relative depth at each end of its range
OUT_OF_RANGE = 1e-3  # by which normalized values may exceed 1


class DepthEncoding(Protocol):
    """Role of an encoding of a file's numbers."""

    def nearness(self, raw: Raw) -> Floats:
        """Return the nearness (H, W) of a file's numbers; 0 where unknown."""

    def quantum(self, raw: Raw) -> float | None:
        """Return the smallest step of nearness in the numbers; None if it varies."""


@dataclass(frozen=True)
class PlanarDepth:
    """Distance along the optical axis, z; 0, negative numbers, inf and NaN are unknown.

    Raises ValueError: a number is not finite and above 0.
    """

    # Values per scene unit: 1000 for millimeters if scenes are in meters, 5000 for TUM and
    # ICL-NUIM. None means 1, for floats only.
    scale: float | None = None

    def __post_init__(self) -> None:
        _check_positive(scale=self.scale)

    def nearness(self, raw: Raw) -> Floats:
        return _where_known(raw, _reciprocal(_scaled(raw, self.scale)))

    def quantum(self, raw: Raw) -> None:  # noqa: ARG002 - the same for all numbers
        return None


@dataclass(frozen=True, eq=False)
class RayLength:
    """Distance from the camera, along the ray; 0, negative numbers, inf and NaN are unknown."""

    camera: Camera  # camera of the picture, with its lens
    scale: float | None = None  # as for `PlanarDepth`

    def __post_init__(self) -> None:
        _check_positive(scale=self.scale)

    def nearness(self, raw: Raw) -> Floats:
        place = pixel_centers(raw.shape)
        if self.camera.distortion is not None:
            place = undistorted_places(self.camera, place)
        x, y = np.moveaxis(directions(self.camera, place), 2, 0)
        length = np.sqrt(1.0 + x * x + y * y)
        return _where_known(raw, length * _reciprocal(_scaled(raw, self.scale)))

    def quantum(self, raw: Raw) -> None:  # noqa: ARG002 - the same for all numbers
        return None


@dataclass(frozen=True)
class InverseDepth:
    """1 / z; 0, negative numbers, inf and NaN are unknown.

    With `near` and `far`, v = value / scale is 0 at far and 1 at near, as in MPEG's depth maps:
    1 / z = v (1 / near − 1 / far) + 1 / far. Then 0 is known, unless far is inf.

    Raises ValueError: a number is not above 0, near is not below far, or one of them is missing.
    """

    # Values per unit of 1 / z, or of v (255 for 8 bits). None means 1, for floats only.
    scale: float | None = None
    # Z at v = 1 and v = 0, scene units; far may be inf. Both or neither.
    near: float | None = None
    far: float | None = None

    def __post_init__(self) -> None:
        _check_positive(scale=self.scale, near=self.near)
        if (self.near is None) != (self.far is None):
            raise ValueError("inverse depth between two distances needs near and far, not just one")
        if self.near is not None and self.far is not None and not self.near < self.far:
            raise ValueError(f"near {self.near:g} is not below far {self.far:g}")

    def nearness(self, raw: Raw) -> Floats:
        value = _scaled(raw, self.scale)
        if self.near is None or self.far is None:
            return _where_known(raw, value)
        finite = value[np.isfinite(value)]
        if finite.size and finite.max() > 1.0 + OUT_OF_RANGE:
            raise ValueError(
                f"inverse depth between near and far goes up to {finite.max():g} instead of 1; give"
                " its scale (255 for 8 bits, 65535 for 16)"
            )
        span = 1.0 / self.near - 1.0 / self.far
        with np.errstate(invalid="ignore"):
            nearness = np.clip(value, 0.0, 1.0) * span + 1.0 / self.far
        return _where(np.isfinite(raw) & (raw >= 0), nearness)

    def quantum(self, raw: Raw) -> float | None:
        span = 1.0 if self.near is None or self.far is None else 1.0 / self.near - 1.0 / self.far
        return _step(raw, self.scale, span)


@dataclass(frozen=True)
class Disparity:
    """Disparity of a calibrated pair, px; 0, negative numbers, inf and NaN are unknown.

    1 / z = (value / scale + doffs) / (focal × baseline).

    Raises ValueError: a number is not finite, or focal, baseline or scale not above 0.
    """

    focal: float  # focal length of the rectified pair, px
    baseline: float  # distance between its cameras, scene units
    # Values per px: 16 for OpenCV's matchers, 256 for KITTI. None means 1, for floats only.
    scale: float | None = None
    doffs: float = 0.0  # difference of the principal points, px, right minus left (Middlebury)

    def __post_init__(self) -> None:
        _check_positive(scale=self.scale, focal=self.focal, baseline=self.baseline)
        if not math.isfinite(self.doffs):
            raise ValueError(f"doffs {self.doffs} is not finite")

    def nearness(self, raw: Raw) -> Floats:
        disparity = _scaled(raw, self.scale) + self.doffs
        return _where_known(raw, disparity / (self.focal * self.baseline))

    def quantum(self, raw: Raw) -> float | None:
        return _step(raw, self.scale, 1.0 / (self.focal * self.baseline))


@dataclass(frozen=True)
class BareDisparity:
    """Disparity of a rectified pair without calibration, px, used as nearness.

    0, negative numbers, inf and NaN are unknown.
    """

    # As for `Disparity`: 4 for Middlebury 2003, 2 for its half-size pairs of 2006.
    scale: float | None = None

    def __post_init__(self) -> None:
        _check_positive(scale=self.scale)

    def nearness(self, raw: Raw) -> Floats:
        return _where_known(raw, _scaled(raw, self.scale))

    def quantum(self, raw: Raw) -> float | None:
        return _step(raw, self.scale, 1.0)


@dataclass(frozen=True)
class RelativeDepth:
    """Relative depth with unknown scale and shift, as networks predict it.

    Their range, without a thousandth of them at each end, is mapped to far .. near. NaN and inf are
    unknown, 0 is not.

    Raises ValueError: a number is not above 0, near is not below far, or far is inf with
    `is_distance`.
    """

    # Z of the nearest and of the farthest point, scene units.
    near: float = NEAR
    far: float = FAR
    # True: larger numbers are farther, and linear in z (Marigold). False: larger numbers are
    # nearer, and linear in 1 / z (MiDaS, Depth Anything).
    is_distance: bool = False
    # Ends of the numbers' range, for films; None: the map's own.
    ends: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        _check_positive(near=self.near)
        if not self.near < self.far:
            raise ValueError(f"near {self.near:g} is not below far {self.far:g}")
        if self.is_distance and math.isinf(self.far):
            raise ValueError("distances up to an unknown scale need a finite far")

    def nearness(self, raw: Raw) -> Floats:
        is_known = np.isfinite(raw)
        low, high = self._range(raw)
        share = np.maximum((raw.astype(np.float64) - low) / (high - low), 0.0)  # where known
        if self.is_distance:
            return _where(is_known, 1.0 / (self.near + share * (self.far - self.near)))
        return _where(is_known, share * (1.0 / self.near - 1.0 / self.far) + 1.0 / self.far)

    def quantum(self, raw: Raw) -> float | None:
        if self.is_distance or raw.dtype.kind == "f":
            return None
        low, high = self._range(raw)
        return _step(raw, high - low, 1.0 / self.near - 1.0 / self.far)

    def _range(self, raw: Raw) -> tuple[float, float]:
        return self.ends_of(raw) if self.ends is None else self.ends

    @staticmethod
    def ends_of(raw: Raw) -> tuple[float, float]:
        """Return the ends of a map's range, without outliers."""
        known = raw[np.isfinite(raw)].astype(np.float64)
        if not known.size or known.min() == known.max():
            raise ValueError("relative depth is the same everywhere: it has no information")
        low = float(np.quantile(known, STRAY, method="lower"))
        high = float(np.quantile(known, 1.0 - STRAY, method="higher"))
        return (low, high) if low < high else (float(known.min()), float(known.max()))


def check_scale(nearness: Floats) -> str | None:
    """Return a warning if the median depth is over 1 km or under 1 mm in meters, else None."""
    known = nearness[nearness > 0]
    if not known.size:
        return None
    middle = 1.0 / float(np.median(known))
    if NEAREST <= middle <= FARTHEST:
        return None
    return (
        f"half of the picture is beyond {middle:.3g} m, if its unit is m; check the depth's scale"
    )


def _check_positive(**numbers: float | None) -> None:
    for name, number in numbers.items():
        if number is not None and not (math.isfinite(number) and number > 0):
            raise ValueError(f"{name} {number} is not finite and above 0")


def _scaled(raw: Raw, scale: float | None) -> Doubles:
    """Convert numbers to the encoding's unit."""
    if scale is None and raw.dtype.kind != "f":
        raise ValueError(
            f"depth in whole numbers ({raw.dtype}) needs its scale: the value of 1 unit, such as"
            " 1000 for mm, 5000 for TUM, 4 for quarters of a pixel, 255 for 8 bits of 0..1"
        )
    return raw.astype(np.float64) / (1.0 if scale is None else scale)


def _reciprocal(value: Doubles) -> Doubles:
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1.0 / value


def _where_known(raw: Raw, nearness: Doubles) -> Floats:
    return _where(np.isfinite(raw) & (raw > 0), nearness)


def _where(is_known: NDArray[np.bool_], nearness: Doubles) -> Floats:
    """Return nearness in float32, 0 where it is unknown or out of range."""
    with np.errstate(over="ignore", invalid="ignore"):
        single = nearness.astype(np.float32)
    return np.where(is_known & np.isfinite(single) & (single > 0), single, np.float32(0))


def _step(raw: Raw, scale: float | None, unit: float) -> float | None:
    """Return the step of nearness between integer levels; None for floats.

    Levels may be multiples of a step, as in 8-bit maps stretched to 16 bits.
    """
    if raw.dtype.kind == "f" or scale is None or not (raw > 0).any():
        return None
    levels = raw[raw > 0].astype(np.int64)
    apart = int(np.gcd.reduce(levels - levels[0]))
    return max(1, apart) * unit / scale
