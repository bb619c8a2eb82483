"""
Sharpen soft depth edges to fit the picture
===========================================

Depth from sensors and networks is soft at object boundaries. From other viewpoints such edges
stretch into rubber sheets. By default, ``warp`` detects soft depth and moves its edges to where the
picture's colors change.

The same from the command line, with a picture and depth of yours:

.. code-block:: console

    $ resample-warp3d render photo.jpg depth.png --depth-scale 1000 --fov 60 --move 0.34,0,0 --refine sharpen -o moved.png
"""

from scipy.ndimage import gaussian_filter

from resample_warp3d import warp
from resample_comparisons.warp3d.scenes import generated

room = generated(400)
color, depth = room.render(room.source, room.shape)
soft = 1 / gaussian_filter(1 / depth, 2.5)
for name, refine in (("as-it-is", "none"), ("refined", "auto")):
    warped = warp(color, soft, room.source, room.views["side"], refine=refine)
    part = warped.to_image(background=(0, 0, 0)).crop((120, 90, 290, 220))
    part.save(f"{name}.png")

# sphinx_gallery_thumbnail_number = -1
