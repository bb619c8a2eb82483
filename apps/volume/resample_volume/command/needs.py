"""Peak memory of a picture of volumes.

Measured as the peak of fresh processes (`python -m benchmarks.memory`). The number of visible
voxels is known only once they are counted, so memory is checked twice: for values and picture
before the scan, and for everything before shading and painting. Chunked volumes (`Bricks`) and
mapped files keep their own account.
"""

from collections.abc import Sequence
from math import prod

from resample.command.session import libraries
from resample.memory import require
from resample.memory.mapped import is_in_file
from resample_volume.data.values import is_streamed
from resample_volume.media.appearance import VolumeLayer
from resample_volume.rendering import Fit, Subject
from resample_volume.types import Volume
from resample_volume.voxels.gathered import Gathered

BYTES_PER_PIXEL = 80  # of a picture and its copies for writing
SCANNED = 4  # bytes of temporaries per voxel during the scan
SCANNED_FLOATS = 18  # the same for values of floating point
VISIBLE, VISIBLE_OF_FIELD = 58, 22  # bytes per visible voxel; per voxel of a ray cast field
REMEDY = "take a smaller or downsampled volume, or show less of it"


def check_memory(
    media: Sequence[VolumeLayer],
    size: tuple[int, int],
    subject: Subject | None = None,
    fit: Fit = "visible",
) -> None:
    """Reject a picture that does not fit in memory, and log (DEBUG) what it needs.

    Parameters
    ----------
    size
        Height and width of the picture, px.
    subject
        Their visible voxels, once known.
    """
    volumes = [volume for volume, _ in media]
    if any(is_streamed(volume) or is_in_file(volume.values) for volume in volumes):
        return
    parts = {"libraries": libraries(), "values": sum(_bytes_of(volume) for volume in volumes)}
    parts["the picture"] = BYTES_PER_PIXEL * size[0] * size[1]
    what = volumes[0].name or "the volume"
    if subject is not None:
        parts[f"{subject.visible} visible voxels"] = (
            _bytes_per_visible(subject.voxels, fit) * subject.visible
        )
        if isinstance(subject.voxels, Gathered) and subject.voxels.thin.parts > 1:
            parts["slices between thick ones"] = subject.voxels.spline.coefficient.nbytes
    require(what, parts, REMEDY)


def _bytes_per_visible(voxels: object, fit: Fit) -> int:
    """Bytes per visible voxel; a field needs these only to place a camera and for slopes."""
    if not isinstance(voxels, Gathered):
        return VISIBLE
    return VISIBLE_OF_FIELD if fit == "visible" or len(voxels.table.table) > 1 else 0


def _bytes_of(volume: Volume) -> int:
    kind = volume.values.dtype
    looked_at = SCANNED if kind.kind in "bui" else SCANNED_FLOATS
    return (kind.itemsize + looked_at) * prod(volume.values.shape)
