"""Stacks of pictures: which arrays are frames, and which are pictures of many channels."""

from os import PathLike
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.exchange import picture_and_encoding
from resample.files.stores.opening import Address
from resample.words import shortly
from resample_texture.texels.gaps import masked
from resample_texture.types import FRAMES, AnyAxis, Warped

MOST_CHANNELS = 15  # of an array of which nothing says what its last axis is
MOST_COLORS = 4  # channels of which a picture is likelier than a stack of frames so narrow
CHANNELS: Literal[-1] = -1


class GivenPictures(NamedTuple):
    """A picture, or a stack of them, and what is known of it."""

    values: NDArray[Any]  # (H, W) or (H, W, C), or (N, ...) of them
    is_encoded: bool | None  # whether its file says that levels are sRGB-encoded
    axis: AnyAxis | None  # 0: a stack; -1: a picture with channels; None: without

    @property
    def is_stack(self) -> bool:
        """Whether the first axis counts frames."""
        return self.axis == FRAMES

    def check_alone(self, name: str) -> None:
        """Refuse a stack where one picture is taken."""
        if self.is_stack:
            raise ValueError(f"{name} is of one picture, not of a stack {self.values.shape}")

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of each picture."""
        height, width = self.values.shape[self.is_stack :][:2]
        return height, width


def given_pictures(
    given: Any, axis: AnyAxis | None = None, matrices: int | None = None, kinds: str = "biufc"
) -> GivenPictures:
    """Read what `warp` takes as a picture or a stack; see `axis_of`."""
    values, is_encoded = picture_and_encoding(given, kinds=kinds)
    is_named = isinstance(given, str | PathLike | Address) or hasattr(given, "dims")
    if is_named and axis is None and values.ndim == 3:
        axis = CHANNELS  # files and names of dimensions say so
    return GivenPictures(values, is_encoded, axis_of(values, axis, matrices))


def axis_of(image: Any, axis: AnyAxis | None = None, matrices: int | None = None) -> AnyAxis | None:
    """Return which axis of an array does not belong to a picture: 0, -1, or None.

    `axis`: as `warp` takes it; by default three dimensions are a picture of up to 15 channels,
    unless there is a matrix for each frame. `matrices`: number of matrices, if they are a stack.
    """
    shape = image.shape
    if image.ndim not in (2, 3, 4) or 0 in shape:
        raise ValueError(
            f"a picture is (H, W) or (H, W, C), a stack of them (N, H, W) with axis=0, or"
            f" (N, H, W, C), and none is empty; not {shape}"
        )
    if axis not in (None, FRAMES, CHANNELS, 2) or isinstance(axis, bool):
        raise ValueError(f"axis {shortly(axis)}; give 0 for frames, or -1 for channels")
    if axis is not None and (image.ndim, axis == FRAMES) in ((2, True), (2, False), (4, False)):
        raise ValueError(f"axis {axis} of {shape}; leave that out, its dimensions say enough")
    if image.ndim == 2:
        return None
    found = _guessed(shape, matrices) if axis is None else axis
    if found == FRAMES and matrices not in (None, shape[0]):
        raise ValueError(f"{matrices} matrices for {shape[0]} frames; give one, or one for each")
    return FRAMES if found == FRAMES else CHANNELS


def _guessed(shape: tuple[int, ...], matrices: int | None) -> AnyAxis:
    """Return the axis of an array of which nothing is said, or refuse it."""
    rows, columns, channels = shape[-3:]
    is_narrow, is_one, has_each = channels <= MOST_CHANNELS, len(shape) == 3, matrices == shape[0]
    if is_one and has_each and not is_narrow:
        return FRAMES
    if is_narrow and (not is_one or not has_each or channels <= MOST_COLORS):
        return CHANNELS if is_one else FRAMES
    told = "" if matrices is None else f", with {matrices} matrices,"
    kinds = "axis=-1 if so, axis=0 if it is a stack (N, H, W)" if is_one else "axis=0 if so"
    raise ValueError(
        f"{shape}{told} would be {rows} rows of {columns} pixels with {channels} channels each;"
        f" give {kinds}, or, of channels first, numpy.moveaxis(image, {len(shape) - 3}, -1)"
    )


def matrices_in(given: Any, shape: tuple[int, int]) -> NDArray[Any] | None:
    """Return matrices (N, 3, 3) or (N, 2, 3), if that is given; `shape`: of the target."""
    if callable(given) or not isinstance(given, list | tuple | np.ndarray):
        return None
    try:
        form = np.shape(given)
    except ValueError:  # of lists of different lengths
        return None
    is_maps = isinstance(given, tuple) and form == (2, *shape)
    is_stack = form[1:] in ((2, 3), (3, 3)) and form[0] > 0 and not is_maps
    return np.asarray(given) if is_stack else None


def stacked(each: list[Warped], image: NDArray[Any]) -> Warped:
    """Stack warped pictures; `image`: that they were."""
    images = [warped.image for warped in each]
    stack: NDArray[Any] = np.stack([np.ma.getdata(one) for one in images])
    if isinstance(image, np.ma.MaskedArray):
        mask = np.stack([np.ma.getmaskarray(one) for one in images])
        stack = masked(stack, mask, image.fill_value)
    return type(each[0])(stack, np.stack([warped.coverage for warped in each]))
