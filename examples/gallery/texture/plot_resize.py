"""
Ten times smaller
=================

Rings that get finer toward the outside are reduced by ten. A bilinear lookup reads four of every
hundred texels and shows false rings. ``resize`` averages all texels that a pixel covers: what is
too fine becomes gray.

The same from the command line, with a picture of yours:

.. code-block:: console

    $ resample-texture resize rings.png small.png --size 150x150
"""

import numpy as np

from resample_texture import resize

y, x = np.mgrid[-750:750, -750:750] + 0.5
rings = (0.5 + 0.5 * np.cos((x**2 + y**2) / 1500)).astype(np.float32)
for method in ("bilinear", "hybrid"):
    resize(rings, (150, 150), method=method).save(f"{method}.png")

# sphinx_gallery_thumbnail_number = -1
