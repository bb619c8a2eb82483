"""Particles of a radius each: how much light a spiral of 20,000 spheres takes.

Radii are from a hundredth of a pixel to ten pixels. `python examples/particles.py picture.png`
draws the spiral dark before white.
"""

import sys
from pathlib import Path

import numpy as np

from resample import Camera, absorbed
from resample.files.images import write_png

HEIGHT, WIDTH = 150, 200  # px
CAMERA = Camera.from_intrinsics(200.0, 200.0, WIDTH / 2, HEIGHT / 2)


def spheres(count=20_000):
    """Places (N, 3), opacities (N,) and radii (N,) of a spiral of two arms, scene units."""
    rng = np.random.default_rng(5)
    out = rng.uniform(0.2, 3, count)
    turn = 2.2 * np.log(out) + np.pi * rng.integers(0, 2, count) + rng.normal(0, 0.2, count)
    x, y, z = out * np.cos(turn), out * np.sin(turn), rng.normal(0, 0.1, count)
    tilt = 0.9  # rad
    y, z = y * np.cos(tilt) - z * np.sin(tilt), y * np.sin(tilt) + z * np.cos(tilt)
    radius = np.exp(rng.uniform(np.log(3e-4), np.log(0.3), count))
    return np.stack([x, y, z + 7], axis=1), np.full(count, 0.1), radius


def disc(radius=0.25, opacity=0.8):
    """Light that a single sphere straight ahead takes."""
    return absorbed([[0, 0, 5]], opacity, radius, CAMERA, size=(HEIGHT, WIDTH))


def main(path: Path) -> None:
    """Write what light comes through."""
    left = 1 - absorbed(*spheres(), CAMERA, size=(HEIGHT, WIDTH))
    write_png(path, np.stack([left, left, left, np.ones_like(left)], axis=-1))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
