"""Read labels of voxels."""

from collections.abc import Sequence

from resample_volume.classification.labels import Labels, check_known, parse_rules
from resample_volume.data.recordings import volume_at
from resample_volume.data.values import is_streamed
from resample_volume.files.source import open_streamed, open_volume
from resample_volume.types import Volume


def read_labels(path: str, rules: Sequence[str], volume: Volume) -> Labels:
    """Read the labels of a volume's voxels from a file.

    Parameters
    ----------
    rules
        Each such as `1:color=tomato,opacity=0.5` or `2:hidden`, one for a label.
    """
    chosen = parse_rules(rules)
    try:
        found = _volume_of(path, is_streamed(volume))
        if found.colors is not None:
            raise ValueError("labels are whole numbers, one for each voxel, not colors")
        labels = Labels(found.values, chosen)
        labels.check(volume)
        check_known(labels)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return labels


def _volume_of(path: str, streamed: bool) -> Volume:
    """Open the volume of labels, streamed if possible and wanted."""
    held = open_streamed(path) if streamed else None
    return open_volume(path) if held is None else volume_at(held, None, None)
