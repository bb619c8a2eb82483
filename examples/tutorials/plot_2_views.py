"""
View an RGB-D image from another viewpoint
==========================================

You have a color image and the depth of its pixels, from a sensor, a renderer, stereo or a network, and
want to view it from another viewpoint. In ten minutes you will do that, find out what was occluded, and
fill it.
"""

# %%
# Color, depth and a camera
# -------------------------
#
# A generated room stands in for yours: color is linear light, ``depth`` is the distance along the camera's
# axis. Depths that are zero, negative or not finite are unknown.

from resample_warp3d import Camera, warp
from resample_comparisons.warp3d.scenes import generated

room = generated(300)
color, depth = room.render(room.source, room.shape)
camera = Camera.from_fov(60, 300, 300)  # or Camera.from_intrinsics(fx, fy, cx, cy)
print(color.shape, f"depth from {depth.min():.2f} to {depth.max():.2f} m")
warp(color, depth, camera, camera).save("source.png")

# %%
# Move
# ----
#
# A pose maps world to camera, x to the right, y down, z ahead. A camera 0.4 m to the right has the
# translation -0.4.

import numpy as np

right = camera.moved(np.c_[np.eye(3), [-0.4, 0, 0]])
moved = warp(color, depth, camera, right)
moved.save("moved.png", background=(0, 0, 0))
print(moved)

# %%
# Black areas were not visible to the source. There are no cracks between the samples of a surface, although they
# have moved apart: the samples of a surface are connected to a sheet, which is cut only where the surface ends.
#
# Types of holes
# --------------

from resample_warp3d import Hole

print({hole.name: int((moved.holes == hole).sum()) for hole in Hole})
moved.to_image("depth").save("depth.png")
moved.to_image("holes").save("holes.png")

# %%
# Filling
# -------
#
# ``fill=True`` fills holes from the background beside them. ``fill="layer"`` does it once for all views of a
# source, so that it is the same in all frames of a film.

warp(color, depth, camera, right, fill=True).save("filled.png")

# %%
# Closer
# ------
#
# Two meters ahead, each sample covers several pixels. A pixel gets the colors of the samples in proportion to the
# areas that they cover, so edges stay sharp.

ahead = camera.moved(np.c_[np.eye(3), [0.3, 0.2, -2.0]])
for method in ("mcmillan", "hybrid"):
    warp(color, depth, camera, ahead, method=method).save(
        f"ahead-{method}.png", background=(0, 0, 0)
    )

# %%
# Many views of one source
# ------------------------
#
# ``DepthScene`` prepares a source once; so does ``prepare``. Each view then only costs its painting.

from resample_warp3d import DepthScene

scene = DepthScene(color, depth, camera)
for n, step in enumerate((-0.3, 0.0, 0.3)):
    scene.render(camera.moved(np.c_[np.eye(3), [step, 0, 0]])).save(
        f"step-{n}.png", background=(0, 0, 0)
    )

# %%
# From the command line
# ---------------------
#
# .. code-block:: console
#
#     $ resample-warp3d render photo.jpg depth.png --depth-scale 1000 --fov 60 --move 0.4,0,0 --fill -o moved.png
#     $ resample-warp3d animate photo.jpg depth.png --depth-scale 1000 --fov 60 --path sway -o sway.webp
#     $ resample-warp3d view photo.jpg depth.png --depth-scale 1000 --fov 60
#
# Next: :doc:`depth of a network </howto/network_depth>`, or :doc:`point clouds </howto/clouds>`.
