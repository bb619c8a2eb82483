"""
Figure 7: orders that pop
=========================

A translucent box is viewed at 44.9 and at 45.1 degrees; the lower row is 16 times the difference.
Sheets along the lattice's axes change their axis in between, and the whole picture pops. Sorting
every sample by depth changes it a little, sheets parallel to the screen by hardly more than the
rotation.

The same from the command line, with curves over a whole turn:

.. code-block:: console

    $ resample-volume figures -o figures --figure 7
"""

import numpy as np
from PIL import Image

from resample_comparisons.volume.painting import AxisSheets, ImageSheets
from resample.profiles.orders import EverySample
from resample.resampler import Resampler
from resample_volume import Appearance, Light, open_volume, render

box = open_volume("checker-box:size=40,block=8")
look = Appearance("checker:opacity=0.3", Light((0.0, -1.0, 0.6)))
orders = {"axis-sheets": AxisSheets(), "every-sample": EverySample(), "image-sheets": ImageSheets()}
for name, order in orders.items():
    before, after = (
        render(box, look, (azimuth, 8, 1.15), size=(200, 200), resampler=Resampler(order=order))
        for azimuth in (44.9, 45.1)
    )
    before, after = (frame.to_uint8(background=(0, 0, 0)).astype(int) for frame in (before, after))
    difference = np.clip(16 * np.abs(after - before), 0, 255)
    Image.fromarray(np.vstack([after, difference]).astype(np.uint8)).save(f"{name}.png")
