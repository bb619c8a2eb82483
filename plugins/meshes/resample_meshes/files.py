"""Read files of textured meshes with trimesh.

trimesh silently drops what it cannot find. The textures that a material names are looked for here,
so that a mesh is never gray because a file is missing.

trimesh keeps a material's name, so materials are renamed to their numbers before it reads them.
"""

import errno
import json
import math
import struct
import warnings
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.files.images import read_image
from resample.reading.limits import check_file, check_unpacked
from resample.reading.meshes import (
    JSON,
    check_mesh,
    header_of,
    named_textures,
    trimesh_resolver,
    unreadable,
)
from resample.reading.native import plain
from resample.types import Floats
from resample_meshes.shapes import AlphaMode, Cover, Mesh, checked_array
from resample_texture.types import Edge

MAGIC = b"glTF"  # first bytes of a binary file
EDGES = {33071: Edge.CLAMP, 33648: Edge.MIRROR, 10497: Edge.WRAP}
ALPHAS = {"OPAQUE": AlphaMode.OPAQUE, "MASK": AlphaMode.MASK, "BLEND": AlphaMode.BLEND}
BYTES_PER_TEXEL = 16  # of a texture in memory: four floats


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


class _MeshFile(NamedTuple):
    """A mesh file, and its header."""

    path: Path
    named: list[Path]  # texture files that it names
    given: Floats | None  # texture to use instead
    gltf: Described | None
    kept: dict[Any, Floats]  # material textures, which parts may share


def load_mesh(path: str | Path, texture: str | Path | Floats | None = None) -> Mesh:
    """Read a mesh with its textures.

    Parameters
    ----------
    texture
        Texture to use instead of the file's: a file, or (H, W, 3) linear light.

    Returns
    -------
    The mesh in the file's own space. Parts without a texture or texture coordinates have their
    material's color. A glTF material's color multiplies its texture; its alpha mode and wrap modes
    are kept. In other formats textures repeat and are opaque.
    """
    source = Path(path)
    check_file(path)
    given = None if texture is None else _given_texture(texture)
    check_mesh(source)
    named = [] if texture is not None else list(named_textures(source))
    for file in named:
        if not file.is_file():
            message = f"is missing; {source.name} names it as its texture, or give another"
            raise FileNotFoundError(errno.ENOENT, message, str(file))
    try:
        opened = _MeshFile(source, named, given, described(source), {})
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise unreadable(source.name, error) from None
    geometries = _geometries(opened)
    try:
        if given is not None and all(_uv(one) is None for one in geometries):
            raise ValueError("has no texture coordinates; a texture cannot be laid on it")
        mesh = _joined([_piece(one, opened) for one in geometries])
    except ValueError as error:
        raise ValueError(f"{source.name}: {error}") from None
    except (TypeError, LookupError, AttributeError) as error:  # of what trimesh read incompletely
        raise unreadable(source.name, error) from None
    if not (texture is None or isinstance(texture, str | Path)):
        return mesh
    # Files hold levels, but for the floats of bright light.
    covers = [
        replace(cover, is_encoded=bool(one.max() <= 1.0))
        for one, cover in zip(mesh.textures, mesh.covers, strict=True)
    ]
    return replace(mesh, covers=tuple(covers))


def _scene(source: _MeshFile) -> Any:
    import trimesh

    path = source.path
    if source.gltf is None:
        return trimesh.load_scene(plain(path), resolver=trimesh_resolver(path), process=False)
    return trimesh.load_scene(
        BytesIO(source.gltf.content),
        file_type=path.suffix.lower()[1:],
        resolver=trimesh_resolver(path),
        process=False,
    )


def _geometries(source: _MeshFile) -> list[Any]:
    """Return all meshes of a file, transformed, as trimesh objects."""
    name = source.path.name
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow: large pictures, see `_check_texture`
            scene = _scene(source)
        for one in scene.geometry.values():
            _share_pictures(one)
        found = [one for one in scene.dump() if len(getattr(one, "faces", ()))]
        for one in found:
            # Copies keep vertex colors besides a material, which trimesh drops.
            held = getattr(scene.geometry[one.metadata["name"]].visual, "vertex_attributes", {})
            if one.visual.kind == "texture" and "color" in held:
                one.visual.vertex_attributes["color"] = held["color"]
    except Exception as error:  # trimesh and its parsers raise anything at all
        for file in source.named:
            read_image(file)  # raises for the one that cannot be read
        raise unreadable(name, error) from None
    if not found:
        raise ValueError(f"{name} holds no triangles; a mesh with texture is needed")
    return found


def _share_pictures(geometry: Any) -> None:
    """Let copies of a mesh share its pictures instead of decoding them again."""
    material: Any = getattr(geometry.visual, "material", None)
    held = [*vars(material).values(), *getattr(material, "_data", {}).values()] if material else []
    for picture in held:
        if hasattr(picture, "convert"):
            picture.copy = partial(_itself, picture)
            picture.__deepcopy__ = partial(_itself, picture)


def _itself(picture: Any, *_: Any) -> Any:
    return picture


def _given_texture(texture: str | Path | Floats) -> Floats:
    if isinstance(texture, str | Path):
        return _three_channels(read_image(texture, encoding="srgb"), str(texture))
    return checked_array("texture", texture, (None, None, 3), np.float32)


def _three_channels(picture: Floats, name: str) -> Floats:
    """Return straight red, green and blue of a picture (H, W, C), premultiplied if with alpha."""
    count = picture.shape[2]
    if count > 4:
        raise ValueError(f"{name} has {count} channels; a texture has 1 to 4")
    color = picture[..., : 3 if count > 2 else 1]
    if count in (2, 4):
        alpha = picture[..., -1:]
        color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
    return np.ascontiguousarray(np.broadcast_to(color, (*color.shape[:2], 3)))


def _uv(geometry: Any) -> Any:
    """Return the texture coordinates of a trimesh mesh, or None."""
    uv: Any = getattr(geometry.visual, "uv", None)
    return None if uv is None or not len(uv) else uv


def _piece(geometry: Any, source: _MeshFile) -> Mesh:
    """Convert a trimesh mesh."""
    position, triangle = np.asarray(geometry.vertices), np.asarray(geometry.faces)
    visual = geometry.visual
    uv = _uv(geometry)
    if source.given is not None and (uv is not None or source.gltf is None):
        return Mesh(position, triangle, uv, (source.given,))
    if visual.kind == "face":
        color = np.repeat(_linear(visual.face_colors), 3, axis=0)
        corner = np.arange(triangle.size).reshape(-1, 3)
        return Mesh(position[triangle.ravel()], corner, color=color)
    if source.gltf is not None:
        return _gltf_piece(geometry, uv, source, source.gltf)
    if visual.kind == "vertex":
        return Mesh(position, triangle, color=_linear(visual.vertex_colors))
    texture = _own_texture(visual, uv, source)
    return Mesh(position, triangle, _or_zeros(uv, position), (texture,))


def _gltf_piece(geometry: Any, uv: Any, source: _MeshFile, gltf: Described) -> Mesh:
    """Convert a part of a glTF file with its texture, vertex colors or material color."""
    position, triangle = np.asarray(geometry.vertices), np.asarray(geometry.faces)
    visual, look = geometry.visual, WHITE
    if visual.kind == "vertex":
        return Mesh(position, triangle, color=_levels(visual.vertex_colors)[:, :3])
    if visual.kind == "texture":
        look = gltf.materials[int(visual.material.name)]
    if look.has_texture and uv is not None:
        count = 3 if look.cover.alpha is AlphaMode.OPAQUE else 4
        texture = _material_picture(visual.material, source, look.factor[:count])
        return Mesh(position, triangle, uv, (texture,), covers=(look.cover,))
    colors: Any = getattr(visual, "vertex_attributes", {}).get("color")
    if colors is not None:
        return Mesh(position, triangle, color=_levels(colors)[:, :3] * look.factor[:3])
    texture = look.factor[None, None]
    return Mesh(position, triangle, _or_zeros(None, position), (texture,), covers=(look.cover,))


def _or_zeros(uv: Any, position: NDArray[Any]) -> Any:
    """Return texture coordinates; zeros for a texture of one color."""
    return np.zeros((len(position), 2)) if uv is None else uv


def _own_texture(visual: Any, uv: Any, source: _MeshFile) -> Floats:
    """Return the texture of an OBJ's or PLY's material; one texel if it has only a color."""
    material: Any = getattr(visual, "material", None)
    is_colored = "kd" in (getattr(material, "kwargs", None) or {})
    if uv is None and not is_colored:
        raise ValueError("has no texture coordinates and no colors; export it with them")
    is_bare = not source.named and source.path.suffix.lower() in (".obj", ".ply")
    if is_bare and not is_colored:  # trimesh invents a gray material
        raise ValueError("names no texture for its texture coordinates; give one")
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is not None and uv is not None:
        return _material_picture(material, source)
    if source.path.suffix.lower() == ".ply" and source.named:
        return _given_texture(source.named[0])
    for file in source.named:
        read_image(file)  # raises for the one that cannot be read
    return _linear(np.asarray(material.main_color)[None, None])


def _material_picture(
    material: Any, source: _MeshFile, factor: Floats = WHITE.factor[:3]
) -> Floats:
    """Return a material's texture in linear light, with as many channels as factors."""
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is None:
        for file in source.named:
            read_image(file)  # raises for the one that cannot be read
        raise OSError(f"a texture of {source.path.name} is missing or damaged")
    key = (id(image), factor.tobytes())
    if key not in source.kept:
        _check_texture(image.size, source)
        try:
            picture = np.asarray(image.convert("RGBA"))
        except (OSError, ValueError, SyntaxError) as error:
            raise OSError(f"a texture of {source.path.name} is damaged: {error}") from None
        linear = np.concatenate([_linear(picture), _levels(picture)[..., 3:]], axis=2)
        source.kept[key] = linear[..., : len(factor)] * factor
    return source.kept[key]


def _check_texture(size: tuple[int, int], source: _MeshFile) -> None:
    """Refuse textures that unpack to implausibly more than their files' size."""
    files = {source.path, *source.named}
    pixels = [one.shape[0] * one.shape[1] for one in source.kept.values()]
    unpacked = BYTES_PER_TEXEL * (sum(pixels) + math.prod(size))
    check_unpacked("its textures", sum(file.stat().st_size for file in files), unpacked)


def _linear(levels: NDArray[Any]) -> Floats:
    """Convert the first three channels of sRGB values 0..255 to linear light."""
    return from_srgb(np.asarray(levels, np.float32)[..., :3] / np.float32(255))


def _levels(numbers: Any) -> Floats:
    """Return numbers 0..1 of floats 0..1 or of integers up to 255 or 65535."""
    array = np.asarray(numbers)
    whole = np.iinfo(array.dtype).max if array.dtype.kind in "iu" else 1
    return array.astype(np.float32) / np.float32(whole)


def _joined(pieces: list[Mesh]) -> Mesh:
    """Join several meshes into one."""
    vertices = np.cumsum([0, *(len(piece.position) for piece in pieces)])
    triangle, texture = [], []
    known: dict[Any, tuple[int, Floats, Cover]] = {}  # textures, each once
    for piece, first_vertex in zip(pieces, vertices, strict=False):
        triangle.append(piece.triangle + first_vertex)
        numbers = [-1]
        for one, cover in zip(piece.textures, piece.covers, strict=True):
            place = one.__array_interface__["data"][0], one.shape  # parts may share one
            entry = known.setdefault((place, cover), (len(known), one, cover))
            numbers.insert(-1, entry[0])
        texture.append(np.array(numbers)[piece.texture])
    return Mesh(
        np.concatenate([piece.position for piece in pieces]),
        np.concatenate(triangle),
        np.concatenate([piece.uv for piece in pieces]),
        tuple(one for _, one, _ in known.values()),
        np.concatenate(texture),
        np.concatenate([piece.color for piece in pieces]),
        tuple(cover for _, _, cover in known.values()),
    )
