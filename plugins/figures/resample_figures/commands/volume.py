"""`resample-volume figures`."""

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from resample.command import flags
from resample.command.flags import OptionTopic

FIGURES = Path("figures")


def figures(
    *,
    output: flags.Output = FIGURES,
    figure: Annotated[
        tuple[str, ...], OptionTopic.APPEARANCE, Parameter(negative="", show_default=False)
    ] = (),
    data: flags.Source = None,
) -> None:
    """Reproduce the paper's Figures 1 to 4 and 7 to 9, as pictures and tables.

    For example:

        resample-volume figures
        resample-volume figures --figure 7 --figure 8
        resample-volume figures --figure 1-2 -o figure-1

    Parameters
    ----------
    output
        Written to: folder for .png, .csv and .json files; created if missing.
    figure
        Figures of the paper: 1-2, 3-4, 7, 8 or 9. [default: all]
    data
        Folder of the paper's volumes (engine.nhdr, ...). [default: where fetch stores them]
    """
    from resample_figures.volumes import make

    sys.stdout.write(make(output, figure or None, data))
