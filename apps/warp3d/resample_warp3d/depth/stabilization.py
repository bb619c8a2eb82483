"""Keep the depth of unchanged pixels from picture to picture of a film.

Coarse and noisy maps differ a little from picture to picture. Where colors stay, small differences
of depth are noise, and the previous depth is kept; larger ones are followed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats

Mask = NDArray[np.bool_]

SAME = 6.0 / 255.0  # change of the root of light up to which a color is the same, without noise
NOISIEST = 16.0 / 255.0  # the same, at most
OF_COLOR = 3.0  # times the median change of smooth parts, which is noise
TEXTURED = 0.9  # quantile of the local contrast above which pixels show whether the camera moves
LEAST, MOST = 0.0025, 0.15  # difference that is noise, as a share of the depth's extent
COMMON = 0.05  # the same, at most, where all pixels differ alike
OF_DEPTH = 9.0  # times the median deviation of unchanged pixels
STANDING = 0.7  # share of unchanged textured pixels; with fewer the camera moves
SPARSE = 7  # pixels from one to the next that medians are taken of


@dataclass
class SteadyDepth:
    """Depth of a shot's pictures; unchanged pixels keep their depth."""

    extent: float
    _color: Floats | None = None  # roots of light of the pictures that the nearness is from
    _nearness: Floats | None = None

    def added(self, color: Floats, nearness: Floats) -> Floats:
        """Return the steady nearness of the next picture."""
        root = np.sqrt(np.maximum(color, np.float32(0)), dtype=np.float32)
        if self._color is None or self._nearness is None:
            self._color, self._nearness = root, nearness
            return nearness
        share = self._followed(unchanged(root, self._color), nearness, self._nearness)
        kept = self._nearness + share * (nearness - self._nearness)
        self._nearness = np.where(share < 1.0, kept, nearness).astype(np.float32)
        np.copyto(self._color, root, where=share[..., None] > 0.0)
        return self._nearness

    def _followed(self, same: Mask, nearness: Floats, held: Floats) -> Floats:
        """Return the share of each change of depth that is followed."""
        import cv2

        few = (nearness - held)[::SPARSE, ::SPARSE][same[::SPARSE, ::SPARSE]] / self.extent
        middle = np.median(few) if few.size else 0.0
        spread = np.median(np.abs(few - middle)) if few.size else 0.0
        common = min(OF_DEPTH * abs(middle), COMMON)
        noise = float(np.clip(OF_DEPTH * spread, max(LEAST, common), MOST))
        change = cv2.absdiff(nearness, held) / np.float32(self.extent)
        share = np.clip(change / np.float32(noise) - np.float32(1.0), 0.0, 1.0)
        share[~same | (held <= 0)] = 1.0
        share[same & (held > 0) & (nearness <= 0)] = 0.0  # gaps that come and go
        return np.asarray(share, np.float32)


def unchanged(root: Floats, last: Floats) -> Mask:
    """Return the pixels (H, W) with the same colors in two pictures, up to noise.

    None are if the camera moves: if most textured pixels change.

    `root`, `last`: (H, W, C) roots of light.
    """
    import cv2

    change = np.maximum.reduce(np.moveaxis(cv2.absdiff(root, last).reshape(root.shape), 2, 0))
    gray = np.ascontiguousarray(root[..., root.shape[2] // 2])
    contrast = cv2.absdiff(gray, cv2.blur(gray, (3, 3)))
    few, their = contrast[::SPARSE, ::SPARSE], change[::SPARSE, ::SPARSE]
    noise = float(np.median(their[few <= np.median(few)]))
    same = change <= float(np.clip(OF_COLOR * noise, SAME, NOISIEST))
    is_textured = contrast >= np.quantile(few, TEXTURED)
    return same if same[is_textured].mean() >= STANDING else np.zeros_like(same)
