"""How textures cover triangles: wrap modes and alpha modes."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from resample.types import Floats
from resample_texture.texels.pyramid import Pyramid, pyramid
from resample_texture.types import Edge


class AlphaMode(StrEnum):
    """Alpha mode of a texture."""

    OPAQUE = "opaque"  # alpha is ignored
    MASK = "mask"  # opaque where alpha is at least the cutoff, else invisible
    BLEND = "blend"  # blended over what is behind


@dataclass(frozen=True)
class Cover:
    """How a texture covers triangles.

    Parameters
    ----------
    along_u, along_v
        Wrap modes beyond the texture's edges: wrap, mirror or clamp.
    alpha
        Alpha mode; a texture without a fourth channel is opaque.
    cutoff
        Least visible alpha of a mask.

    Raises
    ------
    ValueError
        A wrap mode or alpha mode is unknown, or the cutoff is negative or not a number.
    """

    along_u: Edge = Edge.WRAP
    along_v: Edge = Edge.WRAP
    alpha: AlphaMode = AlphaMode.OPAQUE
    cutoff: float = 0.5

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

    A mask is cut by its alpha between texels, so its largest level is not multiplied.
    """
    color = texture[..., :3]
    if texture.shape[2] == 3:
        return pyramid(color)
    levels = pyramid(np.ascontiguousarray(color * _visibility(texture, cover)))
    if cover.alpha is AlphaMode.MASK:
        levels.texel[: color.size] = color.ravel()
    return levels


def alpha_halvings(texture: Floats, cover: Cover) -> Pyramid:
    """Return the pyramid of a texture's alpha; of a mask its visibility from level 1 on."""
    if texture.shape[2] == 3:
        return pyramid(np.ones((*texture.shape[:2], 1), np.float32))
    levels = pyramid(_visibility(texture, cover))
    if cover.alpha is AlphaMode.MASK:
        levels.texel[: texture[..., 3].size] = texture[..., 3].ravel()
    return levels


def _visibility(texture: Floats, cover: Cover) -> Floats:
    """Return the visibility 0..1 of the texels of a texture (H, W, 4), as (H, W, 1)."""
    alpha = texture[..., 3:]
    if cover.alpha is AlphaMode.MASK:
        return (alpha >= cover.cutoff).astype(np.float32)
    return np.clip(alpha, np.float32(0), np.float32(1))
