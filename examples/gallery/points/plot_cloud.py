"""
A cloud of points
=================

Points of a surface are painted as discs that close it; their size follows from the distance between
points. Coverage at outlines is in sixteenths of a pixel.

The same from the command line, with a cloud of yours:

.. code-block:: console

    $ resample-points render scan.ply --camera 30,35,1 -o scan.png
"""

import numpy as np

from resample_points import Cloud, framed, render_cloud

rng = np.random.default_rng(3)
turn, round_ = rng.uniform(0, 2 * np.pi, (2, 60_000))
away = 2.2 + np.cos(round_)
place = np.stack([away * np.cos(turn), away * np.sin(turn), np.sin(round_)], axis=1)
outward = [np.cos(round_) * np.cos(turn), np.cos(round_) * np.sin(turn), np.sin(round_)]
normal = np.stack(outward, axis=1)
shade = 0.1 + 0.9 * np.clip(normal @ [0.3, -0.6, 0.74], 0, 1)
stripes = np.where(np.sin(6 * turn + 3 * round_) > 0, 1.0, 0.0)[:, None]
color = (stripes * [0.75, 0.09, 0.02] + (1 - stripes) * [0.85, 0.7, 0.45]) * shade[:, None]

cloud = Cloud(place, normal, color.astype(np.float32), np.empty(0))
camera = framed(cloud, size=(480, 360), azimuth=30, elevation=35)
render_cloud(cloud, camera, size=(480, 360)).save("a-ring.png", background=(1, 1, 1))
