"""
Particles from a hundredth of a pixel to ten
============================================

Spheres of any radius, color and opacity, composited nearest first. Those too small for a ray per
sub-pixel are painted as points, which absorb the same total light.

The same as a program:

.. code-block:: console

    $ python examples/particles.py particles.png
"""

import numpy as np

from resample import Camera, Resampler, particles

rng = np.random.default_rng(5)
out = rng.uniform(0.2, 3, 20_000)
turn = 2.2 * np.log(out) + np.pi * rng.integers(0, 2, out.size) + rng.normal(0, 0.2, out.size)
x, y, z = out * np.cos(turn), out * np.sin(turn), rng.normal(0, 0.08, out.size)
place = np.stack([x, 0.55 * y - 0.83 * z, 9.5 + 0.83 * y + 0.55 * z], axis=1)
warm = np.clip(out / 3 + rng.normal(0, 0.15, out.size), 0, 1)[:, None]
color = warm * [0.15, 0.4, 1.0] + (1 - warm) * [1.0, 0.45, 0.1]
radius = 3e-4 * 1000 ** rng.uniform(0, 1, out.size) ** 2

camera = Camera.from_fov(40, 300, 480)
frame = Resampler()(particles(place, color, 0.9, radius), camera, height=300, width=480)
frame.save("a-spiral.png", background=(0, 0, 0))
