"""How textures are laid on triangles: what lies beyond their edges, and what their alpha does."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from resample.types import Floats
from resample_texture.texels.pyramid import Pyramid, pyramid
from resample_texture.types import Edge


class Alpha(StrEnum):
    """What a texture's alpha does."""

    OPAQUE = "opaque"  # nothing
    MASK = "mask"  # a texture is seen wholly where its alpha is at least a cutoff, else not at all
    BLEND = "blend"  # what is behind shows through


@dataclass(frozen=True)
class Cover:
    """How a texture is laid on triangles.

    Parameters
    ----------
    along_u, along_v
        What lies beyond the texture's edges: wrap, mirror or clamp.
    alpha
        What its fourth channel does; a texture without one is opaque.
    cutoff
        Least alpha of a mask that is seen.

    Raises
    ------
    ValueError
        An edge or a way of alpha is none of these, or the cutoff is not a number.
    """

    along_u: Edge = Edge.WRAP
    along_v: Edge = Edge.WRAP
    alpha: Alpha = Alpha.OPAQUE
    cutoff: float = 0.5

    def __post_init__(self) -> None:
        for name in ("along_u", "along_v"):
            edge = Edge(getattr(self, name))
            if edge is Edge.TRANSPARENT:
                raise ValueError(
                    "a texture's edge is transparent; wrap, mirror or clamp are allowed"
                )
            object.__setattr__(self, name, edge)
        object.__setattr__(self, "alpha", Alpha(self.alpha))
        if not self.cutoff >= 0.0:
            raise ValueError(f"a cutoff of {self.cutoff}; 0 or more is allowed")


def halvings(texture: Floats, cover: Cover) -> Pyramid:
    """Colors of a texture (H, W, 3 or 4), multiplied by what is seen of it, and their halvings.

    A mask is cut by its alpha between texels, so its largest level is left as it is.
    """
    color = texture[..., :3]
    if texture.shape[2] == 3:
        return pyramid(color)
    levels = pyramid(np.ascontiguousarray(color * _seen(texture, cover)))
    if cover.alpha is Alpha.MASK:
        levels.texel[: color.size] = color.ravel()
    return levels


def alpha_halvings(texture: Floats, cover: Cover) -> Pyramid:
    """Alpha of a texture (H, W, 3 or 4) or, in all but the largest level, what a mask shows."""
    if texture.shape[2] == 3:
        return pyramid(np.ones((*texture.shape[:2], 1), np.float32))
    levels = pyramid(_seen(texture, cover))
    if cover.alpha is Alpha.MASK:
        levels.texel[: texture[..., 3].size] = texture[..., 3].ravel()
    return levels


def _seen(texture: Floats, cover: Cover) -> Floats:
    """How much is seen of the texels of a texture (H, W, 4), as (H, W, 1)."""
    alpha = texture[..., 3:]
    if cover.alpha is Alpha.MASK:
        return (alpha >= cover.cutoff).astype(np.float32)
    return np.clip(alpha, np.float32(0), np.float32(1))
