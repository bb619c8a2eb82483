"""3D warping of depth images by hybrid forward resampling.

The names below are imported on first use, so that `import resample_warp3d` is fast.
"""

from typing import TYPE_CHECKING

try:
    from resample.lazy import attributes, listing
except ModuleNotFoundError as error:
    raise ImportError(
        "`resample` is here another project's package, the distribution `resample`; "
        "pip uninstall resample, then pip install --force-reinstall --no-deps hybrid-resample"
    ) from error

if TYPE_CHECKING:
    from resample.cameras.models import Camera, Orthographic
    from resample.cameras.pixels import Equirectangular
    from resample_warp3d.calls import animate, render, stereo
    from resample_warp3d.depth.equation import between, of_rectified
    from resample_warp3d.depth.preparation import prepare
    from resample_warp3d.depth.refining.conditioning import refine
    from resample_warp3d.methods.hybrid import Hybrid
    from resample_warp3d.projection_models import StereoPanorama, mapping_between
    from resample_warp3d.scenes import DepthScene
    from resample_warp3d.sheet.sheets import background, behind
    from resample_warp3d.types import DepthImage, Equation, Hole, Source, Warped
    from resample_warp3d.viewing import view
    from resample_warp3d.views.multi_source import (
        Joining,
        PosedSource,
        agreed,
        merge,
        render_together,
    )
    from resample_warp3d.views.panoramas import SEAMLESS, panorama
    from resample_warp3d.warping import registered, warp, warp_disparity

_HOMES = {
    "Camera": "resample.cameras.models",
    "DepthImage": "types",
    "DepthScene": "scenes",
    "Equation": "types",
    "Equirectangular": "resample.cameras.pixels",
    "Hole": "types",
    "Hybrid": "methods.hybrid",
    "Joining": "views.multi_source",
    "Orthographic": "resample.cameras.models",
    "SEAMLESS": "views.panoramas",
    "Source": "types",
    "StereoPanorama": "projection_models",
    "PosedSource": "views.multi_source",
    "Warped": "types",
    "agreed": "views.multi_source",
    "animate": "calls",
    "background": "sheet.sheets",
    "behind": "sheet.sheets",
    "between": "depth.equation",
    "merge": "views.multi_source",
    "of_rectified": "depth.equation",
    "panorama": "views.panoramas",
    "prepare": "depth.preparation",
    "refine": "depth.refining.conditioning",
    "registered": "warping",
    "render": "calls",
    "render_together": "views.multi_source",
    "stereo": "calls",
    "view": "viewing",
    "warp": "warping",
    "mapping_between": "projection_models",
    "warp_disparity": "warping",
}

__all__ = [
    "SEAMLESS",
    "Camera",
    "DepthImage",
    "DepthScene",
    "Equation",
    "Equirectangular",
    "Hole",
    "Hybrid",
    "Joining",
    "Orthographic",
    "PosedSource",
    "Source",
    "StereoPanorama",
    "Warped",
    "agreed",
    "animate",
    "background",
    "behind",
    "between",
    "mapping_between",
    "merge",
    "of_rectified",
    "panorama",
    "prepare",
    "refine",
    "registered",
    "render",
    "render_together",
    "stereo",
    "view",
    "warp",
    "warp_disparity",
]

__getattr__ = attributes(__name__, _HOMES)
__dir__ = listing(_HOMES)
