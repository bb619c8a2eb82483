"""Sizes of pictures, looked at before their pixels are decoded."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from resample.reading.limits import check_free, check_unpacked
from resample.words import one_line

FORMS = {"uint8": 1, "int8": 1, "uint16": 2, "int16": 2, "half": 2, "double": 8}  # others have 4


def check_picture(path: str | Path, spec: Any, size: int | None = None) -> None:
    """Refuse a picture that unpacks to far more than its file can honestly hold, or than is free.

    Parameters
    ----------
    path
        The file.
    spec
        Header of it, as OpenImageIO has it.
    size
        Bytes of a value in memory; as it is stored.

    Raises
    ------
    ValueError
        It does, or it has no pixels.
    """
    count, stored = check_honest(path, spec)
    check_free(str(path), count * (size or stored))


def check_honest(path: str | Path, spec: Any) -> tuple[int, int]:
    """Refuse a picture that unpacks to far more than its file can honestly hold, or to nothing.

    Returns
    -------
    How many values it has, and bytes of each.

    Raises
    ------
    ValueError
        So it does.
    """
    shape = (spec.width, spec.height, max(1, spec.depth), spec.nchannels)
    if min(shape) < 1:
        raise ValueError(f"{path} has {spec.width} x {spec.height} pixels; get the file again")
    count, stored = math.prod(shape), FORMS.get(str(spec.format), 4)
    check_unpacked(str(path), Path(path).stat().st_size, count * stored)
    return count, stored


@contextmanager
def decoding(path: str | Path) -> Iterator[None]:
    """Make one error of all that decoders written in Python raise where a file is damaged.

    Raises
    ------
    OSError
        Something else than a lack of memory was raised.
    """
    try:
        yield
    except (MemoryError, FileNotFoundError, PermissionError):
        raise
    except Exception as error:  # Pillow's plugins raise a dozen kinds
        raise OSError(f"{path} is not a picture that can be read: {one_line(error):.200}") from None
