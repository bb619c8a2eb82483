"""
Labels stay labels
==================

A label map must not be averaged: class 2 is not between class 1 and class 3. ``majority`` gives
every pixel the class that covers most of it, ``nearest`` the one at its center. No new labels
appear, whatever the type.

The same from the command line, with labels of yours:

.. code-block:: console

    $ resample-texture warp labels.png --matrix 0.2,0.05,0,-0.05,0.2,16 --size 120x120 --method majority -o out.png
"""

import numpy as np

from resample_texture import warp

y, x = np.mgrid[0:512, 0:512]
hills = np.sin(x / 23) + np.sin(y / 31 + x / 90) + np.sin((x + y) / 47)
grain = np.random.default_rng(1).normal(0, 0.6, x.shape)
labels = np.clip(1.2 * hills + 3 + grain, 0, 6).astype(np.uint8)
matrix = np.array([[0.2, 0.05, 0], [-0.05, 0.2, 16], [0, 0, 1]])
colors = np.array(
    [
        [20, 30, 60],
        [0, 90, 140],
        [60, 150, 110],
        [230, 200, 110],
        [220, 110, 60],
        [150, 40, 50],
        [90, 0, 40],
    ],
    np.uint8,
)
for method in ("nearest", "majority"):
    warped = warp(labels, matrix, (120, 120), method=method)
    picture = colors[warped.image.astype(int)]
    warp(picture, np.eye(3), (120, 120)).save(f"{method}.png")

# sphinx_gallery_thumbnail_number = -1
