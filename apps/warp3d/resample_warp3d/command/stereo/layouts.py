"""Layouts of stereo pairs: both pictures in one."""

import numpy as np

from resample.files.pictures import Picture
from resample.types import Floats

HALF = "half-"  # beginning of layouts of pictures squeezed by 2


def together(left: Picture, right: Picture, layout: str) -> Picture:
    """Combine the pictures of both eyes."""
    first, second = _with_alpha_of_either(left, right)
    if layout == "anaglyph":
        return _anaglyph(first, second)
    axis = 1 if layout.endswith(("side-by-side", "vr180")) else 0
    both = [picture.data for picture in (first, second)]
    if layout.startswith(HALF):
        both = [_squeezed(each, axis) for each in both]
    return first._replace(data=np.concatenate(both, axis=axis))


def _squeezed(data: Floats, axis: int) -> Floats:
    """Return a picture (H, W, C) squeezed by 2 along an axis: each pixel is the mean of its square.

    An odd side is squeezed to the next larger half.
    """
    import cv2

    height, width, channels = data.shape
    size = (width, (height + 1) // 2) if axis == 0 else ((width + 1) // 2, height)
    made = cv2.resize(np.ascontiguousarray(data), size, interpolation=cv2.INTER_AREA)
    return np.asarray(made, np.float32).reshape(size[1], size[0], channels)


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
