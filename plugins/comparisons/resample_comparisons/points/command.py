"""`resample-points compare`."""

import sys
from pathlib import Path
from typing import Annotated

from resample.command import flags
from resample.command.settings import height_and_width
from resample_comparisons.options import Json, rows_as_json
from resample_points.command.choices import CloudAim, CloudOptions
from resample_points.command.gaussians import GaussianOptions

AIM, CLOUD, GAUSSIANS = CloudAim.usual(), CloudOptions.usual(), GaussianOptions.usual()


def compare(
    file: Path,
    /,
    *,
    methods: flags.AppearanceFlag[str] = "affine,trained,rays",
    aim: Annotated[CloudAim, flags.Flat] = AIM,
    look: Annotated[CloudOptions, flags.Flat] = CLOUD,
    gaussians: Annotated[GaussianOptions, flags.Flat] = GAUSSIANS,
    size: flags.Size = flags.USUAL_SIZE,
    output: flags.OptionalOutput = None,
    as_json: Json = False,
) -> None:
    """Compare ways to render 3D Gaussians with 16 x 16 rays per pixel, each in its own order.

    For example:

        resample-points compare sample:knot-gaussians --size 160x120
        resample-points compare sample:knot-gaussians --size 160x120 -o a.png
        resample-points compare sample:knot-gaussians --methods rays --size 99

    Parameters
    ----------
    file
        3D Gaussians: .ply of a trainer or compressed, .splat, .spz, .sog, or a folder of SOG.
    methods
        Methods separated by commas: trained, distance, rays, bare, affine (the usual projection),
        or mitsuba, where it is installed (its time without starting it).
    output
        Written to: all pictures side by side with enlarged details (.png).
    """
    from resample.command.session import Session
    from resample.files.writing import check_targets
    from resample.measuring.compare import check_sheet, contact_sheet, plain
    from resample_comparisons.points.compare import compare_methods, methods_named
    from resample_points.command.gaussians import gaussians_of
    from resample_points.command.rendering import holds_gaussians

    names, shape = methods_named(methods), height_and_width(size)
    if output is not None:
        check_sheet(output)
        check_targets(output)
    aim.check()
    gaussians.check()
    if not holds_gaussians(file, look, gaussians):
        raise ValueError(f"{file.name} holds no 3D Gaussians, which this command compares")
    session = Session()
    scene = gaussians_of(session, file, look, gaussians)
    camera = scene.upright(aim).camera_for(scene.framing, shape)
    rows, pictures = compare_methods(scene, camera, shape, names)
    if output is not None:
        contact_sheet(pictures, output)
    sys.stdout.write(rows_as_json(rows) if as_json else plain(rows))
