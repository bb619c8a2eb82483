"""Hybrid forward resampling: points where samples shrink, splats where they grow.

The names below are imported on first use, so that `import resample` is fast.
"""

from typing import TYPE_CHECKING, Any

from resample.lazy import attributes, listing, warn_of_namesake
from resample.showable import register_exporter

if TYPE_CHECKING:
    from resample.cameras.models import Camera, Orthographic
    from resample.cameras.poses import look_at, orbit
    from resample.cameras.viewpoints import Orbit
    from resample.jobs import open, render, resize, stereo, warp  # noqa: A004
    from resample.library import Scatter, Scattering, particles
    from resample.painting.choices import Footprint, Opacity, Primitive
    from resample.progress import Cancel, CancelledError, cancellable
    from resample.resampler import Resampler
    from resample.samples.finding import sample, sample_path
    from resample.types import Frame, Samples

_HOMES = {
    "Camera": "cameras.models",
    "Cancel": "progress",
    "CancelledError": "progress",
    "Footprint": "painting.choices",
    "Frame": "types",
    "Opacity": "painting.choices",
    "Orbit": "cameras.viewpoints",
    "Orthographic": "cameras.models",
    "Primitive": "painting.choices",
    "Resampler": "resampler",
    "Samples": "types",
    "Scatter": "library",
    "Scattering": "library",
    "cancellable": "progress",
    "look_at": "cameras.poses",
    "open": "jobs",
    "orbit": "cameras.poses",
    "particles": "library",
    "render": "jobs",
    "resize": "jobs",
    "sample": "samples.finding",
    "sample_path": "samples.finding",
    "stereo": "jobs",
    "warp": "jobs",
}

__all__ = [
    "Camera",
    "Cancel",
    "CancelledError",
    "Footprint",
    "Frame",
    "Opacity",
    "Orbit",
    "Orthographic",
    "Primitive",
    "Resampler",
    "Samples",
    "Scatter",
    "Scattering",
    "cancellable",
    "look_at",
    "open",
    "orbit",
    "particles",
    "render",
    "resize",
    "sample",
    "sample_path",
    "stereo",
    "warp",
]


def _exporter() -> Any:
    from resample.files import conversion

    return conversion


warn_of_namesake(__path__[0])
register_exporter(_exporter)
__getattr__ = attributes(__name__, _HOMES | {"view": "view:", "_view": "jobs:view"})
__dir__ = listing(_HOMES)
