"""Stacks of pictures and pages of TIFF files, with the sizes of OME-TIFF and ImageJ."""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.lengths import ratio, times, unit_of_length
from resample.reading.limits import check_items, check_unpacked
from resample.reading.native import suppressed_output
from resample.reading.pictures import check_picture, opened
from resample.reading.texts import check_xml_text
from resample_volume.data.recordings import is_color
from resample_volume.data.values import require_memory
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    VolumeHeader,
    accept_any,
    existing_file,
    header,
    recording,
    stem,
)
from resample_volume.files.texts import Numbers, spacing_of
from resample_volume.types import UNKNOWN, VOXEL, ChannelLook, Recording

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

AXES = "XYZ"
DIGITS = 6  # of a resolution, a fraction of integers or a float32, that mean something
MICROMETERS = "µm"  # of OME, if it names no unit
PIXELS = "pixel"  # of ImageJ, likewise
USUAL = (1.0, 72.0, 96.0)  # dots per inch, of no scanner
COMMON = {"in": "inch", "inch": "inch", "cm": "cm"}  # units of tags
FLAT = "no distance of slices is stated; the columns' is assumed"


class Page(NamedTuple):
    """What the first page says, besides its pixels."""

    description: str
    resolution: tuple[float, float]  # pixels per unit along x and y; 0: none
    unit: str  # of the resolution: none, in or cm
    orientation: int = 1  # by its tag


class StackFacts(NamedTuple):
    """Sizes and order of a stack's pages."""

    times: int = 1
    channels: int = 1
    slices: int = 0  # 0: all pages
    fastest: str = "ZCT"  # in which order these change, the first from page to page
    spacing: tuple[float, ...] = (1.0, 1.0, 1.0)  # x, y, z
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    length: str = VOXEL  # unit of these, as `Volume` has it
    looks: tuple[ChannelLook, ...] = ()
    pages: tuple[int, ...] = ()  # numbers of pages in that order; empty: as they follow
    line: tuple[float, float] = (0.0, 1.0)  # values are the first plus stored ones times the second
    note: str = ""

    def sorted(self, values: NDArray[Any]) -> NDArray[Any]:
        """Reshape pages (N, Y, X) to (T, C, Z, Y, X); further axes are kept."""
        size = {"T": self.times, "C": self.channels, "Z": self.slices or len(values)}
        slowest = self.fastest[::-1]
        if self.pages:
            values = values[list(self.pages)]
        split = values.reshape(*(size[axis] for axis in slowest), *values.shape[1:])
        places = [slowest.index(axis) for axis in "TCZ"]
        return split.transpose(*places, *range(3, split.ndim))


def stack_facts(page: Page, count: int, parts: int, name: str, *, is_alone: bool) -> StackFacts:
    """Parse what the first page says.

    `parts`: numbers of a pixel. `is_alone`: whether all pages are in its file.
    """
    turned = f"slices are as stored: their orientation tag, {page.orientation}, is not applied"
    turned = "" if page.orientation == 1 else turned
    if "<OME" in page.description:
        found = _of_ome(page.description, count, parts, name)
    elif page.description.startswith("ImageJ="):
        found = _of_imagej(page, count)
    else:
        # Resolutions do not cover the third axis.
        (x, y), per, told = page.resolution, COMMON.get(page.unit), ""
        is_usual = x == y and x * (2.54 if per == "cm" else 1) in USUAL
        if per and min(x, y) > 0 and not is_usual:
            told = f"its resolution of {x:g} x {y:g} pixels per {per} is not used, as slices have "
            told += "no distance (--spacing)"
        return StackFacts(note="; ".join(filter(None, [told, turned])))
    if not all(0 < step < math.inf for step in found.spacing):
        listed = " x ".join(f"{step:g}" for step in found.spacing)
        raise ValueError(f"{name}: voxels of {listed}; correct its header, or give --spacing")
    if not is_alone:
        is_several = found.times * found.channels > 1
        note = "times and channels are not sorted in a folder: all pages are slices" * is_several
        note = "; ".join(filter(None, [note, turned]))
        return found._replace(times=1, channels=1, slices=0, looks=(), pages=(), note=note)
    sizes = (found.times, found.channels, found.slices or count)
    if min(sizes) < 1 or not np.isfinite(found.line).all():
        raise ValueError(f"{name}: its sizes or calibration are not numbers; correct its header")
    said = math.prod(sizes)
    if said != count or (parts > 1 and found.channels > 1):
        raise ValueError(
            f"{name} has {count} pages and says that they are {found.times} times, "
            f"{found.channels} channels and {found.slices} slices; convert it to one file with a "
            "page for each"
        )
    return found._replace(note="; ".join(filter(None, [found.note, turned])))


def _of_ome(text: str, count: int, parts: int, name: str) -> StackFacts:
    from xml.etree import ElementTree

    check_xml_text(name, text)
    try:
        root = ElementTree.fromstring(text)  # noqa: S314  no entities, as checked
    except ElementTree.ParseError as error:
        raise ValueError(f"{name}: its OME-XML is damaged: {error}") from None
    every = root.findall(".//{*}Image/{*}Pixels")
    if not every:
        return StackFacts(note="its OME-XML holds no image, so that it states no sizes")
    if len(every) > 1:
        raise ValueError(f"{name} holds {len(every)} images of OME; write one of them to a file")
    pixels = every[0]
    size = {axis: _whole(pixels, f"Size{axis}", 1, name) for axis in "ZCT"}
    if parts > 1:
        size["C"] = max(1, size["C"] // parts)
    if size["C"] * size["T"] == 1 and size["Z"] == 1:
        size["Z"] = count  # older files say nothing
    order = pixels.get("DimensionOrder", "XYZCT")[2:]
    if sorted(order) != sorted("ZCT"):
        raise ValueError(f"{name}: its DimensionOrder is XY{order:.9}; correct it")
    spacing, length = _lengths(pixels, name)
    looks: tuple[ChannelLook, ...] = ()
    for channel in pixels.findall("{*}Channel"):
        color = channel.get("Color", "")  # a signed integer of red, green, blue and opacity
        is_number = re.fullmatch(r"-?\d{1,10}", color) is not None
        shown = f"#{(int(color) >> 8) & 0xFFFFFF:06x}" if is_number else ""
        looks = (*looks, ChannelLook(channel.get("Name", ""), shown))
    looks = looks if any(look.label or look.color for look in looks) else ()
    facts = StackFacts(size["T"], size["C"], size["Z"], order, spacing, length=length, looks=looks)
    if length != VOXEL and pixels.get("PhysicalSizeZ") is None:
        facts = facts._replace(note=FLAT)
    return facts._replace(pages=_pages(pixels, size, order, count, name))


def _lengths(pixels: "Element", name: str) -> tuple[tuple[float, ...], str]:
    """Return spacing, and x's unit."""
    given = [pixels.get(f"PhysicalSize{axis}") for axis in AXES]
    if None in given[:2]:
        return (1.0, 1.0, 1.0), VOXEL
    steps: list[float] = []
    units: list[str] = []
    for axis, word in zip(AXES, given, strict=True):
        unit, by = unit_of_length(pixels.get(f"PhysicalSize{axis}Unit", MICROMETERS))
        try:
            steps.append(steps[0] if word is None else times(float(word), by))
        except ValueError:
            raise ValueError(f"{name}: its PhysicalSize{axis} is {word!r:.40}") from None
        units.append(units[0] if word is None else unit)
    if not all(units):
        if len(set(units)) > 1:
            raise ValueError(f"{name}: its PhysicalSizes are in different units; correct them")
        return tuple(steps), UNKNOWN
    return _in_first(units, steps), units[0]


def _pages(
    pixels: "Element", size: dict[str, int], order: str, count: int, name: str
) -> tuple[int, ...]:
    """Return the pages in their order, if blocks of data say another one."""
    place, step = {}, 1
    for axis in order:
        place[axis], step = step, step * size[axis]
    found = np.arange(count)
    for block in pixels.findall("{*}TiffData"):
        if block.get("IFD") is None:
            continue
        first = sum(_whole(block, f"First{axis}", 0, name) * place[axis] for axis in "ZCT")
        page, many = _whole(block, "IFD", 0, name), _whole(block, "PlaneCount", 1, name)
        if min(first, page, many) < 0 or max(first, page) + many > count:
            raise ValueError(f"{name}: its TiffData names pages that are not there; correct it")
        found[first : first + many] = np.arange(page, page + many)
    if np.array_equal(found, np.arange(count)):
        return ()
    if len(set(found.tolist())) < count:
        raise ValueError(f"{name}: its TiffData names a page twice; correct it")
    return tuple(found.tolist())


def _whole(element: "Element", key: str, otherwise: int, name: str) -> int:
    word = element.get(key, str(otherwise))
    if not re.fullmatch(r"-?\d{1,9}", word):
        raise ValueError(f"{name}: its {key} is {word!r:.40}, where a whole number is")
    return int(word)


def _of_imagej(page: Page, count: int) -> StackFacts:
    lines = [line.partition("=") for line in page.description.splitlines()]
    told = {key.strip(): value.strip() for key, _, value in lines}

    def number(key: str, otherwise: float) -> float:
        try:
            return float(told.get(key, otherwise))
        except ValueError:
            return math.nan

    def whole(key: str, otherwise: int) -> int:
        word = told.get(key, str(otherwise))
        return int(word) if re.fullmatch(r"\d{1,9}", word) else otherwise

    frames, channels = (max(1, whole(key, 1)) for key in ("frames", "channels"))
    slices = whole("slices", 0) or (count if frames * channels == 1 else 1)
    facts = StackFacts(frames, channels, slices, "CZT", line=(number("c0", 0), number("c1", 1)))
    if number("cf", 0):
        note = "its calibration of values is not linear and is not applied"
        facts = facts._replace(line=(0.0, 1.0), note=note)
    words = [told.get("unit", COMMON.get(page.unit, PIXELS))]
    words += [told.get(f"{axis}unit", words[0]) for axis in "yz"]
    units, factors = zip(*map(unit_of_length, words), strict=True)
    if not min(page.resolution) > 0 or (not units[0] and "spacing" not in told):
        return facts
    if units[0] and "spacing" not in told:
        facts = facts._replace(note=FLAT)
    across = [float(f"{1 / each:.{DIGITS}g}") for each in page.resolution]
    steps = _in_first(units, map(times, (*across, abs(number("spacing", across[0]))), factors))
    first = [number(f"{axis}origin", 0) for axis in "xyz"]
    origin = tuple(0.0 - start * step for start, step in zip(first, steps, strict=True))
    return facts._replace(spacing=steps, origin=origin, length=units[0] or UNKNOWN)


def _in_first(units: Sequence[str], lengths: Iterable[float]) -> tuple[float, ...]:
    """Return lengths in the first of their units; unchanged if one is unknown."""
    if not all(units):
        return tuple(lengths)
    by = (ratio(unit, units[0]) for unit in units)
    return tuple(map(times, lengths, by))


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
                reason = image.geterror().strip().rpartition("\n")[2] or "no reason given"
                raise ValueError(f"slice {n} of {known.name} is damaged: {reason}")
            values[n] = _straight(pixels, image.spec())
    return values if parts > 1 else values[..., 0]


def _walk(path: Path) -> Iterator[tuple[SlicePage, Any]]:
    """Yield the pages of one file, each with the open image at it."""
    if not path.is_file():
        raise ValueError(f"{path.name} is a device or a pipe, not a file")
    try:
        source = opened(path)
    except OSError as error:
        reason = str(error).rpartition("that can be read: ")[2]
        raise ValueError(f"{path.name} cannot be read: {reason}") from None
    with closing(source) as image:
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


def _straight(pixels: NDArray[Any], spec: Any) -> NDArray[Any]:
    """Undo premultiplied alpha, if the file has it."""
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


@dataclass(frozen=True)
class TiffStack(OneOfAll):
    """A folder of gray pictures, sorted by number, or one multi-page file.

    Sizes, times and channels are from OME-TIFF or ImageJ; other pictures have none.
    """

    spacing: Numbers = ""  # instead of the file's

    suffixes: ClassVar[tuple[str, ...]] = (".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp")

    def __post_init__(self) -> None:
        spacing_of(self.spacing)

    def recorded(self, path: Path, check: Check = accept_any) -> Recording:
        if path.is_dir():
            files = (file for file in path.iterdir() if file.suffix.lower() in self.suffixes)
            paths = sorted((file for file in files if not file.name.startswith(".")), key=natural)
            name = path.resolve().name
        else:
            paths, name = [existing_file(path)], stem(path, self.suffixes)
        if not paths:
            raise ValueError(f"{path} holds no slices; known are {', '.join(self.suffixes)}")
        # Walk all slices; they must be alike.
        pages = []
        with suppressed_output():
            for page in (page for path in paths for page, _ in _walk(path)):
                pages.append(page)
                check_items(paths[0].name, len(pages), "slices")
        first = pages[0]
        for page in pages:
            if page.channels not in (1, 3, 4):
                raise ValueError(
                    f"{page.name} has {page.channels} channels; slices have one number per pixel, "
                    "or colors: convert it to gray"
                )
            if page[1:5] != first[1:5]:
                raise ValueError(
                    f"{page.name} is {page.width} x {page.height} {page.dtype}, {first.name} is "
                    f"{first.width} x {first.height} {first.dtype}; slices must be alike"
                )
        first, count = pages[0], len(pages)
        facts = stack_facts(first.told, count, first.channels, name, is_alone=len(paths) == 1)
        own = (facts.spacing, facts.length)
        spacing, length = spacing_of(self.spacing) if self.spacing else own
        shape = (first.width, first.height, facts.slices or count)
        known = header(shape, first.dtype, name, spacing=spacing, origin=facts.origin)
        color, parts = is_color((first.channels,), known.dtype), first.channels * facts.channels
        known = known._replace(length=length, note=facts.note, is_color=color)
        known = known._replace(parts=parts, times=facts.times)
        check(known)
        every = facts.sorted(stack_values(paths, known, pages))
        if facts.line != (0, 1):
            every = np.asarray(facts.line[0] + facts.line[1] * every, np.float32)
            known = known._replace(dtype=every.dtype, is_color=False)
        found = recording(every, known, channels_first=first.channels == 1)
        return found._replace(looks=facts.looks)
