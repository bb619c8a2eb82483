"""Read TIFF and PNG stacks, and the order of times, slices and channels in them."""

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

NUMPY = {"half": "float16", "float": "float32", "double": "float64"}  # OpenImageIO's name: NumPy's
OME = {"Z": r'SizeZ="(\d+)"', "C": r'SizeC="(\d+)"', "T": r'SizeT="(\d+)"'}
IMAGEJ = {"Z": r"^slices=(\d+)", "C": r"^channels=(\d+)", "T": r"^frames=(\d+)"}
IMAGEJ_ORDER = "CZT"  # channels change from page to page


class SlicePage(NamedTuple):
    """One slice, not yet read."""

    name: str
    width: int
    height: int
    channels: int
    dtype: str
    description: str = ""


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


def stack_values(paths: list[Path], known: VolumeHeader) -> NDArray[Any]:
    """Read values (Z, Y, X), or colors (Z, Y, X, C), of picture files."""
    require_memory(known.size, known.name)
    check_unpacked(known.name, sum(path.stat().st_size for path in paths), known.size)
    values = np.empty((*known.shape[::-1], known.parts), known.dtype)
    with suppressed_output():
        pages = ((path, image) for path in paths for _, image in _walk(path))
        for n, (path, image) in enumerate(pages):
            check_picture(path, image.spec())
            pixels = image.read_image("unknown")  # as stored
            if pixels is None:
                raise ValueError(f"slice {n} of {known.name} is damaged: {_last(image.geterror())}")
            values[n] = _straight(pixels, image.spec())
    return values if known.parts > 1 else values[..., 0]


def _walk(path: Path) -> Iterator[tuple[SlicePage, Any]]:
    """Yield the pages of one file, each with the open image at it."""
    with _opened(path) as image:
        n = 0
        while image.seek_subimage(n, 0):
            spec = image.spec()
            kind = NUMPY.get(str(spec.format), str(spec.format))
            header = spec.get_string_attribute("ImageDescription")
            yield SlicePage(path.name, spec.width, spec.height, spec.nchannels, kind, header), image
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


class PageOrder(NamedTuple):
    """Order of pages of several times, slices and channels."""

    times: int
    channels: int
    slices: int
    fastest: str  # Z, C and T in the order in which they change, the first from page to page

    def sorted(self, values: NDArray[Any]) -> NDArray[Any]:
        """Reshape pages (N, Y, X) to (T, C, Z, Y, X); further axes are kept."""
        size = {"T": self.times, "C": self.channels, "Z": self.slices}
        slowest = self.fastest[::-1]
        split = values.reshape(*(size[axis] for axis in slowest), *values.shape[1:])
        places = [slowest.index(axis) for axis in "TCZ"]
        return split.transpose(*places, *range(3, split.ndim))


def page_order(description: str, pages: int, parts: int, name: str) -> PageOrder | None:
    """Parse the page order from a file's description, as of OME and ImageJ.

    `parts`: numbers per pixel: color components are not channels. Result: None if it says nothing,
    or that all pages are slices of one volume.
    """
    if "<OME" in description:
        found = re.search(r'DimensionOrder="XY([ZCT]{3})"', description)
        fastest, forms = (found[1] if found else "ZCT"), OME
    elif description.startswith("ImageJ="):
        fastest, forms = IMAGEJ_ORDER, IMAGEJ
    else:
        return None
    size = {axis: re.search(form, description, re.MULTILINE) for axis, form in forms.items()}
    count = {axis: int(match[1]) if match else 1 for axis, match in size.items()}
    if parts > 1:
        count["C"] = max(1, count["C"] // parts)
    if count["C"] * count["T"] == 1:
        return None
    said = count["T"] * count["C"] * count["Z"]
    if said != pages or (parts > 1 and count["C"] > 1):
        raise ValueError(
            f"{name} has {pages} pages and says that they are {count['T']} times, {count['C']} "
            f"channels and {count['Z']} slices; convert it to one file with a page for each"
        )
    return PageOrder(count["T"], count["C"], count["Z"], fastest)
