"""
Warp a picture
==============

You have a picture and know where its points should go: by a matrix, four corners, a map or a lens. In ten
minutes you will warp it, as the mean of what a pixel covers where it shrinks and by a spline where it does not, read the
covered fraction of each pixel, and replace OpenCV calls.
"""

# %%
# A picture and a matrix
# ----------------------
#
# Pictures are NumPy arrays (H, W) or (H, W, C) of any type. Integers are taken as sRGB levels and decoded
# to linear light before filtering; floats are linear light already. Here is a wall:

from resample_texture import warp
from resample_comparisons.texture.scenes import bricks

wall = bricks(512)
print(wall.shape, wall.dtype)

# %%
# A 3 × 3 matrix maps source to target. Coordinates start at the picture's corner: the first pixel's center is
# at (0.5, 0.5). (OpenCV's matrices start at that center; ``resample_dropins.opencv`` takes them.)

import numpy as np

matrix = np.array([[0.5, 0.12, 30], [-0.08, 0.45, 60], [0, 0.0006, 1]])
warped = warp(wall, matrix, (250, 300))  # height and width of the target
warped.save("turned.png", background=(1, 1, 1))
print(warped)

# %%
# The result
# ----------
#
# ``warped.image`` is multiplied by ``warped.coverage``, the covered fraction of each pixel. So pictures can
# be composited by addition, and edges have no fringe. ``warped.mean`` is the average color of what covers
# each pixel.

picture = warped.image + (1 - warped.coverage[..., None]) * np.array([0.02, 0.1, 0.35])
warp(picture.astype(np.float32), np.eye(3), picture.shape[:2]).save("over-blue.png")
print(f"an area of {warped.coverage.sum():.1f} pixels is covered")

# %%
# Far and near at once
# --------------------
#
# A floor up to the horizon is difficult: in the distance hundreds of source pixels (texels) fall into one pixel,
# and close to the viewer one texel covers several pixels. One setting handles both. ``edge="mirror"`` continues
# the picture beyond its edges.

from resample_texture.geometry.matrices import from_corners, page_corners

far = [[120, 40], [180, 40], [600, 250], [-300, 250]]
floor = from_corners(page_corners((512, 512)), far)
for method in ("bilinear", "hybrid"):
    warp(wall, floor, (250, 300), edge="mirror", method=method).save(f"floor-{method}.png")

# %%
# ``bilinear`` is OpenCV's, available here by name like other methods; ``resample plugins methods`` lists them.
#
# Maps
# ----
#
# A function returns each pixel's position in the source; two arrays, as for ``cv2.remap``, do the same as a
# ``BackwardMap``. Arrays of where each texel *goes* are a ``ForwardMap``, for optical flow.

warp(wall, lambda x, y: (x + 12 * np.sin(y / 20), y + 8 * np.sin(x / 17)), (250, 300)).save(
    "waves.png"
)

# %%
# In place of OpenCV
# ------------------
#
# ``warpPerspective`` of ``resample_dropins.opencv`` takes the arguments of ``cv2.warpPerspective``, and its conventions:

import cv2

from resample_dropins.opencv import warpPerspective

levels = (255 * wall**0.4545).astype(np.uint8)
small = np.diag([0.15, 0.15, 1.0])
theirs = cv2.warpPerspective(levels, small, (76, 76))
ours = warpPerspective(levels, small, (76, 76))
for name, given in (("opencv", theirs), ("ours", ours)):
    warp(given, np.eye(3), (76, 76)).save(f"{name}.png")

# %%
# From the command line
# ---------------------
#
# .. code-block:: console
#
#     $ resample-texture warp photo.png --corners "60,20 560,90 500,330 20,360" -o out.png
#     $ resample-texture warp photo.png --matrix H.txt --convention opencv --size 1280x720 -o out.png
#     $ resample-texture view photo.png
#
# Next: :doc:`replace cv2.warpPerspective </howto/opencv>`, or :doc:`how it works </theory/index>`.
