"""Volume rendering by hybrid forward resampling.

The names below are imported when they are first used, so that `import resample_volume` is quick.
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
    from resample.cameras.viewpoints import Orbit
    from resample_volume.annotations import Annotations, annotate, measure
    from resample_volume.appearance import Appearance, XRay
    from resample_volume.calls import animate, render
    from resample_volume.classification.presets import load_transfer
    from resample_volume.classification.transfer import TransferFunction
    from resample_volume.data.rectilinear import rectilinear
    from resample_volume.files.source import open_volume
    from resample_volume.files.source import open_volume as open  # noqa: A004
    from resample_volume.inputs import as_volume
    from resample_volume.meshes import ImagePlane, IsoSurface, SceneMesh, read_mesh, scene_mesh
    from resample_volume.scenes import Scene
    from resample_volume.types import Volume
    from resample_volume.viewing import picture, view
    from resample_volume.voxels.shading import Light

_HOMES = {
    "Annotations": "annotations",
    "Appearance": "appearance",
    "ImagePlane": "meshes",
    "IsoSurface": "meshes",
    "Light": "voxels.shading",
    "Orbit": "resample.cameras.viewpoints",
    "Scene": "scenes",
    "SceneMesh": "meshes",
    "TransferFunction": "classification.transfer",
    "Volume": "types",
    "XRay": "appearance",
    "animate": "calls",
    "annotate": "annotations",
    "as_volume": "inputs",
    "load_transfer": "classification.presets",
    "measure": "annotations",
    "open": "files.source:open_volume",
    "open_volume": "files.source",
    "read_mesh": "meshes",
    "picture": "viewing",
    "rectilinear": "data.rectilinear",
    "render": "calls",
    "scene_mesh": "meshes",
    "view": "viewing",
}

# fmt: off
__all__ = [
    "Annotations", "Appearance", "ImagePlane", "IsoSurface", "Light", "Orbit", "Scene", "SceneMesh",
    "TransferFunction", "Volume", "XRay", "animate", "annotate", "as_volume", "load_transfer",
    "measure", "open", "open_volume", "picture", "read_mesh", "rectilinear", "render", "scene_mesh",
    "view",
]
# fmt: on

__getattr__ = attributes(__name__, _HOMES)
__dir__ = listing(_HOMES)
