"""The `resample-texture` command."""

import sys
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

from cyclopts import Parameter

from resample.command import flags
from resample.command.applications import demonstrator, fetcher
from resample.command.flags import OptionTopic
from resample.command.help_formatter import CommandLine, add_command
from resample.command.session import run
from resample.command.settings import Serving, Written, height_and_width, with_settings
from resample.lazy import installed_version
from resample_texture.command.choices import (
    BetweenProjections,
    Edges,
    Factor,
    Filling,
    NewSize,
    Outputs,
    Picture,
    PictureFiltering,
    PictureTarget,
    PictureWarping,
    Reports,
    Rotation,
    Undistortion,
    WarpGeometry,
)

app = CommandLine(
    name="resample-texture",
    help=(
        "Texture mapping and image warping: texels are projected as points where they shrink and "
        "split into parts where they grow.\n\n"
        "For example:\n\n"
        "    resample-texture resize sample:bricks small.png --size 100\n"
        '    resample-texture warp sample:bricks --corners "9,0 90,9 80,70 0,60" -o a.png\n'
        "    resample-texture mesh sample:knot -o knot.png\n"
    ),
    version=installed_version,
)
app.first = (
    "matrix corners size factor degrees expand lens from to turn camera methods "
    "scene path frames fit width height edge method filter background"
)
app.register_install_completion_command()

Files = Annotated[
    list[Picture],
    Parameter(
        help="Pictures, files of several pages, films, folders or quoted patterns such as "
        '"photos/*.jpg", followed by the output unless --output names it.'
    ),
]
Output = Annotated[
    flags.OptionalOutput,
    Parameter(
        help="Written to: .png, .tif, .exr, .webp, .avif or .jpg; for several a folder, or a "
        'quoted pattern such as "small/*.webp"; for pages and frames .tif, .gif, .webp, .apng or '
        ".mp4. [default: the last of the files]"
    ),
]

PLACE, WARPING, WRITTEN = WarpGeometry.usual(), PictureWarping.usual(), Written.usual()
OUTPUTS, SERVING, NEW_SIZE = Outputs.usual(), Serving.usual(), NewSize.usual()
PROJECTING, FILTERING, REPORTS = (
    BetweenProjections.usual(),
    PictureFiltering.usual(),
    Reports.usual(),
)
PAGE = Filling.usual()  # a page must not fade at the photo's edges
FLOOR = "warp sample:bricks --corners 170,0,214,0,700,384,-316,384 --size 384"
DEMO = {
    "floor-points.png": f"{FLOOR} --method points",
    "floor.png": FLOOR,
    "flight.gif": "animate sample:bricks --frames 24 --fps 12 --size 320x180",
}


@app.command
def warp(
    files: Files,
    /,
    *,
    output: Output = None,
    place: Annotated[WarpGeometry, flags.Flat] = PLACE,
    warping: Annotated[PictureWarping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    outputs: Annotated[Outputs, flags.Flat] = OUTPUTS,
) -> None:
    """Warp pictures by a matrix, by corners, by a map or by a lens.

    For example:

        resample-texture warp sample:bricks --matrix 0.5,0,0,0,0.5,0 -o half.png
        resample-texture warp sample:bricks --corners "9,0 90,9 80,70 0,60" -o a.png
        resample-texture warp sample:test-card --matrix 0.9,0.2,0,-0.2,0.9,99 -o b.png

    Float files are linear light, 8 bits sRGB, 16 bits as --encoding says. A file may also be an
    address of zarr or OME-Zarr, such as s3://bucket/slide.zarr. All pages of a TIFF and all frames
    of a .gif, .webp, .apng or film are warped alike.
    """
    from resample_texture.command.jobs import warp_all

    place.check()
    warp_all(files, output, place.target, warping=warping, written=written, outputs=outputs)


@app.command
def view(
    image: Path,
    /,
    *,
    place: Annotated[WarpGeometry, flags.Flat] = PLACE,
    warping: Annotated[PictureWarping, flags.Flat] = WARPING,
    page: Annotated[Serving, flags.Flat] = SERVING,
) -> None:
    """Show a picture in the browser: drag its corners, choose a method, copy the command.

    Or show a mesh with its textures, and orbit it.

    For example:

        resample-texture view sample:bricks
        resample-texture view sample:knot
        resample-texture view sample:bricks --corners "9,0 90,9 80,70 0,60"

    Parameters
    ----------
    image
        Any picture, or a mesh: .obj, .glb or .gltf.
    """
    from resample import registry
    from resample.view.server import show
    from resample.view.views import settings_of
    from resample_texture.viewing import MESHES, picture_view

    if image.suffix.lower() in MESHES:
        if given := settings_of([place, warping]):
            raise ValueError(f"{', '.join(given)}: of pictures; leave that out with a mesh")
        model_view = registry.load("pages", "texture.mesh")
        show(lambda: model_view(image), page)
    else:
        warping.check()
        show(lambda: picture_view(image, (place, warping)), page)


@app.command
def resize(
    files: Files,
    /,
    *,
    output: Output = None,
    new: Annotated[NewSize, flags.Flat] = NEW_SIZE,
    warping: Annotated[Filling, flags.Flat] = PAGE,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    outputs: Annotated[Outputs, flags.Flat] = OUTPUTS,
) -> None:
    """Resize pictures; each fills its target exactly, or keeps its aspect by --fit.

    For example:

        resample-texture resize sample:bricks small.png --size 100
        resample-texture resize sample:bricks half.jpg --size 50%
        resample-texture resize sample:test-card wide.png --size 640x360 --fit cover
    """
    from resample_texture.command.jobs import warp_all

    new.check()
    warping = new.opened(warping)
    warp_all(files, output, new.target, warping=warping, written=written, outputs=outputs)


@app.command
def scale(
    files: Files,
    /,
    *,
    output: Output = None,
    by: Annotated[Factor, flags.Flat],
    warping: Annotated[Filling, flags.Flat] = PAGE,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    outputs: Annotated[Outputs, flags.Flat] = OUTPUTS,
) -> None:
    """Scale pictures by an exact factor; their sizes are rounded to whole px.

    For example:

        resample-texture scale sample:bricks half.png --factor 0.5
        resample-texture scale sample:bricks narrow.png --factor 0.5,1
        resample-texture scale sample:test-card large.png --factor 2 --filter lanczos
    """
    from resample_texture.command.jobs import warp_all

    by.check()
    warp_all(files, output, by.target, warping=warping, written=written, outputs=outputs)


@app.command
def rotate(
    files: Files,
    /,
    *,
    output: Output = None,
    turn: Annotated[Rotation, flags.Flat],
    warping: Annotated[PictureWarping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    outputs: Annotated[Outputs, flags.Flat] = OUTPUTS,
) -> None:
    """Rotate pictures about their center; multiples of 90 degrees copy pixels.

    For example:

        resample-texture rotate sample:bricks turned.png --degrees 30
        resample-texture rotate sample:bricks upright.png --degrees 90
        resample-texture rotate sample:bricks level.png --degrees -1.5 --keep-size
    """
    from resample_texture.command.jobs import warp_all

    warp_all(files, output, turn.target, warping=warping, written=written, outputs=outputs)


@app.command
def undistort(
    files: Files,
    /,
    *,
    output: Output = None,
    out_of: Annotated[Undistortion, flags.Flat],
    warping: Annotated[PictureWarping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    outputs: Annotated[Outputs, flags.Flat] = OUTPUTS,
) -> None:
    r"""Remove a lens's distortion from pictures and rectify them, or add it.

    For example:

        resample-texture undistort sample:bricks a.png \
            --lens 400,400,256,256,-0.2,0,0,0
        resample-texture undistort sample:bricks b.png --inverse \
            --lens 400,400,256,256,-0.2,0,0,0
        resample-texture undistort sample:bricks c.png --fisheye \
            --lens 300,300,256,256,0,0,0,0
    """
    from resample_texture.command.jobs import warp_all

    aim = out_of.aim()
    warp_all(files, output, aim, warping=warping, written=written, outputs=outputs)


@app.command
def project(
    files: Files,
    /,
    *,
    output: Output = None,
    projecting: Annotated[BetweenProjections, flags.Flat] = PROJECTING,
    filtering: Annotated[PictureFiltering, flags.Flat] = FILTERING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    reports: Annotated[Reports, flags.Flat] = REPORTS,
) -> None:
    r"""Show pictures of one projection in another, without seams: panoramas, cube maps, fisheyes.

    For example:

        resample-texture project sample:bricks a.png --size 400 \
            --from perspective:fov=90 --to fisheye:fov=90
        resample-texture project sample:bricks b.png --size 640x480 --turn 30,10 \
            --from fisheye:fov=180 --to perspective:fov=70
        resample-texture project sample:bricks c.png --size 400x200 \
            --from stereographic --to equirectangular
    """
    from resample_texture.command.jobs import warp_all

    projecting.check()
    warping = PictureWarping(**dict(filtering))
    outputs = Outputs(**dict(reports))
    warp_all(files, output, projecting.target, warping=warping, written=written, outputs=outputs)


@app.command
def rectify(
    files: Files,
    /,
    *,
    corners: Annotated[str, OptionTopic.APPEARANCE, flags.Hyphen],
    output: Output = None,
    size: flags.AppearanceFlag[str | None] = None,
    warping: Annotated[Filling, flags.Flat] = PAGE,
    written: Annotated[Written, flags.Flat] = WRITTEN,
) -> None:
    """Rectify photographed pages, all by the same corners.

    For example:

        resample-texture rectify sample:page -o page.png
        resample-texture rectify sample:page --size 600x800 -o large.png
        resample-texture rectify sample:bricks --corners "9,0 90,9 80,70 0,6" -o a.png

    Parameters
    ----------
    corners
        x,y of four corners: the page's, in px of the photo, in any order.
    size
        Size in px: 400 for a square, 640x480 for width and height. [default: the page's sides in
        the photo]
    """
    from resample.console import note
    from resample_texture.command.jobs import warp_all
    from resample_texture.geometry.matrices import (
        from_corners,
        order_corners,
        page_corners,
        parse_points,
        rectified_shape,
    )

    ordered = order_corners(parse_points(corners))
    shape = rectified_shape(ordered) if size is None else height_and_width(size)
    if min(rectified_shape(ordered)) < 4:
        note("the corners enclose less than 4 px; they are x and y in px of the photo, not shares")
    page = PictureTarget(from_corners(ordered, page_corners(shape)), shape)
    warp_all(files, output, lambda _: page, warping=warping, written=written, outputs=OUTPUTS)


@app.command
def info(
    images: list[Picture],
    /,
    *,
    as_json: Annotated[bool, OptionTopic.APPEARANCE, Parameter(name="--json", negative="")] = False,
) -> None:
    """Print metadata of pictures and films, and assumptions about their colors.

    For example:

        resample-texture info sample:bricks
        resample-texture info sample:page
        resample-texture info sample:test-card --json

    Parameters
    ----------
    images
        Pictures, animations, films, folders or quoted patterns.
    as_json
        Print JSON instead of a table.
    """
    import json

    from resample.files.pictures import picture_at
    from resample.files.sequences import files_of, frames_of

    files = files_of(images)
    told: list[dict[str, Any]] = []
    for file in files:
        frames = frames_of(file)
        facts: dict[str, Any] = {"kind": "picture"}
        if frames is not None:
            duration = round(sum(frames.seconds), 3)
            facts = {"kind": "pictures", "count": len(frames.seconds), "seconds": duration}
            facts["plays"] = frames.plays or "without end"
        if frames is not None and frames.pages is None:
            first = next(iter(frames.read())).data
            told.append({**facts, "size": [first.shape[1], first.shape[0]]})
            continue
        header = picture_at(file).header
        kind, about = header.kind, header.about
        meaning = "levels of displays" if kind.is_encoded else "linear light"
        told.append(
            {
                **facts,
                "size": [header.size[1], header.size[0]],
                "channels": list(kind.channels),
                "values": about.number or f"{kind.bits} bits",
                "meaning": "numbers" if about.number else meaning,
                "assumed": about.assumed or None,
                "colors": about.colors or None,
                "orientation": header.orientation,
                "georeference": about.geo is not None and about.geo.has_place,
            }
        )
    if len(told) > 1:
        told = [{"file": str(file), **facts} for file, facts in zip(files, told, strict=True)]
    if as_json:
        sys.stdout.write(json.dumps(told if len(told) > 1 else told[0], indent=2) + "\n")
        return
    tables = (
        "".join(f"{name:18}{json.dumps(value)}\n" for name, value in facts.items())
        for facts in told
    )
    sys.stdout.write("\n".join(tables))


@app.command
def animate(
    image: Picture,
    /,
    *,
    output: flags.FilmOutput,
    path: flags.AppearanceFlag[Literal["fly", "turn"]] = "fly",
    frames: flags.AppearanceFlag[int] = 48,
    fps: flags.FramesPerSecond = 24.0,
    size: flags.Size = flags.USUAL_SIZE,
    method: flags.AppearanceFlag[str] = "hybrid",
    edge: flags.AppearanceFlag[Edges] = "transparent",
    background: flags.FilmBackground = "#9dbbd8",
    resume: flags.Resume = False,
) -> None:
    """Animate a camera that flies over a picture, or orbits it.

    For example:

        resample-texture animate sample:bricks -o fly.gif
        resample-texture animate sample:bricks --path turn -o turn.webp
        resample-texture animate sample:test-card --frames 24 --size 320x180 -o frames

    Parameters
    ----------
    image
        Any picture.
    path
        Camera path: fly, low over the picture and back; or turn, around its center.
    frames
        Number of frames.
    method
        Method: hybrid, paper, bilinear, opencv-supersample:n=8 ...; see resample plugins.
    edge
        What lies beyond the picture's edges.
    """
    from resample import registry
    from resample.command.films import write_shared
    from resample.command.session import require_picture
    from resample.console import film_background
    from resample.files.animations import check_film
    from resample.files.pictures import form_of, read_picture
    from resample_texture.command import rendering
    from resample_texture.types import AnyLight, Edge

    flight = rendering.Flyover(path, frames, height_and_width(size))
    behind = film_background(background)
    check_film(output, fps)
    (height, width, _), _ = form_of(image)
    texel, pixel = rendering.BYTES_OF_FILM
    require_picture(flight.size, pixel, {"the source": texel * height * width})
    read = read_picture(image)
    light: AnyLight | None = "pixels" if read.kind.is_encoded else None
    paint = rendering.FlightOptions(registry.build("methods", method), Edge(edge), behind, light)
    picture = rendering.with_alpha(read.data)
    write_shared(output, rendering.shots(picture, flight, paint), fps=fps, resume=resume)


app.command(fetcher("resample_texture", "astronaut"))


app.command(
    demonstrator(
        app, "Warp a brick wall to a floor, by points and by the hybrid, and fly over it.", DEMO
    )
)


with_settings(app)
add_command(app, "texture.mesh", "Render a textured mesh.")
add_command(
    app,
    "texture.compare",
    "Compare methods on a picture, separately where texels shrink and where they grow.",
)
add_command(
    app,
    "texture.figures",
    "Reproduce the paper's Figure 5: a floor by points, by the hybrid, and backward.",
)


def main() -> NoReturn:
    """Run the process's command line."""
    run(app)
