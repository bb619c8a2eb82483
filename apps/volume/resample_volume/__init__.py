"""Volume rendering by hybrid forward resampling.

The names below are imported when they are first used, so that `import resample_volume` is quick.
"""

from typing import TYPE_CHECKING

from resample.lazy import attributes

if TYPE_CHECKING:
    from resample.cameras.viewpoints import Orbit
    from resample_volume.files.source import open_volume
    from resample_volume.inputs import as_volume
    from resample_volume.looks.presets import load_transfer
    from resample_volume.looks.transfer import TransferFunction
    from resample_volume.media.rectilinear import rectilinear
    from resample_volume.rendering import Appearance, render
    from resample_volume.types import Volume
    from resample_volume.voxels.shading import Light

_HOMES = {
    "Appearance": "rendering",
    "Light": "voxels.shading",
    "Orbit": "resample.cameras.viewpoints",
    "TransferFunction": "looks.transfer",
    "Volume": "types",
    "as_volume": "inputs",
    "load_transfer": "looks.presets",
    "open_volume": "files.source",
    "rectilinear": "media.rectilinear",
    "render": "rendering",
}

__all__ = [
    "Appearance",
    "Light",
    "Orbit",
    "TransferFunction",
    "Volume",
    "as_volume",
    "load_transfer",
    "open_volume",
    "rectilinear",
    "render",
]

__getattr__ = attributes(__name__, _HOMES)
