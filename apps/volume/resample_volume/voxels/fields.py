"""Tables of what a field's values look like."""

import numpy as np

from resample_volume.classification.surveys import survey
from resample_volume.classification.transfer import Transfer
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light

COLUMNS = 4096  # columns of a table of looks; integer values fall on columns
MOST_COLUMNS = 1 << 16
MARGIN = (
    64  # values beyond each end of the robust range whose looks are compared with those of the ends
)

UNLIT = Light(ambient=1.0, diffuse=0.0, specular=0.0)


def check_iso(iso: float | None, volume: Volume, data_range: tuple[float, float]) -> None:
    """Reject an isosurface of a value that the data do not cross."""
    low, high = data_range
    if iso is not None and not low < iso <= high and np.isfinite(volume.values).any():
        raise ValueError(
            f"there is no surface of the value {iso:g}: {volume.name} holds {low:g} to {high:g}"
        )


def table_range(
    volume: Volume, transfer: Transfer, data_range: tuple[float, float]
) -> tuple[float, float]:
    """Return the range of a table of looks: without outliers if these look like its ends."""
    (low, high), (least, greatest) = survey(volume).span, data_range
    if (low, high) == data_range:
        return data_range
    value = np.concatenate([np.linspace(least, low, MARGIN), np.linspace(high, greatest, MARGIN)])
    flat = np.zeros(value.size, np.float32) if transfer.needs_gradient else None
    color, opacity = transfer.classify(value, flat, data_range, 1.0)
    look = np.column_stack([color, opacity]).reshape(2, MARGIN, 4)
    same = (look[0] == look[0, -1]).all() and (look[1] == look[1, 0]).all()
    return (low, high) if same else data_range


def columns_of(volume: Volume, data_range: tuple[float, float]) -> int:
    """Return the number of columns of a table of looks, such that integers fall on columns."""
    span = data_range[1] - data_range[0]
    if volume.values.dtype.kind not in "iu" or not 1 <= span < MOST_COLUMNS:
        return COLUMNS
    return int(span) * max(1, COLUMNS // int(span)) + 1
