"""Write volumes to files."""

from pathlib import Path

from resample.files.writing import replacing, save_array
from resample_volume.files.formats.metaimage import write_metaimage
from resample_volume.files.formats.nifti import write_nifti
from resample_volume.files.formats.nrrd import write_nrrd
from resample_volume.files.parsing.headers import KEPT
from resample_volume.types import Volume

SUFFIXES = (".nrrd", ".mha", ".nii", ".nii.gz", ".npy")


def write_volume(path: Path, volume: Volume) -> None:
    """Write a volume with its spacing, origin and direction (.npy: values only)."""
    suffix = check_suffix(path)
    with replacing(path) as temporary:
        if suffix == ".npy":
            save_array(temporary, volume.values)
            return
        if volume.values.ndim != 3 or volume.values.dtype.name not in KEPT:
            raise OSError(f"{path}: {volume.values.dtype} {volume.values.shape} is no volume")
        if suffix == ".nrrd":
            write_nrrd(temporary, volume)
        elif suffix == ".mha":
            write_metaimage(temporary, volume)
        else:
            write_nifti(temporary, volume, is_packed=suffix == ".nii.gz")


def check_suffix(path: Path) -> str:
    """Return a file's suffix; reject one that `write_volume` cannot write, before any work."""
    suffix = next((known for known in SUFFIXES if path.name.lower().endswith(known)), "")
    if not suffix:
        raise ValueError(f"{path}: volumes are written as {', '.join(SUFFIXES)}")
    return suffix
