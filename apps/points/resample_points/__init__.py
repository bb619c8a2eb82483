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
    from resample_points.calls import animate, render
    from resample_points.calls import opened as open  # noqa: A004
    from resample_points.data.cloud import Cloud
    from resample_points.data.columns import join_clouds, select_points
    from resample_points.data.gaussians import (
        Gaussians,
        cropped_gaussians,
        joined_gaussians,
        placed_gaussians,
    )
    from resample_points.files.gaussians.formats import read_gaussians, write_gaussians
    from resample_points.files.readers import read_cloud
    from resample_points.geometry.framing import framed
    from resample_points.geometry.spacing import prepare_cloud
    from resample_points.painting.bending import ProjectedCamera
    from resample_points.painting.gaussians import GaussianStyle, gaussian_camera, render_gaussians
    from resample_points.painting.rasters import Raster, raster_of, rasterized
    from resample_points.painting.rendering import CloudStyle, index_cloud, render_cloud
    from resample_points.scenes import CloudScene
    from resample_points.viewing import view

_HOMES = {
    "Camera": "resample.cameras.models",
    "Cloud": "data.cloud",
    "CloudScene": "scenes",
    "CloudStyle": "painting.rendering",
    "GaussianStyle": "painting.gaussians",
    "Gaussians": "data.gaussians",
    "cropped_gaussians": "data.gaussians",
    "framed": "geometry.framing",
    "joined_gaussians": "data.gaussians",
    "placed_gaussians": "data.gaussians",
    "ProjectedCamera": "painting.bending",
    "Raster": "painting.rasters",
    "gaussian_camera": "painting.gaussians",
    "index_cloud": "painting.rendering",
    "join_clouds": "data.columns",
    "prepare_cloud": "geometry.spacing",
    "raster_of": "painting.rasters",
    "rasterized": "painting.rasters",
    "read_cloud": "files.readers",
    "read_gaussians": "files.gaussians.formats",
    "animate": "calls",
    "open": "calls:opened",
    "render": "calls",
    "render_cloud": "painting.rendering",
    "render_gaussians": "painting.gaussians",
    "select_points": "data.columns",
    "view": "viewing",
    "write_gaussians": "files.gaussians.formats",
}

__all__ = [
    "Camera",
    "Cloud",
    "CloudScene",
    "CloudStyle",
    "GaussianStyle",
    "Gaussians",
    "ProjectedCamera",
    "Raster",
    "animate",
    "cropped_gaussians",
    "framed",
    "gaussian_camera",
    "index_cloud",
    "join_clouds",
    "joined_gaussians",
    "open",
    "placed_gaussians",
    "prepare_cloud",
    "raster_of",
    "rasterized",
    "read_cloud",
    "read_gaussians",
    "render",
    "render_cloud",
    "render_gaussians",
    "select_points",
    "view",
    "write_gaussians",
]

# To `resample_particles`; until the next release.
_MOVED = dict.fromkeys(("DensityMap", "Particles", "column_density", "read_particles"), "particles")
__getattr__ = attributes(__name__, {**_HOMES, **_MOVED})
__dir__ = listing(_HOMES)
