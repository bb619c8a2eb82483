"""Color metadata of files, and conversion of matrix/TRC profiles to sRGB.

In PNG, cICP comes before iCCP, and that before sRGB, and that before gAMA and cHRM (PNG, third
edition, section 4.3).
"""

import struct
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import lru_cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from resample.colors import to_srgb
from resample.files.metadata.tags import PNG_START, before_pixels
from resample.types import Doubles, Floats

MARKS = (b"cICP", b"gAMA", b"cHRM", b"mDCV", b"cLLI")  # chunks of PNG besides the profile and sRGB
# Primaries and transfer curves of ITU-T H.273. Those near sRGB are taken for it.
CODED = (
    {**dict.fromkeys((1, 2, 5, 6, 7), ""), 9: "BT.2020", 11: "DCI-P3", 12: "Display P3"},
    {**dict.fromkeys((1, 2, 4, 6, 7, 8, 13, 14, 15), ""), 16: "PQ", 18: "HLG"},
)
LINEAR = 8
REC_709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)  # red, green, blue, white
WITHIN = 0.002  # most by which such numbers differ
USUAL_GAMMA = 40_000, 50_000  # 1 / 2.2 is 45,455 in a PNG file
LINEAR_GAMMA = 95_000, 105_000
NEAR = 3  # levels by which a profile of sRGB differs from another
FLOATS = (".tif", ".tiff")  # floats of any meaning
CHRM = 8 + 32 + 4  # bytes of a chunk
SPACES = ("tiff:ColorSpace", "jpeg:ColorSpace")
SQUARE = 0.01  # by which square pixels are wider than high
HEADER, ENTRY = 128, 12  # bytes of a profile before its table of tags, and of an entry
FIXED = 65_536.0  # ICC's numbers are 16.16
NUMBERS = 1, 3, 4, 5, 7  # of parametric curves, by type

Curve = Callable[[Any], Any]


def is_encoded(path: Path, spec: Any) -> bool:
    """Whether integers are encoded for displays; by default 8 bits are, and 16 are light."""
    coded = spec.getattribute("CICP")
    if coded is not None or spec.getattribute("ICCProfile") is not None:
        return coded is None or int(coded[1]) != LINEAR
    space = spec.get_string_attribute("oiio:ColorSpace").lower()
    if "lin" in space or spec.format != "uint16":
        return "lin" not in space
    found = _chunks_of(path)  # OpenImageIO takes every PNG file for sRGB
    return bool(found.keys() & {b"sRGB", b"gAMA"}) if found else "srgb" in space


def colors_of(path: Path, spec: Any) -> str:
    """Description of a file's color metadata; empty for sRGB and Rec. 709, or if missing."""
    coded, profile = spec.getattribute("CICP"), spec.getattribute("ICCProfile")
    if coded is not None:
        return coded_colors(coded)
    if profile is not None:
        name = spec.get_string_attribute("ICCProfile:profile_description")
        return "" if is_srgb(np.asarray(profile, np.uint8).tobytes()) else f"profile {name!r:.60}"
    found, primaries = _chunks_of(path), spec.getattribute("chromaticities")
    if b"sRGB" in found:
        return ""
    if len(found.get(b"cHRM", b"")) == CHRM:
        white_first = np.frombuffer(found[b"cHRM"][8:-4], ">u4", 8) / 100_000
        primaries = np.roll(white_first, -2)
    gamma = int.from_bytes(found[b"gAMA"][8:-4]) if b"gAMA" in found else USUAL_GAMMA[1]
    if not any(low <= gamma <= high for low, high in (USUAL_GAMMA, LINEAR_GAMMA)):
        return f"gamma of {100_000 / max(gamma, 1):.3g}"
    is_usual = primaries is None or np.allclose(primaries, REC_709, atol=WITHIN)
    return "" if is_usual else "primaries (chromaticities)"


def coded_colors(numbers: Iterable[int]) -> str:
    """Primaries and transfer curve by their numbers, in words; empty for sRGB and its like."""
    words = (known.get(int(n), f"code {n}") for known, n in zip(CODED, numbers, strict=False))
    return " ".join(filter(None, words))


def marks_of(path: Path) -> bytes:
    """A PNG file's chunks about colors, besides the profile."""
    return b"".join(found for name, found in _chunks_of(path).items() if name in MARKS)


def assumed_of(path: Path, spec: Any) -> str:
    """Assumption about a picture's values where its file says nothing."""
    space = spec.get_string_attribute("oiio:ColorSpace").lower()
    is_said = "lin" in space or is_encoded(path, spec)
    if spec.format == "uint16" and not is_said:
        return "16 bits are taken for linear light"
    is_float = spec.format in ("float", "half", "double") and path.suffix.lower() in FLOATS
    return "floats are taken for linear light" if is_float and "lin" not in space else ""


def oddities_of(spec: Any) -> Iterator[str]:
    """Color metadata that no reader obeys."""
    if "CMYK" in {spec.get_string_attribute(name) for name in SPACES}:
        yield "CMYK becomes RGB by a formula, not by a color profile"
    yield from stretched(spec.get_float_attribute("PixelAspectRatio", 1.0))


def stretched(ratio: float) -> Iterator[str]:
    """Note on pixels, by the ratio of their width and height; empty if square."""
    if ratio > 0 and abs(ratio - 1.0) > SQUARE:
        yield f"pixels are {ratio:.4g} times as wide as high; they are taken for square"


def _chunks_of(path: Path) -> dict[bytes, bytes]:
    """Chunks before a PNG file's pixels, whole, by name; none of other files."""
    with path.open("rb") as file:
        if file.read(8) != PNG_START:
            return {}
        return {chunk[4:8]: chunk for chunk in before_pixels(file)}


@lru_cache(8)
def is_srgb(profile: bytes) -> bool:
    """Whether a profile's colors look as in sRGB."""
    from PIL import Image, ImageCms

    mode = {b"GRAY": "L", b"RGB ": "RGB"}.get(profile[16:20], "")
    ramp = np.arange(0, 256, 17).astype(np.uint8)
    colors = ramp if mode == "L" else np.stack(np.meshgrid(ramp, ramp, ramp), axis=3)
    image = Image.fromarray(colors.reshape(len(ramp), -1, *colors.shape[3:]))
    try:
        own, usual = ImageCms.ImageCmsProfile(BytesIO(profile)), ImageCms.createProfile("sRGB")
        seen = ImageCms.profileToProfile(
            image, own, usual, ImageCms.Intent.RELATIVE_COLORIMETRIC, "RGB"
        )
    except (ImageCms.PyCMSError, OSError, ValueError):
        return False
    wanted = np.asarray(image.convert("RGB"), np.int16)
    return bool(np.abs(np.asarray(seen, np.int16) - wanted).max() <= NEAR)


def converted(color: Floats, profile: bytes) -> Floats:
    """Convert straight light (..., C), decoded by sRGB's curve, to sRGB primaries.

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
    names = {b"RGB ": b"rgb", b"GRAY": b"k"}.get(profile[16:20], b"")
    tags = {}  # none where it is cut off
    with suppress(struct.error):
        (count,) = struct.unpack_from(">I", profile, HEADER)
        places = (HEADER + 4 + ENTRY * n for n in range(min(count, len(profile) // ENTRY)))
        entries = [struct.unpack_from(">4sII", profile, place) for place in places]
        tags = {name: profile[first : first + size] for name, first, size in entries}
    wanted = [bytes([name]) + b"TRC" for name in names]
    wanted += [bytes([name]) + b"XYZ" for name in names if name != ord("k")]
    if not wanted or not tags.keys() >= set(wanted):
        raise ValueError("its profile is not of the type matrix/TRC; convert it to sRGB")
    curves = tuple(_curve(tags[name]) for name in wanted if name.endswith(b"TRC"))
    columns = [_fixed(tags[name][8:20]) for name in wanted if name.endswith(b"XYZ")]
    return curves, np.stack(columns, axis=1) if columns else np.eye(1)


@lru_cache(1)
def _usual() -> Doubles:
    """Matrix (3, 3) from light of sRGB to XYZ, white as in profiles (D50)."""
    from PIL import ImageCms

    return profile_colors(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())[1]


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
