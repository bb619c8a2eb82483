"""A picture warped for the command line: in light or as encoded."""

from collections.abc import Callable
from typing import Any

import numpy as np

from resample.colors import from_srgb, to_srgb
from resample.command.session import Session, announce_compilation, require_picture
from resample.files.pictures import Picture
from resample.types import Floats
from resample_texture.command.choices import Target, Warping
from resample_texture.warping import warp

BYTES_PER_VALUE = 16  # of a target and the copies that are made when it is warped and written


def warped(
    session: Session,
    picture: Picture,
    target: Target,
    choice: Warping,
    roi: tuple[int, int, int, int] | None = None,
) -> tuple[Picture, Floats]:
    """Picture at its target, and the coverage of its pixels.

    What is not covered is transparent if that is what lies beyond the edge, and black if not.
    """
    from resample_texture.texels.kernels.painting import paint_blocks

    height, width = target.shape if roi is None else (roi[3], roi[2])
    check_memory((height, width), picture.data.shape[2])
    as_encoded = picture.kind.is_encoded and (choice.total or not choice.linear)
    source = _curved(picture, to_srgb) if as_encoded else picture.data
    announce_compilation(paint_blocks)
    with session.stage("warp", bar="warping"):
        image, coverage = warp(
            source,
            target.geometry,
            target.shape,
            choice.method,
            filter=choice.filter,
            interpolation=choice.interpolation,
            quality=choice.quality,
            total=choice.total or None,
            edge=choice.edge,
            roi=roi,
            threads=choice.threads,
        )
    kind = picture.kind
    if choice.edge == "transparent" and not choice.total and not kind.has_alpha:
        kind = kind._replace(channels=(*kind.channels, "A"))
        image = np.concatenate([image, coverage[..., None]], axis=2, dtype=np.float32)
    result = Picture(image, kind)
    return Picture(_curved(result, from_srgb), kind) if as_encoded else result, coverage


def report(session: Session, picture: Picture, result: Picture, choice: Warping) -> dict[str, Any]:
    """Sizes and times, for `--stats`."""
    return {
        "source": [picture.data.shape[1], picture.data.shape[0]],
        "size": [result.data.shape[1], result.data.shape[0]],
        "channels": list(result.kind.channels),
        "method": choice.method,
        "seconds": session.times(),
    }


def check_memory(shape: tuple[int, int], channels: int) -> None:
    """Refuse a target that this machine cannot hold, before any work is done."""
    require_picture(shape, BYTES_PER_VALUE * (channels + 1))


def _curved(picture: Picture, curve: Callable[[Floats], Floats]) -> Floats:
    """Premultiplied values whose straight color went through a curve."""
    data = picture.data
    if not picture.kind.has_alpha:
        return np.ascontiguousarray(curve(data))
    alpha = data[..., -1:]
    color = np.divide(data[..., :-1], alpha, out=np.zeros_like(data[..., :-1]), where=alpha > 0.0)
    return np.concatenate([curve(color) * alpha, alpha], axis=2, dtype=np.float32)
