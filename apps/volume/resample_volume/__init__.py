"""Volume rendering by hybrid forward resampling.

The names below are imported when they are first used, so that `import resample_volume` is quick.
"""

from typing import TYPE_CHECKING

from resample.lazy import attributes

if TYPE_CHECKING:
    from resample_volume.framing import Orbit
    from resample_volume.presets import load_transfer
    from resample_volume.rendering import Appearance, as_volume, render
    from resample_volume.shading import Light
    from resample_volume.source import open_volume
    from resample_volume.transfer import TransferFunction
    from resample_volume.types import Volume

_HOMES = {
    "Appearance": "rendering",
    "Light": "shading",
    "Orbit": "framing",
    "TransferFunction": "transfer",
    "Volume": "types",
    "as_volume": "rendering",
    "load_transfer": "presets",
    "open_volume": "source",
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
    "render",
]

__getattr__ = attributes(__name__, _HOMES)
