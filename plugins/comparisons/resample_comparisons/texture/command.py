"""`resample-texture compare`."""

import sys
from typing import Annotated, Literal

from resample.command import flags
from resample.command.settings import height_and_width
from resample_comparisons.options import Json, method_names, rows_as_json
from resample_texture.command.choices import MATRIX, Edges, Picture

COMPARED = "bilinear,opencv-supersample:n=4,paper,hybrid"
SHEETS = (".png", ".html")
SCENES = ("floor", "floor-yaw", "floor-close", "zoom", "shrink")


def compare(
    image: Picture,
    /,
    *,
    scene: Annotated[str, MATRIX._replace(known=SCENES), flags.Hyphen] = "floor",
    methods: flags.AppearanceFlag[str] = COMPARED,
    output: flags.OptionalOutput = None,
    as_json: Json = False,
    truth_filter: flags.AppearanceFlag[Literal["box", "gaussian"]] = "box",
    linear: flags.AppearanceFlag[bool] = True,
    edge: flags.AppearanceFlag[Edges] = "transparent",
    size: flags.AppearanceFlag[str | None] = None,
) -> None:
    """Compare methods on a picture, separately where texels shrink and where they grow.

    The truth uses 16 x 16 rays per pixel and Catmull-Rom interpolation of the picture.

    For example:

        resample-texture compare sample:bricks
        resample-texture compare sample:bricks --methods bilinear,hybrid -o a.html
        resample-texture compare sample:zone-plate --scene shrink -o shrink.png

    Parameters
    ----------
    image
        A picture; a small one is tiled with its mirror images.
    scene
        Scene: floor, floor-yaw, floor-close, zoom, shrink, or a matrix as warp takes
        it.
    methods
        Methods separated by commas; with parameters as in opencv-supersample:n=8,kernel=linear.
    output
        Written to: a page with sliders (.html), or all pictures side by side with enlarged
        details (.png).
    truth_filter
        Pixel filter of the truth: the pixel's area, or a Gaussian of 0.5 px.
    linear
        Average linear light, or encoded values.
    edge
        What lies beyond the picture's edges. Not measured.
    size
        Size in px: 400 for a square, 640x480 for width and height. [default: half the (tiled)
        picture's; for a matrix the picture's]
    """
    from resample import registry
    from resample.files.formats import flattened
    from resample.files.pictures import read_picture
    from resample.files.writing import check_targets
    from resample.measuring.compare import plain
    from resample_comparisons.texture.compare import Judge, sheet, source_values
    from resample_comparisons.texture.scenes import check_scene, scene_of
    from resample_texture.types import Edge

    names = method_names(methods)
    registry.check("methods", names)
    check_scene(scene)
    shape = None if size is None else height_and_width(size)
    if output is not None and output.suffix.lower() not in SHEETS:
        raise ValueError(f"{output}: comparisons are written as {' or '.join(SHEETS)}")
    check_targets(output)
    picture = flattened(read_picture(image), (0.0, 0.0, 0.0))
    if len(picture.kind.channels) not in (1, 3):
        raise ValueError(f"{image} is neither gray nor RGB: {', '.join(picture.kind.channels)}")
    values = source_values(picture.data, linear=linear)
    judge = Judge(truth_filter, Edge(edge), linear)
    seen = scene_of(values, scene, shape)
    comparison = judge.compare(f"{image.name}, {scene}", seen, names)
    if output is not None and output.suffix.lower() == ".html":
        from resample_comparisons.texture.compare import write_report

        write_report(comparison, output, about=judge.about(seen))
    elif output is not None:
        sheet(comparison, output)
    sys.stdout.write(rows_as_json(comparison.rows) if as_json else plain(comparison.rows))
