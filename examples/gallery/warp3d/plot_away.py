"""
From far away
=============

Twelve meters back, objects are a quarter as large. Points that are painted one by one flicker and
break up thin posts. The hybrid gives each pixel the mean of all samples that it shows.

The same from the command line, in the same generated room:

.. code-block:: console

    $ resample-warp3d compare --scene generated --views back4 --methods mcmillan-zbuffer,hybrid -o compare.png
"""

from resample_warp3d import warp
from resample_comparisons.warp3d.scenes import generated

room = generated(512)
color, depth = room.render(room.source, room.shape)
for method in ("mcmillan-zbuffer", "hybrid"):
    seen = warp(color, depth, room.source, room.views["back4"], method=method, size=(512, 512))
    part = seen.to_image(background=(0, 0, 0)).crop((190, 175, 340, 290))
    part.save(f"{method}.png")

# sphinx_gallery_thumbnail_number = -1
