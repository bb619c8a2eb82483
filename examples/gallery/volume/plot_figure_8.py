"""
Figure 8: splats near, points far
=================================

The paper colors splats red to show the primitives. By its rule voxels are points as soon as they
are smaller than a pixel (left). The default paints splats on sub-pixels until voxels are smaller
than about 0.04 pixels (right), in about the same time and with far smaller errors.

The same from the command line; the paper's own volumes come by ``resample-volume fetch``:

.. code-block:: console

    $ resample-volume render vessel-tree --transfer vessels --camera 20,10,0.8 --method paper --color-by primitive -o primitives.png
    $ resample-volume render vessel-tree --transfer vessels --camera 20,10,0.8 -o default.png
"""

from resample import Primitive, Resampler
from resample_volume import open_volume, render

tree = open_volume("vessel-tree:size=256")
paper = Resampler(primitive=Primitive.PAPER, splat_color=(0.8, 0.03, 0.03))
for name, resampler in (("paper", paper), ("default", Resampler())):
    frame = render(tree, "vessels", (20, 10, 0.8), size=(360, 360), resampler=resampler)
    frame.save(f"{name}.png", background=(0, 0, 0))
    print(f"{name}: {frame.statistics.splats} splats, {frame.statistics.points} points")
