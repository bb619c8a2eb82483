"""`resample-warp3d compare`."""

import sys
from typing import Annotated, Literal

from resample.command import flags
from resample.command.settings import height_and_width
from resample_comparisons.options import Json, method_names, rows_as_json
from resample_warp3d.command.choices import Depth, Refine
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.command.target import Aim

EYE, DEPTH, AIM = SourceCamera.usual(), Depth.usual(), Aim.usual()
VIEWS = "side,back4,in3,oblique"  # of the generated scene
SIDE = 512  # px per side of the generated scene's views
COMPARED = "mcmillan,mesh,paper,hybrid"


def compare(
    color: str | None = None,
    depth: str | None = None,
    /,
    *,
    scene: flags.AppearanceFlag[Literal["generated"] | None] = None,
    truth: flags.Source = None,
    mask: flags.Source = None,
    eye: Annotated[SourceCamera, flags.Flat] = EYE,
    meaning: Annotated[Depth, flags.Flat] = DEPTH,
    aim: Annotated[Aim, flags.Flat] = AIM,
    views: flags.AppearanceFlag[str] = VIEWS,
    methods: flags.AppearanceFlag[str] = COMPARED,
    refine: flags.AppearanceFlag[Refine] = "auto",
    output: flags.OptionalOutput = None,
    as_json: Json = False,
) -> None:
    """Compare methods with a true view, in the generated scene or in your own pictures.

    Only pixels that the source also shows are measured; holes are black.

    For example:

        resample-warp3d compare sample:room
        resample-warp3d compare sample:room --methods mcmillan,hybrid -o compare.png
        resample-warp3d compare --scene generated --views oblique --size 256

    Parameters
    ----------
    color
        Any picture, with a true picture of the new view. [default: the generated scene]
    depth
        .png, .tif, .exr, .pfm, .npy or .npz of the same size; file:name selects a channel or
        array.
    scene
        Scene: generated, a ray-traced room of known depth.
    truth
        True picture of the camera at --pose.
    mask
        Pixels to measure, white in a picture. [default: those that the source's depth reaches]
    views
        Views of the generated scene: side, back4, in3, oblique, roll, separated by commas.
    methods
        Methods separated by commas; with parameters as in hybrid:quality=2.
    refine
        Repair of depth that does not fit the picture: none, or snap, sharpen, shift, complete or
        densify; auto chooses. All methods get the repaired depth.
    output
        Written to: all pictures side by side with enlarged details (.png).
    """
    from resample import registry
    from resample.files.writing import check_targets
    from resample.measuring.compare import check_sheet, plain
    from resample_comparisons.warp3d.compare import check_views, compare_scene, sheet
    from resample_comparisons.warp3d.files import TrueView, compare_files
    from resample_warp3d.command.inputs import DepthReader

    names = method_names(methods)
    registry.check("warps", names)
    given = TrueView(color, depth, truth, mask)
    is_generated = color is None or scene is not None
    given.check(is_generated=is_generated)
    if output is not None:
        check_sheet(output)
    check_targets(output)
    if is_generated:
        chosen = [view.strip() for view in views.split(",") if view.strip()]
        check_views(chosen)
        side = SIDE if aim.size is None else height_and_width(aim.size)[0]
        comparison = compare_scene(names, side, chosen)
    else:
        aim.check()
        comparison = compare_files(given, DepthReader.checked(eye, meaning), aim, names, refine)
    if output is not None:
        sheet(comparison, output)
    sys.stdout.write(rows_as_json(comparison.rows) if as_json else plain(comparison.rows))
