"""
Figures 3 and 4: the footprint of a ball
========================================

A ball away from the axis projects to an ellipse whose center is not the projection of the ball's
center. Models of footprints differ in how they treat the rays within; the curves are their largest
errors. ``exact`` has none, on and off the axis.

The same from the command line:

.. code-block:: console

    $ resample-volume figures -o figures --figure 3 --figure 4
"""

import tempfile
from pathlib import Path

from resample_figures.volumes import make

with tempfile.TemporaryDirectory() as folder:
    make(Path(folder), ["3-4"])
    Path("figures-3-and-4.png").write_bytes(Path(folder, "figure-3-4.png").read_bytes())
