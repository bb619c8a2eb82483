"""3D warping of depth images by hybrid forward resampling.

The names below are imported when they are first used, so that `import resample_warp3d` is quick.
"""

from typing import TYPE_CHECKING

from resample.lazy import attributes

if TYPE_CHECKING:
    from resample.cameras.models import Camera
    from resample_warp3d.depth.equation import between, of_rectified
    from resample_warp3d.depth.preparation import prepare
    from resample_warp3d.merging import merge
    from resample_warp3d.methods.hybrid import Hybrid
    from resample_warp3d.sheet.behind import background, behind
    from resample_warp3d.types import DepthImage, Equation, Hole, Source, Warped
    from resample_warp3d.views.together import Joining, Standing, agreed, render_together
    from resample_warp3d.warping import render, warp, warp_disparity

_HOMES = {
    "Camera": "resample.cameras.models",
    "DepthImage": "types",
    "Equation": "types",
    "Hole": "types",
    "Hybrid": "methods.hybrid",
    "Joining": "views.together",
    "Source": "types",
    "Standing": "views.together",
    "Warped": "types",
    "agreed": "views.together",
    "background": "sheet.behind",
    "behind": "sheet.behind",
    "between": "depth.equation",
    "merge": "merging",
    "of_rectified": "depth.equation",
    "prepare": "depth.preparation",
    "render": "warping",
    "render_together": "views.together",
    "warp": "warping",
    "warp_disparity": "warping",
}

__all__ = [
    "Camera",
    "DepthImage",
    "Equation",
    "Hole",
    "Hybrid",
    "Joining",
    "Source",
    "Standing",
    "Warped",
    "agreed",
    "background",
    "behind",
    "between",
    "merge",
    "of_rectified",
    "prepare",
    "render",
    "render_together",
    "warp",
    "warp_disparity",
]

__getattr__ = attributes(__name__, _HOMES)
