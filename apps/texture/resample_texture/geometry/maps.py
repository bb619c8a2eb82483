"""Read arrays of two numbers per pixel: map files, flow files, OpenCV's integer maps.

Files do not say what the numbers mean (coordinates in the source, or displacements of texels); the
caller decides by the class of `geometry` that it makes of them.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.files.images import read_channels
from resample.reading.arrays import is_npy, read_npy, read_npz
from resample.types import Doubles

FIXED_POINT_STEPS = 32  # per pixel, of OpenCV's integer maps
FLOW_MAGIC = 202021.25  # the first number of a .flo file
UNKNOWN_FLOW = 1e9  # px; larger flow means unknown, Baker et al. 2011
NAMES = (("X", "Y"), ("x", "y"), ("U", "V"), ("u", "v"), ("map_x", "map_y"), ("R", "G"))


def read_map(path: str | Path) -> NDArray[Any]:
    """Read two numbers per pixel, (H, W, 2), x first, in the file's own type.

    `path`: `.npy` of the shape (H, W, 2); `.npz` with the arrays x and y; `.flo` (Middlebury's
    optical flow, not a number where it is unknown); or any picture with two channels, or with
    channels named X and Y, U and V, or R and G, as they are stored.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".flo":
        data = Path(path).read_bytes()
        if len(data) < 12 or np.frombuffer(data, "<f4", 1)[0] != FLOW_MAGIC:
            raise ValueError(f"{path} is not a .flo file: it does not begin with {FLOW_MAGIC}")
        width, height = (int(number) for number in np.frombuffer(data, "<i4", 2, 4))
        if width < 1 or height < 1 or len(data) != 12 + 8 * width * height:
            raise OSError(f"{path} is damaged: {len(data)} bytes for {width} × {height} vectors")
        flow = np.frombuffer(data, "<f4", -1, 12).reshape(height, width, 2).astype(np.float64)
        is_known = (np.abs(flow) <= UNKNOWN_FLOW).all(axis=2, keepdims=True)
        return np.where(is_known, flow, np.nan)
    if suffix in (".npy", ".npz"):
        loaded = read_arrays(path)
        if isinstance(loaded, dict):
            return _two_of(loaded, path)
        return checked_pairs(loaded, f"{path}: a map")
    return _two_of(dict(read_channels(path)), path)


def places_by_map(
    pairs: NDArray[Any], shift: float = 0.0
) -> Callable[[Doubles, Doubles], tuple[Doubles, Doubles]]:
    """Return a function from x and y of a rectangle of pixel centers to a map's values.

    `pairs`: (H, W, 2) of real numbers. `shift`: added to the numbers, px.
    """

    def places(x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
        left, top = int(x[0, 0]), int(y[0, 0])
        part = pairs[top : top + x.shape[0], left : left + x.shape[1]].astype(np.float64)
        return part[..., 0] + shift, part[..., 1] + shift

    return places


def read_arrays(path: str | Path) -> NDArray[Any] | dict[str, NDArray[Any]]:
    """Read the array of a .npy file, or the arrays of a .npz file by name."""
    file = Path(path)
    # Only the parts that are used are read.
    return read_npy(file, mapped=True) if is_npy(file) else read_npz(file)


def as_pairs(array: ArrayLike, name: str) -> Doubles:
    """Return checked numbers (H, W, 2) as float64; `name` begins error messages."""
    return checked_pairs(array, name).astype(np.float64)


def checked_pairs(array: ArrayLike, name: str) -> NDArray[Any]:
    """Return checked numbers (H, W, 2), unconverted; `name` begins error messages."""
    pairs = np.asarray(array)
    if pairs.ndim != 3 or pairs.shape[2] != 2 or pairs.size == 0:
        raise ValueError(f"{name} holds two numbers per pixel, (H, W, 2), not {pairs.shape}")
    if not is_number(pairs):
        raise ValueError(f"{name} holds real numbers, not {pairs.dtype}")
    return pairs


def is_number(array: NDArray[Any]) -> bool:
    """Whether an array holds real numbers."""
    return array.dtype.kind in "fiu"


def from_fixed_point(whole: NDArray[Any], fraction: NDArray[Any]) -> Doubles:
    """Return coordinates (h, w, 2) of OpenCV's two integer maps, centers at integers.

    `whole`: (h, w, 2) int16, whole pixels. `fraction`: (h, w) uint16, 32 y + x in 32nds of a pixel.
    """
    places = as_pairs(whole, "a fixed-point map")
    if fraction.shape != whole.shape[:2]:
        raise ValueError(f"{fraction.shape} fractions do not fit a map of {whole.shape[:2]} pixels")
    if whole.dtype != np.int16 or fraction.dtype not in (np.uint16, np.int16):
        raise ValueError(
            f"a fixed-point map is of int16 and uint16, not of {whole.dtype} and {fraction.dtype}"
        )
    y, x = np.divmod(fraction.astype(np.int64), FIXED_POINT_STEPS)
    return places + np.stack([x, y % FIXED_POINT_STEPS], axis=2) / FIXED_POINT_STEPS


def _two_of(channel: dict[str, NDArray[Any]], path: str | Path) -> NDArray[Any]:
    """Return the channels x and y, by name, or because there are only two."""
    known = [pair for pair in NAMES if all(name in channel for name in pair)]
    if not known and len(channel) != 2:
        names = ", ".join(channel) or "none"
        raise ValueError(f"{path}: a map has two channels, or channels X and Y; here are {names}")
    x, y = (channel[name] for name in (known[0] if known else channel))
    if x.shape != y.shape or x.ndim != 2:
        raise ValueError(f"{path}: x of {x.shape} and y of {y.shape} are not pictures of one size")
    return checked_pairs(np.stack([x, y], axis=2), f"{path}: a map")
