"""
Any function is a map
=====================

A function that says where each pixel looks in the source warps a picture. How far pixels reach
there is found from how the function changes from one pixel to the next, so that nothing aliases
where it squeezes the picture.

From the command line a map comes as a file with the arrays ``x`` and ``y``:

.. code-block:: console

    $ resample-texture warp photo.png --map map.npz --edge mirror -o out.png
"""

import numpy as np

from resample_texture import warp
from resample_texture.showing.scenes import bricks


def whirl(x, y):
    """Where a pixel looks: turned the more, the nearer it is to the middle."""
    right, down = x - 200, y - 150
    angle = 3.5 * np.exp(-np.hypot(right, down) / 70)
    cosine, sine = np.cos(angle), np.sin(angle)
    return 1.2 * (right * cosine - down * sine) + 256, 1.2 * (right * sine + down * cosine) + 256


warp(bricks(512), whirl, (300, 400), edge="mirror").save("a-whirl.png")
