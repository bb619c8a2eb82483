"""Volumes as the command line's files and words give them."""

from pathlib import Path

import numpy as np

from resample import registry
from resample_volume.command.choices import Source
from resample_volume.files.readers import Raw, three_numbers
from resample_volume.files.source import open_volume
from resample_volume.types import Volume


def opened(source: Source, name: str) -> Volume:
    """Volume of that name, a file, a folder or what is generated.

    Raises
    ------
    ValueError, LookupError, OSError
        See `resample_volume.files.source.open_volume`.
    """
    if not name:
        raise ValueError("the volume has no name; give a file, a folder or checker-box")
    reader = None if source.reader is None else registry.build("readers", source.reader)
    if source.shape is not None or source.dtype is not None:
        if reader is not None:
            raise ValueError("give either a reader or shape and dtype, not both")
        reader = Raw(shape=source.shape or "", dtype=source.dtype or "")
    volume = open_volume(Path(name) if Path(name).exists() else name, reader)
    if source.spacing is not None:
        volume = volume._replace(spacing=np.array(three_numbers("spacing", source.spacing)))
    return volume
