"""Draw an orientation cube of the scene's or a patient's axes."""

import numpy as np

from resample.types import Doubles, Floats
from resample_volume.space.text import letters

AXES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")
PATIENT = ("L", "R", "P", "A", "S", "I")  # directions of the LPS axes
FINE = 4  # sub-pixels per side of a pixel
TYPE = 96  # px, of letters before they are mapped to a face
RIM = 0.07  # dark border, of half a side
REACH = 1.75  # half sides, from the cube's center to its corners


def cube_picture(rotation: Doubles, side: int, names: tuple[str, ...] = AXES) -> Floats:
    """Draw a cube with a letter on each face (S, S, 4), premultiplied, linear.

    Parameters
    ----------
    rotation
        (3, 3) from scene to camera.
    side
        S, px.
    """
    place = ((np.arange(side * FINE) + 0.5) / (side * FINE) * 2 - 1) * REACH
    screen = np.stack(np.meshgrid(place, place), axis=-1)
    fine = np.zeros((side * FINE, side * FINE, 4))
    for face, name in enumerate(names):
        normal = (1 - 2 * (face % 2)) * np.eye(3)[face // 2]
        toward = -float(rotation[2] @ normal)
        if toward > 1e-3:
            _draw(fine, screen, rotation, normal, name)
    coarse = fine.reshape(side, FINE, side, FINE, 4).mean(axis=(1, 3))
    return np.asarray(coarse, np.float32)


def _draw(fine: Doubles, screen: Doubles, rotation: Doubles, normal: Doubles, name: str) -> None:
    """Draw a face, upright as seen from outside."""
    up = np.array([0.0, 1.0, 0.0] if normal[2] else [0.0, 0.0, 1.0])
    across = np.cross(up, normal)
    to_screen = np.stack([rotation @ across, rotation @ up], axis=1)[:2]
    middle = (rotation @ normal)[:2]
    local = (screen - middle) @ np.linalg.inv(to_screen).T  # -1..1 to the right and up
    inside = (np.abs(local) <= 1).all(axis=-1)
    bright = 0.15 + 0.55 * -float(rotation[2] @ normal)
    is_rim = np.abs(local).max(axis=-1) > 1 - RIM
    gray = np.where(is_rim, 0.02, bright * (1 - _ink(name, local)) + 0.01)
    fine[inside, :3] = gray[inside, None]
    fine[inside, 3] = 1.0


def _ink(name: str, local: Doubles) -> Doubles:
    """Return the coverage by ink at points on a face."""
    mask = letters(name, TYPE)
    height, width = mask.shape
    scale = max(width / 1.5, height / 1.1)  # px of letters per half side
    column = np.floor(local[..., 0] * scale + width / 2).astype(np.int64)
    row = np.floor(-local[..., 1] * scale + height / 2).astype(np.int64)
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    return np.asarray(
        np.where(inside, mask[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)], 0.0)
    )
