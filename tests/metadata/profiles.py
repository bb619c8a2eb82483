"""Color profiles, as the International Color Consortium's version 2 has them."""

import struct

WIDE = ((0.6097, 0.3111, 0.0195), (0.2053, 0.6257, 0.0609), (0.1492, 0.0632, 0.7446))  # Adobe RGB's
WHITE = (0.9642, 1.0, 0.8249)  # D50


def matrix_profile(gamma: float = 1.8) -> bytes:
    """A display profile with wide primaries, called wide."""
    tags = {
        name: _place(color) for name, color in zip((b"rXYZ", b"gXYZ", b"bXYZ"), WIDE, strict=True)
    }
    tags |= {name: _curve(gamma) for name in (b"rTRC", b"gTRC", b"bTRC")}
    return _profile(b"RGB ", "wide", tags)


def gray_profile(gamma: float = 1.0) -> bytes:
    """A profile of shades, called gray."""
    return _profile(b"GRAY", "gray", {b"kTRC": _curve(gamma)})


def _place(xyz: tuple[float, ...]) -> bytes:
    return b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(65536 * part) for part in xyz))


def _curve(gamma: float) -> bytes:
    return b"curv\0\0\0\0" + struct.pack(">IH", 1, round(256 * gamma)) + b"\0\0"


def _profile(space: bytes, name: str, tags: dict[bytes, bytes]) -> bytes:
    words = name.encode() + b"\0"
    told = b"desc\0\0\0\0" + struct.pack(">I", len(words)) + words + bytes(78)
    tags = {b"desc": told + bytes(-len(told) % 4), b"wtpt": _place(WHITE), **tags}
    place, entries, content = 132 + 12 * len(tags), b"", b""
    for key, value in tags.items():
        entries += key + struct.pack(">2I", place + len(content), len(value))
        content += value
    size = place + len(content)
    head = struct.pack(">I4sI", size, b"\0\0\0\0", 0x02100000) + b"mntr" + space + b"XYZ "
    head += struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + b"acsp" + bytes(28)
    head += struct.pack(">3i", *(round(65536 * part) for part in WHITE))
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + entries + content
