"""The type of textured meshes, checked, and how textures cover their triangles."""

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import to_srgb
from resample.types import Doubles, Floats
from resample_texture.scenes import shrunk
from resample_texture.types import Edge

Ints = NDArray[np.int64]

FARTHEST = 1e6  # repeats of a texture; beyond, float32 coordinates are too coarse

_LEFT_OUT: Any = None


class Pyramid(NamedTuple):
    """The levels of a picture's pyramid."""

    texel: Floats  # (T,) all levels, one after the other, each of them (h, w, C)
    levels: NDArray[np.int64]  # (L, 3) where a level begins in `texel`, its height and its width


def pyramid(source: Floats) -> Pyramid:
    """Return the pyramid of a picture (H, W, C).

    A level has half the rows and columns of the previous one, rounded down and at least one. At odd
    sizes texels are means over more than 2 × 2 texels; the outer ones count in part.
    """
    pictures = [source]
    while max(pictures[-1].shape[:2]) > 1:
        height, width = pictures[-1].shape[:2]
        pictures.append(shrunk(pictures[-1], max(1, height // 2), max(1, width // 2)))
    ends = np.cumsum([picture.size for picture in pictures])
    levels = [
        (end - picture.size, *picture.shape[:2])
        for end, picture in zip(ends, pictures, strict=True)
    ]
    texel = np.concatenate([picture.ravel() for picture in pictures])
    return Pyramid(texel, np.array(levels, np.int64))


class AlphaMode(StrEnum):
    """Alpha mode of a texture."""

    OPAQUE = "opaque"  # alpha is ignored
    MASK = "mask"  # opaque where alpha is at least the cutoff, else invisible
    BLEND = "blend"  # blended over surfaces behind


@dataclass(frozen=True)
class Cover:
    """How a texture covers triangles.

    Raises ValueError: a wrap mode or alpha mode is unknown, or the cutoff is negative or not a
    number.
    """

    # Wrap modes beyond the texture's edges: wrap, mirror or clamp.
    along_u: Edge = Edge.WRAP
    along_v: Edge = Edge.WRAP
    alpha: AlphaMode = AlphaMode.OPAQUE  # alpha mode; a texture without a fourth channel is opaque
    cutoff: float = 0.5  # least visible alpha of a mask
    is_encoded: bool = False  # interpolated as levels of sRGB, as files have them

    def __post_init__(self) -> None:
        for name in ("along_u", "along_v"):
            edge = Edge(getattr(self, name))
            if edge is Edge.TRANSPARENT:
                raise ValueError(
                    "a texture's edge is transparent; wrap, mirror or clamp are allowed"
                )
            object.__setattr__(self, name, edge)
        object.__setattr__(self, "alpha", AlphaMode(self.alpha))
        if not self.cutoff >= 0.0:
            raise ValueError(f"a cutoff of {self.cutoff}; 0 or more is allowed")


def halvings(texture: Floats, cover: Cover) -> Pyramid:
    """Return the pyramid of a texture (H, W, 3 or 4), multiplied by its visibility.

    Its levels are means of light; before the largest comes the same in levels of sRGB if these are
    interpolated. A mask is cut by its alpha between texels, so these two are not multiplied.
    """
    color, visible = texture[..., :3], np.ones(1, np.float32)
    if texture.shape[2] == 4:
        visible = _visibility(texture, cover)
    light = pyramid(np.ascontiguousarray(color * visible))
    if cover.alpha is AlphaMode.MASK:
        visible = np.ones(1, np.float32)
        light.texel[: color.size] = color.ravel()
    return _after(to_srgb(color) * visible, light) if cover.is_encoded else light


def alpha_halvings(texture: Floats, cover: Cover) -> Pyramid:
    """Return the pyramid of a texture's alpha; of a mask its visibility from level 1 on."""
    alpha = np.ones((*texture.shape[:2], 1), np.float32)
    if texture.shape[2] == 4:
        alpha = _visibility(texture, cover)
    levels = pyramid(alpha)
    if texture.shape[2] == 4 and cover.alpha is AlphaMode.MASK:
        alpha = texture[..., 3:]
        levels.texel[: alpha.size] = alpha.ravel()
    return _after(alpha, levels) if cover.is_encoded else levels


def _after(first: Floats, rest: Pyramid) -> Pyramid:
    """Return a pyramid with another level in front of it, as large as its largest."""
    levels = np.vstack([rest.levels[:1], rest.levels])
    levels[1:, 0] += first.size
    return Pyramid(np.concatenate([first.ravel(), rest.texel]), levels)


def _visibility(texture: Floats, cover: Cover) -> Floats:
    """Return the visibility 0..1 of the texels of a texture (H, W, 4), as (H, W, 1)."""
    alpha = texture[..., 3:]
    if cover.alpha is AlphaMode.MASK:
        return (alpha >= cover.cutoff).astype(np.float32)
    return np.clip(alpha, np.float32(0), np.float32(1))


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with textures or vertex colors.

    Raises ValueError: shapes do not fit, a number is not finite or too large, a triangle names a
    missing vertex or texture, or no color is defined for the triangles.
    """

    position: Doubles  # (V, 3) scene units
    triangle: Ints  # (T, 3) indices of vertices, counterclockwise seen from outside
    # (V, 2) texture coordinates: u to the right, v upward, 0..1 across the texture, which repeats
    # beyond, up to ±1e6.
    uv: Doubles = _LEFT_OUT
    # Pictures (H, W, 3) or (H, W, 4), linear light, straight alpha.
    textures: tuple[Floats, ...] = ()
    # (T,) index of each triangle's texture, −1 for vertex colors. Default: the first texture, or
    # vertex colors if there are no textures.
    texture: Ints = _LEFT_OUT
    color: Floats = _LEFT_OUT  # (V, 3) linear light
    # Wrap and alpha modes of each texture. Default: textures repeat and are opaque.
    covers: tuple[Cover, ...] = ()

    def __post_init__(self) -> None:
        position = checked_array("position", self.position, (None, 3), np.float64)
        triangle = checked_array("triangle", self.triangle, (None, 3), np.int64)
        if not triangle.size:
            raise ValueError("a mesh without triangles shows nothing; give at least one")
        _check_range("vertex", triangle, 0, len(position))
        chosen = np.full(len(triangle), 0 if self.textures else -1)
        if self.texture is not None:
            chosen = checked_array("texture", self.texture, (len(triangle),), np.int64)
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
        object.__setattr__(self, "color", checked_array("color", color, (count, 3), np.float32))

    @cached_property
    def pyramids(self) -> tuple[Pyramid, ...]:
        """Color pyramids of the textures, computed on first use.

        Colors are multiplied by the texture's visibility, except in the largest level of a mask.
        """
        return tuple(halvings(*one) for one in zip(self.textures, self.covers, strict=True))

    @cached_property
    def alphas(self) -> tuple[Pyramid, ...]:
        """Alpha pyramids of the textures, or visibility of masks; empty if all are opaque."""
        if all(texture.shape[2] == 3 for texture in self.textures):
            return ()
        return tuple(alpha_halvings(*one) for one in zip(self.textures, self.covers, strict=True))


def checked_array(
    name: str, given: Any, shape: tuple[int | None, ...], kind: type[np.generic]
) -> NDArray[Any]:
    """Return a checked contiguous array; None in the shape stands for any size."""
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
    """Return a checked texture, with alpha unless its mode is opaque."""
    channels = 4 if np.ndim(given) == 3 and np.shape(given)[2] == 4 else 3
    picture: Floats = checked_array("texture", given, (None, None, channels), np.float32)
    if not picture.size:
        raise ValueError("a texture has no texels; give at least one")
    if cover.alpha is AlphaMode.OPAQUE:
        return np.ascontiguousarray(picture[..., :3])
    return picture


def _places(given: Any, count: int) -> Doubles:
    """Return checked texture coordinates (count, 2)."""
    uv = checked_array("uv", given, (count, 2), np.float64)
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
