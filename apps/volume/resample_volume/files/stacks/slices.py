"""Volumes that come as pictures: TIFF and PNG stacks, DICOM series."""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.reading.pictures import check_picture
from resample.types import Doubles
from resample_volume.files.headers import Header, volume
from resample_volume.files.itk import attempt, described, units_told
from resample_volume.files.memory import require_memory
from resample_volume.files.suppression import suppressed_output
from resample_volume.media.rectilinear import rectilinear
from resample_volume.types import Volume

NUMPY = {"half": "float16", "float": "float32", "double": "float64"}  # OpenImageIO's name: NumPy's

EVEN_GAPS = 0.01  # of their mean, by which distances of slices may differ

POSITION = "0020|0032"  # DICOM's Image Position (Patient)


class Page(NamedTuple):
    """One slice before its values are read."""

    name: str
    width: int
    height: int
    channels: int
    dtype: str
    description: str = ""


def natural(path: Path) -> list[tuple[int, str]]:
    """Sort key under which `slice9` comes before `slice10`."""
    pieces = re.split(r"(\d+)", path.name)
    return [(int(piece), "") if piece.isdigit() else (-1, piece) for piece in pieces]


def files_with(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Visible files of a folder with one of the suffixes, in natural order."""
    found = (file for file in folder.iterdir() if file.suffix.lower() in suffixes)
    return sorted((file for file in found if not file.name.startswith(".")), key=natural)


def stack_pages(paths: list[Path]) -> list[Page]:
    """All slices of picture files, which have to be alike.

    Raises
    ------
    ValueError
        A file is no picture, has several channels, or differs from the first.
    """
    with suppressed_output():
        pages = [page for path in paths for page, _ in _walk(path)]
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


def stack_values(paths: list[Path], known: Header) -> NDArray[Any]:
    """Values (Z, Y, X), or of colors (Z, Y, X, C), of picture files."""
    require_memory(known.size, known.name)
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


def dicom_files(folder: Path, series: str) -> list[str]:
    """Files of one DICOM series, in the order of their positions.

    GDCM leaves out files that it cannot parse; here they are an error.
    """
    import SimpleITK

    with suppressed_output():
        reader = SimpleITK.ImageSeriesReader()
        known = {
            uid: reader.GetGDCMSeriesFileNames(str(folder), uid)
            for uid in reader.GetGDCMSeriesIDs(str(folder))
        }
    taken = {Path(file).name for files in known.values() for file in files}
    damaged = [file.name for file in sorted(folder.iterdir()) if is_dicom(file)]
    damaged = [name for name in damaged if name not in taken and name != "DICOMDIR"]
    if damaged:
        raise ValueError(f"{damaged[0]} is a damaged DICOM file (of {len(damaged)}); get it again")
    if len(known) == 1 and not series:
        return list(*known.values())
    if series not in known:
        listed = ", ".join(known) or "none; is this a folder of DICOM files?"
        raise ValueError(f"{folder.name}: name one series ({series or 'none'} given) of: {listed}")
    return list(known[series])


def dicom_volume(files: list[str], name: str) -> Volume:
    """Volume of DICOM slices; where these are not evenly spaced, it is interpolated.

    Raises
    ------
    ValueError
        Slices are at one place, or not behind each other.
    """
    import SimpleITK

    with suppressed_output():
        first = SimpleITK.ImageFileReader()
        first.SetFileName(files[0])
        attempt(name, first.ReadImageInformation)
        require_memory(2 * 2 * math.prod(first.GetSize()) * len(files), name)  # int16, copied
        reader = SimpleITK.ImageSeriesReader()
        reader.SetFileNames(files)
        reader.MetaDataDictionaryArrayUpdateOn()
        image = attempt(name, reader.Execute)
    known = described(image, name)._replace(units=units_told(first))
    found = volume(SimpleITK.GetArrayFromImage(image), known)
    places = _places(reader, len(files))
    gaps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    if len(gaps) < 2 or np.ptp(gaps) <= EVEN_GAPS * gaps.mean():
        return found
    return _interpolated(found, places, gaps)


def _interpolated(found: Volume, places: Doubles, gaps: Doubles) -> Volume:
    """Volume whose slices, at uneven distances along one line, are made even."""
    uneven = (
        f"{found.name}: its {len(places)} slices are not evenly spaced but {gaps.min():.4g} to "
        f"{gaps.max():.4g} apart"
    )
    way = (places[-1] - places[0]) / max(np.linalg.norm(places[-1] - places[0]), 1e-30)
    z = (places - places[0]) @ way
    aside = np.linalg.norm(places - places[0] - z[:, np.newaxis] * way, axis=1).max()
    if np.diff(z).min() <= EVEN_GAPS * gaps.mean() or aside > EVEN_GAPS * gaps.mean():
        raise ValueError(f"{uneven}; is one missing, or there twice?")
    if found.colors is not None:
        raise ValueError(f"{uneven}, and colors are not interpolated; is one missing?")
    x, y = (found.spacing[n] * np.arange(found.values.shape[2 - n]) for n in (0, 1))
    even = rectilinear(found.values, x, y, z, name=found.name)
    direction = np.column_stack([found.direction[:, :2], way])
    note = f"{even.note}; is a slice missing?"
    return even._replace(origin=places[0], direction=direction, units=found.units, note=note)


def is_dicom(file: Path) -> bool:
    """Whether a file says that it is DICOM; its name often does not."""
    if not file.is_file():
        return False
    with file.open("rb") as opened:
        opened.seek(128)
        return opened.read(4) == b"DICM"


def _places(reader: Any, count: int) -> Doubles:
    """Positions (N, 3) of slices, as far as all have one."""
    if not all(reader.HasMetaDataKey(n, POSITION) for n in range(count)):
        return np.zeros((0, 3))
    places = [reader.GetMetaData(n, POSITION).split("\\") for n in range(count)]
    return np.array(places, np.float64)


def _walk(path: Path) -> Iterator[tuple[Page, Any]]:
    """Pages of one file, each with the open image that stands at it."""
    with _opened(path) as image:
        n = 0
        while image.seek_subimage(n, 0):
            spec = image.spec()
            kind = NUMPY.get(str(spec.format), str(spec.format))
            told = spec.get_string_attribute("ImageDescription")
            yield Page(path.name, spec.width, spec.height, spec.nchannels, kind, told), image
            n += 1
        image.geterror()  # that there is no page n


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    import OpenImageIO

    straight = OpenImageIO.ImageSpec()
    straight.attribute("oiio:UnassociatedAlpha", 1)  # colors are not multiplied by opacities
    image = OpenImageIO.ImageInput.open(str(path), straight)
    if image is None:
        raise ValueError(f"{path.name} cannot be read: {_last(OpenImageIO.geterror())}")
    try:
        yield image
    finally:
        image.close()


def _straight(pixels: NDArray[Any], spec: Any) -> NDArray[Any]:
    """Pixels whose colors are not multiplied by their opacities, as some files have them."""
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
