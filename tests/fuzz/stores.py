"""Small valid files of the corpus that lie in folders, in pictures, or in the cache."""

import hashlib
import io
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

SETTINGS = (
    'command = "resample-volume render"\nfov = 30.5\nsubpixels = 4\nfilter = "gaussian:sigma=0.6"\n'
)
SIGNATURE = b"\x89PNG\r\n\x1a\n"


def _tree(write: Callable[[Path], object]) -> dict[str, bytes]:
    """Files of a folder that a function fills, by their names from there on."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(folder)
        found = sorted(path for path in folder.rglob("*") if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def ome_zarr(version: int, values: Any) -> dict[str, bytes]:
    """Files of an OME-Zarr of one level, metadata first."""
    import zarr

    scale: dict[str, Any] = {"type": "scale", "scale": [1.5, 1.0, 1.0]}
    axes = [{"name": axis, "type": "space", "unit": "micrometer"} for axis in "zyx"]
    levels = [{"path": "0", "coordinateTransformations": [scale]}]
    said: dict[str, Any] = {"axes": axes, "datasets": levels}

    def write(folder: Path) -> None:
        group = zarr.create_group(folder / "a.ome.zarr", zarr_format=version)
        group.create_array("0", data=values, chunks=(3, 4, 4))
        if version == 2:
            group.attrs["multiscales"] = [said | {"version": "0.4"}]
        else:
            group.attrs["ome"] = {"version": "0.5", "multiscales": [said]}

    files = _tree(write)
    return dict(sorted(files.items(), key=lambda item: "/c/" in item[0] or "/0/" in item[0]))


def zipped(files: dict[str, bytes]) -> bytes:
    """Files of a store in an archive, without the store's own folder."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as target:
        for name, content in files.items():
            target.writestr(name.partition("/")[2], content)
    return packed.getvalue()


def png_with(text: str) -> bytes:
    """Picture that keeps settings in its text."""
    said = b"tEXtresample:settings\0" + text.encode()
    head = b"IHDR" + struct.pack(">2I5B", 2, 2, 8, 0, 0, 0, 0)
    data = b"IDAT" + zlib.compress(bytes(6))
    return SIGNATURE + b"".join(_chunk(part) for part in (head, said, data, b"IEND"))


def _chunk(part: bytes) -> bytes:
    return struct.pack(">I", len(part) - 4) + part + struct.pack(">I", zlib.crc32(part))


def chunks_of(content: bytes) -> list[bytes]:
    """Kinds with contents of a PNG's chunks."""
    found, place = [], len(SIGNATURE)
    while place + 12 <= len(content):
        size = struct.unpack_from(">I", content, place)[0]
        found.append(content[place + 4 : place + 8 + size])
        place += 12 + size
    return found


def png_of(chunks: list[bytes]) -> bytes:
    """PNG of chunks, with their checksums."""
    return SIGNATURE + b"".join(map(_chunk, chunks))


def kernel() -> bytes:
    """Entry of the cache of kernels."""
    data = b'["module.name", "q", ["module.name"], 1.5]\n' + b"payload" * 9
    return b"resample kernel 2\n" + hashlib.blake2b(data).digest() + data
