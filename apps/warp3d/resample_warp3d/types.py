"""Types of the application: depth images, equations, sources, results, method role.

Continuous pixel coordinates everywhere: the pixel in row i, column j covers
[j, j + 1) × [i, i + 1) and has its center at (j + 0.5, i + 0.5), in the source as in the target.
Cameras look along +z, x to the right and y down; poses map world to camera.

McMillan's warping equation maps a pixel x₁ of the source to x₂ ~ M x₁ + δ(x₁) e, with a matrix M,
the epipole e (the image of the source's camera center in the target) and a generalized disparity δ.
Two cameras give M = K₂ R K₁⁻¹, e = K₂ t and δ = 1 / z; a rectified pair M = 1, e = (−1, 0, 0) and δ
in px. Nearer is larger; 0 means unknown. δ divided by the third coordinate of x₂ is δ as seen from
the target; it is called *nearness* here and is linear on planes, in both views.
"""

from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from resample.calling import constructed
from resample.showable import Showable
from resample.types import Doubles, Floats

Links = NDArray[np.uint8]

# Bits of a sample's links: that neighbour lies on the same surface. Links are symmetric.
RIGHT, DOWN, LEFT, UP = 1, 2, 4, 8
TURNS = 16  # factor of these bits, in a sheet: the surface turns away beyond that side
MARGIN = 2  # unlinked samples around a sheet; colors are interpolated from five
NO_LENS: Doubles = np.empty((0, 0, 2))  # places of samples that lie where pixels have them
AS_GIVEN: Floats = np.empty((0, 0), np.float32)  # trust of depth that was not refined


class Hole(IntEnum):
    """Cause of a hole in the target; `NONE` for covered pixels.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, Hole, warp
    >>> depth = np.full((32, 32), 4.0)
    >>> depth[8:24, 8:24] = 1.0  # a square before a wall
    >>> camera = Camera.from_fov(60, 32, 32)
    >>> right = camera.moved(np.c_[np.eye(3), [-0.4, 0, 0]])
    >>> holes = warp(np.ones((32, 32)), depth, camera, right).holes
    >>> Hole(holes[16, 16]).name, Hole(holes[16, 31]).name
    ('DISOCCLUDED', 'OUTSIDE')
    """

    NONE = 0  # fully or partly covered
    DISOCCLUDED = 1  # hidden in the source by something nearer
    OUTSIDE = 2  # outside the source's frame
    NO_DEPTH = 3  # in the source, without depth
    CRACK = 4  # a gap between samples, filled from both sides


@constructed("nearness is 1 / depth, or disparity")
class DepthImage(NamedTuple):
    """A picture with its depth, as nearness: 1 / depth, or disparity.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, prepare
    >>> color, depth = np.ones((24, 32, 3), np.float32), np.full((24, 32), 2.0)
    >>> image = DepthImage(color, np.float32(1 / depth))
    >>> prepare(image).nearness[12, 16].item()
    0.5
    """

    color: Floats  # (H, W, C) linear light, premultiplied if a channel is opacity
    nearness: Floats  # (H, W) δ; 0: unknown
    place: Doubles = NO_LENS  # (H, W, 2) undistorted position of each sample, px; or (0, 0, 2)


class Equation(NamedTuple):
    """McMillan's warping equation, x₂ ~ matrix x₁ + δ epipole.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Equation
    >>> pair = Equation(np.eye(3), np.array([-1.0, 0.0, 0.0]))  # rectified, δ in px
    >>> (pair.matrix @ (20, 10, 1) + 4 * pair.epipole).tolist()
    [16.0, 10.0, 1.0]
    """

    matrix: Doubles  # (3, 3)
    epipole: Doubles  # (3,)

    def in_frame(self, matrix: Doubles) -> "Equation":
        """Return the equation to a frame that a matrix (3, 3) maps the target to."""
        return Equation(matrix @ self.matrix, matrix @ self.epipole)


class Sheet(NamedTuple):
    """A depth image as a sheet of cells, one around each sample, torn where surfaces end."""

    color: Floats  # (G, 3, H + 4, W + 4) channel groups; colors not mixed between surfaces
    vertex: Floats  # (H + 1, W + 1) nearness at the lattice's corners; 0 where the sheet is torn
    place: Doubles  # (H + 1, W + 1, 2) their undistorted positions, px; or (0, 0, 2)
    torn: NDArray[np.int32]  # (H, W) row of `corner`; −1: corners of the lattice, −2: no cell
    corner: Floats  # (N, 4, 3) x, y and nearness of torn cells' corners, row by row
    links: Links  # (H + 4, W + 4) of the source, with TURNS; MARGIN unlinked around, as for colors
    ends: NDArray[np.int32]  # (M, 2) row of `corner` and corner, where surfaces turn away
    roundness: Floats  # (M, 2) of the ends: squared nearness per px, outward, along x and y


class Source(NamedTuple):
    """A depth image prepared for warping; see `resample_warp3d.depth.preparation`.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, prepare
    >>> noise = np.random.default_rng(1).normal(0, 0.002, (64, 64))
    >>> color, nearness = np.ones((64, 64, 3), np.float32), np.float32(0.5 * (1 + noise))
    >>> source = prepare(DepthImage(color, nearness))
    >>> round(source.noise, 3), bool(source.nearness.std() < nearness.std() / 2)  # smoothed
    (0.002, True)
    """

    color: Floats  # (H, W, C)
    nearness: Floats  # (H, W) smoothed along surfaces if noisy or coarse; 0: unknown
    slope: Floats  # (H, W, 2) change of nearness to the next column and row, on the surface
    links: Links  # (H, W) which neighbours are on the same surface
    place: Doubles  # (H, W, 2) as in DepthImage
    noise: float  # standard deviation of the nearness, relative to it
    step: float = 0.0  # smallest step of nearness
    trust: Floats = AS_GIVEN  # (H, W) 0..1 certainty of refined depth; or (0, 0)


class Rendered(NamedTuple):
    """Result of a method in the frame of a target."""

    image: Floats  # (H, W, C) multiplied by the coverage
    coverage: Floats  # (H, W) 0..1
    nearness: Floats  # (H, W) of the nearest surface; 0 where nothing is
    magnification: (
        Floats  # (H, W) px of the target per px of the source (areas); 0 where nothing is
    )
    bridged: NDArray[np.bool_]  # (H, W) filled between samples


class _WarpedDepth(NamedTuple):
    """Fields of `Warped`."""

    image: Floats  # (H, W, C) multiplied by the coverage
    coverage: Floats  # (H, W) 0..1
    depth: Floats  # (H, W) z in the target, 1 / nearness; inf where nothing is
    holes: NDArray[np.uint8]  # (H, W) values of `Hole`
    magnification: (
        Floats  # (H, W) px of the target per px of the source (areas); 0 where nothing is
    )
    confidence: (
        Floats  # (H, W) 0..1: how far the source's sampling, view and depth support the pixel
    )


class Warped(Showable, _WarpedDepth):
    """A warped depth image.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, warp
    >>> camera = Camera.from_fov(60, 24, 32)
    >>> ahead = camera.moved(np.c_[np.eye(3), [0, 0, -0.5]])
    >>> warped = warp(np.ones((24, 32, 3)), np.full((24, 32), 2.0), camera, ahead)
    >>> warped
    Warped(24 × 32 × 3 float32, 100 % covered)
    >>> round(warped.depth[12, 16].item(), 3), round(warped.magnification[12, 16].item(), 2)
    (1.5, 1.78)
    """

    __slots__ = ()

    is_preview = False  # whether fewer samples and pixels were used


class Previewed(Warped):
    """A quick preview of a warped depth image, made from fewer samples and pixels."""

    __slots__ = ()

    is_preview = True


class Method(Protocol):
    """Role of a warping method.

    A plugin is a class; its constructor takes options by name and rejects bad ones with a
    `ValueError`; its entry point is in the group `resample.warps`. With a pixel filter it is called
    for a frame of sub-pixels. A method that can only fill whole pixels has an attribute
    `is_per_pixel` that is True, and takes no filter; one with `is_whole` True covers a pixel fully
    as soon as anything is in it.
    """

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        """Warp a prepared depth image into a frame of (height, width) px."""
