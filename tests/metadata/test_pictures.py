"""What picture files say of their pixels: turns, windows, scales and colors.

Answers are those that the files were written with; Pillow reads them as well where it can.
"""

import re
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import OpenImageIO
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageOps

from resample.files.conversion import picture_and_encoding
from resample.files.films import film_picture, new_film, new_stream
from resample.files.formats import WriteOptions
from resample.files.pictures import read_picture
from resample.files.saving import write_picture
from resample.files.sequences import frames_of, write_frames
from resample.reading.pictures import opened
from tests.metadata.corpus import Outcome, Variant
from tests.metadata.files import (
    ALPHA,
    DEEP,
    GRAY,
    LEVELS,
    LIGHT,
    SRGB,
    chunk,
    chunks,
    exr,
    gamma,
    packed_png,
    png,
    profile,
    radiance,
    shown,
    turned,
)
from tests.metadata.profiles import gray_profile, matrix_profile

Write = Callable[[Path], Any]
STRAIGHT = np.concatenate([LEVELS, ALPHA], axis=2)
UNSEEN = "is in CIELAB"
PLAIN = re.escape("its 16 bits are taken for linear light")
P3 = chunk(
    b"cHRM", np.array([31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000], ">u4").tobytes()
)


class Read(NamedTuple):
    """A picture and what it shows."""

    path: Path
    values: NDArray[Any]  # (H, W, C) of a display, 0 to 1, and straight alpha; or light
    is_light: bool = False
    tolerance: float = 1e-4


class Copied(NamedTuple):
    """A picture, and the file that it is copied to."""

    source: Path
    target: Path


# ---------------------------------------------------------------------------------------- turns


def _turned(suffix: str, orientation: int, folder: Path) -> Read:
    path = folder / f"in{suffix}"
    lossless = {".webp": {"lossless": True}, ".avif": {"quality": 100, "subsampling": "4:4:4"}}
    turned(path, LEVELS, orientation, **lossless.get(suffix, {}))
    with Image.open(path) as image:
        upright = ImageOps.exif_transpose(image).convert("RGB")
    return Read(path, np.asarray(upright) / 255.0, tolerance=0.005)


def _turned_late(folder: Path) -> Read:
    """The tag is behind the pixels, where Exif may be."""
    tags = Image.Exif()
    tags[274] = 6
    block = tags.tobytes().removeprefix(b"Exif\0\0")
    png(folder / "in.png", LEVELS, after=chunk(b"eXIf", block))
    return Read(folder / "in.png", np.rot90(LEVELS, -1) / 255.0)


def _ordered(order: bytes, upright: NDArray[Any], folder: Path) -> Read:
    radiance(folder / "in.hdr", LIGHT, order=order)
    return Read(folder / "in.hdr", upright, is_light=True, tolerance=0.004)


def _bottom_up(is_flipped: bool, folder: Path) -> Read:
    """Rows of a bitmap run up, or down if its height is negative."""
    path = folder / "in.bmp"
    Image.fromarray(LEVELS).save(path)
    data = bytearray(path.read_bytes())
    if is_flipped:
        data[22:26] = (-len(LEVELS)).to_bytes(4, "little", signed=True)
        rows = np.frombuffer(data[54:], np.uint8).reshape(len(LEVELS), -1)[::-1]
        data[54:] = rows.tobytes()
    path.write_bytes(data)
    return Read(path, LEVELS / 255.0)


TURNS = [
    *(
        Variant(name, "orientation", str(n), "obeyed", partial(_turned, suffix, n))
        for name, suffix, some in (
            ("JPEG", ".jpg", range(2, 9)), ("PNG", ".png", range(2, 9)),
            ("TIFF", ".tif", range(2, 9)), ("WebP", ".webp", (3, 6, 7)),
            ("AVIF", ".avif", (3, 6, 7)),
        )
        for n in some
    ),
    Variant("PNG", "orientation", "6 behind the pixels", "obeyed", _turned_late),
    *(
        Variant("Radiance", "resolution", order.decode(), "obeyed", partial(_ordered, order, light))
        for order, light in (
            (b"-Y 4 +X 6", LIGHT), (b"+Y 4 +X 6", LIGHT[::-1]), (b"-Y 4 -X 6", LIGHT[:, ::-1]),
            (b"+Y 4 -X 6", LIGHT[::-1, ::-1]),
            (b"+X 4 +Y 6", np.rot90(LIGHT)), (b"-X 4 -Y 6", np.rot90(LIGHT, -1)),
            (b"+X 4 -Y 6", np.rot90(LIGHT)[::-1]), (b"-X 4 +Y 6", np.rot90(LIGHT, -1)[::-1]),
        )
    ),
    Variant("BMP", "height", "positive", "obeyed", partial(_bottom_up, False)),
    Variant("BMP", "height", "negative", "obeyed", partial(_bottom_up, True)),
]  # fmt: skip

# -------------------------------------------------------------------------------------- windows


def _window(
    at: tuple[int, int], whole: tuple[int, int, int, int], folder: Path, **more: int
) -> Read:
    """Data whose corner is at `at`, in a display window (x, y, width, height)."""
    left, top, width, height = whole
    exr(
        folder / "in.exr", LIGHT, ("R", "G", "B"), x=at[0], y=at[1], full_x=left, full_y=top,
        full_width=width, full_height=height, **more,
    )  # fmt: skip
    far = np.zeros((30, 30, 3), np.float32)
    far[10 + at[1] :, 10 + at[0] :][: LIGHT.shape[0], : LIGHT.shape[1]] = LIGHT
    wanted = far[10 + top : 10 + top + height, 10 + left : 10 + left + width]
    return Read(folder / "in.exr", wanted, is_light=True)


def _offset(folder: Path) -> Read:
    """An offset of PNG is for compositors: viewers show the picture alone."""
    png(folder / "in.png", LEVELS, chunk(b"oFFs", np.array([5, 3], ">i4").tobytes() + b"\0"))
    return Read(folder / "in.png", LEVELS / 255.0)


def _position(folder: Path) -> Read:
    tags = {286: (3.0,), 287: (2.0,), 282: (1.0,), 283: (1.0,), 296: 1}
    Image.fromarray(LEVELS).save(folder / "in.tif", tiffinfo=tags)
    return Read(folder / "in.tif", LEVELS / 255.0)


def _backwards(folder: Path) -> Read:
    exr(folder / "in.exr", LIGHT[..., ::-1], ("B", "G", "R"))
    return Read(folder / "in.exr", LIGHT, is_light=True)


WINDOWS = [
    *(
        Variant("EXR", "dataWindow, displayWindow", case, "obeyed", partial(_window, at, whole))
        for case, at, whole in (
            ("data in a larger display", (2, 1), (0, 0, 12, 10)),
            ("overscan", (-2, -1), (0, 0, 3, 2)),
            ("both", (-1, 2), (0, 0, 9, 5)),
            ("display not at 0, 0", (3, 4), (3, 4, 6, 4)),
            ("negative corner", (-3, -4), (-3, -4, 8, 6)),
            ("no overlap", (8, 8), (0, 0, 4, 4)),
        )
    ),
    Variant(
        "EXR", "dataWindow, displayWindow", "tiles in a larger display", "obeyed",
        partial(_window, (2, 1), (0, 0, 12, 10), tile_width=4, tile_height=4),
    ),
    Variant("EXR", "channels", "B, G, R", "obeyed", _backwards),
    Variant("PNG", "oFFs", "5, 3", "obeyed", _offset),
    Variant("TIFF", "XPosition, YPosition", "3, 2", "obeyed", _position),
]  # fmt: skip

# --------------------------------------------------------------------------------------- scales


def _exposed(lines: bytes, divisor: float, folder: Path) -> Read:
    radiance(folder / "in.hdr", LIGHT, lines)
    return Read(folder / "in.hdr", LIGHT / divisor, is_light=True, tolerance=0.004)


def _portable(most: int, folder: Path) -> Read:
    """A portable gray map with a greatest level; it is encoded for displays in 8 bits."""
    values = (GRAY.astype(np.int64) * most // 255).astype(">u2" if most > 255 else "u1")
    head = f"P5\n# a comment\n{GRAY.shape[1]} {GRAY.shape[0]}\n{most}\n".encode()
    (folder / "in.pgm").write_bytes(head + values.tobytes())
    share = (values / most)[..., None]
    return Read(folder / "in.pgm", share, is_light=most > 255, tolerance=0.004)


def _floats(scale: str, folder: Path) -> Read:
    """A portable float map: the sign of its scale is the byte order, its size a factor."""
    stored = LIGHT[::-1].astype("<f4" if scale.startswith("-") else ">f4")
    (folder / "in.pfm").write_bytes(f"PF\n6 4\n{scale}\n".encode() + stored.tobytes())
    return Read(folder / "in.pfm", LIGHT * abs(float(scale)), is_light=True)


def _few_bits(bits: int, has_palette: bool, before: str, folder: Path) -> Read:
    numbers = np.random.default_rng(7).integers(0, 2**bits, (4, 8))
    colors = np.random.default_rng(8).integers(0, 256, (2**bits, 3)).astype(np.uint8)
    lead = chunk(b"PLTE", colors.tobytes()) if has_palette else b""
    if before:
        lead += chunk(b"tRNS", b"\0\xc8" if has_palette else b"\0\1")
    packed_png(folder / "in.png", numbers, bits, 3 if has_palette else 0, lead)
    alpha = np.where(numbers == 0, 0, np.where(numbers == 1, 200, 255)) / 255
    if not has_palette:
        colors, alpha = (
            np.arange(2**bits)[:, None].repeat(3, 1) * 255 // (2**bits - 1),
            numbers != 1,
        )
    parts = [colors[numbers] / 255, alpha[..., None]]
    return Read(
        folder / "in.png", np.concatenate(parts[: 2 if before else 1], axis=2), tolerance=0.01
    )


def _keyed(levels: NDArray[Any], folder: Path) -> Read:
    """One color is transparent."""
    key = levels[1, 2]
    png(folder / "in.png", levels, chunk(b"tRNS", key.astype(">u2").tobytes()))
    most = np.iinfo(levels.dtype).max
    alpha = ~(levels == key).all(axis=2, keepdims=True)
    is_light = levels.dtype == np.uint16
    color = levels / most * alpha if is_light else levels / most
    return Read(folder / "in.png", np.concatenate([color, alpha], axis=2), is_light=is_light)


SCALES = [
    *(
        Variant("Radiance", "EXPOSURE", case, "obeyed", partial(_exposed, lines, divisor))
        for case, lines, divisor in (
            ("none", b"", 1.0), ("2", b"EXPOSURE=2.0\n", 2.0), ("1.25", b"EXPOSURE= 1.25\n", 1.25),
            ("2 and 4, a product", b"EXPOSURE=2\nEXPOSURE=4\n", 8.0),
        )
    ),
    *(
        Variant("PGM", "maxval", str(most), "obeyed", partial(_portable, most))
        for most in (100, 255, 1023, 4095, 65535)
    ),
    *(
        Variant("PFM", "scale", scale, "obeyed", partial(_floats, scale))
        for scale in ("-1.0", "1.0", "-2.0")
    ),
    *(
        Variant(
            "PNG", "bit depth", f"{bits}, {'palette' if palette else 'gray'}{before}", "obeyed",
            partial(_few_bits, bits, palette, before),
        )
        for bits in (1, 2, 4)
        for palette in (False, True)
        for before in ("", " and tRNS")
    ),
    Variant("PNG", "tRNS", "a color of 8 bits", "obeyed", partial(_keyed, LEVELS)),
    Variant("PNG", "tRNS", "a color of 16 bits", "obeyed", partial(_keyed, DEEP)),
]  # fmt: skip

# --------------------------------------------------------------------------------------- TIFF


def _tiff(values: NDArray[Any], wanted: Any, is_light: bool, folder: Path, **options: Any) -> Read:
    tifffile.imwrite(folder / "in.tif", values, metadata=None, **options)
    return Read(folder / "in.tif", np.asarray(wanted), is_light, 0.004)


def _by_pillow(mode: str, suffix: str, folder: Path, **options: Any) -> Read:
    """A picture of a kind that Pillow writes, as Pillow reads it."""
    path = folder / f"in{suffix}"
    source = Image.fromarray(LEVELS)
    (source.quantize(16) if mode == "P" else source.convert(mode)).save(path, **options)
    with Image.open(path) as image:
        return Read(path, np.asarray(image.convert("RGB")) / 255.0, tolerance=0.02)


WHITE = {"photometric": "miniswhite"}
DIM = GRAY[..., None] / 255.0
DEEP_GRAY = np.ascontiguousarray(DEEP[..., 0])
KINDS: list[tuple[str, str, Outcome, Write, str]] = [
    ("MinIsWhite", "8 bits", "obeyed", partial(_tiff, GRAY, 1 - DIM, False, **WHITE), ""),
    ("MinIsWhite", "16 bits", "obeyed",
     partial(_tiff, DEEP_GRAY, 1 - DEEP_GRAY[..., None] / 65535, True, **WHITE), ""),
    ("MinIsWhite", "16 bits, big-endian", "obeyed",
     partial(_tiff, DEEP_GRAY, 1 - DEEP_GRAY[..., None] / 65535, True, byteorder=">", **WHITE), ""),
    ("MinIsWhite", "16 bits in tiles", "obeyed",
     partial(_tiff, DEEP_GRAY, 1 - DEEP_GRAY[..., None] / 65535, True, tile=(16, 16), **WHITE), ""),
    ("MinIsWhite", "floats", "refused",
     partial(_tiff, LIGHT[..., 0].copy(), 0, True, **WHITE), "MinIsWhite"),
    ("MinIsWhite", "32 bits", "refused",
     partial(_tiff, DEEP_GRAY.astype(np.uint32), 0, True, **WHITE), "MinIsWhite"),
    ("CIELAB", "8 bits", "refused", partial(_tiff, LEVELS, 0, False, photometric="cielab"), UNSEEN),
    ("CIELAB", "16 bits", "refused", partial(_tiff, DEEP, 0, False, photometric="cielab"), UNSEEN),
    ("ICCLAB", "8 bits", "refused", partial(_tiff, LEVELS, 0, False, photometric="icclab"),
     "PhotometricInterpretation=9"),
    ("YCbCr", "8 bits", "obeyed", partial(_by_pillow, "YCbCr", ".tif"), ""),
    ("palette", "8 bits", "obeyed", partial(_by_pillow, "P", ".tif"), ""),
    ("bilevel", "1 bit, Group 4", "obeyed",
     partial(_by_pillow, "1", ".tif", compression="group4"), ""),
    ("planar", "8 bits", "obeyed",
     partial(_tiff, np.moveaxis(LEVELS, 2, 0).copy(), LEVELS / 255, False, photometric="rgb",
             planarconfig="separate"), ""),
    ("byte order", "16 bits", "obeyed",
     partial(_tiff, DEEP, DEEP / 65535, True, photometric="rgb", byteorder=">"), ""),
    ("byte order", "floats", "obeyed",
     partial(_tiff, LIGHT, LIGHT, True, photometric="rgb", byteorder=">"), ""),
    ("CMYK", "8 bits", "told", partial(_by_pillow, "CMYK", ".tif"), "CMYK"),
]  # fmt: skip


def _alpha(kind: str, levels: NDArray[Any], folder: Path) -> Read:
    """Colors as stored: multiplied by alpha if it is associated."""
    most = float(np.iinfo(levels.dtype).max)
    alpha = levels[..., -1:] / most
    stored, straight = levels, levels / most
    if kind == "assocalpha":
        color = np.rint(levels[..., :-1] * alpha).astype(levels.dtype)
        stored = np.concatenate([color, levels[..., -1:]], axis=2)
        straight = np.concatenate([color / most / alpha, alpha], axis=2)
    name = "rgb" if levels.shape[2] == 4 else "minisblack"
    tifffile.imwrite(
        folder / "in.tif", stored, photometric=name, extrasamples=[kind], planarconfig="contig",
        metadata=None,
    )  # fmt: skip
    if levels.dtype == np.uint16:  # linear: alpha times color is light
        light = np.concatenate([straight[..., :-1] * alpha, alpha], axis=2)
        return Read(folder / "in.tif", light, is_light=True)
    return Read(folder / "in.tif", straight)


DEEP_ALPHA = STRAIGHT.astype(np.uint16) * 257
TIFFS = [
    *(Variant("TIFF", *one[:4], one[4]) for one in KINDS),
    *(
        Variant("TIFF", "ExtraSamples", f"{kind}, {case}", "obeyed", partial(_alpha, kind, levels))
        for kind in ("assocalpha", "unassalpha")
        for case, levels in (
            ("8 bits", STRAIGHT), ("gray of 8 bits", STRAIGHT[..., [0, 3]].copy()),
            ("16 bits", DEEP_ALPHA),
        )
    ),
    *(
        Variant("TGA", "image descriptor", case, "obeyed",
                partial(_by_pillow, "RGB", ".tga", orientation=orientation))
        for case, orientation in (("rows run up", -1), ("rows run down", 1))
    ),
    Variant("JPEG", "CMYK", "8 bits", "told", partial(_by_pillow, "CMYK", ".jpg"), "CMYK"),
    Variant("JPEG", "components", "gray", "obeyed", partial(_by_pillow, "L", ".jpg", quality=98)),
    *(
        Variant(name, "palette or colors", "8 bits", "obeyed", partial(_by_pillow, mode, suffix))
        for name, mode, suffix in (
            ("GIF", "P", ".gif"), ("TGA", "RGB", ".tga"), ("BMP", "P", ".bmp"),
            ("JPEG 2000", "RGB", ".jp2"), ("PPM", "RGB", ".ppm"),
        )
    ),
]  # fmt: skip

# ------------------------------------------------------------------------------ curves of PNG


def _chunked(before: bytes, wanted: Any, is_light: bool, folder: Path) -> Read:
    png(folder / "in.png", LEVELS, before)
    return Read(folder / "in.png", np.asarray(wanted), is_light)


S = chunk(b"sRGB", b"\0")
SHARES = LEVELS / 255.0


def _cicp(*numbers: int) -> bytes:
    return chunk(b"cICP", bytes(numbers))


CURVES = [
    Variant("PNG", field, case, "obeyed", partial(_chunked, before, SHARES, is_light))
    for field, case, before, is_light in (
        ("gAMA", "1.0", gamma(100_000), True),
        ("gAMA", "1 / 2.2", gamma(45_455), False),
        ("gAMA", "1.0, but sRGB", S + gamma(100_000), False),
        ("gAMA", "1.0, but iCCP", profile(SRGB) + gamma(100_000), False),
        ("gAMA", "1.0, but cICP", _cicp(1, 13, 0, 1) + gamma(100_000), False),
        ("cICP", "sRGB", _cicp(1, 13, 0, 1), False),
        ("cICP", "linear", _cicp(1, 8, 0, 1), True),
        ("cICP", "linear, but iCCP and sRGB", _cicp(1, 8, 0, 1) + profile(SRGB) + S, True),
        ("iCCP", "sRGB", profile(SRGB), False),
    )
]

READ = [*TURNS, *WINDOWS, *SCALES, *TIFFS, *CURVES]

# ---------------------------------------------------------------------------- marks in copies


def _marked(before: bytes, suffix: str, folder: Path, levels: NDArray[Any] = LEVELS) -> Copied:
    png(folder / "in.png", levels, before)
    return Copied(folder / "in.png", folder / f"out{suffix}")


def _profiled(suffix: str, target: str, folder: Path) -> Copied:
    levels = np.ascontiguousarray(np.broadcast_to(LEVELS[1, 1], LEVELS.shape))
    Image.fromarray(levels).save(folder / f"in{suffix}", icc_profile=matrix_profile())
    return Copied(folder / f"in{suffix}", folder / f"out{target}")


def _gray_profiled(suffix: str, target: str, folder: Path) -> Copied:
    Image.fromarray(GRAY).save(folder / f"in{suffix}", icc_profile=gray_profile())
    return Copied(folder / f"in{suffix}", folder / f"out{target}")


def _nclx(primaries: int, transfer: int, target: str, folder: Path) -> Copied:
    Image.fromarray(LEVELS).save(folder / "in.avif")
    data = (folder / "in.avif").read_bytes()
    at = data.index(b"colrnclx") + 8
    told = primaries.to_bytes(2, "big") + transfer.to_bytes(2, "big")
    (folder / "in.avif").write_bytes(data[:at] + told + data[at + 4 :])
    return Copied(folder / "in.avif", folder / f"out{target}")


def _primaries(target: str, folder: Path) -> Copied:
    p3 = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)
    exr(folder / "in.exr", LIGHT, ("R", "G", "B"), chromaticities=p3)
    return Copied(folder / "in.exr", folder / f"out{target}")


def _bare(values: NDArray[Any], suffix: str, target: str, folder: Path) -> Copied:
    """A picture without any mark."""
    path = folder / f"in{suffix}"
    if suffix == ".png":
        png(path, values)
    else:
        tifffile.imwrite(path, values, photometric="rgb", metadata=None)
    return Copied(path, folder / f"out{target}")


PQ, HLG, GAMMA = _cicp(9, 16, 0, 1), _cicp(9, 18, 0, 1), gamma(55_556)
LOST = "its colors are taken for sRGB"
MARKS = [
    *(
        Variant("PNG", field, f"{case}, to .png", "obeyed", partial(_marked, before, ".png"))
        for field, case, before in (
            ("cICP", "PQ", PQ), ("cICP", "HLG", HLG), ("cICP", "Display P3", _cicp(12, 13, 0, 1)),
            ("gAMA", "1 / 1.8", GAMMA), ("cHRM", "Display P3", P3 + gamma(45_455)),
            ("cICP", "PQ and mDCV", PQ + chunk(b"mDCV", bytes(24))),
        )
    ),
    Variant("PNG", "gAMA", "1 / 1.8 of 16 bits, to .png", "obeyed",
            partial(_marked, GAMMA, ".png", levels=DEEP)),
    *(
        Variant(
            "PNG", field, f"{case}, to {target}", "told", partial(_marked, before, target),
            f"{says}.*{LOST}",
        )
        for target in (".jpg", ".tif", ".exr", ".webp")
        for field, case, before, says in (
            ("cICP", "PQ", PQ, "BT.2020 PQ"), ("gAMA", "1 / 1.8", GAMMA, "gamma of 1.8"),
            ("cHRM", "Display P3", P3, "primaries"),
        )
    ),
    *(
        Variant(name, "profile", f"wide, to {target}", "obeyed", partial(_profiled, suffix, target))
        for name, suffix in (
            ("JPEG", ".jpg"), ("PNG", ".png"), ("TIFF", ".tif"), ("WebP", ".webp"),
            ("AVIF", ".avif"),
        )
        for target in (".png", suffix)[: 1 if suffix == ".png" else 2]
    ),
    *(
        Variant(
            name, "profile", "wide, to .exr", "told", partial(_profiled, suffix, ".exr"),
            f"profile 'wide'.*{LOST}",
        )
        for name, suffix in (("JPEG", ".jpg"), ("PNG", ".png"), ("TIFF", ".tif"))
    ),
    Variant("PNG", "profile", "gray, to .png", "obeyed", partial(_gray_profiled, ".png", ".png")),
    Variant("TIFF", "profile", "gray, to .jpg", "obeyed", partial(_gray_profiled, ".tif", ".jpg")),
    Variant("PNG", "profile", "gray, to .webp, which has colors", "told",
            partial(_gray_profiled, ".png", ".webp"), f"profile 'gray'.*{LOST}"),
    Variant("AVIF", "nclx", "BT.2020 PQ", "told", partial(_nclx, 9, 16, ".png"), f"PQ.*{LOST}"),
    Variant("AVIF", "nclx", "Display P3", "told", partial(_nclx, 12, 13, ".png"), f"P3.*{LOST}"),
    Variant("EXR", "chromaticities", "Display P3, to .exr", "obeyed", partial(_primaries, ".exr")),
    Variant("EXR", "chromaticities", "Display P3, to .png", "told", partial(_primaries, ".png"),
            f"chromaticities.*{LOST}"),
    *(
        Variant(name, "no mark", f"{case}, to {target}", "told",
                partial(_bare, values, suffix, target), says)
        for name, suffix, case, values, target, says in (
            ("PNG", ".png", "16 bits", DEEP, ".jpg", "16 bits are taken for linear light"),
            ("PNG", ".png", "16 bits", DEEP, ".exr", "16 bits are taken for linear light"),
            ("PNG", ".png", "16 bits", DEEP, ".avif", "16 bits are taken for linear light"),
            ("TIFF", ".tif", "16 bits", DEEP, ".jpg", "16 bits are taken for linear light"),
            ("TIFF", ".tif", "floats", LIGHT, ".png", "floats are taken for linear light"),
            ("TIFF", ".tif", "floats", LIGHT, ".exr", "floats are taken for linear light"),
        )
    ),
    *(
        Variant(name, "no mark", f"{case}, to {target}", "obeyed",
                partial(_bare, values, suffix, target))
        for name, suffix, case, values, target in (
            ("PNG", ".png", "8 bits", LEVELS, ".png"), ("PNG", ".png", "16 bits", DEEP, ".png"),
            ("TIFF", ".tif", "floats", LIGHT, ".tif"),
        )
    ),
]  # fmt: skip

LINEAR = [
    Variant("PNG", f"{field}, linear", f"to {target}", "obeyed",
            partial(_marked, before, target, levels=np.full((8, 8, 3), 55, np.uint8)))
    for field, before in (("gAMA", gamma(100_000)), ("cICP", _cicp(1, 8, 0, 1)))
    for target in (".jpg", ".webp", ".avif", ".tif")
]  # fmt: skip
MARKS += [
    Variant("PNG", "gAMA, linear", "16 bits, to .tif", "told",
            partial(_marked, gamma(100_000), ".tif", levels=DEEP), "linear light"),
]  # fmt: skip

# ------------------------------------------------------ where light alone is used, as in 3D views

LIGHT_ONLY = [
    Variant(name, f"{field}, its light used", case, "told", write, says)
    for name, field, case, write, says in (
        ("PNG", "cICP", "PQ", partial(_marked, PQ, ""), "taken for sRGB, not BT.2020 PQ"),
        ("PNG", "gAMA", "1 / 1.8", partial(_marked, GAMMA, ""), "taken for sRGB, not gamma of 1.8"),
        ("JPEG", "profile", "wide", partial(_profiled, ".jpg", ""), "for sRGB, not profile 'wide'"),
        ("EXR", "chromaticities", "Display P3", partial(_primaries, ""), "for sRGB, not primaries"),
        ("PNG", "no mark", "16 bits", partial(_bare, DEEP, ".png", ""), PLAIN),
        ("TIFF", "no mark", "floats", partial(_bare, LIGHT, ".tif", ""), "its floats are taken"),
    )
]
# ---------------------------------------------------------------------------------- animations


def _animated(suffix: str, target: str, told: dict[str, Any], folder: Path) -> Copied:
    first, *others = (Image.fromarray(LEVELS // n) for n in (1, 2, 3))
    told = {"duration": 50, "lossless": True, **told}
    first.save(folder / f"in{suffix}", save_all=True, append_images=others, **told)
    return Copied(folder / f"in{suffix}", folder / f"out{target}")


# Times that all frames are shown, and how GIF, WebP and APNG tell it; 0: without end.
PLAYS = {
    0: ({"loop": 0}, {"loop": 0}, {"loop": 0}),
    1: ({}, {"loop": 1}, {"loop": 1}),
    3: ({"loop": 2}, {"loop": 3}, {"loop": 3}),
}
SUFFIXES = (".gif", ".webp", ".apng")
LOOPS = [
    Variant(name, "loop count", f"{plays or 'endless'}, to {target}", "obeyed",
            partial(_animated, suffix, target, told[n]))
    for n, (name, suffix) in enumerate(zip(("GIF", "WebP", "APNG"), SUFFIXES, strict=True))
    for plays, told in PLAYS.items()
    for target in SUFFIXES
    if plays or target == suffix
]  # fmt: skip
WIDE_FRAMES = Variant(
    "WebP", "profile", "wide, of an animation", "told",
    partial(_animated, ".webp", ".webp", {"icc_profile": matrix_profile()}), "not its profile's",
)  # fmt: skip


def _film(told: dict[str, Any], folder: Path) -> Path:
    path = folder / "in.mp4"
    with new_film(path) as film:
        stream = new_stream(film, 24.0, (16, 16))
        for name, value in told.items():
            setattr(stream.codec_context, name, value)
        film.mux(stream.encode(film_picture(np.zeros((16, 16, 3), np.uint8), stream)))
        film.mux(stream.encode(None))
    return path


FILMS = [
    Variant("MP4", field, case, "told", partial(_film, told), says)
    for field, case, told, says in (
        ("color_trc", "PQ", {"color_trc": 16}, "taken for sRGB, not PQ"),
        ("color_trc, color_primaries", "HLG, BT.2020", {"color_trc": 18, "color_primaries": 9},
         "taken for sRGB, not BT.2020 HLG"),
        ("sample_aspect_ratio", "2 : 1", {"sample_aspect_ratio": Fraction(2)}, "2 times as wide"),
    )
]  # fmt: skip
VARIANTS = [*READ, *MARKS, *LINEAR, *LIGHT_ONLY, *LOOPS, WIDE_FRAMES, *FILMS]


@pytest.mark.parametrize("one", READ, ids=str)
def test_a_picture_is_shown_as_its_file_says(one, tmp_path, capsys):
    read: Read = one.write(tmp_path)
    if one.outcome == "refused":
        with pytest.raises((ValueError, OSError), match=one.says):
            read_picture(read.path)
        return
    picture = read_picture(read.path)
    assert re.search(one.says, capsys.readouterr().err), "a message is missing"
    seen = np.asarray(picture.data, np.float64)
    if not read.is_light:
        seen = as_displayed(seen, has_alpha=picture.kind.has_alpha)
    wanted = read.values
    if read.path.suffix == ".gif":  # palettes may have transparency
        seen = seen[..., :3]
    if seen.shape[2] in (1, 2) and wanted.shape[2] > 2:
        seen = seen[..., [0, 0, 0, 1][: 2 + seen.shape[2]]]
    assert seen.shape == wanted.shape
    visible = wanted[..., 3:] > 0 if wanted.shape[2] == 4 else True
    np.testing.assert_allclose(seen * visible, wanted * visible, atol=read.tolerance)


def as_displayed(light: NDArray[Any], *, has_alpha: bool) -> NDArray[np.float64]:
    """Straight values of a display of premultiplied light."""
    if not has_alpha:
        return shown(light)
    alpha = light[..., -1:]
    color = np.divide(light[..., :-1], alpha, out=np.zeros_like(light[..., :-1]), where=alpha > 0)
    return np.concatenate([shown(color), alpha], axis=2)


@pytest.mark.parametrize("one", MARKS, ids=str)
def test_colors_of_a_copy_are_those_of_its_source(one, tmp_path, capsys):
    copied: Copied = one.write(tmp_path)
    write_picture(copied.target, read_picture(copied.source, as_data=True), WriteOptions())
    said = capsys.readouterr().err
    if one.outcome == "told":
        assert re.search(one.says, said)
        assert said.count("\n") == 1
        return
    assert not said
    if one.field == "profile":
        np.testing.assert_allclose(*map(in_srgb, copied), atol=5)  # levels; of JPEG and AVIF
    elif one.field == "chromaticities":
        both = [opened(path).spec().getattribute("chromaticities") for path in copied]
        np.testing.assert_allclose(*both, rtol=1e-6)
    elif copied.source.suffix == ".png":
        wanted, found = map(chunks, copied)
        for name in (b"cICP", b"gAMA", b"cHRM", b"mDCV") if one.field != "no mark" else ():
            assert found.get(name) == wanted.get(name)
        np.testing.assert_array_equal(
            *(OpenImageIO.ImageBuf(str(path)).get_pixels() for path in copied)
        )


@pytest.mark.parametrize("one", LINEAR, ids=str)
def test_linear_light_is_encoded_where_files_cannot_say_so(one, tmp_path):
    copied: Copied = one.write(tmp_path)
    write_picture(copied.target, read_picture(copied.source, as_data=True), WriteOptions())
    with Image.open(copied.target) as image:
        levels = np.asarray(image.convert("RGB"), np.float64)
    np.testing.assert_allclose(levels, 255 * shown(np.array(55 / 255)), atol=2)


@pytest.mark.parametrize("one", LIGHT_ONLY, ids=str)
def test_what_is_taken_for_light_is_told(one, tmp_path, capsys):
    source = one.write(tmp_path).source
    for read in (read_picture, picture_and_encoding):
        read(source)
        assert re.search(one.says, capsys.readouterr().err)


@pytest.mark.parametrize("one", LOOPS, ids=str)
def test_an_animation_is_shown_as_often_as_its_source(one, tmp_path):
    copied: Copied = one.write(tmp_path)
    frames = frames_of(copied.source)
    write_frames(copied.target, frames.read(), frames, WriteOptions())
    plays = next(n for n in PLAYS if one.case.startswith(str(n or "endless")))
    with Image.open(copied.target) as image:
        told = PLAYS[plays][SUFFIXES.index(copied.target.suffix)]
        assert image.info.get("loop") == told.get("loop")


@pytest.mark.parametrize("one", [WIDE_FRAMES, *FILMS], ids=str)
def test_what_is_lost_of_an_animation_is_told(one, tmp_path, capsys):
    if one in FILMS:
        pytest.importorskip("av")
    made = one.write(tmp_path)
    frames_of(made if one in FILMS else made.source)
    assert re.search(one.says, capsys.readouterr().err)


def in_srgb(path: Path) -> NDArray[np.int64]:
    """Levels as an sRGB display shows them, by littleCMS."""
    with Image.open(path) as image:
        own = ImageCms.ImageCmsProfile(BytesIO(image.info["icc_profile"]))
        seen = ImageCms.profileToProfile(
            image, own, ImageCms.createProfile("sRGB"), outputMode="RGB"
        )
    return np.asarray(seen, np.int64)
