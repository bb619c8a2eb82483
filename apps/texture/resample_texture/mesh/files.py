"""Textured meshes and the files they come from, read by trimesh.

trimesh drops what it cannot find without a word: a texture that a material names is looked for
here, so that a mesh is never gray for want of a file.
"""

import errno
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.files.images import read_image
from resample.types import Doubles, Floats
from resample_texture.mesh.covers import Alpha, Cover, alpha_halvings, halvings
from resample_texture.texels.pyramid import Pyramid

Ints = NDArray[np.int64]

FARTHEST = 1e6  # textures; float32 files cannot tell places within one that lies beyond

_LEFT_OUT: Any = None


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with textures, or with colors at their vertices.

    Parameters
    ----------
    position
        (V, 3) scene units.
    triangle
        (T, 3) vertices; seen from outside they go around counterclockwise.
    uv
        (V, 2) texture coordinates: u to the right, v upward, 0..1 over the texture, which goes on
        periodically beyond, to ±1e6.
    textures
        Pictures (H, W, 3) or (H, W, 4), linear light, not multiplied by their alpha.
    texture
        (T,) which of them covers a triangle, −1 where vertex colors do; left out, it is the first,
        or vertex colors where there are no textures.
    color
        (V, 3) linear light.
    covers
        How each texture is laid on; left out, they repeat and are opaque.

    Raises
    ------
    ValueError
        Shapes do not fit, a number is not finite or too large, a triangle names a vertex or texture
        that is not there, or nothing says what color the triangles have.
    """

    position: Doubles
    triangle: Ints
    uv: Doubles = _LEFT_OUT
    textures: tuple[Floats, ...] = ()
    texture: Ints = _LEFT_OUT
    color: Floats = _LEFT_OUT
    covers: tuple[Cover, ...] = ()

    def __post_init__(self) -> None:
        position = _array("position", self.position, (None, 3), np.float64)
        triangle = _array("triangle", self.triangle, (None, 3), np.int64)
        if not triangle.size:
            raise ValueError("a mesh without triangles shows nothing; give at least one")
        _check_range("vertex", triangle, 0, len(position))
        chosen = np.full(len(triangle), 0 if self.textures else -1)
        if self.texture is not None:
            chosen = _array("texture", self.texture, (len(triangle),), np.int64)
        _check_range("texture", chosen, -1, len(self.textures))
        if (chosen >= 0).any() and self.uv is None:
            raise ValueError("has no texture coordinates; a texture cannot be laid on it")
        if (chosen < 0).any() and self.color is None:
            raise ValueError("has neither a texture nor vertex colors; give one of them")
        count = len(position)
        uv = np.zeros((count, 2)) if self.uv is None else _places(self.uv, count)
        color = np.ones((count, 3)) if self.color is None else self.color
        covers = tuple(self.covers) or (Cover(),) * len(self.textures)
        if len(covers) != len(self.textures):
            raise ValueError(
                f"{len(covers)} covers for {len(self.textures)} textures; give as many"
            )
        pictures = [_picture(*one) for one in zip(self.textures, covers, strict=True)]
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "triangle", triangle)
        object.__setattr__(self, "uv", uv)
        object.__setattr__(self, "textures", tuple(pictures))
        object.__setattr__(self, "covers", covers)
        object.__setattr__(self, "texture", chosen)
        object.__setattr__(self, "color", _array("color", color, (count, 3), np.float32))

    @cached_property
    def pyramids(self) -> tuple[Pyramid, ...]:
        """Colors of textures with their halvings, made when they are first needed.

        They are multiplied by what is seen of a texture, but for the largest level of a mask.
        """
        return tuple(halvings(*one) for one in zip(self.textures, self.covers, strict=True))

    @cached_property
    def alphas(self) -> tuple[Pyramid, ...]:
        """Likewise their alphas, or what is seen of masks; nothing if all are opaque."""
        if all(texture.shape[2] == 3 for texture in self.textures):
            return ()
        return tuple(alpha_halvings(*one) for one in zip(self.textures, self.covers, strict=True))


def load_mesh(path: str | Path, texture: str | Path | Floats | None = None) -> Mesh:
    """Read a mesh with its textures.

    Parameters
    ----------
    path
        OBJ, GLB, glTF, PLY or whatever else trimesh reads. All objects of a scene are put in their
        places and become one mesh.
    texture
        Picture to use in place of all that the file names: a file, or (H, W, 3) linear light.

    Returns
    -------
    The mesh in the file's own space. Transparency of textures is ignored; a material's color
    multiplies the texture in glTF, and is used where there is no texture in all formats.

    Raises
    ------
    ValueError
        The file is no mesh, has no triangles, or has neither texture coordinates nor vertex colors.
    OSError
        The file or a texture it names is missing or damaged.
    """
    source = Path(path)
    if not source.is_file():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    given = None if texture is None else _given_texture(texture)
    named = [] if texture is not None else list(_named_textures(source))
    for file in named:
        if not file.is_file():
            message = f"is missing; {source.name} names it as its texture, or give another"
            raise FileNotFoundError(errno.ENOENT, message, str(file))
    pieces = [_piece(one, source, named, given) for one in _geometries(source, named)]
    try:
        return _joined(pieces)
    except ValueError as error:
        raise ValueError(f"{source.name}: {error}") from None


def _array(
    name: str, given: Any, shape: tuple[int | None, ...], kind: type[np.generic]
) -> NDArray[Any]:
    """Contiguous array of a shape, checked; None in the shape stands for any size."""
    array = np.ascontiguousarray(given, kind)
    fits = len(shape) == array.ndim
    if not fits or any(
        want not in (None, have) for want, have in zip(shape, array.shape, strict=True)
    ):
        wanted = ", ".join("any" if size is None else str(size) for size in shape)
        raise ValueError(f"{name} has the shape {array.shape}; it must be ({wanted})")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds numbers that are not finite; remove or repair them")
    return array


def _picture(given: Any, cover: Cover) -> Floats:
    """A texture, with an alpha if that does anything."""
    channels = 4 if np.ndim(given) == 3 and np.shape(given)[2] == 4 else 3
    picture: Floats = _array("texture", given, (None, None, channels), np.float32)
    if not picture.size:
        raise ValueError("a texture has no texels; give at least one")
    if cover.alpha is Alpha.OPAQUE:
        return np.ascontiguousarray(picture[..., :3])
    return picture


def _places(given: Any, count: int) -> Doubles:
    """Texture coordinates (count, 2), checked."""
    uv = _array("uv", given, (count, 2), np.float64)
    farthest = float(np.abs(uv).max(initial=0.0))
    if farthest > FARTHEST:
        raise ValueError(
            f"a texture coordinate of {farthest:g}; {FARTHEST:g} is the limit: textures repeat, so "
            "subtract whole numbers"
        )
    return uv


def _check_range(name: str, index: Ints, least: int, count: int) -> None:
    low, high = int(index.min()), int(index.max())
    if low < least or high >= count:
        raise ValueError(f"{name} {low if low < least else high} is named, but there are {count}")


def _geometries(source: Path, named: list[Path]) -> list[Any]:
    """All of a file's meshes in their places, as trimesh has them."""
    import trimesh

    try:
        scene = trimesh.load_scene(source, process=False)
        found = [one for one in scene.dump() if len(getattr(one, "faces", ()))]
    except Exception as error:  # trimesh and its parsers raise anything at all
        for file in named:
            read_image(file)  # says which one cannot be read
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise ValueError(f"{source.name} cannot be read as a mesh: {reason}") from None
    if not found:
        raise ValueError(f"{source.name} holds no triangles; a mesh with texture is needed")
    return found


def _given_texture(texture: str | Path | Floats) -> Floats:
    if isinstance(texture, str | Path):
        return _three_channels(read_image(texture), str(texture))
    return _array("texture", texture, (None, None, 3), np.float32)


def _three_channels(picture: Floats, name: str) -> Floats:
    """Red, green and blue of a picture (H, W, C) that is multiplied by its alpha, if any."""
    count = picture.shape[2]
    if count > 4:
        raise ValueError(f"{name} has {count} channels; a texture has 1 to 4")
    color = picture[..., : 3 if count > 2 else 1]
    if count in (2, 4):
        alpha = picture[..., -1:]
        color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
    return np.ascontiguousarray(np.broadcast_to(color, (*color.shape[:2], 3)))


def _named_textures(source: Path) -> Iterator[Path]:
    """Files that a mesh names as its textures, whether they are there or not."""
    kind = source.suffix.lower()
    if kind == ".obj":
        for library in _values(source, "mtllib"):
            file = source.parent / library
            yield from (file.parent / name for name in _material_textures(file, source))
    elif kind == ".ply":
        with source.open("rb") as opened:
            header = opened.read(1 << 16).partition(b"end_header")[0].decode("latin-1")
        for line in header.splitlines():
            words = line.split(maxsplit=2)
            if words[:2] == ["comment", "TextureFile"] and len(words) == 3:
                yield source.parent / words[2].strip()
    elif kind == ".gltf":
        yield from _gltf_textures(source)


def _material_textures(library: Path, source: Path) -> list[str]:
    if not library.is_file():
        message = f"is missing; {source.name} names it for its textures"
        raise FileNotFoundError(errno.ENOENT, message, str(library))
    values = _values(library, "map_kd")
    return [value.split()[-1] if value.startswith("-") else value for value in values]


def _values(file: Path, key: str) -> list[str]:
    """What follows a key word at the beginnings of a file's lines."""
    with file.open(encoding="utf-8", errors="replace") as lines:
        split = (line.split(maxsplit=1) for line in lines)
        found = [words[1] for words in split if len(words) == 2 and words[0].lower() == key]
    return [value.strip().replace("\\", "/") for value in found]


def _gltf_textures(source: Path) -> list[Path]:
    from urllib.parse import unquote

    try:
        content = json.loads(source.read_text(encoding="utf-8"))
        names = [image.get("uri", "data:") for image in content.get("images", [])]
    except (ValueError, AttributeError):
        return []  # trimesh says what is wrong with it
    return [source.parent / unquote(name) for name in names if not name.startswith("data:")]


def _piece(geometry: Any, source: Path, named: list[Path], given: Floats | None) -> Mesh:
    """One of trimesh's meshes."""
    position, triangle = np.asarray(geometry.vertices), np.asarray(geometry.faces)
    visual = geometry.visual
    uv: Any = getattr(visual, "uv", None)
    try:
        if given is not None:
            return Mesh(position, triangle, uv, (given,))
        if visual.kind == "vertex":
            return Mesh(position, triangle, color=_linear(visual.vertex_colors))
        if visual.kind == "face":
            color = np.repeat(_linear(visual.face_colors), 3, axis=0)
            corner = np.arange(triangle.size).reshape(-1, 3)
            return Mesh(position[triangle.ravel()], corner, color=color)
        return Mesh(position, triangle, uv, (_own_texture(visual, source, named),))
    except ValueError as error:
        raise ValueError(f"{source.name}: {error}") from None


def _own_texture(visual: Any, source: Path, named: list[Path]) -> Floats:
    """Picture of a material; one texel where it has a color only."""
    uv: Any = getattr(visual, "uv", None)
    material: Any = getattr(visual, "material", None)
    if uv is None or not len(uv):
        raise ValueError("has no texture coordinates and no vertex colors; export it with them")
    if not named and source.suffix.lower() in (".obj", ".ply"):  # trimesh makes up a gray one
        raise ValueError("names no texture for its texture coordinates; give one")
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is not None:
        return _material_picture(material, image, source)
    if source.suffix.lower() == ".ply" and named:
        return _three_channels(read_image(named[0]), str(named[0]))
    for file in named:
        read_image(file)  # says which one cannot be read
    return _linear(np.asarray(material.main_color)[None, None])


def _material_picture(material: Any, image: Any, source: Path) -> Floats:
    try:
        picture = np.asarray(image.convert("RGB"))
    except (OSError, ValueError, SyntaxError) as error:
        raise OSError(f"a texture of {source.name} is damaged: {error}") from None
    factor = getattr(material, "baseColorFactor", None)
    if factor is None:
        return _linear(picture)
    return _linear(picture) * (np.asarray(factor, np.float32)[:3] / np.float32(255))


def _linear(levels: NDArray[Any]) -> Floats:
    """Linear light of the first three channels of sRGB values 0..255."""
    return from_srgb(np.asarray(levels, np.float32)[..., :3] / np.float32(255))


def _joined(pieces: list[Mesh]) -> Mesh:
    """One mesh of several."""
    vertices = np.cumsum([0, *(len(piece.position) for piece in pieces)])
    textures = np.cumsum([0, *(len(piece.textures) for piece in pieces)])
    shifted = zip(pieces, vertices, textures, strict=False)
    triangle, texture = [], []
    for piece, first_vertex, first_texture in shifted:
        triangle.append(piece.triangle + first_vertex)
        texture.append(np.where(piece.texture < 0, -1, piece.texture + first_texture))
    return Mesh(
        np.concatenate([piece.position for piece in pieces]),
        np.concatenate(triangle),
        np.concatenate([piece.uv for piece in pieces]),
        tuple(one for piece in pieces for one in piece.textures),
        np.concatenate(texture),
        np.concatenate([piece.color for piece in pieces]),
    )
