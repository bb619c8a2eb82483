"""Pictures that are kept as their files store them, in memory or in a file meanwhile.

Levels of 8 and 16 bits stay levels, and halves of light stay halves; all else is kept as light, or
as numbers, of 32 bits.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from resample.files.facts.metadata import About, upright
from resample.files.images import holds_half, light_of, number_rows, read_rows
from resample.files.pictures import (
    Header,
    Kind,
    alpha_last,
    has_levels,
    header_of,
    is_plain,
    read_picture_levels,
    with_gaps,
)
from resample.files.stores.opening import is_store
from resample.files.stores.pictures import open_picture
from resample.memory.mapped import array_where_it_fits
from resample.types import Floats

WIDE = ("int32", "uint32")  # numbers that 32 bits of floating point do not hold


class KeptForm(NamedTuple):
    """What is kept of a picture."""

    shape: tuple[int, int, int]  # height, width and channels, upright
    dtype: np.dtype[Any]
    is_encoded: bool  # by the sRGB curve: levels, or what light was made of

    @property
    def size(self) -> int:
        """Bytes of it."""
        height, width, channels = self.shape
        return height * width * channels * self.dtype.itemsize


class KeptPicture(NamedTuple):
    """A picture as it is kept, upright."""

    data: NDArray[Any]  # (H, W, C) levels of straight alpha; or light, premultiplied, or numbers
    kind: Kind
    about: About
    has_nans: bool = False  # values that are missing
    has_gaps: bool = False  # values that are not finite: those, and infinite ones

    @property
    def has_levels(self) -> bool:
        """Whether values are levels, which are not light yet."""
        return self.data.dtype.kind == "u"


def kept_form(path: Path) -> KeptForm | None:
    """What `keep_picture` makes of a file; None of pictures that it does not keep.

    Raises
    ------
    OSError
        The file is missing or damaged.
    """
    header = header_of(path, 0, as_data=True)
    shape, kind, about, _ = header
    if about.number in WIDE:
        return None
    if is_plain(path, header):
        levels = np.dtype(np.uint8 if kind.bits == 8 else np.uint16)
        return KeptForm((*header.size, shape[2]), levels, kind.is_encoded)
    form = np.dtype(_light_type(path, header))
    return KeptForm((*header.size, len(kind.channels)), form, kind.is_encoded)


def keep_picture(path: Path) -> KeptPicture:
    """Read a picture as `read_picture` does, but keep it as it is stored, where that is smaller.

    What memory should not hold is in a file, see `array_where_it_fits`.

    Raises
    ------
    OSError
        The file is missing or damaged.
    ValueError
        `kept_form` knows none of it, or it fits nowhere.
    """
    if has_levels(path):
        return KeptPicture(*read_picture_levels(path))
    header = header_of(path, 0, as_data=True)
    kind, channels = alpha_last(header.kind)
    rows = (strip[..., channels] for strip in _rows(path, header))
    shape = (*header.shape[:2], len(channels))
    data = array_where_it_fits(shape, _light_type(path, header), path.name)
    done, has_nans, has_gaps = 0, False, False
    for strip in rows:
        light = with_gaps(strip, kind, header.about)
        data[done : done + len(light)] = light
        done += len(light)
        has_gaps = has_gaps or not bool(np.isfinite(light).all())
        has_nans = has_nans or bool(np.isnan(light).any())
    turned = upright(data, header.orientation)
    return KeptPicture(turned, kind, header.upright_about, has_nans, has_gaps)


def _light_type(path: Path, header: Header) -> DTypeLike:
    """Least type that holds a picture's light, or its numbers."""
    if is_store(path):
        is_half = open_picture(path).array.dtype.name == "float16"
    else:
        is_half = not (header.about.number or header.kind.is_encoded) and holds_half(path)
    return np.float16 if is_half else np.float32


def _rows(path: Path, header: Header) -> Iterator[Floats]:
    """Light, or numbers, as pixels are stored, from the top."""
    if is_store(path):
        kind = header.kind
        strips = open_picture(path).strips()
        return (light_of(strip, kind.channels, is_encoded=kind.is_encoded) for strip in strips)
    return number_rows(path) if header.about.number else read_rows(path)[1]
