"""What a warp will hold in memory at its height, from what is known before any work.

Measured as the highest mark of fresh processes (`python -m benchmarks.memory`).
"""

from math import prod
from pathlib import Path
from typing import NamedTuple

from resample.command.session import OTHERS, bytes_written, libraries, require_picture
from resample.files.pictures import form_of
from resample.files.stores.addresses import Place
from resample.memory import require
from resample.memory.mapped import pages_of
from resample_texture.asking import method_named
from resample_texture.command.choices import Warping

BYTES_PER_TEXEL = 6  # and channel, of a source and what is held while it is decoded
BYTES_IN_STRIP = 28  # and value, of what is drawn of a large picture at a time
BYTES_PER_MESH_PIXEL = 100  # of a mesh's picture
BYTES_OF_FILM = 16, 60  # of a texel of what a camera flies over, and of a pixel of a frame
REMEDY = "take a smaller size, or a part of it by --roi"


class InStrips(NamedTuple):
    """What is held of a picture that is drawn strip by strip."""

    source: int  # bytes of it as it is kept
    strip: int  # values that are drawn at a time


def require_room(
    form: tuple[int, int, int],
    shape: tuple[int, int],
    choice: Warping,
    output: Path,
    *,
    has_alpha: bool = False,
    in_strips: InStrips | None = None,
) -> None:
    """Refuse a warp that memory does not hold, and say (DEBUG) what it needs.

    Parameters
    ----------
    form
        Height, width and channels of the source, opacity included.
    shape
        Height and width of what is written, px.
    choice
        How it is warped.
    output
        What it is written to: integers are encoded by way of floats.
    has_alpha
        Whether one of the channels is opacity.
    in_strips
        What is held of a large picture, which is drawn strip by strip.

    Raises
    ------
    ValueError
        It needs more than is allowed, or free.
    """
    height, width = shape
    what = f"a picture of {width} x {height} pixels"
    if in_strips is not None:
        source = pages_of(in_strips.source) or in_strips.source
        parts = {"the source": source, "a strip": BYTES_IN_STRIP * in_strips.strip}
    else:
        opens = choice.edge == "transparent" and not (has_alpha or choice.total)
        values = form[2] + opens
        parts = {
            "the source": BYTES_PER_TEXEL * prod(form),
            "the result": values * bytes_written(shape, output),
        }
    is_ours = ".rivals." not in type(method_named(choice.method)).__module__
    require(what, {"libraries": libraries() if is_ours else OTHERS, **parts}, REMEDY)


def require_film(source: Place, size: tuple[int, int]) -> None:
    """Refuse a flight over a picture, in frames (height, width), as `require_room` does.

    Raises
    ------
    ValueError, OSError
        It needs more than is allowed, or free; or the file is no picture.
    """
    (height, width, _), _ = form_of(source)
    texel, pixel = BYTES_OF_FILM
    require_picture(size, pixel, {"the source": texel * height * width})
