"""Pictures kept in their stored form, in memory or in a temporary file.

8- and 16-bit levels stay levels, half floats stay half floats; everything else is kept as light,
or as numbers, of 32 bits.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.chunked import Part, StoredPicture, is_in_store, open_picture
from resample.files.facts.metadata import FileMetadata, upright
from resample.files.images import holds_half, light_of, number_rows, read_levels, read_rows
from resample.files.pictures import (
    Header,
    Kind,
    alpha_last,
    header_in_store,
    header_of,
    is_plain,
    with_gaps,
)
from resample.files.stores.addresses import Address, Place
from resample.memory.mapped import array_where_it_fits
from resample.types import Floats

WIDE = ("int32", "uint32")  # integers that float32 cannot represent exactly


class LoadedPicture(NamedTuple):
    """A picture in memory as it is stored, upright."""

    data: NDArray[Any]  # (H, W, C) levels of straight alpha; or light, premultiplied, or numbers
    kind: Kind
    about: FileMetadata
    has_nans: bool = False  # missing values
    has_gaps: bool = False  # missing or infinite values

    @property
    def has_levels(self) -> bool:
        """Whether values are levels that are not converted to light yet."""
        return self.data.dtype.kind == "u"


@dataclass(frozen=True, eq=False)
class LoadablePicture:
    """A picture whose header has been read, and that can be loaded as stored."""

    path: Place
    header: Header
    stored: StoredPicture | None  # of zarr

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and channels, upright."""
        return (*self.header.size, len(self.header.kind.channels))

    @property
    def is_encoded(self) -> bool:
        """Whether it has sRGB-encoded levels, or light converted from them."""
        return self.header.kind.is_encoded

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """Type of the kept values."""
        if self.is_plain:
            return np.dtype(np.uint8 if self.header.kind.bits == 8 else np.uint16)
        if self.stored is not None:
            is_half = self.stored.array.dtype.name == "float16"
        else:
            is_light = not (self.header.about.number or self.is_encoded)
            is_half = is_light and holds_half(self._file)
        return np.dtype(np.float16 if is_half else np.float32)

    @cached_property
    def is_plain(self) -> bool:
        """Whether it has nothing but its levels."""
        return is_plain(self.path, self.header)

    @property
    def size(self) -> int:
        """Bytes of the kept values."""
        height, width, channels = self.shape
        return height * width * channels * self.dtype.itemsize

    def load(self, seen: Part | None = None) -> LoadedPicture:
        """Read the picture as `read_picture` does, but keep the stored form if it is smaller.

        Large arrays are kept in a file, see `array_where_it_fits`.

        Parameters
        ----------
        seen
            Rows and columns needed. Other levels in chunks are not read.

        Raises
        ------
        OSError
            The file is missing or damaged.
        ValueError
            It fits neither into memory nor on the disk.
        """
        header = self.header
        if self.is_plain:
            levels = self._levels(seen)
            return LoadedPicture(levels, header.kind, header.upright_about)
        kind, channels = alpha_last(header.kind)
        shape = (*header.shape[:2], len(channels))
        data = array_where_it_fits(shape, self.dtype, self.path.name)
        done, has_nans, has_gaps = 0, False, False
        for strip in self._strips():
            light = with_gaps(strip[..., channels], kind, header.about)
            data[done : done + len(light)] = light
            done += len(light)
            has_gaps = has_gaps or not bool(np.isfinite(light).all())
            has_nans = has_nans or bool(np.isnan(light).any())
        turned = upright(data, header.orientation)
        return LoadedPicture(turned, kind, header.upright_about, has_nans, has_gaps)

    @property
    def _file(self) -> Path:
        assert isinstance(self.path, Path)  # addresses are always stores
        return self.path

    def _levels(self, seen: Part | None) -> NDArray[Any]:
        """Levels (H, W, C), upright."""
        if self.stored is not None:
            return self.stored.levels(seen)
        levels = read_levels(self._file, self.header.kind.channels)
        return upright(levels, self.header.orientation)

    def _strips(self) -> Iterator[Floats]:
        """Light, or numbers, in the stored orientation, from the top."""
        kind = self.header.kind
        if self.stored is not None:
            rows = self.stored.strips()
            return (light_of(strip, kind.channels, is_encoded=kind.is_encoded) for strip in rows)
        return number_rows(self._file) if self.header.about.number else read_rows(self._file)[1]


def loadable_picture(path: Place) -> LoadablePicture | None:
    """Open a picture that can be loaded as stored; None for integers that float32 cannot represent.

    Raises
    ------
    OSError
        The file is missing or damaged.
    """
    stored = None
    if isinstance(path, Address) or is_in_store(path):
        stored = open_picture(path)
        header = header_in_store(stored)
    else:
        header = header_of(path, 0, as_data=True)
    return None if header.about.number in WIDE else LoadablePicture(path, header, stored)
