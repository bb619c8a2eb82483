"""Convert volumes of other libraries: VTK, PyVista, SimpleITK, nibabel, xarray, yt."""

from collections.abc import Callable
from typing import Any

from resample_volume.types import Volume

Part = str | tuple[str, ...]  # name of an array or a field; yt's have two words
Taker = Callable[[Any, Part, str], Volume]  # of an object, a part of it and a name


def check_whole(part: Part, what: str) -> None:
    """Reject a part of an object without parts."""
    if part:
        raise ValueError(f"{what} is one volume, without a part {part!r:.60}; leave part out")
