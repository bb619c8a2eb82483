"""
Maximum, sum and surface
========================

Besides composited light, a pixel can show the maximum along its ray, the sum as in an X-ray, or an
isosurface. All of them are computed along rays through a spline that interpolates the voxels.

The same from the command line:

.. code-block:: console

    $ resample-volume render vessel-tree --projection maximum --camera 40,15,0.95 -o maximum.png
    $ resample-volume render vessel-tree --projection first-hit --iso 128 --camera 40,15,0.95 -o surface.png
"""

from resample import Resampler
from resample.profiles.orders import Rays
from resample.painting.choices import Projection
from resample_volume import render

for projection in (Projection.MAXIMUM, Projection.ADDITIVE, Projection.FIRST_HIT):
    iso = 128 if projection is Projection.FIRST_HIT else None
    along = Resampler(order=Rays(), projection=projection, iso=iso)
    frame = render("vessel-tree", "auto", (40, 15, 0.95), size=(280, 280), resampler=along)
    frame.save(f"{projection.value}.png", background=(0, 0, 0))

# sphinx_gallery_thumbnail_number = -1
