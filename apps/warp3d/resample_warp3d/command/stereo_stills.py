"""Photographs for two eyes in files of their own: MPO and JPS."""

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np

from resample.files.formats import QUALITY, WriteOptions, as_srgb, flattened, levels
from resample.files.pictures import Picture
from resample.files.writing import replacing

PAIRS = (".mpo", ".jps")
# Stereoscopic descriptor: side by side, full width and height, right picture first; no separation.
CROSSED = struct.pack(">HI", 4, 0x00000201)
DISPARITY = 0x020002  # type of a further picture of an MPO: multi-view, by disparity
SHOWN = 0x20000000  # of the picture that players without two eyes show


def write_pair(path: Path, left: Picture, right: Picture, look: WriteOptions) -> None:
    """Write the pictures of both eyes: MPO holds two JPEGs, JPS one, with the right one first."""
    both = [_image(picture, path, look) for picture in (left, right)]
    quality = {"quality": look.quality or QUALITY[".jpg"], "subsampling": 0}
    with replacing(path) as temporary:
        if path.suffix.lower() == ".mpo":
            first, second = both
            first.save(temporary, "MPO", save_all=True, append_images=[second], **quality)
            temporary.write_bytes(_typed(temporary.read_bytes()))
            return
        from PIL import Image

        whole = Image.fromarray(np.hstack([np.asarray(each) for each in both[::-1]]))
        made = io.BytesIO()
        whole.save(made, "JPEG", **quality)
        body = b"_JPSJPS_" + CROSSED + struct.pack(">H", 0)
        marker = b"\xff\xe3" + struct.pack(">H", 2 + len(body)) + body
        data = made.getvalue()
        after = 4 + int.from_bytes(data[4:6], "big")  # JFIF's segment comes first
        temporary.write_bytes(data[:after] + marker + data[after:])


def _image(picture: Picture, path: Path, look: WriteOptions) -> Any:
    """Return a picture as screens show it, opaque, as a Pillow image."""
    from PIL import Image

    shown = as_srgb(picture)
    if shown.kind.has_alpha:
        shown = flattened(shown, look.background or (0.0, 0.0, 0.0))
    if len(shown.kind.channels) not in (1, 3) or shown.about.number:
        raise ValueError(f"{path}: neither gray nor RGB; .tif holds other channels and numbers")
    shades = levels(shown.data, "uint8", has_alpha=False, is_light=look.is_light)
    return Image.fromarray(shades[..., 0] if shades.shape[2] == 1 else np.asarray(shades, np.uint8))


def _typed(data: bytes) -> bytes:
    """Return an MPO whose pictures are marked as those of two eyes, as Pillow does not."""
    place = data.index(b"MPF\0") + 4
    order = "<" if data[place : place + 2] == b"II" else ">"
    (table,) = struct.unpack_from(f"{order}I", data, place + 4)
    (count,) = struct.unpack_from(f"{order}H", data, place + table)
    made = bytearray(data)
    for n in range(count):
        tag, _, _, value = struct.unpack_from(f"{order}HHII", data, place + table + 2 + 12 * n)
        if tag == 0xB002:  # entries of 16 bytes, which begin with their types
            for each, kind in enumerate((SHOWN | DISPARITY, DISPARITY)):
                struct.pack_into(f"{order}I", made, place + value + 16 * each, kind)
    return bytes(made)
