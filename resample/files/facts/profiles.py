"""ICC profiles of a matrix and curves, as of cameras and displays: their colors in sRGB."""

import struct
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np

from resample.colors import to_srgb
from resample.types import Doubles, Floats

HEADER, ENTRY = 128, 12  # bytes of a profile before its table of tags, and of an entry of that
FIXED = 65_536.0  # ICC's numbers are 16.16
NUMBERS = 1, 3, 4, 5, 7  # of parametric curves, by type

Curve = Callable[[Any], Any]


def converted(color: Floats, profile: bytes) -> Floats:
    """Convert straight light (..., C), decoded as sRGB is, to that of sRGB.

    Colors beyond sRGB become negative, or larger than 1.

    Raises ValueError: the profile is of neither RGB by a matrix nor gray by a curve.
    """
    curves, to_xyz = profile_colors(profile)
    values = to_srgb(color)
    light = np.stack([curve(values[..., n]) for n, curve in enumerate(curves)], axis=-1)
    if len(curves) == 1:
        return light.astype(np.float32)
    return np.asarray(light @ (np.linalg.inv(_usual()) @ to_xyz).T, np.float32)


@lru_cache(8)
def profile_colors(profile: bytes) -> tuple[tuple[Curve, ...], Doubles]:
    """Read the curves of a profile's channels to light, 0..1, and its matrix from that to XYZ."""
    tags, names = _tags(profile), {b"RGB ": b"rgb", b"GRAY": b"k"}.get(profile[16:20], b"")
    wanted = [bytes([name]) + b"TRC" for name in names]
    wanted += [bytes([name]) + b"XYZ" for name in names if name != ord("k")]
    if not wanted or not tags.keys() >= set(wanted):
        raise ValueError("its profile is no matrix with curves; convert it where it was made")
    curves = tuple(_curve(tags[name]) for name in wanted if name.endswith(b"TRC"))
    columns = [_fixed(tags[name][8:20]) for name in wanted if name.endswith(b"XYZ")]
    return curves, np.stack(columns, axis=1) if columns else np.eye(1)


@lru_cache(1)
def _usual() -> Doubles:
    """Matrix (3, 3) from light of sRGB to XYZ, white as in profiles (D50)."""
    from PIL import ImageCms

    return profile_colors(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())[1]


def _tags(profile: bytes) -> dict[bytes, bytes]:
    """Contents of a profile, by name; none if it is cut off."""
    try:
        (count,) = struct.unpack_from(">I", profile, HEADER)
        places = (HEADER + 4 + ENTRY * n for n in range(min(count, len(profile) // ENTRY)))
        entries = [struct.unpack_from(">4sII", profile, place) for place in places]
    except struct.error:
        return {}
    return {name: profile[first : first + size] for name, first, size in entries}


def _fixed(data: bytes) -> Doubles:
    return np.frombuffer(data, ">i4").astype(np.float64) / FIXED


def _curve(data: bytes) -> Curve:
    """Curve of a tag: a table, a power, or a formula (ICC.1, sections 10.6 and 10.18)."""
    kind = data[:4]
    if kind == b"curv":
        (count,) = struct.unpack_from(">I", data, 8)
        table = np.frombuffer(data, ">u2", count, 12).astype(np.float64)
        if count > 1:
            return partial(np.interp, xp=np.linspace(0.0, 1.0, count), fp=table / 65_535.0)
        return partial(_formula, g=float(table[0]) / 256.0 if count else 1.0)
    (form,) = struct.unpack_from(">H", data, 8)
    if kind != b"para" or form >= len(NUMBERS):
        raise ValueError("its profile has curves of an unknown kind; convert it where it was made")
    numbers = _fixed(data[12 : 12 + 4 * NUMBERS[form]]).tolist()
    if form in (1, 2):  # their line is where the power's base is below 0
        g, a, b, *c = numbers
        return partial(_formula, g=g, a=a, b=b, d=-b / a, e=sum(c), f=sum(c))
    return partial(_formula, **dict(zip("gabcdef", numbers, strict=False)))


def _formula(
    x: Doubles, g: float, a: float = 1.0, b: float = 0.0, c: float = 0.0, d: float = 0.0,
    e: float = 0.0, f: float = 0.0,
) -> Doubles:  # fmt: skip
    """(a x + b) ** g + e from d on, below that c x + f."""
    return np.where(x >= d, np.maximum(a * x + b, 0.0) ** g + e, c * x + f)
