"""Compare methods on the command line's files."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from resample.command.intrinsics import Shape
from resample_warp3d.command.inputs import (
    DepthInput,
    DepthReader,
    TrueView,
    read_truth,
    read_view,
)
from resample_warp3d.command.target import Aim
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import sourced
from resample_warp3d.types import Equation, Source

if TYPE_CHECKING:
    from resample_warp3d.figures.compare import DepthComparison


def compare_files(
    given: TrueView, reader: DepthReader, aim: Aim, names: Sequence[str], refine: str = "auto"
) -> "DepthComparison":
    """Compare methods with a true picture."""
    from resample_warp3d.figures.compare import compare_view

    truth, mask = read_truth(Path(str(given.truth)), given.mask)
    size = f"{truth.shape[1]}x{truth.shape[0]}"
    if aim.size not in (None, size):
        raise ValueError(f"{given.truth} has {size} pixels; leave out the size")
    seen = read_view(reader, str(given.color), str(given.depth))
    source, equation, _ = placed(seen, reader, aim.model_copy(update={"size": size}), refine)
    return compare_view(source, equation, truth, mask, names)


def placed(
    seen: DepthInput, reader: DepthReader, aim: Aim, refine: str = "auto"
) -> tuple[Source, Equation, Shape]:
    """Return the prepared source, the equation of its new view, and the frame's shape."""
    full = seen.image.nearness.shape[0], seen.image.nearness.shape[1]
    target = aim.camera(seen.pinhole, full, reader.eye.convention)
    source = sourced(seen.refined(refine), noise=None)
    return source, between(seen.pinhole, target), aim.shape(full)
