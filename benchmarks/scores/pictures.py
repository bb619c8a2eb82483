"""Pictures and cameras to and from files, without the product."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from benchmarks.scores.judging import Bytes, Floats


class View(NamedTuple):
    """Pinhole camera with square pixels."""

    turn: Floats  # (3, 3) rows right, down and ahead, in the world
    eye: Floats
    focal: float  # px
    center: tuple[float, float]  # px; pixel centers are at halves

    def smaller(self, factor: float) -> "View":
        """The same camera with larger pixels, so that all is seen as from afar."""
        center = (self.center[0] / factor, self.center[1] / factor)
        return self._replace(focal=self.focal / factor, center=center)


def look_at(eye: ArrayLike, at: ArrayLike, up: ArrayLike) -> Floats:
    """Rows right, down and ahead of a camera at `eye` that looks at `at`."""
    ahead = np.asarray(at, np.float64) - np.asarray(eye)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, np.asarray(up, np.float64))
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def to_light(levels: ArrayLike) -> Floats:
    """Linear light of sRGB levels, 0..1."""
    v = np.asarray(levels, np.float64)
    return np.asarray(np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4))


def to_levels(light: ArrayLike) -> Floats:
    """Levels in sRGB of linear light, 0..1."""
    v = np.clip(np.asarray(light, np.float64), 0, 1)
    return np.asarray(np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055))


def eight_bits(levels: ArrayLike) -> Bytes:
    """Round levels in 0..1 to 0..255."""
    return np.asarray(np.rint(np.clip(levels, 0, 1) * 255), np.uint8)


def rounded(levels: Floats) -> Floats:
    """Levels as a file of 8 bits gives them."""
    return eight_bits(levels) / 255.0


def read_png(path: Path) -> tuple[Floats, Floats]:
    """Levels (H, W, 3) and alpha (H, W) of a picture, 0..1."""
    rgba = np.asarray(Image.open(path).convert("RGBA"), np.float64) / 255
    return rgba[..., :3], rgba[..., 3]


def shown(path: Path) -> Floats:
    """Levels (H, W, 3) of a picture as it is shown over black."""
    rgb, alpha = read_png(path)
    return rgb * alpha[..., None]


def write_png(path: Path, levels: Floats | Bytes | NDArray[np.float32]) -> None:
    """Write levels, of 8 bits or in 0..1."""
    Image.fromarray(levels if levels.dtype == np.uint8 else eight_bits(levels)).save(path)


def write_camera(path: Path, view: View, size: tuple[int, int]) -> None:
    """Write a camera as trainers of radiance fields do (transforms.json); size: width, height."""
    back = np.eye(4)
    back[:3, :3] = (np.diag([1, -1, -1]) @ view.turn).T
    back[:3, 3] = view.eye
    frame = {"file_path": "view.png", "transform_matrix": back.tolist()}
    facts = {
        **{"fl_x": view.focal, "fl_y": view.focal, "cx": view.center[0], "cy": view.center[1]},
        **{"w": size[0], "h": size[1], "frames": [frame]},
    }
    path.write_text(json.dumps(facts), encoding="utf-8")
