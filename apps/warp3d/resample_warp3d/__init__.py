"""3D warping of depth images by hybrid forward resampling.

The names below are imported when they are first used, so that `import resample_warp3d` is quick.
"""

from typing import TYPE_CHECKING

from resample.lazy import attributes

if TYPE_CHECKING:
    from resample.cameras.models import Camera
    from resample_warp3d.depth.equation import between, of_rectified
    from resample_warp3d.depth.preparation import prepare
    from resample_warp3d.depth.refining.conditioning import refine
    from resample_warp3d.depth.refining.registering import registered
    from resample_warp3d.merging import merge
    from resample_warp3d.methods.hybrid import Hybrid
    from resample_warp3d.types import DepthImage, Equation, Hole, Source, Warped
    from resample_warp3d.warping import render, warp, warp_disparity

_HOMES = {
    "Camera": "resample.cameras.models",
    "DepthImage": "types",
    "Equation": "types",
    "Hole": "types",
    "Hybrid": "methods.hybrid",
    "Source": "types",
    "Warped": "types",
    "between": "depth.equation",
    "merge": "merging",
    "of_rectified": "depth.equation",
    "prepare": "depth.preparation",
    "refine": "depth.refining.conditioning",
    "registered": "depth.refining.registering",
    "render": "warping",
    "warp": "warping",
    "warp_disparity": "warping",
}

__all__ = [
    "Camera",
    "DepthImage",
    "Equation",
    "Hole",
    "Hybrid",
    "Source",
    "Warped",
    "between",
    "merge",
    "of_rectified",
    "prepare",
    "refine",
    "registered",
    "render",
    "warp",
    "warp_disparity",
]

__getattr__ = attributes(__name__, _HOMES)
