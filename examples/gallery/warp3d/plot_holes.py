"""
Why pixels are empty, and how to fill them
==========================================

A step aside uncovers what was occluded. ``holes`` gives the reason for each empty pixel, and
``fill`` fills it from the background beside it, never from the foreground.

The same from the command line, with a picture and depth of yours:

.. code-block:: console

    $ resample-warp3d render photo.jpg depth.png --depth-scale 1000 --fov 60 --move 0.6,0,0 --show holes -o holes.png
    $ resample-warp3d render photo.jpg depth.png --depth-scale 1000 --fov 60 --move 0.6,0,0 --fill -o filled.png
"""

import numpy as np

from resample_warp3d import warp
from resample_comparisons.warp3d.scenes import generated

room = generated(280)
color, depth = room.render(room.source, room.shape)
aside = room.source.moved(np.c_[np.eye(3), [-0.6, 0, 0]])  # world to camera
warped = warp(color, depth, room.source, aside)
warped.save("as-seen.png", background=(0, 0, 0))
warped.to_image("holes").save("reasons.png")
warp(color, depth, room.source, aside, fill=True).save("filled.png")
