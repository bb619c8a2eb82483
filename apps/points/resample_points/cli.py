"""The `resample-points` command."""

from functools import partial
from pathlib import Path
from typing import Annotated, NoReturn

from cyclopts import Parameter

from resample.command import flags
from resample.command.flags import Inline, OptionTopic
from resample.command.help_formatter import CommandLine, add_command
from resample.command.session import run
from resample.command.settings import FrameFormat, Serving, Sharing, height_and_width, with_settings
from resample.lazy import installed_version
from resample_points.command.choices import CloudAim, CloudOptions, CloudStart
from resample_points.command.gaussians import ConvertOptions, GaussianOptions
from resample_points.command.maps import MapOptions

app = CommandLine(
    name="resample-points",
    help=(
        "Point clouds, 3D Gaussians and particles: points where they are small on screen, splats "
        "where they are large.\n\n"
        "For example:\n\n"
        "    resample-points render sample:knot-points -o knot.png\n"
        "    resample-points density sample:halo --color-bar -o halo.png\n"
        "    resample-points view sample:knot-gaussians\n"
    ),
    version=installed_version,
)
app.first = (
    "what resolution type axis quantity methods path frames camera up size color-by color-bar"
)
app.register_install_completion_command()

CLOUD, START, AIM = CloudOptions.usual(), CloudStart.usual(), CloudAim.usual()
GAUSSIANS = GaussianOptions.usual()
MAP, CONVERT = MapOptions.usual(), ConvertOptions.usual()
FORMAT, SERVING, SHARING = FrameFormat.usual(), Serving.usual(), Sharing.usual()


@app.command
def render(
    file: Path,
    /,
    *,
    output: flags.FrameOutput,
    index: Annotated[Path | None, OptionTopic.TARGET] = None,
    aim: Annotated[CloudAim, flags.Flat] = AIM,
    look: Annotated[CloudOptions, flags.Flat] = CLOUD,
    gaussians: Annotated[GaussianOptions, flags.Flat] = GAUSSIANS,
    form: Annotated[FrameFormat, flags.Flat] = FORMAT,
) -> None:
    """Render a point cloud, with its colors and normals if it has them, or 3D Gaussians.

    For example:

        resample-points render sample:knot-points -o knot.png
        resample-points render sample:knot-points --color-by z --color-bar -o z.png
        resample-points render sample:knot-gaussians --camera 40,60 -o g.png

    Parameters
    ----------
    file
        .ply, .pcd, .las, .laz, .e57, .pts, .xyz, .txt, .csv, .bin (KITTI) or .npz. Of 3D Gaussians:
        .ply of a trainer or compressed, .splat, .ksplat, .spz, .sog, or a folder of SOG.
    index
        Also write which point each pixel shows: .npy of the points' numbers, from 0 on in the order
        of the files after selection; -1 for nothing.
    """
    from resample.command.session import Session
    from resample.files.saving import check_frame
    from resample.files.writing import check_targets
    from resample.progress import told
    from resample_points.command.gaussians import gaussians_of
    from resample_points.command.rendering import check_memory, holds_gaussians, scene_of

    check_frame(output, form.bits, form.behind(output.suffix))
    if index is not None and index.suffix.lower() != ".npy":
        raise ValueError(f"{index}: numbers of points are written as .npy")
    shape = form.height_and_width()
    aim.check()
    if holds_gaussians(file, look, gaussians):
        gaussians.check()
        check_targets(output)
        check_memory(shape, output)
        session = Session()
        scene = gaussians_of(session, file, look, gaussians)
        camera = scene.upright(aim).camera_for(scene.framing, shape)
        with session.stage("paint", bar="painting") as progress, told(progress):
            scene.write(output, camera, form)
        return
    look.check(output, shape[0])
    check_targets(output, index)
    check_memory(shape, output)
    session = Session()
    cloud = scene_of(session, file, look)
    with session.stage("paint", bar="painting") as progress:
        camera = aim.camera_for(cloud.scene.surfels, shape)
        with told(progress):
            frame = cloud.picture(camera, shape)
    cloud.write(output, frame, form)
    if index is not None:
        cloud.write_index(index, camera, shape)


@app.command
def animate(
    file: Path,
    /,
    *more: Path,
    output: flags.FilmOutput,
    path: Annotated[str | None, Inline(("orbit", "sway", "still"))] = None,
    frames: flags.AppearanceFlag[int | None] = None,
    start: Annotated[CloudStart, flags.Flat] = START,
    fps: flags.FramesPerSecond = 24.0,
    size: flags.Size = flags.USUAL_SIZE,
    look: Annotated[CloudOptions, flags.Flat] = CLOUD,
    gaussians: Annotated[GaussianOptions, flags.Flat] = GAUSSIANS,
    background: flags.FilmBackground = "black",
    resume: flags.Resume = False,
    sharing: Annotated[Sharing, flags.Flat] = SHARING,
) -> None:
    """Move a camera around a point cloud or 3D Gaussians; `density` films particles.

    For example:

        resample-points animate sample:knot-points --frames 24 -o orbit.gif
        resample-points animate sample:knot-points --path sway --frames 24 -o a.webp
        resample-points animate sample:knot-gaussians --size 320x240 -o frames

    Parameters
    ----------
    file
        A point cloud (.ply, .las, .pcd, .npz ...), or 3D Gaussians (.ply, .splat, .spz, .sog).
    more
        Further files, such as scans of a drive: each is a frame, framed and colored as the first.
    path
        Camera path: orbit, once around; sway, left and right; still; or a file of keyframes or
        poses. [default: orbit; still for several files]
    frames
        Number of frames. [default: 96; for a path as many as its times require]
    """
    from resample.command.workers import check_sharing
    from resample.console import film_background
    from resample.files.animations import check_film
    from resample_points.command.rendering import (
        check_memory,
        holds_gaussians,
        scene_in,
        write_animation,
    )

    shape = height_and_width(size)
    check_film(output, fps)
    check_sharing(sharing)
    start.start()
    behind = film_background(background)
    check_memory(shape, output, sharing.workers or 0)
    gaussians.check()
    for each in (files := (file, *more)):
        if not holds_gaussians(each, look, gaussians):
            look.check(output, shape[0])
    write_animation(
        output,
        files,
        partial(scene_in, files, look, gaussians),
        path=path,
        frames=frames,
        fps=fps,
        start=start,
        shape=shape,
        background=behind,
        threads=look.threads,
        resume=resume,
        sharing=sharing,
    )


@app.command
def info(
    file: Path,
    /,
    *,
    as_json: Annotated[bool, OptionTopic.APPEARANCE, Parameter(name="--json", negative="")] = False,
) -> None:
    """Print the number, bounds and columns of a file's points or 3D Gaussians.

    For example:

        resample-points info sample:knot-points
        resample-points info sample:knot-gaussians
        resample-points info sample:halo --json

    Parameters
    ----------
    file
        A point cloud: .ply, .pcd, .las, .laz, .e57, .pts, .xyz, .txt, .csv, .bin (KITTI) or .npz;
        or 3D Gaussians: .ply, .splat, .ksplat, .spz, .sog, or a folder of SOG.
    as_json
        Print JSON instead of a table.
    """
    import json
    import sys

    from resample_points.command.facts import facts_in

    facts = facts_in(file)
    lines = (f"{name:18}{json.dumps(value)}\n" for name, value in facts.items())
    sys.stdout.write(json.dumps(facts, indent=2) + "\n" if as_json else "".join(lines))


@app.command(name="map")
def map_(
    file: Path,
    /,
    *,
    output: Annotated[flags.Output, Parameter(help="Written to: .tif, a GeoTIFF.")],
    options: Annotated[MapOptions, flags.Flat] = MAP,
) -> None:
    """Map a cloud from above: a GeoTIFF of heights, colors, classes or densities.

    Cells begin at whole multiples of their side, so maps of neighbouring tiles fit together.

    For example:

        resample-points map sample:knot-points -o heights.tif
        resample-points map sample:knot-points --what color -o colors.tif
        resample-points map sample:knot-points --resolution 0.05 -o coarse.tif

    Parameters
    ----------
    file
        .las, .laz, .ply, .xyz or another point cloud; z is up.
    """
    from resample.command.session import Session
    from resample.files.writing import check_targets
    from resample_points.command.maps import write_map

    options.check(output)
    check_targets(output)
    write_map(Session(), [file, *map(Path, options.also)], output, options)


@app.command
def convert(
    file: Path,
    /,
    *,
    output: Annotated[
        flags.Output, Parameter(help="Written to: .ply, .compressed.ply, .spz, .sog or .splat.")
    ],
    options: Annotated[ConvertOptions, flags.Flat] = CONVERT,
) -> None:
    """Convert 3D Gaussians between formats; crop, place and join them.

    For example:

        resample-points convert sample:knot-gaussians -o knot.spz
        resample-points convert sample:knot-gaussians --degree 0 -o a.compressed.ply
        resample-points convert sample:knot-gaussians --least-opacity 0.05 -o b.sog

    Parameters
    ----------
    file
        .ply of a trainer or compressed, .splat, .ksplat, .spz, .sog, or a folder of SOG.
    """
    from resample.command.session import Session
    from resample.files.writing import check_targets
    from resample_points.command.gaussians import converted
    from resample_points.files.gaussians.formats import suffix_of

    options.check()
    suffix_of(output)
    check_targets(output)
    converted(Session(), file, output, options)


@app.command
def view(
    file: Path,
    /,
    *,
    start: Annotated[CloudStart, flags.Flat] = START,
    page: Annotated[Serving, flags.Flat] = SERVING,
) -> None:
    """Show a point cloud or 3D Gaussians in the browser: navigate, copy the command.

    For example:

        resample-points view sample:knot-points
        resample-points view sample:knot-gaussians --camera top
        resample-points view sample:knot-points --port 8000 --no-browser

    Parameters
    ----------
    file
        A point cloud (.ply, .las, .pcd, .npz ...), 3D Gaussians (.ply, .splat, .spz, .sog), or
        particles (.hdf5 of a snapshot).
    """
    from resample.view.server import show
    from resample_points.viewing import view_of

    show(lambda: view_of(file, (start,)), page)


with_settings(app)
add_command(
    app,
    "points.density",
    "Map the particles of a simulation: column density, means of a quantity, slices; film them.",
)
add_command(
    app,
    "points.compare",
    "Compare ways to render 3D Gaussians with 16 x 16 rays per pixel, each in its own order.",
)


def main() -> NoReturn:
    """Run the process's command line."""
    run(app)
