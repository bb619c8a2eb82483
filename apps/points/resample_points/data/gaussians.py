"""3D Gaussians: their type, checks and colors, their training; crop, move and join them."""

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.calling import constructed
from resample.cameras.models import Orthographic
from resample.types import Doubles, Floats
from resample_points.data.cloud import FARTHEST
from resample_points.data.harmonics import (
    CONSTANT,
    COUNTS,
    WIDEST,
    harmonics_along,
    parts_of,
    rounded_to,
    step_of,
    turned_harmonics,
)

if TYPE_CHECKING:
    from resample.cameras.trajectories import PosedPicture

OPAQUE = 0.8  # opacity of Gaussians that show the details of a scene, at least
SMALLEST = 0.01  # share of these that are smaller than what training resolved
RESOLVED = 0.062  # px, deviation of such a Gaussian in training: measured on scans of objects
MOST_PIXELS = 200.0  # px of training that the scene's radius spans, at most, where it is estimated
WIDEST_PICTURE = 1600  # px: trainers shrink pictures that are wider


class Training(NamedTuple):
    """The pictures that a scene was trained with.

    A pixel of these is as large as `distance / focal` around the middle of the scene.
    """

    focal: float  # px
    distance: float  # scene units, from the middle to the farthest of their eyes
    middle: Doubles  # (3,) of the scene
    radius: float  # scene units: half of the scene lies within it
    is_estimated: bool

    def focal_for(self, camera: Any) -> float:
        """Focal length, px, that gives pixels as large as in training, seen from a camera.

        It grows with the distance, beyond the training's. Where rays are parallel it is in px
        per scene unit.
        """
        if isinstance(camera, Orthographic):
            return self.focal / self.distance
        pose = np.asarray(camera.world_to_camera, np.float64)
        away = float(np.linalg.norm(pose[:3, :3] @ self.middle + pose[:3, 3]))
        return self.focal * max(1.0, away / self.distance)

    def is_guessed_for(self, camera: Any) -> bool:
        """Whether a camera's picture is coarser than training's, which is estimated."""
        own = float(getattr(camera, "sx", getattr(camera, "fx", 0.0)))
        return self.is_estimated and own < self.focal_for(camera)


def training_of(
    position: Floats, scale: Floats, opacity: Floats, shots: "Sequence[PosedPicture]" = ()
) -> Training | None:
    """Return the training's view of Gaussians; None if unknown. Their order has no effect.

    `shots`: pictures of training. Without any, the size of a pixel is estimated: few opaque
    Gaussians that appear smaller than 0.062 px, seen along their shortest axis, survive training.
    """
    if not len(opacity):
        return None
    opaque = opacity >= OPAQUE
    if not opaque.any():
        opaque = opacity >= opacity.max()
    middle = np.median(position[opaque].astype(np.float64), axis=0)
    radius = float(np.median(np.linalg.norm(position[opaque] - middle, axis=1)))
    radius += float(np.median(scale[opaque].max(axis=1)))
    focals = [
        abs(shot.camera.fx)
        * min(1.0, WIDEST_PICTURE / (shot.shape[1] if shot.shape else WIDEST_PICTURE))
        for shot in shots
        if shot.camera is not None
    ]
    if focals:
        eyes = np.stack([-shot.pose[:3, :3].T @ shot.pose[:3, 3] for shot in shots])
        away = float(np.linalg.norm(eyes - middle, axis=1).max())
        known = float(np.median(focals))
        return Training(known, max(away, radius), middle, radius, is_estimated=False)
    a, b, c = scale[opaque].T
    between = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
    pixel = float(np.quantile(between, SMALLEST)) / RESOLVED
    return Training(
        radius / max(pixel, radius / MOST_PIXELS), radius, middle, radius, is_estimated=True
    )


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
    """Visible part of a scene, see `cropped_gaussians`."""

    box: ArrayLike | None = None
    least_opacity: float = 0.0
    largest: float | None = None


def checked_gaussians(gaussians: Gaussians, what: str = "the scene") -> Gaussians:
    """Return the Gaussians that can be drawn, in checked arrays, with unit quaternions.

    Gaussians are left out, and their number is logged, if their position, scale, rotation or color
    is not finite, their scale is not above 0, their quaternion is 0, their opacity is not in
    [0, 1], or they are farther away or larger than 1e15. `what`: name of the scene for the log.
    Raises ValueError if an array has another shape, or none can be drawn.
    """
    parts: dict[str, Any] = {}
    count = len(np.atleast_1d(gaussians.position))
    for name, shape in SHAPES.items():
        array = np.asarray(getattr(gaussians, name))
        if array.dtype.kind not in "iuf" or array.shape != (count, *shape):
            wanted = (count, *shape)
            raise ValueError(
                f"{name} of Gaussians has the shape {array.shape}; it must be {wanted}"
            )
        with np.errstate(over="ignore"):  # a number beyond float32 is left out
            parts[name] = np.ascontiguousarray(array, np.float32)
    array = np.asarray(gaussians.harmonics)
    is_known = array.ndim == 3 and array.shape[1] in COUNTS and array.shape[2] == 3
    if array.size == 0:
        array = np.zeros((count, 0, 3), np.int16)
    elif not is_known or len(array) != count or array.dtype != np.int16:
        raise ValueError(
            f"harmonics of Gaussians have the shape {array.shape} and type {array.dtype}; they "
            f"must be int16 ({count}, K, 3) with K = 0, 3, 8 or 15"
        )
    elif not 0 < gaussians.harmonic_step < np.inf:
        raise ValueError(f"a harmonic step of {gaussians.harmonic_step}; it must be above 0")
    whole = gaussians._replace(**parts, harmonics=array)
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


def are_drawable(gaussians: Gaussians) -> NDArray[np.bool_]:
    """Tell which Gaussians (N,) have numbers that define a picture."""
    scale, opacity = gaussians.scale, gaussians.opacity
    known: NDArray[np.bool_] = (opacity >= 0) & (opacity <= 1)
    for axis in range(3):
        known &= np.abs(gaussians.position[:, axis]) <= FARTHEST
        known &= (scale[:, axis] > 0) & (scale[:, axis] <= FARTHEST)
        known &= np.isfinite(gaussians.color[:, axis])
    norm = np.abs(gaussians.rotation).max(axis=1, initial=0)
    known &= (norm > 1e-12) & (norm < 1e15)  # with squares that are finite and not 0
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
        corners = np.asarray(box, np.float64)
        if corners.shape != (2, 3) or not (corners[0] <= corners[1]).all():
            raise ValueError(
                f"a box of {corners.tolist()!r:.100}; give its lowest and highest corner, (2, 3)"
            )
        low, high = corners
        kept &= ((gaussians.position >= low) & (gaussians.position <= high)).all(axis=1)
    if largest is not None:
        if not largest > 0:
            raise ValueError(f"a largest size of {largest:g}; give scene units above 0")
        kept &= gaussians.scale.max(axis=1, initial=0) <= largest
    return kept


AXES_UP = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
DOWN = "-y"  # the axis up in scenes that do not state it, as in photographs
SIMILAR = 1e-4  # relative error of a pose's axes, as float32 and text have


def placed_gaussians(gaussians: Gaussians, pose: ArrayLike) -> Gaussians:
    """Return Gaussians moved by a pose: a rotation, one scale of all axes and a shift.

    Parameters
    ----------
    pose
        (3, 4) or (4, 4), old to new positions.

    Returns
    -------
    Positions, scales, rotations and harmonics are turned with the pose. `up` is kept if the pose
    does not turn.

    Raises
    ------
    ValueError
        The pose is invalid, or it mirrors or shears.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points.data.gaussians import Gaussians
    >>> from resample_points.data.gaussians import placed_gaussians
    >>> parts = (np.ones((1, n), np.float32) for n in (3, 3, 4))
    >>> one = Gaussians(*parts, np.ones(1), np.zeros((1, 3)))
    >>> double = np.diag([2.0, 2.0, 2.0, 1.0])
    >>> placed_gaussians(one, double).scale.tolist()
    [[2.0, 2.0, 2.0]]
    """
    turn, size, shift = _similarity(pose)
    position = (size * np.asarray(gaussians.position, np.float64)) @ turn.T + shift
    moved = gaussians._replace(
        position=position.astype(np.float32),
        scale=(size * np.asarray(gaussians.scale, np.float64)).astype(np.float32),
        training=None,
    )
    if np.array_equal(turn, np.eye(3)):
        return moved
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    product = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    rotation = (np.asarray(gaussians.rotation, np.float64) @ product.T).astype(np.float32)
    moved = moved._replace(rotation=rotation, up=None)
    harmonics, largest = gaussians.harmonics, 0.0
    if not (count := harmonics.shape[1]):
        return moved
    matrix = turned_harmonics(turn, count).astype(np.float32)

    def mixed(rows: slice) -> Floats:
        return np.asarray(np.matmul(matrix, harmonics[rows].astype(np.float32)), np.float32)

    for rows in parts_of(len(harmonics)):
        largest = max(largest, float(np.abs(mixed(rows)).max(initial=0.0)))
    ratio = max(1.0, largest / WIDEST)  # a coarser step only where the numbers grow
    turned = np.empty_like(harmonics)
    for rows in parts_of(len(harmonics)):
        turned[rows] = rounded_to(mixed(rows), ratio)
    return moved._replace(harmonics=turned, harmonic_step=gaussians.harmonic_step * ratio)


def with_up(gaussians: Gaussians, up: str) -> Gaussians:
    """Return a scene rotated so that another axis is up; by default y is down."""
    have, wanted = (
        np.array(AXES_UP[name[-1]]) * (-1 if name[0] == "-" else 1)
        for name in (gaussians.up or DOWN, up)
    )
    if (have == wanted).all():
        return gaussians
    axis = np.cross(have, wanted)
    if not axis.any():  # half a turn
        axis = np.array(AXES_UP["y" if have[0] else "x"])
        turn = 2 * np.outer(axis, axis) - np.eye(3)
    else:  # a quarter
        across = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turn = np.outer(axis, axis) + across
    pose = np.column_stack([turn, np.zeros(3)])
    return placed_gaussians(gaussians, pose)._replace(up=up)


def _similarity(pose: ArrayLike) -> tuple[Doubles, float, Doubles]:
    """Return rotation (3, 3), scale and shift (3,) of a pose."""
    matrix = np.asarray(pose, np.float64)
    is_affine = matrix.shape in {(3, 4), (4, 4)} and np.isfinite(matrix).all()
    if not is_affine or (len(matrix) == 4 and not np.allclose(matrix[3], (0, 0, 0, 1))):
        raise ValueError(
            f"a pose of shape {matrix.shape}; give finite numbers (3, 4), or (4, 4) with the last "
            "row 0 0 0 1"
        )
    linear = matrix[:3, :3]
    volume = float(np.linalg.det(linear))
    size = volume ** (1 / 3) if volume > 0 else 0.0
    if size == 0 or np.abs(linear.T @ linear - size * size * np.eye(3)).max() > SIMILAR * size**2:
        raise ValueError(
            "a pose that mirrors or shears; give a rotation times one positive scale, and a shift"
        )
    left, _, right = np.linalg.svd(linear)  # the closest rotation
    turn = linear / size if np.array_equal(linear, size * np.eye(3)) else left @ right
    return turn, size, matrix[:3, 3]


def joined_gaussians(
    parts: Sequence[Gaussians], poses: Sequence[ArrayLike | None] | None = None
) -> Gaussians:
    """Join several scenes, each moved by a pose if there are poses.

    Harmonics that a scene lacks are 0. The scene is antialiased if all parts are; where some are
    and others are not, that is logged. `up` is kept if all agree.

    Raises
    ------
    ValueError
        There are no parts, a pose is invalid, or the numbers of both differ.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points.data.gaussians import Gaussians
    >>> from resample_points.data.gaussians import joined_gaussians
    >>> parts = (np.ones((1, n), np.float32) for n in (3, 3, 4))
    >>> one = Gaussians(*parts, np.ones(1), np.zeros((1, 3)))
    >>> aside = np.array([[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0.0]])
    >>> joined_gaussians([one, one], [None, aside]).position.tolist()
    [[1.0, 1.0, 1.0], [6.0, 1.0, 1.0]]
    """
    if not parts or (poses is not None and len(poses) != len(parts)):
        given = "no poses" if poses is None else f"{len(poses)} poses"
        raise ValueError(f"{len(parts)} scenes and {given}; give one or more, and a pose for each")
    pairs = zip(parts, poses or [None] * len(parts), strict=True)
    moved = [part if pose is None else placed_gaussians(part, pose) for part, pose in pairs]
    if len(moved) == 1:
        return moved[0]
    modes = {part.is_antialiased for part in moved}
    if len(modes) > 1:
        LOG.warning(
            "some of the joined scenes were trained antialiased and others were not; all are "
            "treated as if they were not"
        )
    ups = {part.up for part in moved}
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in moved]) for name in SHAPES
    }
    # Join harmonics of several degrees and steps.
    width = max(part.harmonics.shape[1] for part in moved)
    harmonics = np.zeros((len(arrays["position"]), width, 3), np.int16)
    known_steps = {part.harmonic_step for part in moved if part.harmonics.size}
    sizes = [
        max(-int(part.harmonics.min()), int(part.harmonics.max())) * part.harmonic_step
        for part in moved
        if part.harmonics.size
    ]
    step = known_steps.pop() if len(known_steps) == 1 else step_of(max(sizes, default=0.0))
    first = 0
    for part in moved:
        count = part.harmonics.shape[1]
        for rows in parts_of(len(part.position) if count else 0):
            some = part.harmonics[rows]
            if part.harmonic_step != step:
                some = rounded_to(some.astype(np.float32) * np.float32(part.harmonic_step), step)
            harmonics[first + rows.start : first + rows.stop, :count] = some
        first += len(part.position)
    up = ups.pop() if len(ups) == 1 else None
    seen = [part.training for part in moved if part.training is not None]
    known = next((training for training in seen if not training.is_estimated), None)
    return Gaussians(**arrays, harmonics=harmonics, harmonic_step=step)._replace(
        is_antialiased=modes == {True}, up=up, training=known
    )
