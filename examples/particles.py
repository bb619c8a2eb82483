"""Particles with radius and color: a spiral of 20,000 spheres, composited nearest first.

Radii range from 0.01 to 10 pixels. `python examples/particles.py picture.png`
"""

import sys
from pathlib import Path

import numpy as np

from resample import Camera, Resampler, particles
from resample.files.saving import write_png

HEIGHT, WIDTH = 150, 200  # px
CAMERA = Camera.from_intrinsics(200.0, 200.0, WIDTH / 2, HEIGHT / 2)
OLD, YOUNG = np.array([1.0, 0.45, 0.1]), np.array([0.15, 0.4, 1.0])  # linear light


def spiral(count=20_000):
    """Positions (N, 3), colors (N, 3), opacities (N,) and radii (N,) of two arms, scene units."""
    rng = np.random.default_rng(5)
    out = rng.uniform(0.2, 3, count)
    turn = 2.2 * np.log(out) + np.pi * rng.integers(0, 2, count) + rng.normal(0, 0.2, count)
    x, y, z = out * np.cos(turn), out * np.sin(turn), rng.normal(0, 0.1, count)
    tilt = 0.9  # rad
    y, z = y * np.cos(tilt) - z * np.sin(tilt), y * np.sin(tilt) + z * np.cos(tilt)
    radius = 3e-4 * 1000 ** rng.uniform(0, 1, count) ** 2
    color = OLD + (YOUNG - OLD) * np.clip(out / 3 + rng.normal(0, 0.15, count), 0, 1)[:, None]
    return np.stack([x, y, z + 7], axis=1), color, np.full(count, 0.9), radius


def visible(position, color, opacity, radius):
    """Render spheres."""
    samples = particles(position, color, opacity, radius)
    return Resampler()(samples, CAMERA, height=HEIGHT, width=WIDTH)


def main(path: Path) -> None:
    """Write the spiral over black."""
    write_png(path, visible(*spiral()).rgba, background=(0.0, 0.0, 0.0))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
