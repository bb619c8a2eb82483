"""
Figures 3 and 4: the footprint of a ball
========================================

A ball away from the axis is seen as an ellipse whose middle is not where the ball's center is
seen. Models of footprints differ in what they make of the rays within; the curves are their
largest errors. ``exact`` has none, on and off the axis.

The same from the command line:

.. code-block:: console

    $ resample-volume figures -o figures --figure 3 --figure 4
"""

import tempfile
from pathlib import Path

from resample_volume.showing.figures import make

with tempfile.TemporaryDirectory() as folder:
    make(Path(folder), ["3-4"])
    Path("figures-3-and-4.png").write_bytes(Path(folder, "figure-3-4.png").read_bytes())
