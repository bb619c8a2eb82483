"""
Figure 5: a floor, near and far
===============================

The paper's Figure 5 maps a texture to a floor. Its near texels are 8 × 8 pixels large, its far ones
1/2 by 1/32 of a pixel. Points alone leave holes where texels grow. Bilinear lookup aliases where
they shrink. The hybrid does neither.

The same from the command line, with a table of errors:

.. code-block:: console

    $ resample-texture figures -o figures
"""

from resample_texture import warp
from resample_comparisons.texture.scenes import checker, scene_of

floor = scene_of(checker(), "floor-close", size=(280, 280))
for method in ("points", "bilinear", "hybrid"):
    warped = warp(floor.source, floor.geometry, floor.shape, method=method)
    warped.save(f"{method}.png", background=(0, 0, 0))

# sphinx_gallery_thumbnail_number = -1
