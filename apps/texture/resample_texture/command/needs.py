"""Estimate of a warp's peak memory, made before any work.

Constants were measured as the peak of fresh processes (`python -m benchmarks.memory`).
"""

from math import prod
from pathlib import Path
from typing import NamedTuple

from resample.command.session import OTHERS, bytes_written, libraries, require_picture
from resample.files.pictures import form_of
from resample.files.stores.opening import Place
from resample.memory import require
from resample.memory.mapped import pages_of
from resample_texture.arguments import method_named
from resample_texture.command.choices import PictureWarping

BYTES_PER_TEXEL = 6  # per texel and channel: the source and its decoding buffers
BYTES_IN_STRIP = 28  # per value of the strip of a large picture that is being drawn
BYTES_PER_MESH_PIXEL = 100  # of a mesh's picture
BYTES_OF_FILM = 16, 60  # per texel of the picture, per pixel of a frame
REMEDY = "take a smaller size, or a part of it by --roi"


class InStrips(NamedTuple):
    """Memory of a picture that is drawn strip by strip."""

    source: int  # bytes of the picture as stored
    strip: int  # values drawn at a time


def check_memory(
    form: tuple[int, int, int],
    shape: tuple[int, int],
    choice: PictureWarping,
    output: Path,
    *,
    has_alpha: bool = False,
    in_strips: InStrips | None = None,
) -> None:
    """Refuse a warp that does not fit into memory; log what it needs (DEBUG).

    Parameters
    ----------
    shape
        Height and width of the result, px.
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
    is_ours = ".baselines." not in type(method_named(choice.method)).__module__
    require(what, {"libraries": libraries() if is_ours else OTHERS, **parts}, REMEDY)


def require_film(source: Place, size: tuple[int, int]) -> None:
    """Refuse a flight over a picture that does not fit into memory, as `check_memory` does."""
    (height, width, _), _ = form_of(source)
    texel, pixel = BYTES_OF_FILM
    require_picture(size, pixel, {"the source": texel * height * width})
