"""Read the properties of glTF materials that trimesh drops.

trimesh keeps a material's name, so materials are renamed to their numbers before it reads them.
"""

import json
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.reading.models.gltf import JSON, header_of
from resample.types import Floats
from resample_texture.mesh.covers import AlphaMode, Cover
from resample_texture.types import Edge

MAGIC = b"glTF"  # first bytes of a binary file
EDGES = {33071: Edge.CLAMP, 33648: Edge.MIRROR, 10497: Edge.WRAP}
ALPHAS = {"OPAQUE": AlphaMode.OPAQUE, "MASK": AlphaMode.MASK, "BLEND": AlphaMode.BLEND}


class Material(NamedTuple):
    """Appearance of a glTF material."""

    factor: Floats  # (4,) linear red, green, blue and alpha, by which a texture is multiplied
    has_texture: bool
    cover: Cover


WHITE = Material(np.ones(4, np.float32), has_texture=False, cover=Cover())


class Described(NamedTuple):
    """A glTF file with its materials."""

    content: bytes  # the file, with materials renamed to their numbers
    materials: list[Material]


def described(file: Path) -> Described | None:
    """Return a glTF file's materials, and the content for trimesh; None for other files."""
    kind = file.suffix.lower()
    if kind not in (".glb", ".gltf"):
        return None
    content = file.read_bytes()
    end = 20 + struct.unpack_from("<I", content, 12)[0] if kind == ".glb" else len(content)
    header = header_of(file)
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


def _material(given: dict[str, Any], header: dict[str, Any]) -> Material:
    look = given.get("pbrMetallicRoughness", {})
    factor = np.array(look.get("baseColorFactor", (1, 1, 1, 1)), np.float32)
    if factor.shape != (4,):
        raise ValueError(f"a baseColorFactor of {factor.size} numbers; it must have 4")
    mode = given.get("alphaMode", "OPAQUE")
    if not isinstance(mode, str) or mode not in ALPHAS:
        raise ValueError(f"an alphaMode {mode!r:.40}; known: {', '.join(ALPHAS)}")
    texture = look.get("baseColorTexture")
    along_u, along_v = _edges(texture, header)
    cover = Cover(along_u, along_v, ALPHAS[mode], float(given.get("alphaCutoff", 0.5)))
    return Material(factor, texture is not None, cover)


def _edges(texture: dict[str, Any] | None, header: dict[str, Any]) -> tuple[Edge, Edge]:
    """Return a texture's wrap modes along u and v."""
    if texture is None:
        return Edge.WRAP, Edge.WRAP
    number = header["textures"][texture["index"]].get("sampler")
    sampler = {} if number is None else header["samplers"][number]
    codes = sampler.get("wrapS", 10497), sampler.get("wrapT", 10497)
    for code in codes:
        if not isinstance(code, int) or code not in EDGES:
            raise ValueError(
                f"a sampler wraps by {code!r:.40}; known: {', '.join(map(str, EDGES))}"
            )
    return EDGES[codes[0]], EDGES[codes[1]]
