"""How finely training saw a scene of 3D Gaussians: by its cameras, or estimated."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.cameras.models import Orthographic
from resample.types import Doubles, Floats

if TYPE_CHECKING:
    from resample.cameras.trajectories import PosedPicture

OPAQUE = 0.8  # opacity of Gaussians that show the details of a scene, at least
SMALLEST = 0.01  # share of these that are smaller than what training resolved
RESOLVED = 0.062  # px, deviation of such a Gaussian in training: measured on scans of objects
MOST = 200.0  # px of training that the scene's radius spans, at most, where it is estimated
WIDEST = 1600  # px: trainers shrink pictures that are wider


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
        """Focal length, px, whose pixels are as large as in training, from where a camera is.

        It grows with the distance, beyond that of training. Where rays are parallel it is in px
        per scene unit.
        """
        if isinstance(camera, Orthographic):
            return self.focal / self.distance
        pose = np.asarray(camera.world_to_camera, np.float64)
        away = float(np.linalg.norm(pose[:3, :3] @ self.middle + pose[:3, 3]))
        return self.focal * max(1.0, away / self.distance)

    def is_guessed_for(self, camera: Any) -> bool:
        """Whether a camera's picture is coarser than those of training, which are estimated."""
        own = float(getattr(camera, "sx", getattr(camera, "fx", 0.0)))
        return self.is_estimated and own < self.focal_for(camera)


def training_of(
    position: Floats, scale: Floats, opacity: Floats, shots: "Sequence[PosedPicture]" = ()
) -> Training | None:
    """Return how training saw Gaussians; None if nothing can be said.

    Parameters
    ----------
    position, scale, opacity
        (N, 3), (N, 3) standard deviations and (N,), of all Gaussians; their order has no effect.
    shots
        Pictures of training. Without any, the size of a pixel is estimated: few opaque Gaussians
        that appear smaller than 0.062 px, seen along their shortest axis, survive training.
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
        abs(shot.camera.fx) * min(1.0, WIDEST / (shot.shape[1] if shot.shape else WIDEST))
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
    return Training(radius / max(pixel, radius / MOST), radius, middle, radius, is_estimated=True)
