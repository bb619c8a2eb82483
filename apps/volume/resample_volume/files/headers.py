"""Headers of volume files, validated before voxels are read, and their voxels."""

import bz2
import gzip
import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, BinaryIO, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.painting.scenes import check_lattice, check_places
from resample.reading.limits import check_size, check_unpacked
from resample.types import Doubles
from resample_volume.data.recordings import SeveralChannelsError, SeveralTimesError, alone, how
from resample_volume.data.values import require_memory
from resample_volume.types import UNKNOWN, Recording, Volume

KEPT = ("uint8", "int8", "uint16", "int16", "int32", "float32", "float64")
WIDENED = {"bool": "uint8", "float16": "float32"}  # widened without loss


class VolumeHeader(NamedTuple):
    """A volume without its values."""

    shape: tuple[int, ...]  # voxels along x, y, z
    dtype: np.dtype[Any]  # of the voxels in the file
    spacing: Doubles  # (3,) x, y, z
    origin: Doubles  # (3,) position of the first voxel
    direction: Doubles  # (3, 3) columns are the steps of x, y, z
    name: str  # for messages
    units: str = ""  # of the values, as `Volume` has them
    times: int = 1  # volumes one after the other
    parts: int = 1  # numbers of a voxel
    is_color: bool = False  # whether these are the parts of a color
    pixel: str = ""  # what the file calls voxels of several numbers
    length: str = UNKNOWN  # as `Volume` has it
    note: str = ""

    @property
    def size(self) -> int:
        """Bytes of the voxels, unpacked."""
        return math.prod(self.shape) * self.times * self.parts * self.dtype.itemsize


def header(
    shape: tuple[int, ...],
    dtype: Any,
    name: str,
    *,
    spacing: ArrayLike = (1, 1, 1),
    origin: ArrayLike = (0, 0, 0),
    direction: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
) -> VolumeHeader:
    """Make a header, and reject anything but a scalar volume.

    The lengths of the columns of `direction` move to the spacing, which preserves all positions.
    """
    check_shape(shape, name)
    kind = check_type(np.dtype(dtype), name)
    steps, lattice = _lattice(_doubles(spacing), _doubles(direction), name)
    start = _doubles(origin)
    if not np.isfinite(start).all():
        raise ValueError(
            f"{name}: origin {_listed(start)} is not finite; correct the file's header"
        )
    check_places(start, f"{name}: its origin")
    return VolumeHeader(tuple(shape), kind, steps, start, lattice, name)


def check_shape(shape: tuple[int, ...], name: str) -> None:
    """Reject all but three dimensions of at least two voxels, given as x, y, z."""
    if len(shape) != 3:
        raise ValueError(
            f"{name} has {len(shape)} dimensions, {_sized(shape)}; a volume has 3 (x, y, z)"
        )
    if min(shape) < 1:
        raise ValueError(f"{name} is empty: {_sized(shape)} voxels; every dimension must be over 0")
    if min(shape) < 2:
        raise ValueError(
            f"{name} is a single slice of {_sized(shape)} voxels; a volume has at least 2 along "
            "x, y and z (give the folder if it is one of a series; "
            "resample-texture takes pictures)"
        )


def check_type(dtype: np.dtype[Any], name: str) -> np.dtype[Any]:
    """Return a type of voxel that can be kept exactly; reject any other."""
    if dtype.kind not in "biuf" or dtype.newbyteorder("=").name not in (*KEPT, *WIDENED):
        raise ValueError(
            f"{name} has voxels of type {dtype}; known are {', '.join(KEPT)} "
            "(bool and float16 are widened to them); convert the volume"
        )
    return dtype


def check_not_empty(known: VolumeHeader) -> None:
    """Reject a header without times or components."""
    if known.times < 1 or known.parts < 1:
        raise ValueError(
            f"{known.name} is empty: {known.times} times, {known.parts} numbers at each voxel; "
            "both must be over 0"
        )


def check_alone(known: VolumeHeader) -> None:
    """Reject more than one volume; the components of colors are one."""
    if known.times > 1:
        raise SeveralTimesError(
            f"{known.name} has 4 dimensions, {_sized((*known.shape, known.times))}; a volume has 3 "
            f"(x, y, z): {how('time', known.times)}"
        )
    if known.parts > 1 and not known.is_color:
        raise SeveralChannelsError(
            f"{known.name} has voxels of type {known.pixel or known.dtype.name!r}, {known.parts} "
            f"numbers each; a volume has one real number per voxel: {how('channel', known.parts)}"
        )


Check = Callable[[VolumeHeader], None]  # check of a header before values are read


def accept_any(known: VolumeHeader) -> None:
    """Accept any header."""


def volume(values: NDArray[Any], known: VolumeHeader) -> Volume:
    """Make a volume of values (Z, Y, X); unsupported types are widened."""
    check_alone(known)
    return alone(recording(values, known))


def recording(
    values: NDArray[Any], known: VolumeHeader, *, channels_first: bool = False
) -> Recording:
    """Make a recording of all values; unsupported types are widened.

    `values`: (T, Z, Y, X, C) without the axes T and C of length 1. `channels_first`: they are (T,
    C, Z, Y, X) instead.
    """
    check_not_empty(known)
    kind = known.dtype.newbyteorder("=")
    kept = np.dtype(WIDENED.get(kind.name, kind))
    if kept != values.dtype:
        require_memory(values.size * kept.itemsize, known.name)
        values = values.astype(kept)
    space = known.shape[::-1]
    if channels_first:
        every = values.reshape(known.times, known.parts, *space)
    else:
        every = values.reshape(known.times, *space, known.parts)
        every = every.transpose(0, 4, 1, 2, 3)
    places = (known.spacing, known.origin, known.direction)
    found = Recording(every, *places, known.name, known.units, known.is_color)
    return found._replace(note=known.note, length=known.length)


def existing_file(path: Path) -> Path:
    """Return the path of a file that can be opened."""
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; name one of its files")
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file")
    if not path.is_file():
        raise OSError(f"{path} is a device or a pipe, not a file")
    try:
        path.open("rb").close()
    except OSError as error:
        raise type(error)(f"{path} cannot be read: {error.strerror}") from None
    return path


def stem(path: PurePath, suffixes: tuple[str, ...]) -> str:
    """Return the file name without its format's suffix: `engine` of `engine.nii.gz`."""
    for suffix in sorted(suffixes, key=len, reverse=True):
        if path.name.lower().endswith(suffix) and len(path.name) > len(suffix):
            return path.name[: -len(suffix)]
    return path.name


@np.errstate(all="ignore")  # absurd numbers are rejected, without warnings
def _lattice(spacing: Doubles, direction: Doubles, name: str) -> tuple[Doubles, Doubles]:
    if not (np.isfinite(spacing).all() and (spacing > 0).all()):
        raise ValueError(
            f"{name}: spacing {_listed(spacing)} must be positive and finite along x, y, z; "
            "correct it (mirroring an axis belongs in the direction)"
        )
    if not np.isfinite(direction).all():
        raise ValueError(f"{name}: direction {_listed(direction)} is not finite; correct it")
    length = np.linalg.norm(direction, axis=0)
    if not length.all() or abs(np.linalg.det(direction / length)) < 1e-6:
        raise ValueError(
            f"{name}: direction {_listed(direction)} is singular; its columns must span space"
        )
    check_lattice(spacing * direction, f"{name}: its lattice")
    if np.allclose(length, 1, atol=1e-5):  # headers are rounded: nearly unit columns are kept
        return spacing, direction
    return spacing * length, direction / length


def _doubles(numbers: ArrayLike) -> Doubles:
    return np.array(numbers, np.float64)


def _listed(numbers: Doubles) -> str:
    return f"({', '.join(f'{number:g}' for number in numbers.ravel())})"


def _sized(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


@dataclass(frozen=True)
class OneOfAll:
    """Base of recorders: one volume is read as all are, if the file holds no more."""

    suffixes: ClassVar[tuple[str, ...]]

    def __call__(self, path: Path) -> Volume:
        return alone(self.recorded(path, check_alone))

    def recorded(self, path: Path, check: Check = accept_any) -> Recording:
        """Read all times and channels, as `Recorder` says."""
        return self.read(existing_file(path), stem(path, self.suffixes), check)

    def read(self, path: Path, name: str, check: Check) -> Recording:
        """Read all times and channels of an existing file; the name is its volume's."""
        raise NotImplementedError


BLOCK = 1 << 20  # bytes decompressed at a time
TEXTS = ("text", "hex")
SLACK = 16 * BLOCK  # excess bytes that are still counted


class VoxelData(NamedTuple):
    """Location and encoding of a file's voxels."""

    paths: list[Path]  # one, or several with equal parts of them
    start: int = 0  # bytes before them; where negative they are the last of the file
    packing: str = "raw"  # raw, gzip (zlib's form, too), bzip2, text or hex
    skip: int = 0  # bytes before them that are compressed as well
    is_exact: bool = True  # nothing may follow them


def voxels(stored: VoxelData, known: VolumeHeader) -> NDArray[Any]:
    """Read all numbers (N,) of a volume, in the file's type; raw ones are memory mapped.

    Raises ValueError: their number differs from the header, compressed data are damaged, or they do
    not fit in memory.
    """
    check_not_empty(known)
    require_memory(known.size, known.name)
    if len(stored.paths) == 1 and stored.packing == "raw":
        return _bare(stored.paths[0], stored, known.dtype, known.size)
    if stored.packing not in TEXTS:
        packed = sum(path.stat().st_size for path in set(stored.paths))
        check_unpacked(known.name, packed, known.size)  # files may be named several times
    values = np.empty(known.size // known.dtype.itemsize, known.dtype)
    target = values.view(np.uint8).data
    count, rest = divmod(known.size, len(stored.paths))
    if rest:
        raise ValueError(
            f"{known.name}: its voxels do not divide evenly among {len(stored.paths)} files"
        )
    for n, path in enumerate(stored.paths):
        _fill(target[n * count : (n + 1) * count], path, stored, known.dtype)
    return values


def first_bytes(path: Path, count: int) -> bytes:
    """Read the first bytes of a file, decompressed if `.gz`; fewer if it is shorter."""
    if path.name.lower().endswith(".gz"):
        with unpacking(path.name), gzip.open(path) as packed:
            return packed.read(count)
    with path.open("rb") as file:
        return file.read(count)


def wrong_size(name: str, given: int, wanted: int, *, more: str = "") -> ValueError:
    """Make the error for data of the wrong size, both in bytes."""
    return ValueError(
        f"{name} holds {given}{more} bytes, {wanted} are wanted; correct the shape and "
        "type, or get the file again"
    )


@contextmanager
def unpacking(name: str) -> Iterator[None]:
    """Convert all errors of damaged compression to one."""
    try:
        yield
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ValueError(f"{name} is damaged: {error}; get the file again") from None


def _bare(path: Path, stored: VoxelData, dtype: np.dtype[Any], size: int) -> NDArray[Any]:
    whole = path.stat().st_size
    start = stored.start if stored.start >= 0 else max(0, whole - size)
    given = max(0, whole - start)
    if given < size or (given > size and stored.is_exact):
        raise wrong_size(path.name, given, size)
    count = size // dtype.itemsize
    if start % dtype.itemsize:  # kernels need aligned numbers
        return np.fromfile(path, dtype, count, offset=start)
    return np.memmap(path, dtype, "r", start, (count,))


def _fill(target: memoryview, path: Path, stored: VoxelData, dtype: np.dtype[Any]) -> None:
    if stored.packing in TEXTS:
        numbers = _of_text(path, stored, dtype)
        if len(numbers) != len(target):
            raise wrong_size(path.name, len(numbers), len(target))
        target[:] = numbers
    elif stored.packing == "raw":
        target[:] = _bare(path, stored, np.dtype(np.uint8), len(target)).data
    else:
        # Decompress a file into memory, and verify its checksums
        wanted, packed = len(target) + stored.skip, path.stat().st_size
        check_unpacked(path.name, packed, wanted)
        count = 0
        with path.open("rb") as file, unpacking(path.name):
            file.seek(max(0, stored.start))
            for piece in _pieces(file, stored.packing):
                first = max(0, count - stored.skip)
                begin = max(0, stored.skip - count)
                kept = piece[begin : begin + max(0, len(target) - first)]
                target[first : first + len(kept)] = kept
                count += len(piece)
                if count > wanted + SLACK:
                    raise wrong_size(path.name, count - stored.skip, len(target), more=" or more")
        if count < wanted or (count > wanted and stored.is_exact):
            raise wrong_size(path.name, max(0, count - stored.skip), len(target))


def _of_text(path: Path, stored: VoxelData, dtype: np.dtype[Any]) -> bytes:
    check_size(path.name, path.stat().st_size)
    words = path.read_bytes()[stored.start :].split()
    try:
        if stored.packing == "hex":
            return bytes.fromhex(b"".join(words).decode("ascii"))
        return np.array(words, dtype).tobytes()
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{path.name} is damaged: {error}; get the file again") from None


def _pieces(file: BinaryIO, packing: str) -> Iterator[bytes]:
    """Yield decompressed bytes of one or more concatenated streams."""
    new = bz2.BZ2Decompressor if packing == "bzip2" else lambda: zlib.decompressobj(wbits=47)
    unpacker: Any = new()
    rest = b""
    while block := rest or file.read(BLOCK // 4):
        if unpacker.eof:
            if not block.startswith((b"\x1f\x8b", b"BZh")):  # padding
                return
            unpacker = new()
        try:
            yield unpacker.decompress(block, 4 * BLOCK)
            while not unpacker.eof and not getattr(unpacker, "needs_input", True):
                yield unpacker.decompress(b"", 4 * BLOCK)
        except OSError as error:  # so bzip2 says it
            raise EOFError(error) from None
        rest = getattr(unpacker, "unconsumed_tail", b"") or unpacker.unused_data
    if not unpacker.eof:
        raise EOFError("the compressed data ends early")
