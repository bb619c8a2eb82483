"""`resample-warp3d figures`."""

import sys
from pathlib import Path
from typing import Annotated

from resample.command import flags
from resample.command.settings import height_and_width
from resample_comparisons.options import method_names
from resample_warp3d.command.choices import Depth, Refine
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.command.target import Aim

EYE, DEPTH, AIM = SourceCamera.usual(), Depth.usual(), Aim.usual()
FIGURES = Path("figures")
SIDE = 512  # px per side of the generated scene's views


def figures(
    color: str | None = None,
    depth: str | None = None,
    /,
    *,
    output: flags.Output = FIGURES,
    eye: Annotated[SourceCamera, flags.Flat] = EYE,
    meaning: Annotated[Depth, flags.Flat] = DEPTH,
    aim: Annotated[Aim, flags.Flat] = AIM,
    views: flags.AppearanceFlag[str] = "oblique",
    methods: flags.AppearanceFlag[str] = "hybrid,mcmillan",
    refine: flags.AppearanceFlag[Refine] = "auto",
) -> None:
    """Reproduce the paper's Figure 6: a picture, and a view by the hybrid and by McMillan.

    For example:

        resample-warp3d figures
        resample-warp3d figures --views side -o figure-6
        resample-warp3d figures sample:room --move 0.3,0,0

    Parameters
    ----------
    color
        Any picture. [default: the generated scene]
    depth
        .png, .tif, .exr, .pfm, .npy or .npz of the same size; file:name selects a channel or
        array.
    output
        Written to: folder for figure-6.png, the single pictures and figure-6.json; created if
        missing.
    views
        Views of the generated scene: one of side, back4, in3, oblique or roll.
    methods
        Methods separated by commas.
    refine
        Repair of depth that does not fit the picture: none, or snap, sharpen, shift, complete or
        densify; auto chooses. Needs COLOR and DEPTH.
    """
    from resample import registry
    from resample.measuring.compare import plain
    from resample_comparisons.warp3d.compare import check_views
    from resample_comparisons.warp3d.files import placed
    from resample_figures.figure_6 import figure_of, generated_figure, write_figures
    from resample_warp3d.command.inputs import DepthReader, read_view

    names = method_names(methods)
    registry.check("warps", names)
    check_views([views])
    if (color is None) != (depth is None):
        raise ValueError("give COLOR and DEPTH, or neither for the generated scene")
    if color is None or depth is None:
        side = SIDE if aim.size is None else height_and_width(aim.size)[0]
        output.mkdir(parents=True, exist_ok=True)
        figure = generated_figure(side, views, names)
    else:
        aim.check()
        reader = DepthReader.checked(eye, meaning)
        output.mkdir(parents=True, exist_ok=True)
        seen = read_view(reader, color, depth)
        figure = figure_of(*placed(seen, reader, aim, refine), names)
    write_figures(output, figure)
    sys.stdout.write(plain(figure.rows))
