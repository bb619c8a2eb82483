"""Write volumes to files."""

from pathlib import Path

import numpy as np

from resample.images import replacing
from resample_volume.types import Volume

SUFFIXES = (".nrrd", ".mha", ".nii", ".nii.gz", ".npy")


def write_volume(path: Path, volume: Volume) -> None:
    """Write a volume with its spacing, origin and direction (.npy: the values alone).

    Raises
    ------
    ValueError
        The suffix is none of `SUFFIXES`.
    OSError
        The file cannot be written.
    """
    name = path.name.lower()
    if not name.endswith(SUFFIXES):
        raise ValueError(f"{path}: volumes are written as {', '.join(SUFFIXES)}")
    with replacing(path) as temporary:
        if name.endswith(".npy"):
            np.save(temporary, volume.values)
        elif name.endswith(".nii.gz"):  # the temporary name ends in .gz alone
            inner = temporary.with_name(f"{temporary.name}.nii.gz")
            try:
                _write_image(inner, volume)
                inner.replace(temporary)
            finally:
                inner.unlink(missing_ok=True)
        else:
            _write_image(temporary, volume)


def _write_image(path: Path, volume: Volume) -> None:
    import SimpleITK as sitk  # noqa: N813 - the library's own habit

    image = sitk.GetImageFromArray(volume.values)
    image.SetSpacing(tuple(map(float, volume.spacing)))
    image.SetOrigin(tuple(map(float, volume.origin)))
    image.SetDirection(tuple(map(float, volume.direction.ravel())))
    try:
        sitk.WriteImage(image, str(path), useCompression=True)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise OSError(f"{path}: could not be written ({reason})") from None
