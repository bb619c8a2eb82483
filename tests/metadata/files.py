"""Small files, written byte by byte where writers of pictures choose for themselves."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO
from numpy.typing import NDArray
from PIL import Image, ImageCms

RNG = np.random.default_rng(7)
HEIGHT, WIDTH = 4, 6
LEVELS = RNG.integers(30, 226, (HEIGHT, WIDTH, 3)).astype(np.uint8)  # of colors
GRAY = np.ascontiguousarray(LEVELS[..., 0])
DEEP = LEVELS.astype(np.uint16) * 257 + RNG.integers(-90, 90, LEVELS.shape).astype(np.uint16)
ALPHA = RNG.integers(60, 256, (HEIGHT, WIDTH, 1)).astype(np.uint8)
LIGHT = (0.02 + 0.9 * (LEVELS / 255.0) ** 2.2).astype(np.float32)
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def shown(light: NDArray[Any]) -> NDArray[np.float64]:
    """Values of a display, 0 to 1, of linear light."""
    light = np.asarray(light, np.float64)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.abs(light) ** (1 / 2.4) - 0.055)


def chunk(name: bytes, content: bytes) -> bytes:
    """A chunk of a PNG file."""
    return (
        struct.pack(">I", len(content))
        + name
        + content
        + struct.pack(">I", zlib.crc32(name + content))
    )


def gamma(stored: int) -> bytes:
    """The chunk gAMA."""
    return chunk(b"gAMA", struct.pack(">I", stored))


def profile(content: bytes) -> bytes:
    """The chunk iCCP."""
    return chunk(b"iCCP", b"a profile\0\0" + zlib.compress(content))


def png(path: Path, levels: NDArray[Any], before: bytes = b"", after: bytes = b"") -> None:
    """Write a PNG of gray, colors or straight alpha, with chunks before and after the pixels."""
    height, width, count = levels.reshape(*levels.shape[:2], -1).shape
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[count]
    bits = 8 * levels.dtype.itemsize
    rows = b"".join(b"\0" + row.astype(f">u{bits // 8}").tobytes() for row in levels)
    _png(path, (width, height, bits, kind), rows, before, after)


def packed_png(
    path: Path, numbers: NDArray[Any], bits: int, kind: int, before: bytes = b""
) -> None:
    """Write a PNG of 1, 2 or 4 bits: gray (kind 0) or of a palette (kind 3)."""
    parts = (numbers[..., None] >> np.arange(bits)[::-1]) & 1
    rows = np.packbits(parts.reshape(len(numbers), -1), axis=1)
    data = b"".join(b"\0" + row.tobytes() for row in rows)
    _png(path, (numbers.shape[1], numbers.shape[0], bits, kind), data, before, b"")


def _png(
    path: Path, head: tuple[int, int, int, int], rows: bytes, before: bytes, after: bytes
) -> None:
    parts = [chunk(b"IHDR", struct.pack(">IIBBBBB", *head, 0, 0, 0)), before]
    parts += [chunk(b"IDAT", zlib.compress(rows)), after, chunk(b"IEND", b"")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))


def chunks(path: Path) -> dict[bytes, bytes]:
    """Contents of a PNG file's chunks, by name."""
    data, place, found = path.read_bytes(), 8, dict[bytes, bytes]()
    while place < len(data):
        size, name = struct.unpack(">I4s", data[place : place + 8])
        found[name] = data[place + 8 : place + 8 + size]
        place += size + 12
    return found


def exr(path: Path, values: NDArray[Any], names: tuple[str, ...], **header: Any) -> None:
    """Write an EXR; `header`: members of OpenImageIO's header, or attributes of it."""
    spec = OpenImageIO.ImageSpec(values.shape[1], values.shape[0], values.shape[2], "float")
    spec.channelnames = names
    for name, value in header.items():
        if hasattr(spec, name):
            setattr(spec, name, value)
        elif isinstance(value, tuple):
            spec.attribute(name, f"float[{len(value)}]", value)
        else:
            spec.attribute(name, value)
    target = OpenImageIO.ImageOutput.create(str(path))
    assert target.open(str(path), spec), target.geterror()
    assert target.write_image(np.ascontiguousarray(values, np.float32)), target.geterror()
    target.close()


def radiance(
    path: Path, light: NDArray[Any], lines: bytes = b"", order: bytes = b"-Y 4 +X 6"
) -> None:
    """Write a Radiance picture without compression, with lines of its header."""
    exponent = np.ceil(np.log2(light.max(axis=2)))
    levels = np.floor(light * (256.0 / 2.0**exponent)[..., None])
    data = np.concatenate([levels, exponent[..., None] + 128], axis=2).astype(np.uint8)
    head = b"#?RADIANCE\n" + lines + b"FORMAT=32-bit_rle_rgbe\n\n" + order + b"\n"
    path.write_bytes(head + data.tobytes())


def turned(path: Path, levels: NDArray[Any], orientation: int, **options: Any) -> None:
    """Write a picture by Pillow with an orientation tag."""
    tags = Image.Exif()
    tags[274] = orientation
    image = Image.fromarray(levels)
    if path.suffix == ".tif":
        image.save(path, tiffinfo={274: orientation}, **options)
    else:
        image.save(path, exif=tags, **options)
