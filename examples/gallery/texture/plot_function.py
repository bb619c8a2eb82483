"""
Any function is a map
=====================

A function that returns each pixel's position in the source warps a picture. Footprints of pixels
follow from the differences between neighbouring pixels, so that nothing aliases where the picture
shrinks.

From the command line a map comes as a file with the arrays ``x`` and ``y``:

.. code-block:: console

    $ resample-texture warp photo.png --map map.npz --edge mirror -o out.png
"""

import numpy as np

from resample_texture import warp
from resample_comparisons.texture.scenes import bricks


def whirl(x, y):
    """Source position of a pixel: rotated more toward the center."""
    right, down = x - 200, y - 150
    angle = 3.5 * np.exp(-np.hypot(right, down) / 70)
    cosine, sine = np.cos(angle), np.sin(angle)
    return 1.2 * (right * cosine - down * sine) + 256, 1.2 * (right * sine + down * cosine) + 256


warp(bricks(512), whirl, (300, 400), edge="mirror").save("a-whirl.png")
