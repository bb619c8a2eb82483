"""Parts of objects: arrays, fields, variables, of which some have several and some have none."""

from collections.abc import Callable
from typing import Any

from resample_volume.types import Volume

Part = str | tuple[str, ...]  # name of an array or a field; yt's have two words
Taker = Callable[[Any, Part, str], Volume]  # of an object, a part of it and a name


def check_whole(part: Part, what: str) -> None:
    """Refuse a part of what has none.

    Raises
    ------
    ValueError
        It is given.
    """
    if part:
        raise ValueError(f"{what} is one volume, without a part {part!r:.60}; leave part out")
