"""Read TIFF and PNG stacks."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_items, check_unpacked
from resample.reading.native import suppressed_output
from resample.reading.pictures import check_picture, opened
from resample_volume.data.memory import require_memory
from resample_volume.files.parsing.headers import VolumeHeader
from resample_volume.files.stacks.descriptions import Page

NUMPY = {"half": "float16", "float": "float32", "double": "float64"}  # OpenImageIO's name: NumPy's


class SlicePage(NamedTuple):
    """One slice, not yet read."""

    name: str
    width: int
    height: int
    channels: int
    dtype: str
    told: Page


def natural(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that puts `slice9` before `slice10`."""
    pieces = re.split(r"(\d+)", path.name)
    return [(int(piece), "") if piece.isdigit() else (-1, piece) for piece in pieces]


def files_with(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Return a folder's visible files with one of the suffixes, in natural order."""
    found = (file for file in folder.iterdir() if file.suffix.lower() in suffixes)
    return sorted((file for file in found if not file.name.startswith(".")), key=natural)


def stack_pages(paths: list[Path]) -> list[SlicePage]:
    """Return all slices of picture files, which must be alike."""
    pages = []
    with suppressed_output():
        for page in (page for path in paths for page, _ in _walk(path)):
            pages.append(page)
            check_items(paths[0].name, len(pages), "slices")
    first = pages[0]
    for page in pages:
        if page.channels not in (1, 3, 4):
            raise ValueError(
                f"{page.name} has {page.channels} channels; slices have one number per pixel, or "
                "colors: convert it to gray"
            )
        if page[1:5] != first[1:5]:
            raise ValueError(
                f"{page.name} is {page.width} x {page.height} {page.dtype}, {first.name} is "
                f"{first.width} x {first.height} {first.dtype}; slices must be alike"
            )
    return pages


def stack_values(paths: list[Path], known: VolumeHeader, pages: list[SlicePage]) -> NDArray[Any]:
    """Read values (N, Y, X), or colors (N, Y, X, C), of all pages of picture files."""
    require_memory(known.size, known.name)
    check_unpacked(known.name, sum(path.stat().st_size for path in paths), known.size)
    parts = pages[0].channels
    values = np.empty((len(pages), *known.shape[1::-1], parts), known.dtype)
    with suppressed_output():
        every = ((path, image) for path in paths for _, image in _walk(path))
        for n, (path, image) in enumerate(every):
            check_picture(path, image.spec())
            pixels = image.read_image("unknown")
            if pixels is None:
                raise ValueError(f"slice {n} of {known.name} is damaged: {_last(image.geterror())}")
            values[n] = _straight(pixels, image.spec())
    return values if parts > 1 else values[..., 0]


def _walk(path: Path) -> Iterator[tuple[SlicePage, Any]]:
    """Yield the pages of one file, each with the open image at it."""
    with _opened(path) as image:
        n = 0
        while image.seek_subimage(n, 0):
            spec = image.spec()
            kind = NUMPY.get(str(spec.format), str(spec.format))
            each = [spec.get_float_attribute(f"{axis}Resolution") for axis in "XY"]
            unit = spec.get_string_attribute("ResolutionUnit")
            text = spec.get_string_attribute("ImageDescription")
            told = Page(text, (each[0], each[1]), unit, spec.get_int_attribute("Orientation", 1))
            yield SlicePage(path.name, spec.width, spec.height, spec.nchannels, kind, told), image
            n += 1
        image.geterror()  # clears the error that there is no page n


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    if not path.is_file():
        raise ValueError(f"{path.name} is a device or a pipe, not a file")
    try:
        image = opened(path)
    except OSError as error:
        reason = str(error).rpartition("that can be read: ")[2]
        raise ValueError(f"{path.name} cannot be read: {reason}") from None
    try:
        yield image
    finally:
        image.close()


def _straight(pixels: NDArray[Any], spec: Any) -> NDArray[Any]:
    """Undo premultiplied alpha, which some files have."""
    if spec.nchannels != 4 or spec.get_int_attribute("oiio:UnassociatedAlpha"):
        return pixels
    alpha, most = pixels[..., 3:].astype(np.float64), 1.0
    if pixels.dtype.kind in "iu":
        most = np.iinfo(pixels.dtype).max
    color = np.divide(
        pixels[..., :3] * np.float64(most),
        alpha,
        where=alpha > 0,
        out=np.zeros((*alpha.shape[:-1], 3)),
    )
    if pixels.dtype.kind in "iu":
        color = np.rint(np.minimum(color, most))
    return np.concatenate([color.astype(pixels.dtype), pixels[..., 3:]], axis=-1)


def _last(message: str) -> str:
    return message.strip().rpartition("\n")[2] or "no reason given"
