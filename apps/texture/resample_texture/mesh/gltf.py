"""What glTF files say of their materials, which trimesh does not hand on.

trimesh keeps a material's name, so every material is given its number as name before trimesh reads.
"""

import json
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.reading.texts import json_of
from resample.types import Floats
from resample_texture.mesh.covers import Alpha, Cover
from resample_texture.types import Edge

MAGIC, JSON = b"glTF", 0x4E4F534A  # first bytes of a binary file, and its first chunk's type
EDGES = {33071: Edge.CLAMP, 33648: Edge.MIRROR, 10497: Edge.WRAP}
ALPHAS = {"OPAQUE": Alpha.OPAQUE, "MASK": Alpha.MASK, "BLEND": Alpha.BLEND}


class Material(NamedTuple):
    """What the parts of a mesh that name a material look like."""

    factor: Floats  # (4,) linear red, green, blue and alpha, by which a texture is multiplied
    has_texture: bool
    cover: Cover


WHITE = Material(np.ones(4, np.float32), has_texture=False, cover=Cover())


class Described(NamedTuple):
    """A glTF file."""

    content: bytes  # in which materials are named by their numbers
    materials: list[Material]


def described(file: Path) -> Described | None:
    """Materials of a glTF file, and what trimesh is to read in its place; None for other files.

    Raises
    ------
    ValueError
        The file is damaged, or says of a material what glTF does not know.
    """
    kind = file.suffix.lower()
    if kind not in (".glb", ".gltf"):
        return None
    content = file.read_bytes()
    start, end = (20, 20 + _length(content)) if kind == ".glb" else (0, len(content))
    header = json_of(content[start:end].decode("utf-8"))
    materials = [_material(one, header) for one in header.get("materials", [])]
    for number, material in enumerate(header.get("materials", [])):
        material["name"] = str(number)
    text = json.dumps(header).encode()
    if kind == ".gltf":
        return Described(text, materials)
    text += b" " * (-len(text) % 4)
    rest = content[end:]
    head = MAGIC + struct.pack("<IIII", 2, 20 + len(text) + len(rest), len(text), JSON)
    return Described(head + text + rest, materials)


def _length(content: bytes) -> int:
    """Bytes of the JSON in a binary file."""
    if content[:4] != MAGIC or len(content) < 20:
        raise ValueError("it is no binary glTF")
    length, kind = struct.unpack_from("<II", content, 12)
    if kind != JSON:
        raise ValueError("its first chunk is not JSON")
    return int(length)


def _material(given: dict[str, Any], header: dict[str, Any]) -> Material:
    look = given.get("pbrMetallicRoughness", {})
    factor = np.array(look.get("baseColorFactor", (1, 1, 1, 1)), np.float32)
    if factor.shape != (4,):
        raise ValueError(f"a baseColorFactor of {factor.size} numbers; it has 4")
    mode = given.get("alphaMode", "OPAQUE")
    if mode not in ALPHAS:
        raise ValueError(f"an alphaMode {mode!r}; there are {', '.join(ALPHAS)}")
    texture = look.get("baseColorTexture")
    along_u, along_v = _edges(texture, header)
    cover = Cover(along_u, along_v, ALPHAS[mode], float(given.get("alphaCutoff", 0.5)))
    return Material(factor, texture is not None, cover)


def _edges(texture: dict[str, Any] | None, header: dict[str, Any]) -> tuple[Edge, Edge]:
    """What lies beyond a texture's edges along u and v."""
    if texture is None:
        return Edge.WRAP, Edge.WRAP
    number = header["textures"][texture["index"]].get("sampler")
    sampler = {} if number is None else header["samplers"][number]
    codes = sampler.get("wrapS", 10497), sampler.get("wrapT", 10497)
    for code in codes:
        if code not in EDGES:
            raise ValueError(f"a sampler wraps by {code}; there are {', '.join(map(str, EDGES))}")
    return EDGES[codes[0]], EDGES[codes[1]]
