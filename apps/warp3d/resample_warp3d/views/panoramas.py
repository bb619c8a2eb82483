"""Split equirectangular depth images into sources that can be rendered together.

    seen = render_together(panorama(color, length), target, (480, 640), joining=SEAMLESS)

The warping equation handles views of less than 180 degrees, so a panorama is split, without
resampling, into six blocks of its pixels: four around, and one about each pole. Each is a depth
image of a camera that looks at its center, with positions for its pixels.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.cameras.models import Camera
from resample.cameras.pixels import rays_at, turn
from resample.files.conversion import as_picture
from resample.types import Floats
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.depth.refining.conditioning import Refine
from resample_warp3d.types import DepthImage
from resample_warp3d.views.multi_source import Agreed, Joining, PosedSource, agreed
from resample_warp3d.warping import as_light

SIDES = 4
SHARED = 4  # px that adjacent blocks overlap, on each side of their seam
SMALLEST = 16  # px of height
SEAMLESS = Joining("feathered", "none", "none", "none", "none")  # feather faces at their borders


def panorama(
    color: NDArray[np.number],
    length: ArrayLike,
    world_to_camera: ArrayLike | None = None,
    *,
    noise: float | None = None,
    refine: Refine = "auto",
) -> Agreed:
    """Prepare a panorama for `resample_warp3d.render_together` with `SEAMLESS`.

    Parameters
    ----------
    color, length, world_to_camera
        As `faces` takes them; color also in 8 or 16 bits, as `resample_warp3d.warp` takes it.
    noise, refine
        As `resample_warp3d.warp` takes them, for each face.

    Raises
    ------
    ValueError
        As `faces` does, or an option is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import SEAMLESS, Camera, panorama, render_together
    >>> sources = panorama(np.ones((128, 256, 3)), np.full((128, 256), 3.0))
    >>> window = Camera.from_fov(60, 24, 32)
    >>> joined = render_together(sources, window, (24, 32), joining=SEAMLESS)
    >>> joined.warped, round(joined.warped.depth[12, 16].item(), 1)
    (Warped(24 × 32 × 3 float32, 100 % covered), 3.0)
    """
    cut = faces(as_light(color), as_picture(length, "depth map"), world_to_camera)
    prepared = [
        PosedSource(prepare(image, noise=noise, refine=refine), camera) for image, camera in cut
    ]
    return agreed(prepared, SEAMLESS)


def faces(
    color: Floats, length: ArrayLike, world_to_camera: ArrayLike | None = None
) -> list[tuple[DepthImage, Camera]]:
    """Split a panorama into depth images and cameras: front, right, back, left, top, bottom.

    `color`: (H, 2 H, C) linear light. The center of the picture is forward (+z), its left and right
    edges meet behind, and its top row is above (−y). `length`: (H, 2 H) distance from the camera,
    along the ray; 0, negative numbers, inf and NaN are unknown. `world_to_camera`: (4, 4) pose of
    the panorama; default: the identity.
    """
    far = np.asarray(length, np.float64)
    height, width = far.shape if far.ndim == 2 else (0, 0)
    if color.shape[:2] != far.shape or width != 2 * height or height < SMALLEST:
        raise ValueError(
            f"a panorama has a color and a depth of H x 2 H pixels, {SMALLEST} or more high, not"
            f" {color.shape[:2]} and {far.shape}"
        )
    if not (np.isfinite(far) & (far > 0)).any():
        raise ValueError("the panorama has no depth at all; check its unit and its file")
    known = np.where(np.isfinite(far) & (far > 0), far, np.inf)
    pose = np.eye(4) if world_to_camera is None else np.asarray(world_to_camera, np.float64)
    # Rows and columns of all faces, possibly beyond the edges, and rotations.
    quarter = height // 4
    around, blocks = np.arange(quarter - SHARED, height - quarter + SHARED), []
    for side in range(SIDES):
        first, last = (width // 2 + round((side + end) * width / SIDES) for end in (-0.5, 0.5))
        ahead = turn(2.0 * math.pi * side / SIDES, 0.0)
        blocks.append((around, np.arange(first - SHARED, last + SHARED), ahead))
    whole, pole = np.arange(-1, width + 1), np.arange(quarter + SHARED)  # their ends overlap
    blocks.append((pole, whole, turn(0.0, 0.5 * math.pi)))
    blocks.append((height - 1 - pole[::-1], whole, turn(0.0, -0.5 * math.pi)))
    made = []
    for rows, columns, turned in blocks:
        center = np.stack(np.broadcast_arrays(columns + 0.5, rows[:, None] + 0.5), axis=2)
        ray = rays_at(center, (height, width)) @ turned[:3, :3].T
        focal = width / (2.0 * math.pi)  # as many px per radian as the panorama has
        camera = Camera.from_intrinsics(focal, focal, 0.0, 0.0, turned @ pose)
        block = np.ix_(rows, columns % width)
        nearness = (1.0 / (known[block] * ray[..., 2])).astype(np.float32)
        place = focal * ray[..., :2] / ray[..., 2:]
        made.append((DepthImage(np.ascontiguousarray(color[block]), nearness, place), camera))
    return made
