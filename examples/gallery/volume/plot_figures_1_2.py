"""
Figures 1 and 2: which samples are points
=========================================

One layer of a volume, from above, with the eye below. By the paper's rule a voxel is a splat (red)
where it is larger than a pixel on screen, and a point (blue) where it is smaller; the border is an
arc. On the right, colors of splats show their order, nearest first, and points are summed in layers
one voxel deep.

The same from the command line:

.. code-block:: console

    $ resample-volume figures -o figures --figure 1 --figure 2
"""

import tempfile
from pathlib import Path

from resample_figures.volumes import make

with tempfile.TemporaryDirectory() as folder:
    make(Path(folder), ["1-2"])
    Path("figures-1-and-2.png").write_bytes(Path(folder, "figure-1-2.png").read_bytes())
