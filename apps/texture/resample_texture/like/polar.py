"""`warpPolar`, `linearPolar` and `logPolar` as in `cv2`, without aliasing."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_texture.arguments import whole_pair
from resample_texture.like.opencv import WARP_FILL_OUTLIERS, WARP_INVERSE_MAP, remap
from resample_texture.types import Method

WARP_POLAR_LINEAR, WARP_POLAR_LOG = 0, 256
BORDER_CONSTANT, BORDER_TRANSPARENT = 0, 5
KERNELS = 7  # bits of flags that are `cv2.INTER_*`
BEYOND = 64  # rows around a polar picture that go on at its other end


def warpPolar(  # noqa: N802, PLR0913 - as cv2 has it
    src: NDArray[Any],
    dsize: tuple[int, int],
    center: tuple[float, float],
    maxRadius: float,  # noqa: N803
    flags: int,
    dst: NDArray[Any] | None = None,
    *,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.warpPolar` without aliasing: angles by rows, radii by columns, or back.

    Parameters
    ----------
    dsize
        Width and height of the result; if not above 0, as OpenCV chooses them.
    center
        x and y of the pole, pixel centers at integers.
    maxRadius
        Radius at the end of a row, px; the result's width is that many px, or its logarithm.
    flags
        `cv2.INTER_*`, with `cv2.WARP_POLAR_LOG`, `cv2.WARP_INVERSE_MAP` (a polar picture becomes
        one of x and y) and `cv2.WARP_FILL_OUTLIERS` (pixels without texels are black).

    Raises
    ------
    ValueError
        The radius is not above 0, of logarithms 1, or as `remap` does.
    """
    least = 1.0 if flags & WARP_POLAR_LOG else 0.0
    if not least < maxRadius < math.inf:
        raise ValueError(f"maxRadius is above {least:g} px, not {maxRadius}")
    image = src if isinstance(src, np.ma.MaskedArray) else np.asarray(src)
    is_log = bool(flags & WARP_POLAR_LOG)
    chosen: dict[str, Any] = {"linear_light": linear_light, "method": method}
    border = BORDER_CONSTANT if flags & WARP_FILL_OUTLIERS else BORDER_TRANSPARENT
    if flags & WARP_INVERSE_MAP:
        width, height = _size(dsize, image.shape[1], image.shape[0])
        y, x = np.mgrid[:height, :width] - np.array([center[1], center[0]])[:, None, None]
        angle = np.arctan2(y, x) % (2.0 * math.pi)
        row = angle * (image.shape[0] / (2.0 * math.pi))
        column = _column(np.hypot(x, y), image.shape[1], maxRadius, is_log)
        around = min(BEYOND, image.shape[0])
        image = image[np.arange(-around, image.shape[0] + around) % image.shape[0]]
        return remap(image, column, row + around, flags & KERNELS, dst, border, **chosen)
    across = round(maxRadius)
    width, height = _size(dsize, across, round(across * math.pi))
    radius = _radius(np.arange(width), width, maxRadius, is_log)
    angle = np.arange(height)[:, None] * (2.0 * math.pi / height)
    x, y = radius * np.cos(angle) + center[0], radius * np.sin(angle) + center[1]
    return remap(image, x, y, flags & KERNELS, dst, border, **chosen)


def linearPolar(  # noqa: N802 - as cv2 has it
    src: NDArray[Any],
    center: tuple[float, float],
    maxRadius: float,  # noqa: N803
    flags: int,
    dst: NDArray[Any] | None = None,
    **chosen: Any,
) -> NDArray[Any]:
    """`cv2.linearPolar`: `warpPolar` to the picture's own size."""
    height, width = np.shape(src)[:2]
    return warpPolar(
        src, (width, height), center, maxRadius, flags & ~WARP_POLAR_LOG, dst, **chosen
    )


def logPolar(  # noqa: N802 - as cv2 has it
    src: NDArray[Any],
    center: tuple[float, float],
    M: float,  # noqa: N803
    flags: int,
    dst: NDArray[Any] | None = None,
    **chosen: Any,
) -> NDArray[Any]:
    """`cv2.logPolar`: `warpPolar` by logarithms to the picture's own size; `M` px per unit."""
    height, width = np.shape(src)[:2]
    most = math.exp(width / M) if M > 0 else 0.0
    return warpPolar(src, (width, height), center, most, flags | WARP_POLAR_LOG, dst, **chosen)


def _size(dsize: tuple[int, int], width: int, height: int) -> tuple[int, int]:
    """Width and height of a result, of which those not above 0 are by default."""
    across, down = whole_pair(dsize, "width", "height")
    if across > 0 and down <= 0:
        return across, round(across * math.pi)
    return (width, height) if across <= 0 or down <= 0 else (across, down)


def _radius(column: Any, width: int, most: float, is_log: bool) -> Doubles:
    """Radius of columns."""
    if not is_log:
        return np.asarray(column * (most / width))
    return np.asarray(np.exp(column * (math.log(most) / width)) - 1.0)


def _column(radius: Doubles, width: int, most: float, is_log: bool) -> Doubles:
    """Column of radii."""
    if not is_log:
        return np.asarray(radius * (width / most))
    return np.asarray(np.log(radius + 1.0) * (width / math.log(most)))
