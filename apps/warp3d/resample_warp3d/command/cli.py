"""The `resample-warp3d` command."""

import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Literal, NoReturn

from cyclopts import App, Parameter

from resample.command import flags
from resample.command.options import run
from resample.command.settings import Written, height_and_width, method_names
from resample_warp3d.command.choices import (
    Aim,
    Depth,
    Extras,
    Joint,
    SourceCamera,
    Travel,
    Warping,
)

app = App(
    name="resample-warp3d",
    help="Pictures with depth, seen from somewhere else: points where samples shrink, parts of "
    "them where they grow.\n\nExample: resample-warp3d render photo.jpg depth.png "
    "--depth-scale 1000 --fov 60 --move 0.1,0,0 -o moved.png",
    version=lambda: version("hybrid-resample"),
)

EYE, DEPTH, AIM, WARPING = SourceCamera(), Depth(), Aim(), Warping()
WRITTEN, EXTRAS, TRAVEL, JOINT = Written(), Extras(), Travel(), Joint()
VIEWS = ("side", "back4", "in3", "oblique")  # some of the generated scene's
SIDE = 512  # px of the generated scene's views
COMPARED = "mcmillan,mesh,paper,hybrid"
DEMO, FIGURES = Path("demo"), Path("figures")


@app.command
def render(
    color: str,
    depth: str,
    /,
    *,
    output: flags.Output,
    eye: Annotated[SourceCamera, flags.Flat] = EYE,
    meaning: Annotated[Depth, flags.Flat] = DEPTH,
    aim: Annotated[Aim, flags.Flat] = AIM,
    view: Annotated[list[str] | None, flags.Switch] = None,
    joint: Annotated[Joint, flags.Flat] = JOINT,
    warping: Annotated[Warping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    extras: Annotated[Extras, flags.Flat] = EXTRAS,
) -> None:
    """Show a picture with depth from another place.

    Example: resample-warp3d render color.jpg depth.png --depth-scale 1000 --intrinsics
    525,525,320,240 --pose T.txt -o moved.png --holes holes.png

    Parameters
    ----------
    color
        Any picture; float files are linear light, the others sRGB.
    depth
        .png, .tif, .exr, .pfm, .npy or .npz of the same size; file:name picks a channel or array.
    output
        Written to: .png, .tif, .exr with what the file holds, or .jpg over a background.
    view
        A further view of the same scene, COLOR,DEPTH,POSE; may be given several times.
    """
    from resample.command.session import Session
    from resample.files.pictures import Look, check_output, look_of, write_picture
    from resample.files.writing import check_targets, write_json
    from resample_warp3d.command.export import write_geometry
    from resample_warp3d.command.inputs import Reader, check_poses, read_view, view_names
    from resample_warp3d.command.rendering import (
        check_memory,
        joined,
        mention_holes,
        prepared,
        report,
    )
    from resample_warp3d.command.writing import (
        check_extras,
        names_picture,
        warped_picture,
        write_extras,
    )

    for choice in (eye, meaning, aim):
        choice.check()
    check_extras(extras)
    warping.built()
    look = Look(written.bits, is_light=False) if warping.unmixed else look_of(written)
    check_output(output, look, transparent=not warping.fill)
    further = [view_names(text) for text in view or []]
    check_targets(output, *extras.paths())
    session, reader = Session(), Reader(eye, meaning, labels=warping.unmixed)
    with session.stage("read"):
        views = [read_view(reader, color, depth)]
        views += [read_view(reader, *names) for names in further]
        check_poses(views)
    picture, camera = views[0].picture, views[0].camera
    source_shape = picture.data.shape[0], picture.data.shape[1]
    shape = aim.shape(source_shape)
    check_memory(shape, picture.data.shape[2])
    target = aim.camera(camera, source_shape, eye.convention)
    sources = prepared(session, views, warping)
    together = joined(
        session, sources, target, shape, warping, joint.joining(unmixed=warping.unmixed)
    )
    seen = together.warped
    if not warping.fill:
        mention_holes(seen)
    with session.stage("write"):
        made = (
            names_picture(seen, picture.kind)
            if warping.unmixed
            else warped_picture(seen, picture.kind, filled=warping.fill)
        )
        write_picture(output, made, look)
        write_extras(extras, seen, meaning.depth_scale if meaning.depth_kind == "z" else None)
        if extras.export is not None:
            write_geometry(extras.export, sources[0].source, camera, extras.export_as)
    if extras.stats is not None:
        write_json(extras.stats, report(session, views, together, warping))


@app.command
def stereo(
    picture: str,
    disparity: str,
    /,
    *,
    output: flags.Output,
    disparity_scale: float | None = None,
    fraction: Annotated[float, flags.Hyphen] = 1.0,
    given: Annotated[Literal["left", "right"], Parameter(name="--from")] = "left",
    warping: Annotated[Warping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    holes: Path | None = None,
    coverage: Path | None = None,
) -> None:
    """Make one picture of a rectified pair from the other and its disparity.

    Example: resample-warp3d stereo im2.png disp2.png --disparity-scale 4 -o right.png

    Parameters
    ----------
    picture
        The left one, unless --from says otherwise.
    disparity
        Of the same size: how much further left things are in the right picture; 0 is unknown.
    output
        As of render.
    disparity_scale
        Numbers per px: 4 for Middlebury 2003, 16 for OpenCV, 256 for KITTI. Floats need none.
    fraction
        How far to go: 1 to the other eye, 0.5 half of the way; below 0 away from it.
    given
        Which of both pictures there is.
    holes
        As of render.
    coverage
        As of render.
    """
    from resample.command.session import Session
    from resample.files.pictures import check_output, look_of, write_picture
    from resample.files.writing import check_targets
    from resample_warp3d.command.inputs import read_rectified
    from resample_warp3d.command.rendering import check_memory, mention_holes, prepared, shifted
    from resample_warp3d.command.writing import check_extras, warped_picture, write_extras

    extras = Extras(holes=holes, coverage=coverage)
    check_extras(extras)
    warping.built()
    look = look_of(written)
    check_output(output, look, transparent=not warping.fill)
    check_targets(output, holes, coverage)
    session = Session()
    seen = read_rectified(picture, disparity, disparity_scale)
    shape = seen.picture.data.shape[0], seen.picture.data.shape[1]
    check_memory(shape, seen.picture.data.shape[2])
    (source,) = prepared(session, [seen], warping)
    way = fraction if given == "left" else -fraction
    warped = shifted(session, source, way, shape, warping)
    if not warping.fill:
        mention_holes(warped)
    write_picture(output, warped_picture(warped, seen.picture.kind, filled=warping.fill), look)
    write_extras(extras, warped, None)


@app.command
def animate(
    color: str,
    depth: str,
    /,
    *,
    output: flags.FilmOutput,
    eye: Annotated[SourceCamera, flags.Flat] = EYE,
    meaning: Annotated[Depth, flags.Flat] = DEPTH,
    travel: Annotated[Travel, flags.Flat] = TRAVEL,
    fps: flags.FramesPerSecond = 24.0,
    size: str | None = None,
    warping: Annotated[Warping, flags.Flat] = WARPING,
    background: flags.FilmBackground = "black",
    resume: flags.Resume = False,
) -> None:
    """Move a camera past a picture with depth.

    Example: resample-warp3d animate photo.jpg depth.png --depth-scale 1000 --fov 60 -o sway.mp4

    Parameters
    ----------
    color
        As of render.
    depth
        As of render.
    size
        In px: 400 for a square, 640x480 for width and height. The picture's.
    """
    from resample.command.session import Session
    from resample.command.settings import linear_color
    from resample.files.animations import check_film, write_film
    from resample_warp3d.command.animation import Range, check_path, poses_of, shots
    from resample_warp3d.command.inputs import Reader, read_view
    from resample_warp3d.command.rendering import check_memory, film_of

    eye.check()
    meaning.check()
    warping.built()
    check_path(travel.path, travel.frames, travel.amount)
    behind = linear_color(background) or (0.0, 0.0, 0.0)
    asked = None if size is None else height_and_width(size)
    check_film(output, fps)
    session = Session()
    seen = read_view(Reader(eye, meaning), color, depth)
    full = seen.picture.data.shape[0], seen.picture.data.shape[1]
    shape = full if asked is None else asked
    check_memory(shape, seen.picture.data.shape[2])
    camera, distance = seen.camera.resized(full, shape), Range.of(seen.image.nearness)
    poses = poses_of(travel.path, travel.frames, travel.amount, camera.world_to_camera, distance)
    film = film_of(session, seen, shape, warping, behind)
    made = shots(poses, camera, film.frame, film.job)
    with session.stage("film", bar="moving") as progress:
        write_film(output, made, fps, resume=resume, progress=progress)


@app.command
def cloud(
    file: Path,
    /,
    *,
    output: flags.FrameOutput,
    camera: flags.Viewed = "30/20/1",
    up: flags.Up = "z",
    pose: str | None = None,
    intrinsics: Annotated[str | None, flags.Hyphen] = None,
    size: flags.Size = "640x480",
    point_size: float = 1.0,
    filter: str | None = None,  # noqa: A002
    light: Literal["none", "eye"] | None = None,
    one_sided: Annotated[bool, flags.Switch] = False,
    background: str | None = None,
    bits: flags.Bits = 8,
) -> None:
    """Show a point cloud with normals, where it has them, and colors.

    Example: resample-warp3d cloud scan.ply --camera 40/20/1.5 --up y -o scan.png

    Parameters
    ----------
    file
        .ply, .pcd, .xyz, .txt, .csv or .npz.
    pose
        File or file:frame of a pose: in place of the camera, with intrinsics.
    intrinsics
        fx,fy,cx,cy[,skew] in px; for a pose.
    point_size
        Factor of what the points' spacing suggests.
    filter
        Pixel filter, such as gaussian:sigma=0.6. The mean over a pixel.
    light
        Where light comes from: eye, for clouds without colors, or none, for others.
    one_sided
        Leave out what is seen from behind.
    background
        Behind the picture: black, white, #rrggbb or none for transparent. None.
    """
    from resample.cameras.files import viewpoint
    from resample.command.session import Session
    from resample.command.settings import linear_color
    from resample.files.images import check_suffix, write_frame
    from resample.files.writing import check_targets
    from resample_warp3d.clouds.files import read_cloud
    from resample_warp3d.clouds.rendering import CloudStyle, Light, render_cloud
    from resample_warp3d.command.rendering import announce, check_memory, cloud_camera

    check_suffix(output)
    shape = height_and_width(size)
    seen_from = viewpoint(camera, up=up)
    if (pose is None) != (intrinsics is None):
        raise ValueError("--pose and --intrinsics belong together; give both, or --camera")
    calibrated = None if pose is None or intrinsics is None else (pose, intrinsics)
    behind = None if background is None else linear_color(background)
    lights = {None: None, "none": Light.NONE, "eye": Light.HEADLIGHT}
    style = CloudStyle(point_size=point_size, light=lights[light], cull=one_sided)
    check_targets(output)
    check_memory(shape, 4)
    points = read_cloud(file)
    placed = cloud_camera(points, shape, seen_from, calibrated)
    announce()
    with Session().stage("paint", bar="painting"):
        frame = render_cloud(points, placed, size=shape, style=style, filter=filter)
    write_frame(output, frame, bits=bits, background=behind)


@app.command
def compare(
    color: str | None = None,
    depth: str | None = None,
    /,
    *,
    scene: Literal["generated"] | None = None,
    truth: Path | None = None,
    mask: Path | None = None,
    eye: Annotated[SourceCamera, flags.Flat] = EYE,
    meaning: Annotated[Depth, flags.Flat] = DEPTH,
    aim: Annotated[Aim, flags.Flat] = AIM,
    views: str = ",".join(VIEWS),
    methods: str = COMPARED,
    output: flags.OptionalOutput = None,
    as_json: flags.Json = False,
) -> None:
    """Measure methods by what a view really shows, in the generated scene or in your own pictures.

    Only pixels that the source sees, too, are measured; holes are black.

    Example: resample-warp3d compare --scene generated --methods mcmillan,mesh,hybrid -o compare.png

    Parameters
    ----------
    color
        As of render, with a true picture of the new view. Left out, the scene is generated.
    depth
        As of render.
    scene
        What is looked at: generated, a room of known depth, ray traced.
    truth
        What the camera at --pose saw.
    mask
        Pixels of the truth to be measured, white in a picture. Those that the depth leads to.
    views
        Of the generated scene: some of side, back4, in3, oblique and roll, separated by commas.
    methods
        Separated by commas; with parameters as in hybrid:quality=2.
    output
        Written to: all pictures side by side with details enlarged (.png).
    """
    from resample import registry
    from resample.files.writing import check_targets, rows_as_json
    from resample.measuring.compare import check_sheet, plain
    from resample_warp3d.command.compare import compare_files
    from resample_warp3d.command.inputs import Reader, TrueView
    from resample_warp3d.command.rendering import announce
    from resample_warp3d.showing.compare import check_views, compare_scene, sheet

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
        announce()
        comparison = compare_scene(names, side, chosen)
    else:
        for choice in (eye, meaning, aim):
            choice.check()
        comparison = compare_files(given, Reader(eye, meaning), aim, names)
    if output is not None:
        sheet(comparison, output)
    sys.stdout.write(rows_as_json(comparison.rows) if as_json else plain(comparison.rows))


@app.command
def figures(
    color: str | None = None,
    depth: str | None = None,
    /,
    *,
    output: flags.Output = FIGURES,
    eye: Annotated[SourceCamera, flags.Flat] = EYE,
    meaning: Annotated[Depth, flags.Flat] = DEPTH,
    aim: Annotated[Aim, flags.Flat] = AIM,
    views: str = "oblique",
    methods: str = "hybrid,mcmillan",
) -> None:
    """Remake the paper's Figure 6: a picture, and a view of it by the hybrid and by McMillan.

    Parameters
    ----------
    color
        As of render. Left out, the scene is generated.
    depth
        As of render.
    output
        Written to: folder for figure-6.png, the single pictures and figure-6.json; created if
        missing.
    views
        Of the generated scene: one of side, back4, in3, oblique or roll.
    methods
        Separated by commas.
    """
    from resample import registry
    from resample.measuring.compare import plain
    from resample_warp3d.command.compare import figure_of_files
    from resample_warp3d.command.inputs import Reader
    from resample_warp3d.command.rendering import announce
    from resample_warp3d.showing.compare import check_views
    from resample_warp3d.showing.figures import generated_figure, write_figures

    names = method_names(methods)
    registry.check("warps", names)
    check_views([views])
    if (color is None) != (depth is None):
        raise ValueError("give COLOR and DEPTH, or neither for the generated scene")
    if color is None or depth is None:
        side = SIDE if aim.size is None else height_and_width(aim.size)[0]
        output.mkdir(parents=True, exist_ok=True)
        announce()
        figure = generated_figure(side, views, names)
    else:
        for choice in (eye, meaning, aim):
            choice.check()
        output.mkdir(parents=True, exist_ok=True)
        figure = figure_of_files((color, depth), Reader(eye, meaning), aim, names)
    write_figures(output, figure)
    sys.stdout.write(plain(figure.rows))


@app.command
def demo(*, output: flags.DemoOutput = DEMO) -> None:
    """Show a generated room from elsewhere by several methods, and a camera that sways in it."""
    from resample_warp3d.command.compare import write_demo

    output.mkdir(parents=True, exist_ok=True)
    write_demo(output)
    sys.stdout.write(f"The pictures are in {output.resolve()}\n")


def main() -> NoReturn:
    """Run the process's command line."""
    run(app)
