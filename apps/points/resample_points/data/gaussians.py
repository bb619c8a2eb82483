"""The type of 3D Gaussians, checks, colors of directions, and cropping."""

import logging
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.calling import constructed
from resample.types import Doubles, Floats
from resample_points.data.cloud import FARTHEST
from resample_points.data.harmonics import CONSTANT, COUNTS, harmonics_along, parts_of
from resample_points.data.training import Training

LOG = logging.getLogger("resample")
SHAPES = {"position": (3,), "scale": (3,), "rotation": (4,), "opacity": (), "color": (3,)}
NO_HARMONICS = np.zeros((0, 0, 3), np.int16)


@constructed()
class Gaussians(NamedTuple):
    """N Gaussians of a trained scene, with activated values; at most 146 bytes each.

    A Gaussian's density is exp(-d² / 2), where d is the distance from its center in standard
    deviations. Its color along a unit direction from the eye is display-referred: 0.5 + 0.28209479
    `color` + Σ `harmonic_step` `harmonics` Y, see `colors_along`.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points.data.gaussians import Gaussians, checked_gaussians
    >>> one = Gaussians(
    ...     position=np.zeros((1, 3), np.float32),
    ...     scale=np.full((1, 3), 0.1, np.float32),
    ...     rotation=np.array([[1, 0, 0, 0]], np.float32),
    ...     opacity=np.array([0.9], np.float32),
    ...     color=np.zeros((1, 3), np.float32),
    ... )
    >>> len(checked_gaussians(one).position)
    1
    """

    position: Floats  # (N, 3) scene units
    scale: Floats  # (N, 3) standard deviations along the own axes, scene units, > 0
    rotation: Floats  # (N, 4) unit quaternions w, x, y, z: own axes to the scene's
    opacity: Floats  # (N,) at the center, 0 to 1
    color: Floats  # (N, 3) coefficients of the constant harmonic
    harmonics: NDArray[np.int16] = NO_HARMONICS  # (N, 0, 3, 8 or 15, 3); or (0, 0, 3) for any N
    harmonic_step: float = 1.0  # a coefficient is a whole number of `harmonics` times this
    is_antialiased: bool = False  # trained with opacities that make up for the dilation
    up: str | None = None  # axis such as "y" or "-z", where the file names it
    training: Training | None = None  # None: estimated when they are rendered


class Crop(NamedTuple):
    """What is shown of a scene, see `cropped_gaussians`."""

    box: ArrayLike | None = None
    least_opacity: float = 0.0
    largest: float | None = None


def checked_gaussians(gaussians: Gaussians, what: str = "the scene") -> Gaussians:
    """Return the Gaussians that can be drawn, in checked arrays, with unit quaternions.

    Those are left out, and their number is logged, whose position, scale, rotation or color is not
    finite, whose scale is not above 0, whose quaternion is 0, whose opacity is not in [0, 1], or
    that are farther away or larger than 1e15.

    Parameters
    ----------
    what
        Name of the scene for the log.

    Raises
    ------
    ValueError
        An array has another shape, or none can be drawn.
    """
    parts: dict[str, Any] = {name: _part(gaussians, name, shape) for name, shape in SHAPES.items()}
    harmonics = _harmonics(gaussians, len(parts["position"]))
    whole = gaussians._replace(**parts, harmonics=harmonics)
    known = are_drawable(whole)
    left_out = len(known) - np.count_nonzero(known)
    if left_out == len(known):
        raise ValueError("has no Gaussians that can be drawn")
    if left_out:
        LOG.warning(
            "%s: %d of %d Gaussians are left out: their numbers are not finite, their scale or "
            "quaternion is 0, or their opacity is not from 0 to 1",
            *(what, left_out, len(known)),
        )
        whole = some_gaussians(whole, known)
    return with_unit_rotations(whole)


def with_unit_rotations(gaussians: Gaussians) -> Gaussians:
    """Return Gaussians with quaternions of length 1."""
    norm = np.sqrt(np.einsum("nk,nk->n", gaussians.rotation, gaussians.rotation))
    return gaussians._replace(rotation=gaussians.rotation / norm[:, None])


def _part(gaussians: Gaussians, name: str, shape: tuple[int, ...]) -> Floats:
    """Return an array of Gaussians in float32, checking its shape."""
    array = np.asarray(getattr(gaussians, name))
    wanted = (len(np.atleast_1d(gaussians.position)), *shape)
    if array.dtype.kind not in "iuf" or array.shape != wanted:
        raise ValueError(f"{name} of Gaussians has the shape {array.shape}; it must be {wanted}")
    with np.errstate(over="ignore"):  # a number beyond float32 is left out
        return np.ascontiguousarray(array, np.float32)


def _harmonics(gaussians: Gaussians, count: int) -> NDArray[np.int16]:
    """Return checked coefficients (N, K, 3)."""
    array = np.asarray(gaussians.harmonics)
    if array.size == 0:
        return np.zeros((count, 0, 3), np.int16)
    is_known = array.ndim == 3 and array.shape[1] in COUNTS and array.shape[2] == 3
    if not is_known or len(array) != count or array.dtype != np.int16:
        raise ValueError(
            f"harmonics of Gaussians have the shape {array.shape} and type {array.dtype}; they "
            f"must be int16 ({count}, K, 3) with K = 0, 3, 8 or 15"
        )
    if not 0 < gaussians.harmonic_step < np.inf:
        raise ValueError(f"a harmonic step of {gaussians.harmonic_step}; it must be above 0")
    return array


def are_drawable(gaussians: Gaussians) -> NDArray[np.bool_]:
    """Tell which Gaussians (N,) have numbers that define a picture."""
    scale, opacity = gaussians.scale, gaussians.opacity
    known: NDArray[np.bool_] = (opacity >= 0) & (opacity <= 1)
    for axis in range(3):
        known &= np.abs(gaussians.position[:, axis]) <= FARTHEST
        known &= (scale[:, axis] > 0) & (scale[:, axis] <= FARTHEST)
        known &= np.isfinite(gaussians.color[:, axis])
    norm = np.abs(gaussians.rotation).max(axis=1, initial=0)
    known &= (norm > 1e-12) & (norm < 1e15)  # whose squares are finite and not 0
    return known


def some_gaussians(gaussians: Gaussians, which: NDArray[Any]) -> Gaussians:
    """Select Gaussians by mask or indices."""
    if which.dtype == np.bool_:
        which = np.flatnonzero(which)
    parts: dict[str, Any] = {
        name: np.take(getattr(gaussians, name), which, axis=0) for name in SHAPES
    }
    harmonics = gaussians.harmonics
    if harmonics.size:
        harmonics = np.take(harmonics, which, axis=0)
    else:
        harmonics = np.zeros((len(which), 0, 3), np.int16)
    return gaussians._replace(**parts, harmonics=harmonics)


def colors_along(gaussians: Gaussians, direction: ArrayLike) -> Doubles:
    """Return display-referred colors (N, 3) along unit directions (N, 3) or (3,) from the eye.

    They are at least 0, and may be above 1.
    """
    colors = 0.5 + CONSTANT * np.asarray(gaussians.color, np.float64)
    count = gaussians.harmonics.shape[1]
    if count:
        along = np.broadcast_to(np.asarray(direction, np.float64), colors.shape)
        for rows in parts_of(len(colors)):
            values = harmonics_along(along[rows], count) * gaussians.harmonic_step
            colors[rows] += np.einsum("nk,nkc->nc", values, gaussians.harmonics[rows])
    return np.maximum(colors, 0.0)


def cropped_gaussians(
    gaussians: Gaussians,
    *,
    box: ArrayLike | None = None,
    least_opacity: float = 0.0,
    largest: float | None = None,
) -> Gaussians:
    """Return the Gaussians within a box, opaque and small enough.

    Parameters
    ----------
    box
        (2, 3) lowest and highest corner for centers, scene units.
    least_opacity
        From 0 to 1.
    largest
        Largest standard deviation along any axis, scene units; leaves out large floaters.

    Raises
    ------
    ValueError
        A limit is invalid, or nothing is left.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points.data.gaussians import Gaussians, cropped_gaussians
    >>> parts = (np.ones((2, n), np.float32) for n in (3, 3, 4))
    >>> two = Gaussians(*parts, np.array([0.1, 0.9]), np.zeros((2, 3)))
    >>> cropped_gaussians(two, least_opacity=0.5).opacity.tolist()
    [0.9]
    """
    kept = kept_by(gaussians, Crop(box, least_opacity, largest))
    if not kept.any():
        raise ValueError(f"none of the {len(kept)} Gaussians is within the box, opacity and size")
    return gaussians if kept.all() else some_gaussians(gaussians, kept)


def kept_by(gaussians: Gaussians, crop: Crop) -> NDArray[np.bool_]:
    """Return which Gaussians (N,) `cropped_gaussians` keeps."""
    box, least_opacity, largest = crop
    if not 0 <= least_opacity <= 1:
        raise ValueError(f"a least opacity of {least_opacity:g}; give a number from 0 to 1")
    kept: NDArray[np.bool_] = gaussians.opacity >= least_opacity
    if box is not None:
        low, high = _corners(box)
        position = gaussians.position
        kept &= ((position >= low) & (position <= high)).all(axis=1)
    if largest is not None:
        if not largest > 0:
            raise ValueError(f"a largest size of {largest:g}; give scene units above 0")
        kept &= gaussians.scale.max(axis=1, initial=0) <= largest
    return kept


def _corners(box: ArrayLike) -> Doubles:
    corners = np.asarray(box, np.float64)
    if corners.shape != (2, 3) or not (corners[0] <= corners[1]).all():
        raise ValueError(
            f"a box of {corners.tolist()!r:.100}; give its lowest and highest corner, (2, 3)"
        )
    return corners
