"""Picture files by OpenImageIO: the core's only decoder; and JPEG encoded in memory.

In memory a picture is float32, linear light, premultiplied, (H, W, C), row 0 at the top. Files with
straight alpha or sRGB-encoded color are converted here, in linear light.
"""

import errno
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.files.metadata.colors import is_encoded
from resample.files.metadata.fields import orientation_of, upright
from resample.reading.native import plain, suppressed_output
from resample.reading.pictures import check_honest, check_picture, complaint_of, opened
from resample.types import Floats

STRIP, LEAST_STRIP = 256, 32  # rows read at a time; for wide pictures
MOST_IN_STRIP = 1 << 22  # values read at a time
COLORS = ("R", "G", "B", "A")
MOST = {"uint8": 255, "uint16": 65535}  # largest value, which scales levels to 0..1
MOST_BYTES = 4  # upper bound on bytes per encoded value: no code of libjpeg's exceeds 26 bits
HEAD = 1 << 16  # bytes besides values and attributes
STEP = 1 << 20  # bytes moved from memory to disk at once


class LightEncoding(NamedTuple):
    """How a file stores light."""

    names: tuple[str, ...]  # of its channels
    is_encoded: bool  # by the sRGB curve
    is_straight: bool  # color is not multiplied by alpha
    levels: int  # largest value of 8 and 16 bits, which scales data to 0..1; 0: other types

    def light(self, data: Floats, size: int | None = None) -> Floats:
        """Convert data (H, W, C) to light, premultiplied, with the channels that are shown.

        `size`: number of values of the whole picture; None: this is it. The data are overwritten.
        """
        alpha = self.names.index("A") if "A" in self.names else None
        color = [n for n in range(len(self.names)) if n != alpha]
        is_multiplied = self.is_encoded and not self.is_straight and alpha is not None
        if is_multiplied and self.levels:  # levels of displays, by alpha
            opacity = data[..., alpha, None]
            data[..., color] /= np.where(opacity > 0, opacity, 1)
            data[..., color] = from_srgb(data[..., color]) * opacity
        elif self.is_encoded and 0 < self.levels < (size or data.size):  # faster than powers
            light = from_srgb((np.arange(self.levels + 1) / self.levels).astype(np.float32))
            for row in data:
                row[:, color] = light[(row[:, color] * self.levels + 0.5).astype(np.uint16)]
        elif self.is_encoded:
            data[..., color] = from_srgb(data[..., color])
        if self.is_straight and alpha is not None:
            data[..., color] *= data[..., alpha, None]
        return data[..., [self.names.index(name) for name in shown(self.names)]]


class PictureFile(NamedTuple):
    """A picture file, open at one of its pages."""

    path: Path
    source: Any  # OpenImageIO's ImageInput
    form: str  # OpenImageIO's type of its values
    encoding: LightEncoding

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and number of stored channels."""
        spec = self.source.spec()
        return spec.height, spec.width, spec.nchannels

    @property
    def has_half_light(self) -> bool:
        """Whether half floats represent its light, as stored, exactly."""
        has_straight_alpha = self.encoding.is_straight and "A" in self.encoding.names
        return self.form == "half" and not (self.encoding.is_encoded or has_straight_alpha)

    def strips(self, form: str = "float", height: int | None = None) -> Iterator[NDArray[Any]]:
        """Rows as stored, in a type of OpenImageIO, from the top; then the file is closed."""
        spec = self.source.spec()
        check_honest(self.path, spec)
        if height is None:
            few = MOST_IN_STRIP // (spec.width * spec.nchannels) // LEAST_STRIP * LEAST_STRIP
            height = min(STRIP, max(LEAST_STRIP, few))
        step = -(-height // spec.tile_height) * spec.tile_height if spec.tile_width else height
        for first in range(spec.y, spec.y + spec.height, step):
            last = min(first + step, spec.y + spec.height)
            with suppressed_output():
                if spec.tile_width:
                    across = spec.x, spec.x + spec.width
                    data = self.source.read_tiles(
                        *across, first, last, 0, 1, 0, spec.nchannels, form
                    )
                else:
                    data = self.source.read_scanlines(first, last, 0, 0, spec.nchannels, form)
            complaint = complaint_of(self.source, "")
            if data is None or complaint:
                raise OSError(f"{self.path} is damaged: {complaint or 'no reason is given'}")
            yield np.asarray(data).reshape(last - first, spec.width, spec.nchannels)
        self.source.close()

    def light_strips(self, height: int | None = None) -> Iterator[Floats]:
        """Rows in linear light; errors as in `strips`."""
        size = int(np.prod(self.shape))
        return (self.encoding.light(strip, size) for strip in self.strips(height=height))

    def values(self) -> Floats:
        """All channels (H, W, C) as stored; errors as in `strips`."""
        check_picture(self.path, self.source.spec(), 4)
        data, done = np.empty(self.shape, np.float32), 0
        for strip in self.strips():
            data[done : done + len(strip)] = strip
            done += len(strip)
        return data


def open_file(path: str | Path, page: int = 0, encoding: str = "auto") -> PictureFile:
    """Open a picture file and read its header, without data.

    `encoding`: of integers: `srgb`, `linear`, or `auto`, which is what the file says; if it says
    nothing, 16 bits are linear and others sRGB.
    """
    source = opened(path, page)
    spec = source.spec()
    form = str(spec.format)
    space = spec.get_string_attribute("oiio:ColorSpace").lower()
    if form in ("half", "float", "double"):
        has_curve = "srgb" in space
    else:
        has_curve = encoding == "srgb" if encoding != "auto" else is_encoded(Path(path), spec)
    is_straight = bool(spec.get_int_attribute("oiio:UnassociatedAlpha"))
    light = LightEncoding(tuple(spec.channelnames), has_curve, is_straight, MOST.get(form, 0))
    return PictureFile(Path(path), source, form, light)


def read_image(path: str | Path, page: int = 0, encoding: str = "auto") -> Floats:
    """Read a picture in linear light, premultiplied, in the stored orientation.

    `path`: any format of OpenImageIO. Integers of 8 bits and files marked so are taken as sRGB,
    others as linear light; `encoding` as in `open_file`. The orientation tag is ignored. Result:
    (H, W, C) with the existing ones of the channels R, G, B and A; all channels if there is no R or
    if there are unnamed bands.
    """
    file = open_file(path, page, encoding)
    return file.encoding.light(file.values())


def read_channels(path: str | Path, page: int = 0) -> dict[str, Floats]:
    """Read all channels of a file by name, (H, W) each, upright, with values as stored."""
    file = open_file(path, page)
    data = upright(file.values(), orientation_of(file.path, file.source.spec()))
    return {name: data[..., n] for n, name in enumerate(file.encoding.names)}


def light_of(
    levels: NDArray[Any], names: Sequence[str], *, is_encoded: bool, size: int | None = None
) -> Floats:
    """Linear light, premultiplied, from levels (H, W, C) with straight alpha; floats are light."""
    if levels.dtype.kind == "f":
        return np.array(levels, np.float32)
    most = int(np.iinfo(levels.dtype).max)
    data = levels.astype(np.float32) / np.float32(most)
    return LightEncoding(tuple(names), is_encoded, is_straight=True, levels=most).light(data, size)


def shown(names: Sequence[str]) -> tuple[str, ...]:
    """Channels that form the picture: only colors, unless there are other bands."""
    has_bands = any(name.startswith("channel") for name in names)  # unnamed in TIFF
    if "R" not in names or has_bands:
        return tuple(names)
    return tuple(name for name in COLORS if name in names)


class BufferedJpeg:
    """OpenImageIO output for a JPEG, written to disk by Python.

    If the system has no in-memory files (other than Linux) or limits the size of files, it is
    rejected beforehand if it might not fit.
    """

    def __init__(self, path: Path, spec: Any) -> None:
        import OpenImageIO

        self._held, self._done = ExitStack(), 0
        self._memory = memory = _memory()
        if memory is not None:
            self._held.callback(os.close, memory)
        # Reject a file that might not fit.
        told = sum(np.asarray(attribute.value).nbytes for attribute in spec.extra_attribs)
        values = int(spec.width) * int(spec.height) * int(spec.nchannels)
        most = MOST_BYTES * values + told + HEAD
        limit = None  # of the size of files of this process, in memory too
        with suppress(ImportError):  # on Windows
            import resource

            limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
            limit = None if limit == resource.RLIM_INFINITY else limit
        if limit is not None and most > limit:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
        if memory is None and shutil.disk_usage(path.parent).free < most:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        self._file = self._held.enter_context(path.open("wb"))
        jpeg: Any = OpenImageIO.ImageOutput.create("jpeg")
        self._target = jpeg
        if not jpeg.open(plain(path) if memory is None else _name(memory), spec):
            raise OSError(f"{path} cannot be written: {jpeg.geterror()}")

    def __del__(self) -> None:
        self._held.close()

    def write_image(self, pixels: Any) -> bool:
        """Write all rows; returns whether it succeeded."""
        return self._drained(is_done=self._target.write_image(pixels))

    def write_scanlines(self, first: int, last: int, z: int, pixels: Any) -> bool:
        """Write some rows; returns whether it succeeded."""
        return self._drained(is_done=self._target.write_scanlines(first, last, z, pixels))

    def close(self) -> bool:
        """Finish the file; returns whether it succeeded."""
        with self._held:
            return self._drained(is_done=self._target.close())

    @property
    def has_error(self) -> bool:
        """Whether OpenImageIO reports an error."""
        return bool(self._target.has_error)

    def geterror(self) -> str:
        """The error message."""
        return str(self._target.geterror())

    def _drained(self, *, is_done: bool) -> bool:
        """Move the data in memory to the file."""
        if self._memory is None:
            return is_done
        end = os.fstat(self._memory).st_size
        while self._done < end:
            data = os.pread(self._memory, min(STEP, end - self._done), self._done)
            self._file.write(data)
            self._done += len(data)
        os.ftruncate(self._memory, 0)  # later writes follow a hole, which takes no space
        return is_done


class PillowOutput:
    """Output for formats of Pillow, with the methods of OpenImageIO's; encodes when closed."""

    has_error = False

    def __init__(self, path: Path, spec: Any, choices: dict[str, Any]) -> None:
        self._path, self._choices, self._spec = path, choices, spec
        self._levels = np.empty((spec.height, spec.width, spec.nchannels), np.uint8)
        self._complaint = ""

    def write_scanlines(self, first: int, last: int, z: int, pixels: Any) -> bool:  # noqa: ARG002
        """Keep some rows."""
        self._levels[first:last] = pixels
        return True

    def close(self) -> bool:
        """Write the file; returns whether it succeeded."""
        from PIL import Image

        gray = [0, 0, 0, 1][: 2 + self._levels.shape[2]]
        levels = self._levels if self._levels.shape[2] > 2 else self._levels[..., gray]
        profile = self._spec.getattribute("ICCProfile")
        if profile is not None:
            self._choices["icc_profile"] = np.asarray(profile, np.uint8).tobytes()
        try:
            Image.fromarray(np.ascontiguousarray(levels)).save(self._path, **self._choices)
        except (ValueError, RuntimeError) as error:
            self._complaint = str(error)
        return not self._complaint

    def geterror(self) -> str:
        """The error message."""
        return self._complaint


def _memory() -> int | None:
    """Descriptor of a new in-memory file; None if the system has no such files."""
    if hasattr(os, "memfd_create"):
        with suppress(OSError):
            memory = os.memfd_create("jpeg")
            if os.path.exists(_name(memory)):
                return memory
            os.close(memory)
    return None


def _name(memory: int) -> str:
    return f"/proc/self/fd/{memory}"
