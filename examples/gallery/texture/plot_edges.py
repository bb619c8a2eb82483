"""
Edges to a part of a pixel
==========================

A white picture of 20 × 12 pixels is rotated. Every pixel at its edges holds the fraction that the
picture covers, so that the sum of all pixels is the area of the picture at any angle: 240.

The same from the command line, with a picture of yours:

.. code-block:: console

    $ resample-texture rotate small.png out.png --degrees 7
"""

import numpy as np

from resample_texture import rotate

white = np.ones((12, 20), np.float32)
for degrees in (3, 7, 30):
    warped = rotate(white, degrees)
    warped.save(f"{degrees}-degrees.png", background=(0, 0, 0))
    print(f"{degrees} degrees: an area of {warped.coverage.sum():.3f}")

# sphinx_gallery_thumbnail_number = -1
