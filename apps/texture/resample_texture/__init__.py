"""Texture mapping and image warping by hybrid forward resampling.

The names below are imported on first use, so that `import resample_texture` is fast.
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
    from resample_texture.everyday import project, resize, rotate, scale, undistort
    from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Homography
    from resample_texture.methods.forward import Hybrid, Points, Splats, Supersample
    from resample_texture.methods.paper import Paper
    from resample_texture.scenes import PictureScene
    from resample_texture.types import Edge, Warped
    from resample_texture.viewing import view
    from resample_texture.warping import Plan, warp, warp_points

_NAMES = {  # by the module that has them
    "everyday": "project resize rotate scale undistort",
    "geometry.mappings": "BackwardMap ForwardMap Homography",
    "methods.forward": "Hybrid Points Splats Supersample",
    "methods.paper": "Paper",
    "scenes": "PictureScene",
    "types": "Edge Warped",
    "viewing": "view",
    "warping": "Plan warp warp_points",
}
_HOMES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = [
    "BackwardMap",
    "Edge",
    "ForwardMap",
    "Homography",
    "Hybrid",
    "Paper",
    "PictureScene",
    "Plan",
    "Points",
    "Splats",
    "Supersample",
    "Warped",
    "project",
    "resize",
    "rotate",
    "scale",
    "undistort",
    "view",
    "warp",
    "warp_points",
]

_MOVED = {  # to packages of plugins/; until the next release
    "chunks": "warp_chunks",
    "like.opencv": "linearPolar logPolar remap warpAffine warpPerspective warpPolar "
    "warp_like_opencv",
    "like.ndimage": "affine_transform map_coordinates zoom",
    "mosaics": "coadd control_points reproject",
}
_OLD = {name: module for module, names in _MOVED.items() for name in names.split()}

__getattr__ = attributes(__name__, _HOMES | _OLD)
__dir__ = listing(_HOMES)
