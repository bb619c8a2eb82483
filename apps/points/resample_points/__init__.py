"""Point clouds: points where they are small on screen, splats where they are large.

The names below are imported on first use, so that `import resample_points` is fast.
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
    from resample.cameras.models import Camera
    from resample_points.data.cloud import Cloud
    from resample_points.data.selecting import join_clouds, select_points
    from resample_points.files.readers import read_cloud
    from resample_points.geometry.framing import framed
    from resample_points.geometry.spacing import prepare_cloud
    from resample_points.painting.bending import ProjectedCamera
    from resample_points.painting.indexing import index_cloud
    from resample_points.painting.rendering import CloudStyle, render_cloud
    from resample_points.scenes import CloudScene
    from resample_points.viewing import view

_HOMES = {
    "Camera": "resample.cameras.models",
    "Cloud": "data.cloud",
    "CloudScene": "scenes",
    "CloudStyle": "painting.rendering",
    "ProjectedCamera": "painting.bending",
    "framed": "geometry.framing",
    "index_cloud": "painting.indexing",
    "join_clouds": "data.selecting",
    "prepare_cloud": "geometry.spacing",
    "read_cloud": "files.readers",
    "render_cloud": "painting.rendering",
    "select_points": "data.selecting",
    "view": "viewing",
}

__all__ = [
    "Camera",
    "Cloud",
    "CloudScene",
    "CloudStyle",
    "ProjectedCamera",
    "framed",
    "index_cloud",
    "join_clouds",
    "prepare_cloud",
    "read_cloud",
    "render_cloud",
    "select_points",
    "view",
]

__getattr__ = attributes(__name__, _HOMES)
__dir__ = listing(_HOMES)
