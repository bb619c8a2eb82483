"""What a page says of a volume in words and numbers: points of a look, picks, histograms."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from resample.painting.choices import Projection
from resample_volume.classification.scales import scale_named, value_at
from resample_volume.classification.surveys import survey
from resample_volume.editing import points_of, spelled
from resample_volume.media.appearance import named_transfer, transfer_of
from resample_volume.picking import Picked
from resample_volume.space.lines import measure
from resample_volume.types import Volume
from resample_volume.viewing.requests import VolumeRequest
from resample_volume.voxels.visible import unit_of

BINS = 256


def transfer_points(volume: Volume, request: VolumeRequest) -> dict[str, Any]:
    """Return the points of a look's curves, and whether a window spreads it."""
    transfer = transfer_of(volume, request.appearance, request.resampler.projection)
    points = [
        (float(value_at(place, volume.scale)), color, opacity)
        for place, color, opacity in points_of(transfer, survey(volume).span)
    ]
    name, projection = request.choices.transfer, request.resampler.projection
    return {
        "points": points,
        "transfer": spelled(points),
        "unit": transfer.opacity_unit,
        "usual": unit_of(named_transfer(name, volume, projection), volume),
        "windowed": _takes_window(volume, name, projection),
    }


def _takes_window(volume: Volume, name: str, projection: Projection) -> bool:
    """Return whether a window spreads a look; others are in data units already."""
    try:
        named_transfer(name, volume, projection, survey(volume).span)
    except ValueError:
        return False
    return True


def pick_distances(picks: Sequence[Picked], volume: Volume) -> dict[str, str]:
    """Return the length and angle between the last two or three picked voxels."""
    if len(picks) < 2:
        return {}
    length = measure(*picks[-2:], volume=volume)
    told = {"distance": f"{length.distance:.6g} {length.unit}".rstrip()}
    if len(picks) == 3 and length.distance and measure(*picks[:2]).distance:
        told["angle"] = f"{measure(*picks).angle:.4g}°"
    return told


def histogram(volume: Volume, span: tuple[float, float]) -> dict[str, Any]:
    """Return the histogram of values in the robust range."""
    low, high = span
    values = np.asarray(volume.values)
    count, _ = np.histogram(values[np.isfinite(values)], BINS, (low, max(high, low + 1e-30)))
    by = scale_named(volume.scale)
    scale = {} if by is None else {"scale": "log" if by.linear is None else "symlog"}
    linear = {} if by is None or by.linear is None else {"linear": by.linear}
    return {"low": low, "high": high, "counts": count.tolist(), **scale, **linear}
