"""Layouts of pictures for two eyes: beside each other, in rows, and in colors for glasses.

Colors are mixed as light. The matrices of Dubois ("A projection method to generate anaglyph stereo
images", ICASSP 2001) make what each eye sees through red and cyan glasses as close to its picture
as the glasses allow; those for LCD screens by Eric Dubois.
"""

from collections.abc import Sequence

import numpy as np

from resample.colors import from_srgb
from resample.files.films import UNMARKED, StereoMarks
from resample.files.pictures import Picture
from resample.types import Floats
from resample_warp3d.command.parallax import HALF

LUMA = (0.2126, 0.7152, 0.0722)  # of sRGB's primaries
NONE = (0.0, 0.0, 0.0)
RED, GREEN, BLUE = np.eye(3)
# Light (3, 3) that red, green and blue have of the left and of the right picture.
ANAGLYPHS = {
    "anaglyph": ([RED, NONE, NONE], [NONE, GREEN, BLUE]),
    "anaglyph-half-color": ([LUMA, NONE, NONE], [NONE, GREEN, BLUE]),
    "anaglyph-gray": ([LUMA, NONE, NONE], [NONE, LUMA, LUMA]),
    "anaglyph-dubois": (
        [(0.437, 0.449, 0.164), (-0.062, -0.062, -0.024), (-0.048, -0.050, -0.017)],
        [(-0.011, -0.032, -0.007), (0.377, 0.761, 0.009), (-0.026, -0.093, 1.234)],
    ),
}

# What players have to know; names of files are those that iw3, Pigasus, SKYBOX and DeoVR know.
MARKS = {
    "side-by-side": StereoMarks("left-right", None, "_LRF_Full_SBS", "left_right"),
    "half-side-by-side": StereoMarks("left-right", None, "_LR", "left_right", 3),
    "top-bottom": StereoMarks("top-bottom", None, "_TBF_fulltb", "top_bottom"),
    "half-top-bottom": StereoMarks("top-bottom", None, "_TB", "top_bottom", 4),
    "cross-eyed": StereoMarks(None, None, "_RLF_cross", "right_left"),
    "half-cross-eyed": StereoMarks(None, None, "_RL", "right_left"),
    "rows": StereoMarks(None, None, "_rows", "row_interleaved_lr"),
    "rgbd": StereoMarks(name="_RGBD"),
    "half-rgbd": StereoMarks(name="_HRGBD"),
    "vr180": StereoMarks("left-right", "180", "_180x180_LR", "left_right"),
    "vr180-fisheye": StereoMarks("left-right", None, "_FISHEYE180_LR", "left_right"),
    **{layout: StereoMarks(None, None, "_redcyan", "anaglyph_cyan_red") for layout in ANAGLYPHS},
}


def marks_of(layout: str | None, *, is_panorama: bool) -> StereoMarks:
    """Return what a player has to know of pictures in a layout."""
    marks = MARKS.get(layout or "one", UNMARKED)
    if not is_panorama or layout in HALF:
        return marks
    short = {"left-right": "_LR", "top-bottom": "_TB"}.get(marks.mode or "", "")
    return marks._replace(around="360", name=f"_360{short}")


def tiled(views: Sequence[Picture], columns: int) -> Picture:
    """Combine views of a quilt, from the lower left one to the upper right one."""
    rows = [
        np.concatenate([each.data for each in views[start : start + columns]], axis=1)
        for start in range(0, len(views), columns)
    ]
    return views[0]._replace(data=np.concatenate(rows[::-1], axis=0))


def shade(share: Floats, like: Picture) -> Picture:
    """Return shares (H, W) of 0..1 as an opaque gray picture with the channels of another one."""
    light = from_srgb(np.clip(share, 0.0, 1.0).astype(np.float32))[..., None]
    data = np.repeat(light, len(like.kind.channels), axis=2)
    if like.kind.has_alpha:
        data[..., -1] = 1.0
    return like._replace(data=np.ascontiguousarray(data, np.float32))


def together(left: Picture, right: Picture, layout: str) -> Picture:
    """Combine the pictures of both eyes; both have alpha if one has."""
    if left.kind.has_alpha != right.kind.has_alpha:
        both = [left, right]
        for n, (data, kind, about) in enumerate(both):
            if not kind.has_alpha:  # opaque
                whole = np.concatenate([data, np.ones_like(data[..., :1])], axis=2)
                both[n] = Picture(whole, kind._replace(channels=(*kind.channels, "A")), about)
        left, right = both
    if layout in ANAGLYPHS:
        return _anaglyph(left, right, layout)
    if layout == "rows":
        whole = np.empty_like(left.data)
        upper, lower = (_squeezed(p.data, 0) for p in (left, right))
        whole[::2], whole[1::2] = upper, lower[: len(whole) // 2]
        return left._replace(data=whole)
    if layout.endswith("cross-eyed"):
        left, right = right, left
    axis = 1 if layout in HALF or layout.endswith(("side-by-side", "cross-eyed", "rgbd")) else 0
    halves = [p.data for p in (left, right)]
    if layout.startswith("half-"):
        halves = [_squeezed(data, axis) for data in halves]
    return left._replace(data=np.concatenate(halves, axis=axis))


def _squeezed(data: Floats, axis: int) -> Floats:
    """Halve a picture (H, W, C) along an axis by means; odd sides to the next larger half."""
    import cv2

    height, width, channels = data.shape
    size = (width, (height + 1) // 2) if axis == 0 else ((width + 1) // 2, height)
    made = cv2.resize(np.ascontiguousarray(data), size, interpolation=cv2.INTER_AREA)
    return np.asarray(made, np.float32).reshape(size[1], size[0], channels)


def _anaglyph(left: Picture, right: Picture, layout: str) -> Picture:
    """Mix the light of both pictures in red and cyan."""
    names, has_alpha = left.kind.channels, left.kind.has_alpha
    colors = names[:-1] if has_alpha else names
    if colors not in (("R", "G", "B"), ("Y",)):
        raise ValueError(f"an anaglyph is made of gray or RGB pictures, not of {', '.join(colors)}")
    data = np.zeros((*left.data.shape[:2], 3), np.float32)
    for picture, shares in zip((left, right), ANAGLYPHS[layout], strict=True):
        matrix = np.asarray(shares, np.float32)
        if len(colors) == 1:
            matrix = matrix.sum(axis=1, keepdims=True)
        color = picture.data
        if has_alpha:
            color, alpha = color[..., :-1], color[..., -1:]
            color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
        data += color @ matrix.T
    np.clip(data, 0, None, out=data)
    channels: tuple[str, ...] = ("R", "G", "B")
    if has_alpha:
        alpha = np.minimum(left.data[..., -1:], right.data[..., -1:])
        data = np.concatenate([data * alpha, alpha], axis=2)
        channels = (*channels, "A")
    return Picture(data, left.kind._replace(channels=channels), left.about)
