"""Convert images of SimpleITK and nibabel."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample_volume.exchange.parts import check_whole
from resample_volume.files.parsing.texts import is_hounsfield
from resample_volume.types import Volume

TO_LPS = np.diag([-1.0, -1.0, 1.0])  # from RAS, and back


def of_simple_itk(image: Any, part: Any, name: str) -> Volume:
    """Convert an image of SimpleITK's with its geometry; parameters as of `datasets.of_dataset`."""
    import SimpleITK

    check_whole(part, "an image of SimpleITK's")
    if image.GetDimension() != 3:
        raise ValueError(f"an image of {image.GetDimension()} dimensions; a volume has 3")
    return Volume(
        SimpleITK.GetArrayFromImage(image),
        np.array(image.GetSpacing(), np.float64),
        np.array(image.GetOrigin(), np.float64),
        np.array(image.GetDirection(), np.float64).reshape(3, 3),
        name,
    )


def of_nibabel(image: Any, part: Any, name: str) -> Volume:
    """Convert an image of nibabel's, of values or colors, to LPS.

    Values are scaled if its header says so, and otherwise as stored.
    """
    check_whole(part, "an image of nibabel's")
    if not (hasattr(image, "dataobj") and hasattr(image, "affine")):
        raise TypeError(f"a volume of nibabel's {type(image).__name__}; give an image of voxels")
    values = _colors(np.asanyarray(image.dataobj))
    while values.ndim > 3 and values.shape[3] == 1:
        values = values[..., 0, :] if values.ndim > 4 else values[..., 0]
    is_colored = image.get_data_dtype().names is not None
    if values.ndim != 3 + is_colored:
        sizes = " x ".join(map(str, values.shape))
        raise ValueError(f"an image of {sizes} holds several volumes; give .slicer[..., 0] of it")
    affine = np.eye(4) if image.affine is None else np.asarray(image.affine, np.float64)
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    steps = affine[:3, :3] / np.where(spacing > 0, spacing, 1)
    axes = (2, 1, 0, 3) if is_colored else (2, 1, 0)
    place = (spacing, TO_LPS @ affine[:3, 3], TO_LPS @ steps)
    return Volume(values.transpose(axes), *place, name, _units(image.header), space="lps")


def _units(header: Any) -> str:
    """Return the units of values, which NIfTI stores in the intent's name."""
    if not hasattr(header, "get_intent"):
        return ""
    return "hu" if is_hounsfield(str(header.get_intent()[2])) else ""


def _colors(values: NDArray[Any]) -> NDArray[Any]:
    """Move components named R, G, B to a last axis."""
    if values.dtype.names is None:
        return values
    return np.stack([values[each] for each in values.dtype.names], axis=-1)
