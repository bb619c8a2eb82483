"""Stereo pairs: eye distance, zero parallax, and layouts with both pictures."""

from typing import NamedTuple

import numpy as np

from resample.console import say
from resample.files.pictures import Picture
from resample.types import Floats
from resample_warp3d.command.choices import Parallax
from resample_warp3d.command.inputs import DepthInput

COMFORT = 0.015  # default parallax before and behind the screen, as a share of the width
STRAY = 0.01  # share of the depth at each end that may exceed this parallax


class Eyes(NamedTuple):
    """Parallax of two eyes: `gain` (n − `zero`) px at nearness n."""

    gain: float
    zero: float

    @classmethod
    def of(cls, view: DepthInput, choice: Parallax) -> "Eyes":
        """Choose eyes for a picture, and report them."""
        nearness, width = view.image.nearness, view.image.nearness.shape[1]
        known = nearness[nearness > 0].astype(np.float64)
        far, middle, near = np.quantile(known, [STRAY, 0.5, 1.0 - STRAY])
        focal = abs(float(view.pinhole.matrix[0, 0]))
        zero = float(middle) if choice.zero_plane is None else 1.0 / choice.zero_plane
        if choice.eyes is None:
            gain = COMFORT * width / max(near - zero, zero - far, 1e-12)
        else:
            gain = focal * choice.eyes
        before, behind = gain * (near - zero), gain * (far - zero)
        say(
            f"the eyes are {gain / focal:.3g} apart, the screen is {1.0 / zero:.3g} away: "
            f"parallax from {behind:.1f} to {before:.1f} px"
        )
        return cls(gain, zero)


def together(left: Picture, right: Picture, layout: str) -> Picture:
    """Combine the pictures of both eyes."""
    first, second = _with_alpha_of_either(left, right)
    if layout == "anaglyph":
        return _anaglyph(first, second)
    axis = 1 if layout == "side-by-side" else 0
    return first._replace(data=np.concatenate([first.data, second.data], axis=axis))


def _with_alpha_of_either(left: Picture, right: Picture) -> tuple[Picture, Picture]:
    """Give both pictures alpha if one has it."""
    if left.kind.has_alpha == right.kind.has_alpha:
        return left, right
    if left.kind.has_alpha:
        return left, _opaque(right)
    return _opaque(left), right


def _opaque(picture: Picture) -> Picture:
    one = np.ones((*picture.data.shape[:2], 1), np.float32)
    kind = picture.kind._replace(channels=(*picture.kind.channels, "A"))
    return Picture(np.concatenate([picture.data, one], axis=2), kind, picture.about)


def _anaglyph(left: Picture, right: Picture) -> Picture:
    """Combine red of the left picture with green and blue of the right one."""
    names, has_alpha = left.kind.channels, left.kind.has_alpha
    colors = names[:-1] if has_alpha else names
    if colors not in (("R", "G", "B"), ("Y",)):
        raise ValueError(f"an anaglyph is made of gray or RGB pictures, not of {', '.join(colors)}")
    straight = [_straight(picture) for picture in (left, right)]
    planes = [straight[0][..., 0], straight[1][..., len(colors) // 2], straight[1][..., -1]]
    data = np.stack(planes, axis=2)
    channels: tuple[str, ...] = ("R", "G", "B")
    if has_alpha:
        alpha = np.minimum(left.data[..., -1:], right.data[..., -1:])
        data = np.concatenate([data * alpha, alpha], axis=2)
        channels = (*channels, "A")
    return Picture(np.asarray(data, np.float32), left.kind._replace(channels=channels), left.about)


def _straight(picture: Picture) -> Floats:
    """Return straight color."""
    if not picture.kind.has_alpha:
        return picture.data
    alpha = picture.data[..., -1:]
    color = picture.data[..., :-1]
    return np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
