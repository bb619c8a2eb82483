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
    from resample_texture.chunks import warp_chunks
    from resample_texture.everyday import project, resize, rotate, scale, undistort
    from resample_texture.geometry.control import control_points
    from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Homography
    from resample_texture.like.opencv import warp_like_opencv
    from resample_texture.methods.forward import Hybrid, Points, Splats, Supersample
    from resample_texture.methods.paper import Paper
    from resample_texture.scenes import PictureScene
    from resample_texture.types import Edge, Warped
    from resample_texture.viewing import view
    from resample_texture.warping import Plan, warp, warp_points

_NAMES = {  # by the module that has them
    "chunks": "warp_chunks",
    "everyday": "project resize rotate scale undistort",
    "geometry.control": "control_points",
    "geometry.mappings": "BackwardMap ForwardMap Homography",
    "like.opencv": "warp_like_opencv",
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
    "control_points",
    "project",
    "resize",
    "rotate",
    "scale",
    "undistort",
    "view",
    "warp",
    "warp_chunks",
    "warp_like_opencv",
    "warp_points",
]

_MOVED = {"coadd": "mosaics", "reproject": "mosaics"}  # to `resample_sky`; until the next release

_LIKE = {  # other libraries' names, of what the calls above do in their way
    "like.opencv": "remap warpAffine warpPerspective warpPolar linearPolar logPolar",
    "like.ndimage": "affine_transform map_coordinates zoom",
}
_THEIRS = {name: module for module, names in _LIKE.items() for name in names.split()}

__getattr__ = attributes(__name__, _HOMES | _MOVED | _THEIRS)
__dir__ = listing(_HOMES)
