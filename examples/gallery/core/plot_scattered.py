"""
Scattered measurements to a grid
================================

Readings at arbitrary positions become a grid: each pixel is the mean of the readings that cover it,
and the coverage is the fraction of it that was measured. Areas are preserved exactly.

The same as a program:

.. code-block:: console

    $ python examples/scattered.py scattered.png
"""

import numpy as np

from resample import Scatter
from resample_texture import warp

rng = np.random.default_rng(4)
place = rng.uniform([0, 0], [180, 120], (20_000, 2)) + rng.normal(0, 2, (20_000, 2))
x, y = place.T
reading = 0.5 + 0.5 * np.sin(x / 9) * np.cos(y / 13 + x / 40)
color = np.outer(reading, [1.0, 0.5, 0.1]) + np.outer(1 - reading, [0.02, 0.1, 0.4])
kept = np.hypot(x - 120, y - 60) > 22  # no measurements there

value, coverage = Scatter()(place[kept], color[kept], radius=0.8, shape=(120, 180))
for name, part in (("value", np.nan_to_num(value)), ("coverage", np.clip(coverage / 3, 0, 1))):
    warp(part.astype(np.float32), np.eye(3), (120, 180)).save(f"{name}.png")
