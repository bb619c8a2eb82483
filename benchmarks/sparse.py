"""Sparse volume of any size: walls of bubbles, generated box by box."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from resample.outofcore.bricks import Box
from resample.types import Doubles
from resample_volume.data.values import Bricks

BUBBLES = 48
WALL, SOFT = 4.0, 1.2  # voxels, half thickness of a wall, and width of its transition
BRIGHTEST = 240.0


@dataclass(frozen=True)
class Bubbles:
    """Walls of bubbles of constant thickness: visible voxels grow with the square of the size."""

    size: int  # voxels along each side

    @cached_property
    def balls(self) -> Doubles:
        """Centers and radii (N, 4) along z, y and x, voxels."""
        rng = np.random.default_rng(20)
        center = rng.uniform(0.12, 0.88, (BUBBLES, 3))
        return self.size * np.column_stack([center, rng.uniform(0.04, 0.11, BUBBLES)])

    def __call__(self, box: Box) -> NDArray[np.uint8]:
        """Values of a box."""
        axes = [np.arange(part.start, part.stop, dtype=np.float64) for part in box]
        values = np.zeros([axis.size for axis in axes], np.float32)
        for *center, radius in self.balls:
            away = [axis - middle for axis, middle in zip(axes, center, strict=True)]
            if _is_near(away, radius):
                z, y, x = (part**2 for part in away)
                far = np.sqrt(z[:, np.newaxis, np.newaxis] + y[:, np.newaxis] + x)
                off = np.abs(far - radius).astype(np.float32)
                wall = np.where(off < WALL, BRIGHTEST * np.exp(-((off / SOFT) ** 2)), 0)
                np.maximum(values, wall, out=values)
        return values.astype(np.uint8)

    def bricks(self, side: int = 64) -> Bricks:
        """The volume as bricks that are generated on demand."""
        sizes = (self.size, self.size, self.size)
        return Bricks(self, sizes, np.dtype(np.uint8), (side, side, side))


def _is_near(away: list[Doubles], radius: float) -> bool:
    """Whether a wall meets a box, from distances to the center along each axis."""
    nearest = [max(part[0], -part[-1], 0.0) for part in away]
    farthest = [max(abs(part[0]), abs(part[-1])) for part in away]
    least, most = (float(np.linalg.norm(ends)) for ends in (nearest, farthest))
    return least < radius + WALL and most > radius - WALL
