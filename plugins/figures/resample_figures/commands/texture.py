"""`resample-texture figures`."""

import sys
from pathlib import Path
from typing import Annotated

from resample.command import flags
from resample.command.flags import OptionTopic
from resample_texture.command.choices import Picture

FIGURES = Path("figures")


def figures(
    *, output: flags.Output = FIGURES, image: Annotated[Picture | None, OptionTopic.SOURCE] = None
) -> None:
    """Reproduce the paper's Figure 5: a floor by points, by the hybrid, and backward.

    For example:

        resample-texture figures
        resample-texture figures -o figure-5
        resample-texture figures --image sample:test-card

    Parameters
    ----------
    output
        Written to: folder for figure5.png, the single pictures and table.txt; created if missing.
    image
        Picture to show beside the checkerboard. [default: a generated brick wall]
    """
    from resample.files.formats import flattened
    from resample.files.pictures import read_picture
    from resample_figures.figure_5 import (
        FIGURE,
        SHEET,
        FloorPicture,
        compare_floors,
        generated,
        write_figures,
    )

    subjects = {"checker": generated("checker")}
    if image is None:
        subjects["bricks"] = generated("bricks")
    else:
        subjects["picture"] = FloorPicture(flattened(read_picture(image), (0.0, 0.0, 0.0)).data)
    output.mkdir(parents=True, exist_ok=True)
    comparisons = compare_floors(subjects, list(FIGURE))
    sys.stdout.write(write_figures(output, comparisons, FIGURE, SHEET))
