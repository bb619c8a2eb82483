"""The application's own nouns.

Continuous pixel coordinates everywhere: the pixel in row i, column j covers
[j, j + 1) × [i, i + 1) and has its center at (j + 0.5, i + 0.5), in the source as in the target.
Cameras look along +z, x to the right and y down; poses map world to camera.

McMillan's warping equation takes a pixel x₁ of the source to x₂ ~ M x₁ + δ(x₁) e, with a matrix M,
the epipole e (where the target's picture shows the source's eye) and a generalised disparity δ. Two
cameras give M = K₂ R K₁⁻¹, e = K₂ t and δ = 1 / z; a rectified pair M = 1, e = (−1, 0, 0) and δ in
px. Nearer is larger; 0 is nothing known. What divides by the third coordinate of x₂ is δ as the
target sees it, which is called *nearness* here and linear on planes, in both views.
"""

from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from resample.showable import Showable
from resample.types import Doubles, Floats

Links = NDArray[np.uint8]

# Bits of a sample's links: that neighbour lies on the same surface. A link has two ends.
RIGHT, DOWN, LEFT, UP = 1, 2, 4, 8
TURNS = 16  # times one of those, in a sheet: beyond that side the surface turns away
MARGIN = 2  # samples around a sheet that nothing is linked with; colors are interpolated from five
AS_GIVEN: Floats = np.empty((0, 0), np.float32)  # trust in depth that was not refined


class Hole(IntEnum):
    """Why a pixel of the target is what it is.

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

    NONE = 0  # covered, wholly or in part
    DISOCCLUDED = 1  # the source has something nearer in the way
    OUTSIDE = 2  # beyond the source's frame
    NO_DEPTH = 3  # the source shows it but knows no depth there
    CRACK = 4  # a gap between samples, filled from both its sides


class DepthImage(NamedTuple):
    """A picture and how far everything in it is.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, prepare
    >>> color, depth = np.ones((24, 32, 3), np.float32), np.full((24, 32), 2.0)
    >>> image = DepthImage(color, np.float32(1 / depth), np.empty((0, 0, 2)))  # without a lens
    >>> prepare(image).nearness[12, 16].item()
    0.5
    """

    color: Floats  # (H, W, C) linear light, premultiplied where a channel is opacity
    nearness: Floats  # (H, W) δ; 0 where there is none
    place: Doubles  # (H, W, 2) where a camera without distortion sees each sample, px; or (0, 0, 2)


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
        """Equation that leads to a frame (3, 3) of the target's."""
        return Equation(matrix @ self.matrix, matrix @ self.epipole)


class Sheet(NamedTuple):
    """A depth image as a sheet of cells, one around each sample, torn where surfaces end."""

    color: Floats  # (G, 3, H + 4, W + 4) groups of channels; surfaces without the others' light
    vertex: Floats  # (H + 1, W + 1) nearness at the lattice's corners; 0 where the sheet is torn
    place: Doubles  # (H + 1, W + 1, 2) where a camera without distortion sees them; or (0, 0, 2)
    torn: NDArray[np.int32]  # (H, W) row of `corner`; −1: corners of the lattice, −2: no cell
    corner: Floats  # (N, 4, 3) x, y and nearness of torn cells' corners, row by row
    links: Links  # (H + 4, W + 4) of the source, and TURNS; MARGIN of nothing around, as of colors
    ends: NDArray[np.int32]  # (M, 2) rows of `corner` and its corners where surfaces turn away
    roundness: Floats  # (M, 2) of them: squared nearness per px, outward, along x and y


class Source(NamedTuple):
    """A depth image prepared for warping; see `resample_warp3d.depth.preparation`.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, prepare
    >>> noise = np.random.default_rng(1).normal(0, 0.002, (64, 64))
    >>> color, nearness = np.ones((64, 64, 3), np.float32), np.float32(0.5 * (1 + noise))
    >>> source = prepare(DepthImage(color, nearness, np.empty((0, 0, 2))))
    >>> round(source.noise, 3), bool(source.nearness.std() < nearness.std() / 2)  # smoothed
    (0.002, True)
    """

    color: Floats  # (H, W, C)
    nearness: Floats  # (H, W) smoothed along surfaces where it is noisy or coarse; 0: none
    slope: Floats  # (H, W, 2) change of nearness to the next column and row, on the surface
    links: Links  # (H, W) which neighbours are on the same surface
    place: Doubles  # (H, W, 2) as in DepthImage
    noise: float  # standard deviation of the nearness, relative to it
    step: float = 0.0  # smallest difference of nearness that is told apart
    trust: Floats = AS_GIVEN  # (H, W) 0..1: how sure refined depth is; or (0, 0)


class Rendered(NamedTuple):
    """What a method makes of a source in the frame of a target."""

    image: Floats  # (H, W, C) multiplied by the coverage
    coverage: Floats  # (H, W) 0..1
    nearness: Floats  # (H, W) of the nearest surface; 0 where nothing is
    magnification: (
        Floats  # (H, W) px of the target per px of the source (areas); 0 where nothing is
    )
    bridged: NDArray[np.bool_]  # (H, W) filled between samples


class _Warped(NamedTuple):
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


class Warped(Showable, _Warped):
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

    is_preview = False  # whether it is of fewer samples and pixels than there are


class Previewed(Warped):
    """A warped depth image that was made quickly, of fewer samples and pixels than there are."""

    __slots__ = ()

    is_preview = True


class Method(Protocol):
    """Role of a way to warp.

    A plugin is a class whose constructor takes the user's choices by name and refuses bad ones with
    a `ValueError`; its entry point stands in the group `resample.warps`. Under a pixel filter it is
    asked for a frame of sub-pixels. A method that can only fill whole pixels has an attribute
    `is_per_pixel` that is True, and takes no filter; one with `is_whole` True covers a pixel wholly
    as soon as anything is in it.
    """

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        """Warp a prepared depth image into a frame of (height, width) px."""
