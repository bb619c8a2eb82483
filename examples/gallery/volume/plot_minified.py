"""
Small on screen
===============

A box of blocks, at 0.4 pixels per voxel. One splat or ray per pixel misses most voxels, and which
ones changes with every degree. Points alone are summed before occlusion is resolved. The hybrid
composites on sub-pixels and filters last.

The same from the command line, as a sheet with errors:

.. code-block:: console

    $ resample-volume compare checker-box:block=5 --camera 30,20,0.95 --methods points,splats,hybrid --size 60x60 -o compare.png
"""

from resample import Primitive, Resampler
from resample_volume import render

for kind in (Primitive.SPLATS, Primitive.POINTS, Primitive.HYBRID):
    renderer = Resampler(primitive=kind)
    frame = render(
        "checker-box:block=5", "checker", (30, 20, 0.95), size=(60, 60), resampler=renderer
    )
    frame.save(f"{kind.value}.png", background=(0, 0, 0))

# sphinx_gallery_thumbnail_number = -1
