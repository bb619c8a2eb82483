"""Read the raw numbers of depth files; `resample_warp3d.depth.encodings` interprets them."""

import math
import re
import struct
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from resample.cameras.record3d import facts_of_recording, unpacked
from resample.console import say_of
from resample.files.metadata.fields import orientation_of, upright
from resample.memory import require_memory
from resample.reading.arrays import is_npy, npz_names, read_npy, read_npz
from resample.reading.limits import check_file, check_unpacked
from resample.reading.native import lacking, suppressed_output
from resample.reading.pictures import WHITE, DisplayedInput, check_picture, complaint_of, opened
from resample.types import Floats
from resample_warp3d.depth.encodings import Raw

PFM_HEADER = re.compile(rb"(P[Ff])\s+(\d+)\s+(\d+)\s+(\S+)\s")
COLMAP_HEADER = re.compile(rb"(\d{1,9})&(\d{1,9})&(\d{1,9})&")
COLORS = 3  # channels of a picture in colors
ALPHA = ("A", "ALPHA")  # names of opacity
LZFSE_BLOCK = re.compile(rb"bvx[-n12](.{4})", re.DOTALL)  # its magic and its unpacked size
SENSORS = (256, 192), (640, 480), (960, 720)  # rows, columns, upright
PROPORTION = 0.02  # by which aspect ratios of confidence and depth may differ
BYTES_PER_VALUE = 24  # of depth and the copies made while converting it to nearness


def read_depth(path: str | Path) -> Raw:
    """Read the raw numbers of a depth file.

    Result: (H, W), upright; not a number outside an EXR's data window. Integers stay integers, so
    that an encoding can require their scale. The scale in a PFM's header only gives its byte order,
    as Middlebury's are not 1 either.
    """
    file, name = _split(path)
    suffix = file.suffix.lower()
    if name and suffix in (".pfm", ".npy", ".bin", ".depth"):
        raise ValueError(f"{file} holds one array, so {name!r} cannot be selected")
    if suffix == ".pfm":
        raw = _read_pfm(file)
    elif suffix == ".r3d":
        raw = _read_recording(file, name or "0")
    elif suffix == ".depth":
        raw = _floats(file.read_bytes(), str(file), "<f4", (0, 0))
    elif suffix == ".bin":
        raw = _read_colmap(file)
    elif suffix in (".npy", ".npz"):
        raw = _read_numpy(file, name)
    else:
        raw = _read_channel(file, name)
    if raw.ndim == 3:
        raw = _gray(raw)
    if raw.ndim != 2 or not raw.size or raw.dtype.kind not in "uif":
        raise ValueError(f"{path} holds {raw.dtype} of shape {raw.shape}; depth is numbers (H, W)")
    return np.ascontiguousarray(raw, raw.dtype.newbyteorder("="))


def confident(nearness: Floats, confidence: Any, least: float | None = None) -> Floats:
    """Return nearness (H, W), 0 where the confidence is too low."""
    import cv2

    is_file = isinstance(confidence, str | PathLike)
    sure = np.asarray(read_depth(str(confidence)) if is_file else confidence, np.float64)
    if sure.ndim != 2 or not np.isfinite(sure).any():
        raise ValueError(f"confidence of shape {sure.shape}; give finite numbers (H, W)")
    (height, width), (rows, columns) = nearness.shape, sure.shape
    if abs(rows * width / (columns * height) - 1.0) > PROPORTION:
        raise ValueError(
            f"confidence of {columns} x {rows} px does not fit depth of {width} x {height} px; "
            "give one of the same frame"
        )
    sure = cv2.resize(sure, (width, height), interpolation=cv2.INTER_NEAREST)
    low = 0.5 * float(np.nanmax(sure)) if least is None else least
    return np.where(sure >= low, nearness, np.float32(0))


def read_depths(path: str | Path) -> Raw | None:
    """Read a stack (N, H, W) of maps from an array file; None if it is not a stack.

    An .npy file is mapped to memory: its maps are read when they are used.
    """
    try:
        file, name = _split(path)
    except FileNotFoundError:
        return None
    if file.suffix.lower() not in (".npy", ".npz"):
        return None
    raw = read_npy(file, mapped=True) if is_npy(file) else _read_numpy(file, name)
    if raw.ndim == 4 and raw.shape[3] == 1:
        raw = raw[..., 0]
    return raw if raw.ndim == 3 and raw.size and raw.dtype.kind in "uif" else None


def _split(path: str | Path) -> tuple[Path, str]:
    """Split off the name behind a colon; empty if there is none."""
    file, _, name = str(path).rpartition(":")
    if Path(path).is_file() or not file:
        file, name = str(path), ""
    check_file(path if not Path(file).is_file() else file)
    return Path(file), name


def _gray(raw: Raw) -> Raw:
    """Return the one channel of an array (H, W, C) or (1, H, W) with equal channels."""
    if raw.shape[0] == 1:
        raw = np.moveaxis(raw, 0, 2)
    first = raw[..., :1]
    is_number = raw.dtype.kind in "uif" and raw.shape[2] <= COLORS
    is_gray = is_number and np.array_equal(raw, first.repeat(raw.shape[2], 2), equal_nan=True)
    gray: Raw = raw[..., 0] if is_gray else raw
    return gray


def _read_pfm(path: Path) -> Raw:
    """Read a portable float map; its rows run from bottom to top."""
    with path.open("rb") as file:
        found = PFM_HEADER.match(file.read(256))
        if found is None:
            raise ValueError(f"{path} is not a PFM: it does not begin with Pf and three numbers")
        letters, width, height = found[1], int(found[2]), int(found[3])
        channels = 1 if letters == b"Pf" else COLORS
        try:
            scale = float(found[4])
        except ValueError:
            raise ValueError(f"{path} is not a PFM: its scale is {found[4]!r}") from None
        file.seek(found.end())
        content = file.read()
    count = width * height * channels
    if len(content) < 4 * count:
        raise OSError(
            f"{path} is cut off: {width} × {height} pixels are {4 * count} bytes, it has "
            f"{len(content)}"
        )
    if abs(scale) != 1:
        say_of(path, f"the scale {abs(scale):g} in its header is not applied")
    kind = "<f4" if scale < 0 else ">f4"
    raw = np.frombuffer(content, kind, count).reshape(height, width, channels)[::-1]
    if channels > 1 and raw.size and _gray(raw).ndim > 2:
        raise ValueError(f"{path} holds 3 channels that differ; depth has one")
    return raw


def _read_recording(path: Path, frame: str) -> Raw:
    """Read the depth of a frame of Record3D, nan where its confidence is the lowest."""
    facts = facts_of_recording(path)
    shape = int(facts.get("dh", 0)), int(facts.get("dw", 0))
    member = f"rgbd/{frame}.depth"
    raw = _floats(unpacked(path, member), f"{path}: {member}", "<f4", shape)
    with suppress(LookupError):  # recordings of the front camera have none
        member = f"rgbd/{frame}.conf"
        sure = _floats(unpacked(path, member), f"{path}: {member}", "u1", raw.shape)
        raw = np.where(sure > 0, raw, np.float32(np.nan))
    return raw


def _floats(data: bytes, name: str, kind: str, shape: tuple[int, ...]) -> Raw:
    """Return numbers, unpacked if need be; a shape of 0 x 0 stands for a usual sensor's."""
    if data[:3] == b"bvx":
        try:
            import liblzfse
        except ImportError as error:
            raise lacking(name, "pyliblzfse", error, "record3d") from None
        sizes = (struct.unpack("<I", each)[0] for each in LZFSE_BLOCK.findall(data))
        check_unpacked(name, len(data), sum(sizes))
        try:
            data = liblzfse.decompress(data)
        except liblzfse.error as error:
            raise OSError(f"{name} is damaged: {error}") from None
    size = np.dtype(kind).itemsize
    known = {rows * columns * size: (rows, columns) for rows, columns in SENSORS}
    found = shape if min(shape) > 0 else known.get(len(data), (0, 0))
    if not data or len(data) != size * math.prod(found):
        sizes_of = ", ".join(f"{rows} x {columns}" for rows, columns in SENSORS)
        raise ValueError(
            f"{name} holds {len(data)} bytes, not {size} for each pixel of "
            + ("x".join(map(str, shape)) if min(shape) > 0 else f"a sensor ({sizes_of})")
        )
    return np.frombuffer(data, kind).reshape(found)


def _read_colmap(path: Path) -> Raw:
    """Read a COLMAP depth map: `width&height&channels&`, then rows of float32 from the top.

    0 is unknown. COLMAP's normal maps, with three such planes, are refused.
    """
    with path.open("rb") as file:
        found = COLMAP_HEADER.match(file.read(64))
        if found is None:
            raise ValueError(
                f"{path} is not a depth map of COLMAP: it does not begin with "
                "width&height&channels&"
            )
        width, height, channels = map(int, found.groups())
        if channels != 1:
            raise ValueError(
                f"{path} holds {channels} channels; depth has one, as in stereo/depth_maps"
            )
        size, wanted = path.stat().st_size - found.end(), 4 * width * height
        if size != wanted:
            raise OSError(
                f"{path} is cut off or damaged: {width} × {height} floats are {wanted} bytes, it"
                f" has {size}"
            )
        what = f"{path} of {width} x {height} pixels"
        require_memory(BYTES_PER_VALUE * width * height, what, "take a smaller one")
        file.seek(found.end())
        return np.frombuffer(file.read(wanted), "<f4").reshape(height, width)


def _read_numpy(path: Path, name: str) -> Raw:
    """Read the array of an NPY, or one of an NPZ."""
    if is_npy(path):
        return read_npy(path)
    picked = _pick(path, npz_names(path), name, "arrays")
    return read_npz(path, picked)[picked]


def _read_channel(path: Path, name: str) -> Raw:
    """Read a channel of a picture, upright, in its own type.

    Without a name, channels of colors that are all equal are taken for one.
    """
    source = opened(path)
    try:
        spec = source.spec()
        if spec.get_int_attribute("tiff:PhotometricInterpretation", -1) == WHITE:
            raise ValueError(
                f"{path} is of the kind MinIsWhite, so its numbers may be inverted; write"
                " it as MinIsBlack"
            )
        if isinstance(source, DisplayedInput):
            source.outside = math.nan
        orientation, names = orientation_of(path, spec), list(spec.channelnames)
        what = f"{path} of {spec.width} x {spec.height} pixels"
        require_memory(BYTES_PER_VALUE * spec.height * spec.width, what, "take a smaller one")
        check_picture(path, spec)
        colors = [n for n, each in enumerate(names) if each.upper() not in ALPHA]
        has_depth = any(each.split(".")[-1] == "Z" for each in names)
        if name or len(colors) < 2 or len(colors) > COLORS or has_depth:
            shown = [names[n] for n in colors] if not name and len(colors) == 1 else names
            raw = _channel(path, source, names.index(_pick(path, shown, name, "channels")))
            return upright(raw, orientation)
        raw, *others = (_channel(path, source, n) for n in colors)
        if not all(np.array_equal(other, raw, equal_nan=True) for other in others):
            _pick(path, names, name, "channels")  # refuses
        return upright(raw, orientation)
    finally:
        source.close()


def _channel(path: Path, source: Any, n: int) -> Raw:
    """Read the n-th channel of an open picture."""
    import OpenImageIO

    spec = source.spec()
    kind = str(spec.channelformat(n))
    wanted = OpenImageIO.TypeDesc("float" if kind == "half" else kind)
    with suppressed_output():
        data = source.read_image(0, 0, n, n + 1, wanted)
    complaint = complaint_of(source, "")
    if data is None or complaint:
        raise OSError(f"{path} is damaged: {complaint or 'it ends too early'}")
    return np.asarray(data).reshape(spec.height, spec.width)


def _pick(path: Path, names: list[str], name: str, what: str) -> str:
    """Return the requested name, or the only one, or depth's."""
    if name in names:
        return name
    depths = [known for known in names if known == "Z" or known.endswith(".Z")]
    for candidates in (names, [known for known in depths if known == "Z"], depths):
        if not name and len(candidates) == 1:
            return candidates[0]
    known = ", ".join(names)
    if names[:3] == ["R", "G", "B"] and not name:
        raise ValueError(
            f"{path} is a picture in color; give the picture first, then its depth, or a channel "
            f"that holds it, {path}:R"
        )
    if name:
        raise ValueError(f"{path} has no {name!r}; it has the {what} {known}")
    raise ValueError(
        f"{path} has the {what} {known or 'of an empty file'}; pick one as {path}:NAME"
    )
