"""Reader of COLMAP's cameras.bin and images.bin: little-endian, unpadded."""

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple

# Models by number, each with its number of parameters.
MODELS = (
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
)

COUNT = struct.Struct("<Q")
CAMERA = struct.Struct("<IiQQ")  # number, model, width, height; then parameters in float64
PICTURE = struct.Struct("<I7dI")  # number, qw, qx, qy, qz, tx, ty, tz, camera; then a name
POINT_BYTES = 24  # of a picture's point: x, y, and the number of a scene point
LONGEST = 4096  # bytes of a name


class Posed(NamedTuple):
    """Pose and camera number of a picture."""

    name: str
    numbers: Sequence[float]  # qw, qx, qy, qz, tx, ty, tz of world to camera
    camera: int


class CameraRecord(NamedTuple):
    """A camera as stored in the file."""

    number: int
    model: str  # "number N" if the model is unknown
    width: int
    height: int
    parameters: Sequence[float]


class _Bytes:
    """Byte stream that raises an error where the file is truncated."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self.file, self.path = file, path
        self.size = path.stat().st_size

    def take(self, layout: struct.Struct, place: str) -> tuple[float, ...]:
        """Read the numbers of a struct layout."""
        content = self.file.read(layout.size)
        if len(content) < layout.size:
            raise ValueError(f"{self.path} is cut off in {place}, after {self.size} bytes")
        return layout.unpack(content)

    def count(self, what: str, least: int) -> int:
        """Read a count of items; each takes at least `least` bytes."""
        count = int(self.take(COUNT, "its first number")[0])
        if count * least > self.size:
            raise ValueError(
                f"{self.path} is cut off or not a COLMAP file: it claims {count}"
                f" {what}, and has {self.size} bytes"
            )
        return count

    def name(self, place: str) -> str:
        """Read a zero-terminated text."""
        start = self.file.tell()
        content, end, _ = self.file.read(LONGEST).partition(b"\0")
        if not end:
            raise ValueError(
                f"{self.path} is cut off or damaged: the name of {place} is not terminated"
            )
        self.file.seek(start + len(content) + 1)
        return content.decode("utf-8", "replace")

    def skip(self, count: int, place: str) -> None:
        """Skip bytes."""
        if self.file.tell() + count > self.size:
            raise ValueError(f"{self.path} is cut off in {place}, after {self.size} bytes")
        self.file.seek(count, 1)


def cameras_of(path: Path) -> Iterator[CameraRecord]:
    """Cameras of cameras.bin; those after an unknown model cannot be read and are omitted."""
    with path.open("rb") as file:
        content = _Bytes(file, path)
        for n in range(content.count("cameras", CAMERA.size)):
            number, model, width, height = map(int, content.take(CAMERA, f"camera {n}"))
            if not 0 <= model < len(MODELS):
                yield CameraRecord(number, f"number {model}", width, height, [])
                return
            name, count = MODELS[model]
            parameters = content.take(struct.Struct(f"<{count}d"), f"camera {n}")
            yield CameraRecord(number, name, width, height, parameters)


def pictures_of(path: Path) -> Iterator[Posed]:
    """Pictures of images.bin, without their points; errors as in `cameras_of`."""
    with path.open("rb") as file:
        content = _Bytes(file, path)
        for n in range(content.count("pictures", PICTURE.size + 1 + COUNT.size)):
            _, *numbers, camera = content.take(PICTURE, f"picture {n}")
            name = content.name(f"picture {n}")
            points = int(content.take(COUNT, f"picture {n}")[0])
            content.skip(POINT_BYTES * points, f"picture {n}")
            yield Posed(name, numbers, int(camera))
