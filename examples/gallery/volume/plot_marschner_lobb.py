"""
Ripples that test interpolation
===============================

The signal of Marschner and Lobb has ripples just below the highest frequency that its 41³ samples
can represent. A smoothing kernel flattens them; the default interpolates the samples and keeps them.

The same from the command line:

.. code-block:: console

    $ resample-volume render marschner-lobb --projection first-hit --iso 0.5 --order rays:sharpness=0 --camera 30,40,1.2 -o smooth.png
    $ resample-volume render marschner-lobb --projection first-hit --iso 0.5 --camera 30,40,1.2 -o sharp.png
"""

from resample import Resampler
from resample.profiles.orders import Rays
from resample.painting.choices import Projection
from resample_volume import render

for name, order in (("smoothed", Rays(sharpness=0.0)), ("interpolated", Rays())):
    surface = Resampler(order=order, projection=Projection.FIRST_HIT, iso=0.5)
    frame = render("marschner-lobb", "auto", (30, 40, 1.2), size=(360, 360), resampler=surface)
    frame.save(f"{name}.png", background=(1, 1, 1))

# sphinx_gallery_thumbnail_number = -1
