"""Volumes to and from files, without libraries."""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[Any]
Spacing = tuple[float, float, float]  # along x, y, z

NRRD_TYPES = {"uint8": "uint8", "int16": "int16", "uint16": "uint16", "float32": "float"}
READ_TYPES = {"uint8": "u1", "int16": "<i2", "uint16": "<u2"}
OME = "http://www.openmicroscopy.org/Schemas/OME/2016-06"


def write_nrrd(path: Path, values: Values, spacing: Spacing = (1, 1, 1)) -> None:
    """Write values (Z, Y, X) as NRRD."""
    kind = NRRD_TYPES[values.dtype.name]
    sizes, spaces = (" ".join(map(str, each)) for each in (values.shape[::-1], spacing))
    head = f"NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {sizes}\nspacings: {spaces}\n"
    head += "endian: little\nencoding: raw\n\n"
    path.write_bytes(head.encode() + values.tobytes())


def read_nrrd(path: Path) -> tuple[Values, Spacing]:
    """Values (Z, Y, X) and spacing of a header whose data are compressed beside it."""
    lines = path.read_text(encoding="utf-8").splitlines()
    text = dict(line.split(": ", 1) for line in lines if ": " in line and line[0] != "#")
    with gzip.open(path.parent / text["data file"]) as file:
        raw = file.read()
    shape = [int(count) for count in text["sizes"].split()][::-1]
    x, y, z = (float(size) for size in text["spacings"].split())
    return np.frombuffer(raw, READ_TYPES[text["type"]]).reshape(shape), (x, y, z)


def write_ome(path: Path, values: Values, sizes: Spacing) -> None:
    """Write values (C, Z, Y, X) as OME-TIFF of 16 bits.

    Voxel sizes, in um, are in the XML alone: there are no resolution tags.
    """
    pages = values.reshape(-1, *values.shape[2:]).astype("<u2")
    about = _ome_xml(values.shape, sizes)
    height, width = pages.shape[1:]
    out, link = bytearray(b"II*\0\0\0\0\0"), 4
    text = len(out)
    out += about + b"\0" * (len(about) % 2)
    for n, page in enumerate(pages):
        data = len(out)
        out += page.tobytes()
        out[link : link + 4] = len(out).to_bytes(4, "little")
        described = [(270, 2, len(about), text)] if n == 0 else []
        tags = [
            *((256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 16), (259, 3, 1, 1)),
            *((262, 3, 1, 1), *described, (273, 4, 1, data), (277, 3, 1, 1)),
            *((278, 4, 1, height), (279, 4, 1, page.nbytes)),
        ]
        out += len(tags).to_bytes(2, "little")
        for tag, kind, count, value in tags:
            out += tag.to_bytes(2, "little") + kind.to_bytes(2, "little")
            out += count.to_bytes(4, "little") + value.to_bytes(4, "little")
        link = len(out)
        out += b"\0" * 4
    path.write_bytes(out)


def _ome_xml(shape: tuple[int, ...], sizes: Spacing) -> bytes:
    counts = " ".join(f'Size{k}="{n}"' for k, n in zip("CZYX", shape, strict=True))
    physical = " ".join(
        f'PhysicalSize{k}="{size}" PhysicalSize{k}Unit="&#181;m"'
        for k, size in zip("XYZ", sizes, strict=True)
    )
    channels = "".join(
        f'<Channel ID="Channel:0:{n}" SamplesPerPixel="1"/>' for n in range(shape[0])
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><OME xmlns="{OME}"><Image ID="Image:0" Name="a">'
        '<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" BigEndian="false" '
        f'{counts} SizeT="1" {physical}>{channels}<TiffData/></Pixels></Image></OME>\0'
    ).encode()
