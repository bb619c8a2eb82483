"""Compare methods on the command line's files."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.command.flags import Shape
from resample.files.formats import flattened
from resample.files.pictures import read_picture
from resample.types import Floats
from resample_comparisons.warp3d.compare import DepthComparison, compare_view
from resample_warp3d.command.inputs import DepthInput, DepthReader, read_view
from resample_warp3d.command.target import Aim
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import sourced
from resample_warp3d.types import Equation, Source


class TrueView(NamedTuple):
    """Files of a depth image and of a true picture of another view."""

    color: str | None
    depth: str | None
    truth: Path | None
    mask: Path | None

    def check(self, *, is_generated: bool) -> None:
        """Reject incomplete files, or files together with a generated scene."""
        if is_generated:
            if any(name is not None for name in self):
                raise ValueError("the generated scene takes no files; leave out --scene or them")
        elif self.depth is None or self.truth is None:
            raise ValueError("give COLOR, DEPTH and --truth, or --scene generated")


def read_truth(truth: Path, mask: Path | None) -> tuple[Floats, NDArray[np.bool_] | None]:
    """Read the true picture of a view (H, W, C), over black, and its mask (H, W); None: unknown."""
    picture = flattened(read_picture(truth), (0.0, 0.0, 0.0))
    if len(picture.kind.channels) not in (1, 3):
        raise ValueError(f"{truth} is neither gray nor RGB: {', '.join(picture.kind.channels)}")
    chosen = None if mask is None else read_picture(mask).data[..., 0] > 0.5
    return picture.data, chosen


def compare_files(
    given: TrueView, reader: DepthReader, aim: Aim, names: Sequence[str], refine: str = "auto"
) -> DepthComparison:
    """Compare methods with a true picture."""
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
