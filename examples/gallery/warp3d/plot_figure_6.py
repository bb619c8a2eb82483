"""
Figure 6: a depth image from the side
=====================================

The paper's Figure 6 compares McMillan's warp, which paints a pixel for each sample, with the
hybrid. Where samples move apart, McMillan's picture has holes and jagged edges. With the hybrid,
only areas that the source did not see stay empty.

The same from the command line, with numbers:

.. code-block:: console

    $ resample-warp3d figures -o figures
"""

from resample_warp3d import warp
from resample_comparisons.warp3d.scenes import generated

room = generated(280)
color, depth = room.render(room.source, room.shape)
warp(color, depth, room.source, room.source).save("source.png")
for method in ("mcmillan", "hybrid"):
    warped = warp(color, depth, room.source, room.views["oblique"], method=method)
    warped.save(f"{method}.png", background=(0, 0, 0))

# sphinx_gallery_thumbnail_number = -1
