"""
Four corners
============

A picture is mapped to four given corners: top left, top right, bottom right, bottom left. Edges are
as sharp as pixels allow, because the covered fraction of every pixel is exact.

The same from the command line, with a picture of yours:

.. code-block:: console

    $ resample-texture warp photo.png --corners "60,20 560,90 500,330 20,360" --size 580x380 -o out.png
"""

from resample_texture import warp
from resample_texture.geometry.matrices import from_corners, page_corners
from resample_comparisons.texture.scenes import bricks

wall = bricks(512)
corners = [[60, 20], [560, 90], [500, 330], [20, 360]]
warped = warp(wall, from_corners(page_corners((512, 512)), corners), (380, 580))
warped.save("a-wall.png", background=(1, 1, 1))
