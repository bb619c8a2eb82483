"""Write volumes to files."""

from pathlib import Path

import numpy as np

from resample.colors import to_srgb
from resample.console.backgrounds import Color
from resample.files.writing import replacing, save_array
from resample.painting.choices import MEASURING, Projection
from resample.resampler import Resampler
from resample.types import Frame
from resample_volume.files.formats.metaimage import write_metaimage
from resample_volume.files.formats.nifti import write_nifti
from resample_volume.files.formats.nrrd import write_nrrd
from resample_volume.files.headers import KEPT
from resample_volume.looks.transfer import DataRange, Transfer, TransferFunction, from_points
from resample_volume.media.appearance import Appearance, transfer_of
from resample_volume.media.xrays import AS_IT_IS, Tone, negative
from resample_volume.types import Volume

GRAYS = from_points([(0.0, (0.0,) * 3, 1.0), (1.0, (1.0,) * 3, 1.0)], normalized=True)
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
    """Suffix of a volume's file; refuses one that `write_volume` would refuse, before any work."""
    suffix = next((known for known in SUFFIXES if path.name.lower().endswith(known)), "")
    if not suffix:
        raise ValueError(f"{path}: volumes are written as {', '.join(SUFFIXES)}")
    return suffix


def with_bar(
    frame: Frame,
    volume: Volume,
    appearance: Appearance,
    resampler: Resampler,
    background: Color | None,
    tone: Tone = AS_IT_IS,
) -> Frame:
    """Picture with a bar of colors, opacities and values, or of sums, to its right."""
    from resample.measuring.color_bars import with_color_bar
    from resample_volume.looks.surveys import survey
    from resample_volume.showing.color_bar import color_bar

    transfer: Transfer = GRAYS
    scale = "" if resampler.projection is Projection.ADDITIVE else volume.scale
    if tone.window is not None:
        extent = tone.window
    elif resampler.projection is Projection.ADDITIVE:
        transfer, extent = _sums(frame)
    else:
        transfer = transfer_of(volume, appearance, resampler.projection)
        extent = survey(volume).span
        if resampler.projection in MEASURING and isinstance(transfer, TransferFunction):
            extent = extent if transfer.normalized else (transfer.value[0], transfer.value[-1])
    if tone.is_negative:
        transfer = _negative(transfer, extent)
    behind = background or (0.0, 0.0, 0.0)
    bar = color_bar(
        transfer, extent, len(frame.rgba), title=volume.name, background=behind, scale=scale
    )
    return frame._replace(rgba=with_color_bar(frame.rgba, bar, background))


def _negative(transfer: Transfer, extent: DataRange) -> Transfer:
    """What is shown of it with black and white exchanged, before black."""
    value = np.linspace(*extent, 256)
    color, opacity = transfer.looks(value, None, extent, 0.0)
    shown = to_srgb(negative(color * opacity[:, np.newaxis]))
    return TransferFunction(value, shown, np.ones(value.size))


def _sums(frame: Frame) -> tuple[Transfer, DataRange]:
    """What the gray levels of an X-ray mean: light grows with the sum, and the largest is white."""
    share = np.linspace(0.0, 1.0, 256)
    gray = np.repeat(to_srgb(share)[:, np.newaxis], 3, axis=1)
    value = np.zeros(1) if frame.value is None else frame.value
    known = value[np.isfinite(value)]
    levels = TransferFunction(share, gray, np.ones(share.size), normalized=True)
    return levels, (0.0, float(known.max(initial=0.0)))
