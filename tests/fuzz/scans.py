"""Small clouds as scanners and CloudCompare write them."""

import struct
import tempfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import numpy as np

RNG = np.random.default_rng(5)
PLACE = RNG.random((12, 3)).astype(np.float32)


def scans() -> list[Mapping[str, bytes]]:
    """PTS, XYZ with a header and a count, KITTI's bytes, PLY with lists, E57."""
    rows = "".join(f"{x} {y} {z} -9 1 99 255\n" for x, y, z in PLACE.tolist())
    head = "//X Y Z Scan_angle R G B\n12\n"
    strength = np.linspace(0, 1, 12, dtype=np.float32)[:, None]
    return [
        {"a.pts": f"12\n{rows}".encode()},
        {"a.asc": (head + rows).encode()},
        {"a.bin": np.concatenate([PLACE, strength], axis=1).tobytes()},
        {"a.ply": _ply("ascii")},
        {"a.ply": _ply("binary_little_endian")},
        *_e57(),
    ]


def _ply(encoding: str) -> bytes:
    """PLY with lists before its vertices and in them, and floats as levels."""
    colors = "".join(f"property float {name}\n" for name in ("red", "green", "blue"))
    places = "".join(f"property float {axis}\n" for axis in "xyz")
    head = (
        f"ply\nformat {encoding} 1.0\nelement strip 2\nproperty list uchar int of\n"
        f"element vertex 12\nproperty list uchar short seen\n{places}{colors}end_header\n"
    ).encode()
    if encoding == "ascii":
        lines = [f"{n % 3}{' 7' * (n % 3)} {x} {y} {z} 9 99 200\n" for n, (x, y, z) in _numbered()]
        return head + ("2 3 4\n0\n" + "".join(lines)).encode()
    body = struct.pack("<B2iB", 2, 3, 4, 0)
    for n, place in _numbered():
        body += struct.pack(f"<B{n % 3}h6f", n % 3, *[7] * (n % 3), *place, 9, 99, 200)
    return head + body


def _numbered() -> list[tuple[int, list[float]]]:
    return list(enumerate(PLACE.tolist()))


def _e57() -> list[Mapping[str, bytes]]:
    """Two scans of pye57; nothing where the extra is not installed."""
    if find_spec("pye57") is None:
        return []
    import pye57

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.e57")
        file = pye57.E57(str(path), mode="w")
        data = {f"cartesian{axis}": column for axis, column in zip("XYZ", PLACE.T, strict=True)}
        file.write_scan_raw(data | {"intensity": PLACE[:, 0]})
        file.write_scan_raw(
            data | dict.fromkeys(("colorRed", "colorGreen", "colorBlue"), PLACE[:, 1])
        )
        file.close()
        return [{"a.e57": path.read_bytes()}]
