"""
Figure 9: rendering times
=========================

The paper measures how time depends on the size of voxels on screen. Here `splats` are one ray per
pixel and alias at a distance, `points` one filter per voxel; the hybrid uses several sub-pixels per
pixel, which cost more.

The same from the command line, for the volumes of the paper where they have been fetched:

.. code-block:: console

    $ resample-volume figures -o figures --figure 9
"""

import time

import matplotlib.pyplot as plt
import numpy as np

from resample import Primitive, Resampler
from resample_volume import Scene

scene = Scene("vessel-tree:size=128")
zooms = 2.0 ** np.arange(-6, 2)
figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
colors = {"points": "#1f5fa8", "splats": "#c0392b", "hybrid": "#2f8f4e"}
for kind, color in colors.items():
    resampler, taken = Resampler(primitive=Primitive(kind)), []
    for zoom in zooms:
        scene.render("vessels", (20, 10, zoom), size=(400, 400), resampler=resampler)
        begun = time.perf_counter()
        for _ in range(3):
            scene.render("vessels", (20, 10, zoom), size=(400, 400), resampler=resampler)
        taken.append(1000 / 3 * (time.perf_counter() - begun))
    axes.loglog(400 * zooms / 128, taken, "o-", color=color, label=kind)
axes.set(xlabel="pixels per voxel, about", ylabel="milliseconds")
axes.legend(frameon=False)
figure.savefig("milliseconds.png", dpi=120)
