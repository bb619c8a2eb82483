"""Read DICOM series and multi-frame files, by pydicom, as volumes in LPS."""

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import RAW, LimitError, check_deflated, check_items, check_unpacked
from resample.reading.native import suppressed_output
from resample.reading.pictures import size_of
from resample.types import Doubles
from resample_volume.data.rectilinear import rectilinear
from resample_volume.data.values import require_memory
from resample_volume.files.headers import check_alone, existing_file, header, stem, volume
from resample_volume.files.tiff import natural
from resample_volume.types import VOXEL, Volume

UNDEFINED = 0xFFFFFFFF  # length of elements with an end mark
EVEN_GAPS = 0.01  # tolerance of slice distances, of their mean
TILTED = 1e-3  # of a step, by which slices may lie aside of each other and stand upright
FITTING = ("uint8", "uint16", "int32", "int8", "int16", "int32")  # what rescaled values may be
GROUPS = ("PerFrameFunctionalGroupsSequence", "SharedFunctionalGroupsSequence")
ORIENTATION = ("PlaneOrientationSequence", "ImageOrientationPatient")
POSITION = ("PlanePositionSequence", "ImagePositionPatient")
PIXELS = ("PixelMeasuresSequence", "PixelSpacing")
SLOPE = ("PixelValueTransformationSequence", "RescaleSlope")
INTERCEPT = ("PixelValueTransformationSequence", "RescaleIntercept")


class _Slice(NamedTuple):
    """One slice, not yet read."""

    path: Path
    dataset: Any  # header of its file
    frame: int  # in its file
    place: Doubles  # (3,) of its first voxel; NaN where it is not told
    axes: Doubles  # (2, 3) steps along its rows and columns
    slope: float
    intercept: float


def dicom_slices(folder: Path, series: str) -> list[Path]:
    """Return the files of one series."""
    known: dict[str, list[Path]] = {}
    for file in sorted(folder.iterdir(), key=natural):
        if file.name == "DICOMDIR" or not (is_dicom(file) or file.suffix.lower() == ".dcm"):
            continue
        dataset = _read_dataset(file)
        with _quiet(file):
            uid, has_picture = str(dataset.get("SeriesInstanceUID", "")), "Rows" in dataset
            if not has_picture and (
                "SeriesInstanceUID" not in dataset
                or "Image Storage"
                in getattr(dataset.get("SOPClassUID", ""), "name", "Image Storage")
            ):
                raise ValueError("its picture is missing")
        if has_picture:
            known.setdefault(uid, []).append(file)
    if len(known) == 1 and not series:
        return next(iter(known.values()))
    if series not in known:
        listed = ", ".join(known) or "none; is this a folder of DICOM files?"
        raise ValueError(
            f"{folder.name}: name one series ({series or 'none'} given; --reader dicom:series=UID) "
            f"of: {listed}"
        )
    return known[series]


def dicom_volume(files: list[Path], name: str) -> Volume:
    """Read a volume of slices; uneven ones are interpolated.

    Slices are sorted by position, otherwise by number, otherwise by file name. Slices with a
    lateral offset (tilted gantry) make a sheared volume.
    """
    slices = [each for path in files for each in _slices(path)]
    with _quiet(files[0]):
        slices = _sorted(slices)
        first = slices[0].dataset
        given = first.get("PhotometricInterpretation") or ""
        if not isinstance(given, str):
            raise ValueError(f"its PhotometricInterpretation is {_shown(given)}, where one text is")
        parts = 3 if given == "PALETTE COLOR" else whole(first, "SamplesPerPixel", 1)
        kind, units = _kind(slices), _units(first)
        sizes = (whole(first, "Columns"), whole(first, "Rows"), len(slices))
        places = np.array([each.place for each in slices])
        spacing, direction = _lattice(slices, places)
    origin = places[0] if np.isfinite(places).all() else np.zeros(3)
    known = header(sizes, kind, name, spacing=spacing, origin=origin, direction=direction)
    # Note assumptions about the slices.
    one, lines = slices[0], []
    if _is_negative(one.dataset) and _units(one.dataset):
        lines.append("MONOCHROME1: low values are meant to be white, --invert shows projections so")
    if "ModalityLUTSequence" in one.dataset:
        lines.append("ModalityLUTSequence is not applied: values are as stored")
    if not (np.isfinite(places).all() and len(places) > 1) and not _between(*one[1:3]):
        lines.append("no distance of slices is stated; 1 mm is assumed")
    known = known._replace(parts=parts, is_color=parts > 1, units=units, note="; ".join(lines))
    pixel = _numbers(first, slices[0].frame, PIXELS, (math.nan,) * 2)
    is_sized = np.isfinite(pixel).all() or first.get("ImagerPixelSpacing") not in (None, "", [])
    known = known._replace(length="mm" if is_sized else VOXEL)
    check_alone(known)
    require_memory(known.size, name)
    check_unpacked(name, sum(file.stat().st_size for file in files), known.size)
    values = _values(slices, (*sizes[::-1], parts), kind)
    found = volume(values if parts > 1 else values[..., 0], known)
    if not np.isfinite(places).all():
        return found
    gaps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    if len(gaps) < 2 or np.ptp(gaps) <= EVEN_GAPS * gaps.mean():
        return found
    return _interpolated(found, places, gaps)


def is_dicom(file: Path) -> bool:
    """Return whether a file's content is DICOM, whatever its name."""
    if not file.is_file():
        return False
    with file.open("rb") as opened:
        opened.seek(128)
        return opened.read(4) == b"DICM"


@contextmanager
def _quiet(path: Path) -> Iterator[None]:
    """Convert any error of pydicom's on a damaged file to one line; drop its warnings."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (MemoryError, LimitError):
        raise
    except Exception as error:  # of any kind: AttributeError, KeyError, struct.error
        reason = (str(error) or type(error).__name__).strip().splitlines()[0]
        raise ValueError(
            f"{path.name} is a damaged DICOM file; get it again ({reason:.150})"
        ) from None


def _read_dataset(path: Path, *, is_whole: bool = False) -> Any:
    """Read the header of a file, or all of it."""
    import pydicom

    if not path.is_file():
        raise ValueError(f"{path.name} is a device or a pipe, not a file")
    with _quiet(path), _Watched(path) as file:
        read: Any = pydicom.dcmread(file, stop_before_pixels=not is_whole, force=not is_dicom(path))
        read.buffer = None  # otherwise a whole inflated file would be held
        if not len(read):
            raise ValueError("it holds nothing")
        for tag in read.keys():  # noqa: SIM118  iterating a header itself converts all values
            raw = read.get_item(tag)
            claimed, value = getattr(raw, "length", 0), getattr(raw, "value", None)
            if claimed != UNDEFINED and isinstance(value, bytes) and len(value) < claimed:
                raise ValueError(f"its {tag} claims {claimed} bytes, {len(value)} are there")
        return read


class _Watched(BufferedReader):
    """A file with a limit on reads of all remaining bytes, for deflated files."""

    def __init__(self, path: Path) -> None:
        super().__init__(FileIO(path))
        self.path = path

    def read(self, size: int | None = -1) -> bytes:
        """Read bytes, and reject files that inflate to far too many."""
        found = super().read(size)
        if size is None or size < 0:
            check_deflated(self.path.name, found, RAW)
        return found


def _slices(path: Path) -> list[_Slice]:
    """Return the slices of one file."""
    dataset = _read_dataset(path)
    if "Rows" not in dataset or "Columns" not in dataset:
        raise ValueError(f"{path.name} is a damaged DICOM file, or holds no picture")
    with _quiet(path):
        count = whole(dataset, "NumberOfFrames", 1)
        if not 1 <= count <= path.stat().st_size:
            raise ValueError(f"its NumberOfFrames is {count}, more than its bytes, or below 1")
        check_items(path.name, count, "frames")
        found, offsets = [], dataset.get("GridFrameOffsetVector")
        for frame in range(count):
            place = _numbers(dataset, frame, POSITION, (math.nan,) * 3)
            axes = _numbers(dataset, frame, ORIENTATION, (1, 0, 0, 0, 1, 0)).reshape(2, 3)
            groups = _groups(dataset, frame)
            if offsets not in (None, "", []):  # doses
                away = numbers(offsets, "GridFrameOffsetVector", count)
                place = place + away[frame] * np.cross(*axes)
            elif frame and not any("PlanePositionSequence" in each for each in groups):
                place = place + frame * (_between(dataset, frame) or 1.0) * np.cross(*axes)
            slope = float(_numbers(dataset, frame, SLOPE, (1,))[0])
            intercept = float(_numbers(dataset, frame, INTERCEPT, (0,))[0])
            found.append(_Slice(path, dataset, frame, place, axes, slope, intercept))
        return found


def _groups(dataset: Any, frame: int) -> list[Any]:
    """Yield the headers of a frame, then those shared by all."""
    found = []
    for name in GROUPS:
        every = dataset.get(name) or []
        if len(every):
            found.append(every[frame if name == GROUPS[0] and frame < len(every) else 0])
    return found


def _numbers(dataset: Any, frame: int, where: tuple[str, str], otherwise: Any) -> Doubles:
    """Return the numbers of a key, of the frame, of all frames or of the file."""
    group, key = where
    homes = [each[group][0] for each in _groups(dataset, frame) if each.get(group)]
    for home in (*homes, dataset):
        found = home.get(key)
        if found not in (None, "", []):
            least = 1 if key == PIXELS[1] else len(otherwise)
            return numbers(found, key, least, len(otherwise))
    return np.array(otherwise, np.float64)


def _between(dataset: Any, frame: int) -> float:
    """Return the distance of slices if their positions do not state it; 0: unknown."""
    for key in ("SpacingBetweenSlices", "SliceThickness"):
        step = _numbers(dataset, frame, ("PixelMeasuresSequence", key), (0,))[0]
        if step > 0 and math.isfinite(step):
            return float(step)
    return 0.0


def _sorted(slices: list[_Slice]) -> list[_Slice]:
    axes = slices[0].axes
    is_one_way = all(np.allclose(each.axes, axes, atol=1e-4) for each in slices)
    if is_one_way and all(np.isfinite(each.place).all() for each in slices):
        normal = np.cross(*axes)
        if len({float(normal @ each.place) for each in slices}) == len(slices):
            return sorted(slices, key=lambda each: float(normal @ each.place))
    numbers = [each.dataset.get("InstanceNumber") for each in slices]
    if len(slices) == len({each.path for each in slices}) and None not in numbers:
        return sorted(slices, key=lambda each: whole(each.dataset, "InstanceNumber"))
    return sorted(slices, key=lambda each: (natural(each.path), each.frame))


def _units(dataset: Any) -> str:
    """Return Hounsfield units for CT, unless rescaling states others.

    (US is "unspecified".)
    """
    if text(dataset, "Modality") != "CT":
        return ""
    return "hu" if text(dataset, "RescaleType") in ("", "HU", "US") else ""


def _kind(slices: list[_Slice]) -> np.dtype[Any]:
    """Return the smallest integer type for all possible values; floats if not integers."""
    first = slices[0].dataset
    if text(first, "PhotometricInterpretation") == "PALETTE COLOR":
        key = "RedPaletteColorLookupTableDescriptor"
        entries = numbers(first.get(key, (0, 0, 16)), key, 3)
        return np.dtype("uint8" if entries[2] <= 8 else "uint16")
    bits, signed = whole(first, "BitsAllocated", 16), whole(first, "PixelRepresentation", 0)
    if bits not in (1, 8, 16, 32, 64):
        raise ValueError(f"its BitsAllocated is {bits}, where 1, 8, 16, 32 or 64 is")
    if all((each.slope, each.intercept) == (1, 0) for each in slices):
        return np.dtype(f"{'int' if signed else 'uint'}{max(8, bits)}")
    scales = {(each.slope, each.intercept) for each in slices}
    if not all(number.is_integer() for scale in scales for number in scale):
        return np.dtype(np.float64)
    stored = whole(first, "BitsStored", bits)
    if not 1 <= stored <= bits:
        raise ValueError(f"its BitsStored is {stored}, where 1 to {bits} is")
    ends = (-(2 ** (stored - 1)), 2 ** (stored - 1) - 1) if signed else (0, 2**stored - 1)
    reached = [slope * end + intercept for slope, intercept in scales for end in ends]
    for name in FITTING if min(reached) >= 0 else FITTING[3:]:
        limits = np.iinfo(name)
        if limits.min <= min(reached) and max(reached) <= limits.max:
            return np.dtype(name)
    return np.dtype(np.float64)


def _values(slices: list[_Slice], shape: tuple[int, ...], kind: np.dtype[Any]) -> NDArray[Any]:
    """Read the rescaled values (Z, Y, X, C) of slices."""
    values = np.empty(shape, kind)
    pixels, path = np.zeros(0), None
    for n, each in enumerate(slices):
        if each.path != path:
            path = each.path
            pixels = _pixels(path)
        frames = whole(each.dataset, "NumberOfFrames", 1)
        if pixels.size != frames * math.prod(shape[1:]):
            raise ValueError(f"{path.name} is unlike the other slices: {pixels.shape} values")
        plane = pixels.reshape(frames, *shape[1:])[each.frame]
        if (each.slope, each.intercept) == (1, 0):
            values[n] = plane
        else:
            values[n] = plane.astype(np.float64) * each.slope + each.intercept
    return values


def _pixels(path: Path) -> NDArray[Any]:
    """Read the stored pixels of a file, colors as red, green and blue."""
    from pydicom.pixels.decoders.base import get_decoder
    from pydicom.pixels.processing import apply_color_lut

    dataset = _read_dataset(path, is_whole=True)
    with _quiet(path):
        meta = vars(dataset).get("file_meta")
        syntax: Any = None if meta is None else meta.get("TransferSyntaxUID")
    plugin = ""
    if syntax and syntax.is_encapsulated:
        try:
            known = get_decoder(syntax).available_plugins
        except NotImplementedError:
            known = ()
        if not known:
            told = "pip install 'hybrid-resample[dicom]'"
            raise ValueError(f"{path.name} is packed as {syntax.name}; {told}")
        # GDCM last, as damaged data may crash it.
        plugin = min(known, key=lambda plugin: (plugin == "gdcm", plugin))
    with _quiet(path), suppressed_output():
        if plugin:
            check_frames(dataset, path.name)
        dataset.pixel_array_options(decoding_plugin=plugin)
        pixels = np.asarray(dataset.pixel_array)
        if text(dataset, "PhotometricInterpretation") == "PALETTE COLOR":
            return np.asarray(apply_color_lut(pixels, dataset))
        if _is_negative(dataset) and not _units(dataset):
            most = -1 if dataset.PixelRepresentation else 2**dataset.BitsStored - 1
            return (most - pixels.astype(np.int64)).astype(pixels.dtype)
        return pixels


def _is_negative(dataset: Any) -> bool:
    """Return whether the lowest values are shown white, by the pixels' interpretation."""
    return text(dataset, "PhotometricInterpretation") == "MONOCHROME1"


def _interpolated(found: Volume, places: Doubles, gaps: Doubles) -> Volume:
    """Interpolate slices at uneven distances along one line to even ones."""
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
    note = "; ".join(filter(None, [f"{even.note}; is a slice missing?", found.note]))
    return even._replace(
        origin=places[0], direction=direction, units=found.units, note=note, length=found.length
    )


# Tags of a header.


def whole(dataset: Any, key: str, otherwise: int | None = None) -> int:
    """Return an integer of a header; `otherwise` if missing."""
    given = dataset.get(key)
    if given in (None, "") and otherwise is not None:
        return otherwise
    try:
        found = numbers(given, key, 1)[0]
        if not found.is_integer():
            raise ValueError
    except ValueError:
        raise ValueError(f"its {key} is {_shown(given)}, where one whole number is") from None
    return int(found)


def text(dataset: Any, key: str) -> str:
    """Return a text of a header, the first of several; empty if missing."""
    given = dataset.get(key) or ""
    return given if isinstance(given, str) else str(next(iter(given), ""))


def numbers(given: Any, key: str, *counts: int) -> Doubles:
    """Return the finite numbers (N,) of a header's key, of an allowed count."""
    try:
        found = np.atleast_1d(np.array(given, np.float64))
        is_right = found.ndim == 1 and len(found) in counts and bool(np.isfinite(found).all())
    except (TypeError, ValueError, OverflowError):
        is_right = False
    if not is_right:
        wanted = " or ".join(map(str, sorted(set(counts))))
        numbered = "finite number is" if wanted == "1" else "finite numbers are"
        raise ValueError(f"its {key} is {_shown(given)}, where {wanted} {numbered}")
    return found


def _shown(given: Any) -> str:
    """Return the given path, shortened."""
    return "missing" if given in (None, "") else f"{str(given)!r:.40}"


def check_frames(dataset: Any, name: str) -> None:
    """Reject compressed frames of another size than the header's."""
    from pydicom.encaps import generate_frames

    wanted = (int(dataset.Rows), int(dataset.Columns))
    count = int(dataset.get("NumberOfFrames", 1) or 1)
    for frame in generate_frames(dataset.PixelData, number_of_frames=count):
        size = size_of(frame)
        if size is not None and size != wanted:
            raise LimitError(
                f"{name} holds a picture of {size[1]} x {size[0]} pixels and says that it has "
                f"{wanted[1]} x {wanted[0]}; get it again"
            )


def _lattice(slices: list[_Slice], places: Doubles) -> tuple[Doubles, Doubles]:
    """Return spacing (3,) and direction (3, 3)."""
    dataset, frame = slices[0].dataset, slices[0].frame
    row, column = slices[0].axes
    key = "ImagerPixelSpacing"
    given = dataset.get(key)
    imager = np.ones(2) if given in (None, "", []) else numbers(given, key, 2)
    down, across = np.resize(_numbers(dataset, frame, PIXELS, imager), 2)
    normal, step = np.cross(row, column), _between(dataset, frame) or 1.0
    if len(slices) > 1 and np.isfinite(places).all():
        way = (places[-1] - places[0]) / (len(slices) - 1)
        length = float(np.linalg.norm(way))
        if length > 0:
            step = length
            if np.linalg.norm(way / length - normal) > TILTED:
                normal = way / length
    return np.array([across, down, step]), np.column_stack([row, column, normal])


@dataclass(frozen=True)
class Dicom:
    """A folder with a DICOM series, sorted by position, or one multi-frame file."""

    series: str = ""  # instance UID; needed where the folder holds several

    space: ClassVar[str] = "lps"
    suffixes: ClassVar[tuple[str, ...]] = (".dcm",)

    def __call__(self, path: Path) -> Volume:
        if path.is_dir():
            files = dicom_slices(path, self.series)
            return dicom_volume(files, path.resolve().name)
        name = stem(existing_file(path), self.suffixes)
        return dicom_volume([path], name)
