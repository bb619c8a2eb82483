"""
Figures 1 and 2: which samples are points
=========================================

A layer of a box, seen from above with the eye below. The paper's rule: where a voxel is larger
than a pixel on screen it is a splat (red), where it is smaller a point (blue). The lower halves
show in which order they are painted.

The same from the command line:

.. code-block:: console

    $ resample-volume figures -o figures --figure 1 --figure 2
"""

import tempfile
from pathlib import Path

from resample_volume.showing.figures import make

with tempfile.TemporaryDirectory() as folder:
    make(Path(folder), ["1-2"])
    Path("figures-1-and-2.png").write_bytes(Path(folder, "figure-1-2.png").read_bytes())
