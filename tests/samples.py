"""Samples and fields that several tests paint, and cameras that see them."""

from functools import lru_cache

import numpy as np

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.resampler import Resampler
from resample.types import Lamp, Samples

SIDE = 16  # px of what `CAMERAS` see of clouds
EYE = (6.0, -5.0, 4.0)
POSE = look_at(EYE, (0, 0, 0))
CAMERAS = {
    "narrow": Camera.from_fov(40.0, height=SIDE, width=SIDE, world_to_camera=POSE),
    "inside": Camera.from_fov(
        90.0, height=SIDE, width=SIDE, world_to_camera=look_at((0.3, -0.2, 0.1), (3, 2, 1))
    ),
    "parallel": Orthographic(2.7, 3.1, 8.2, 7.9, POSE, near=-50.0),
}
DARK = Lamp(np.zeros(3), np.zeros(4), 1.0, 0.0, 0.0, 1.0, 0.0)  # shows colors as they are
LOW, HIGH = -1.0, 3.0  # values of a field's cloud


@lru_cache(maxsize=64)
def painter(**choices):
    """A resampler of these choices: all that want the same one share its tables."""
    return Resampler(**choices)


def cloud(rng, count=30, lattice=None, *, extinction=1.0):
    """Samples anywhere in a cube, of any color."""
    return Samples(
        rng.uniform(-2, 2, (count, 3)).astype(np.float32),
        rng.uniform(0, 1, (count, 3)).astype(np.float32),
        rng.uniform(0, extinction, count).astype(np.float32),
        np.eye(3) if lattice is None else lattice,
    )


def block(side=9, extinction=1.0):
    """A cube of samples on their lattice, all alike."""
    # Positions (N, 3) on a lattice of step 1 around the origin
    axis = np.arange(side) - (side - 1) / 2
    place = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3).astype(np.float32)
    extinction = np.full(len(place), extinction, np.float32)
    return Samples(place, np.ones_like(place), extinction, np.eye(3))


def reordered(given, order):
    """Those of the samples, or of a field's, that `order` says."""
    arrays = {"position", "color", "extinction", "scale", "value", "gradient"}
    found = {name: array for name, array in given._asdict().items() if name in arrays}
    return given._replace(**{name: a[order] for name, a in found.items() if a is not None})


def shuffled(given, rng):
    """Samples or a field in another order."""
    return reordered(given, rng.permutation(len(given.position)))
