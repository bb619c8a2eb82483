"""What a picture of volumes holds in memory at its height.

Measured as the highest mark of fresh processes (`python -m benchmarks.memory`). How many voxels can
be seen is known when they have been counted, so what is needed is said twice: of the values and the
picture before they are looked at, and of all before anything is lit and painted. Volumes in chunks
(`Bricks`), and what is in a file meanwhile, count their own.
"""

from collections.abc import Sequence
from math import prod

from resample.command.session import libraries
from resample.memory import require
from resample.memory.mapped import is_in_file
from resample_volume.data.bricks import Bricks, Values
from resample_volume.media.appearance import Medium
from resample_volume.rendering import Fit, Subject
from resample_volume.types import Volume
from resample_volume.voxels.gathered import Gathered

BYTES_PER_PIXEL = 80  # of a picture and the copies that are made when it is written
LOOKED_AT = 4  # bytes per voxel of what is made of values while they are looked at
LOOKED_AT_FLOATS = 18  # the same of values that are no whole numbers
SEEN, SEEN_OF_FIELD = 58, 22  # bytes of a voxel that can be seen; of a field that rays gather
REMEDY = "take a smaller or downsampled volume, or show less of it"


def require_room(
    media: Sequence[Medium],
    size: tuple[int, int],
    subject: Subject | None = None,
    fit: Fit = "visible",
) -> None:
    """Refuse what memory does not hold, and say (DEBUG) what is needed.

    Parameters
    ----------
    media
        Volumes, read, with their looks.
    size
        Height and width of the picture, px.
    subject
        What can be seen of them, once that is known.
    fit
        What cameras are placed around.

    Raises
    ------
    ValueError
        It needs more than is allowed, or free.
    """
    volumes = [volume for volume, _ in media]
    if any(is_in_bricks(volume) or is_in_file(volume.values) for volume in volumes):
        return
    parts = {"libraries": libraries(), "values": sum(_bytes_of(volume) for volume in volumes)}
    parts["the picture"] = BYTES_PER_PIXEL * size[0] * size[1]
    what = volumes[0].name or "the volume"
    if subject is not None:
        parts[f"{subject.seen} visible voxels"] = _bytes_of_seen(subject.voxels, fit) * subject.seen
        if isinstance(subject.voxels, Gathered) and subject.voxels.thin.parts > 1:
            parts["slices between thick ones"] = subject.voxels.spline.coefficient.nbytes
    require(what, parts, REMEDY)


def _bytes_of_seen(voxels: object, fit: Fit) -> int:
    """Of a voxel; of a field they are looked at only for where a camera is, and for slopes."""
    if not isinstance(voxels, Gathered):
        return SEEN
    return SEEN_OF_FIELD if fit == "visible" or len(voxels.looks.table) > 1 else 0


def is_in_bricks(volume: Volume) -> bool:
    """Whether a volume's values stay in their file."""
    values: Values = volume.values
    return isinstance(values, Bricks)


def _bytes_of(volume: Volume) -> int:
    kind = volume.values.dtype
    looked_at = LOOKED_AT if kind.kind in "bui" else LOOKED_AT_FLOATS
    return (kind.itemsize + looked_at) * prod(volume.values.shape)
