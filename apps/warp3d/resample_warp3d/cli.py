"""The `resample-warp3d` command."""

from functools import partial
from typing import Annotated, NoReturn

from cyclopts import Parameter

from resample.command import flags
from resample.command.applications import demonstrator, fetcher
from resample.command.flags import OptionTopic
from resample.command.help_formatter import CommandLine, add_command
from resample.command.session import run
from resample.command.settings import (
    Serving,
    Sharing,
    Written,
    with_settings,
)
from resample.console import say
from resample.lazy import installed_version
from resample_warp3d.command.choices import (
    Batch,
    Depth,
    DepthWarping,
    Estimating,
    Extras,
    FilmFormat,
    FilmInput,
    Joint,
    Showing,
    Travel,
)
from resample_warp3d.command.parallax import PairDepth, Parallax, StereoWarping
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.command.target import Aim, TargetCamera

app = CommandLine(
    name="resample-warp3d",
    help=(
        "Novel views of pictures with depth: samples are projected as points where they shrink "
        "and split into parts where they grow.\n\n"
        "For example:\n\n"
        "    resample-warp3d render sample:room --move 0.3,0,0 -o moved.png\n"
        "    resample-warp3d stereo sample:room --layout anaglyph -o red-cyan.png\n"
        "    resample-warp3d view sample:room\n"
    ),
    version=installed_version,
)
app.first = (
    "path methods layout fov depth-scale depth-kind move amount turn pose scene "
    "views frames eyes fill size"
)
app.register_install_completion_command()

EYE, DEPTH, AIM, WARPING = SourceCamera.usual(), Depth.usual(), Aim.usual(), DepthWarping.usual()
WRITTEN, EXTRAS, TRAVEL = Written.usual(), Extras.usual(), Travel.usual()
TARGET, SHOWING = TargetCamera.usual(), Showing.usual()
JOINT, SERVING, SHARING = Joint.usual(), Serving.usual(), Sharing.usual()
PAIR_DEPTH, PARALLAX, FILMING = PairDepth.usual(), Parallax.usual(), FilmInput.usual()
STEREO_WARPING = StereoWarping.usual()
BATCH, ESTIMATING, FILM = Batch.usual(), Estimating.usual(), FilmFormat.usual()
DEMO = {
    "moved.png": "render sample:room --fill",
    "anaglyph.png": "stereo sample:room --layout anaglyph",
    "sway.gif": "animate sample:room:size=180 --frames 24 --fps 12",
}


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
    view: Annotated[list[str] | None, OptionTopic.SOURCE, flags.Switch] = None,
    joint: Annotated[Joint, flags.Flat] = JOINT,
    filming: Annotated[FilmInput, flags.Flat] = FILMING,
    warping: Annotated[DepthWarping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    showing: Annotated[Showing, flags.Flat] = SHOWING,
    extras: Annotated[Extras, flags.Flat] = EXTRAS,
) -> None:
    """Render a picture with depth from another viewpoint.

    For example:

        resample-warp3d render sample:room -o moved.png
        resample-warp3d render sample:room --move 0.3,0,0.2 --fill -o near.png
        resample-warp3d render sample:room --move 0.5,0,0 -o far.png --holes holes.png

    Parameters
    ----------
    color
        Any picture; float files are linear light, the others sRGB. Or a film: one file, or a
        folder or pattern of pictures.
    depth
        .png, .tif, .exr, .pfm, .npy or .npz; file:name selects a channel or array; scan.r3d:12
        a frame of Record3D, as for color; .depth, float32. For a film: a film of gray levels, a
        folder, a pattern of depth files, or a stack (N, H, W) in .npy or .npz.
    output
        Written to: .png, .tif or .exr, or .jpg over a background; for a film .mp4, .gif, .webp or
        .apng, a folder for numbered .png files, or a name with * for the number (moved/*.exr).
    view
        Another view of the same scene: COLOR,DEPTH,POSE or sample:room,POSE; repeatable.
    """
    from resample.command.session import Session
    from resample.files import formats, saving
    from resample.files.writing import check_targets, write_json
    from resample_warp3d.command.footage import footage_of
    from resample_warp3d.command.inputs import DepthReader, read_views, view_names
    from resample_warp3d.command.rendering import (
        check_memory,
        joined,
        joining_of,
        mention_holes,
        prepared,
        report,
    )
    from resample_warp3d.command.writing import check_extras, made_of, write_extras, write_geometry

    aim.check()
    showing.check(unmixed=warping.unmixed)
    reader = DepthReader.checked(eye.of_recording(color), meaning, labels=warping.unmixed)
    warping.built()
    look = written.options(output.suffix)
    if warping.unmixed:
        look = formats.WriteOptions(written.bits, is_light=False)
    further = [view_names(text) for text in view or []]
    footage = footage_of(color, depth, filming.fps, labels=warping.unmixed)
    if footage is not None:
        from resample_warp3d.command.films import render_film

        others = {"show": not showing.is_plain, "view": bool(view)}
        render_film(footage, output, look, filming, extras, others, reader, aim, warping)
        return
    check_extras(extras, eye)
    check_targets(output, *extras.paths())
    formats.check_output(output, look)
    session = Session()
    with session.stage("read"):
        taken = read_views(reader, color, depth, further)
    kind, shape = taken.picture.kind, aim.shape(taken.shape)
    check_memory(taken.views, shape, output)
    target = aim.camera_model(taken.camera, taken.shape, eye.convention)
    sources = prepared(session, taken.views, warping)
    joining = joining_of(taken, joint, unmixed=warping.unmixed)
    together = joined(session, sources, target, shape, warping, joining)
    seen = together.warped
    if not warping.fill:
        mention_holes(seen)
    with session.stage("write"):
        made = made_of(seen, kind, warping, showing.show)
        saving.write_picture(output, made, look)
        saving.tell_empty(output, not seen.coverage.any())
        saving.tell_unchanged(output, made, taken.picture, "--move and --turn move the camera")
        write_extras(extras, seen, meaning.scale_of_z)
        if extras.export is not None:
            write_geometry(
                extras.export, sources[0].source, taken.views[0].pinhole, extras.export_as
            )
    if extras.stats is not None:
        write_json(extras.stats, report(session, sources, together, warping))


@app.command
def stereo(
    picture: str,
    depth: str | None = None,
    /,
    *,
    output: flags.Output,
    disparity_scale: flags.AppearanceFlag[float | None] = None,
    eye: Annotated[SourceCamera, flags.Flat] = EYE,
    meaning: Annotated[PairDepth, flags.Flat] = PAIR_DEPTH,
    estimating: Annotated[Estimating, flags.Flat] = ESTIMATING,
    parallax: Annotated[Parallax, flags.Flat] = PARALLAX,
    fraction: Annotated[float, OptionTopic.APPEARANCE, flags.Hyphen] = 1.0,
    batch: Annotated[Batch, flags.Flat] = BATCH,
    filming: Annotated[FilmInput, flags.Flat] = FILMING,
    film: Annotated[FilmFormat, flags.Flat] = FILM,
    warping: Annotated[StereoWarping, flags.Flat] = STEREO_WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    holes: flags.Target = None,
    coverage: flags.Target = None,
) -> None:
    """Make the other eye's picture of a stereo pair, or both, from a picture and its depth.

    For example:

        resample-warp3d stereo sample:room -o right.png
        resample-warp3d stereo sample:room --layout anaglyph -o red-cyan.png
        resample-warp3d stereo sample:room --layout sbs --eyes both -o pair.png

    Parameters
    ----------
    picture
        The left picture, unless --eyes says otherwise; or a film: one file, or a folder or
        pattern of pictures; or photos, with --batch.
    depth
        Disparity of the same size: how much further left things are in the right picture, 0 if
        unknown; or depth of the kind given by --depth-kind. For a film a film of gray
        levels, a folder, a pattern of depth files, or a stack (N, H, W) in .npy or .npz. With
        --batch a folder with files of the same names. Not with --depth-model.
    output
        Written to: .png, .tif or .exr, .jpg over a background, or a pair in .mpo or .jps; for a
        film .mp4, .mov, .mkv, .gif, .webp or .apng, a folder for numbered .png files, or a name
        with * for the number (moved/*.exr); with --batch a folder, or a name with *.
    disparity_scale
        File values per px: 4 for Middlebury 2003, 16 for OpenCV, 256 for KITTI. Not for floats.
        [default: 1 for floats; integers need one]
    fraction
        Distance between the two pictures: 1 is the eyes' distance, 0.5 half of it; below 0 the
        opposite way.
    holes
        Also write the holes by their cause (.png): magenta hidden behind something, gray outside
        the source, blue without depth, yellow a crack that was filled.
    coverage
        Also write the share of each pixel that is covered (.png, .tif, .exr).
    """
    from resample_warp3d.command.footage import opened
    from resample_warp3d.command.stereo_job import StereoJob, write_stereo

    extras = Extras(holes=holes, coverage=coverage)
    parallax.check(meaning, eye)
    if fraction == 0:
        say("--fraction 0 moves nothing: both pictures are the same; 1 is the other eye's")
    if warping.unmixed:  # filling would mix colors
        warping = warping.model_copy(update={"fill": False})
    warping.built()
    job = StereoJob(
        eye, meaning, parallax, fraction, filming, film, warping, written, extras, disparity_scale,
        opened(estimating, warping.threads),
    )  # fmt: skip
    write_stereo(job, picture, depth, output, batch)


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
    filming: Annotated[FilmInput, flags.Flat] = FILMING,
    target: Annotated[TargetCamera, flags.Flat] = TARGET,
    warping: Annotated[DepthWarping, flags.Flat] = WARPING,
    background: flags.FilmBackground = "black",
    depth_output: flags.Target = None,
    resume: flags.Resume = False,
    sharing: Annotated[Sharing, flags.Flat] = SHARING,
) -> None:
    """Animate a camera that moves in a picture or film with depth.

    A film has a pose for each of its pictures; with more --frames it is shown again.

    For example:

        resample-warp3d animate sample:room -o sway.gif
        resample-warp3d animate sample:room --path dolly --amount 0.2 -o dolly.webp
        resample-warp3d animate sample:room --path orbit --frames 24 --fill -o frames

    Parameters
    ----------
    color
        Any picture; float files are linear light, the others sRGB. Or a film: one file, or a
        folder or pattern of pictures.
    depth
        .png, .tif, .exr, .pfm, .npy or .npz; file:name selects a channel or array; scan.r3d:12
        a frame of Record3D, as for color; .depth, float32. For a film: a film of gray levels, a
        folder, a pattern of depth files, or a stack (N, H, W) in .npy or .npz.
    depth_output
        Also write depth z: a folder for a 16-bit .png per frame (values per unit: the depth scale,
        or 1000), or a name with * for the frame's number, such as depth/*.exr or .npy in scene
        units, from which render reads it.
    """
    import numpy as np

    from resample.command.films import write_shared
    from resample.command.session import Session
    from resample.command.workers import at_work, check_sharing
    from resample.console import film_background
    from resample.files.animations import check_film
    from resample_warp3d.command.animation import (
        Range,
        check_path,
        frames_of,
        poses_of,
        shots,
        write_flight,
    )
    from resample_warp3d.command.depths import appearing, depths_of
    from resample_warp3d.command.footage import footage_of
    from resample_warp3d.command.inputs import DepthReader, read_views
    from resample_warp3d.command.rendering import check_memory, film_of

    reader = DepthReader.checked(eye.of_recording(color), meaning)
    warping.built()
    check_path(travel.path, travel.frames, travel.amount)
    behind = film_background(background)
    fps = 24.0 if filming.fps is None else filming.fps
    target.check_target()
    target.shape((1, 2))
    check_film(output, fps)
    check_sharing(sharing)
    depths = depths_of(depth_output, output, meaning, sharing)
    footage = footage_of(color, depth)
    if footage is not None:
        write_flight(
            *(footage, reader, warping, depths, output, travel, target, filming, behind, sharing),
            resume=resume,
        )
        return
    session = Session()
    taken = read_views(reader, color, depth)
    shape = target.shape(taken.shape)
    check_memory(taken.views, shape, output, sharing.workers or 0)
    camera = target.camera_model(taken.camera, taken.shape, eye.convention)
    distance = Range.of(np.concatenate([view.image.nearness.ravel() for view in taken.views]))
    poses = poses_of(travel.path, travel.frames, travel.amount, camera.world_to_camera, distance)
    film = film_of(session, taken, shape, warping, behind)
    made = shots(poses, camera, film, depths)
    files = reader, color, depth
    again = partial(frames_of, files, warping, shape, behind, poses, camera)
    with appearing(depths, resume=resume), at_work(sharing, warping.threads) as crew:
        write_shared(output, made, again, crew, fps=fps, resume=resume)


@app.command
def view(
    file: str,
    depth: str,
    /,
    *,
    eye: Annotated[SourceCamera, flags.Flat] = EYE,
    meaning: Annotated[Depth, flags.Flat] = DEPTH,
    aim: Annotated[Aim, flags.Flat] = AIM,
    further: Annotated[
        list[str] | None, OptionTopic.SOURCE, Parameter(name="--view"), flags.Switch
    ] = None,
    warping: Annotated[DepthWarping, flags.Flat] = WARPING,
    page: Annotated[Serving, flags.Flat] = SERVING,
) -> None:
    """Show a picture with depth in the browser: navigate, copy the command.

    For example:

        resample-warp3d view sample:room
        resample-warp3d view sample:room --move 0.3,0,0 --fill
        resample-warp3d view sample:room --method paper --port 8000 --no-browser

    Parameters
    ----------
    file
        Any picture.
    depth
        Depth of the picture: .png, .tif, .exr, .pfm, .npy or .npz of the same size; file:name
        selects a channel or array.
    further
        Another view of the same scene: COLOR,DEPTH,POSE or sample:room,POSE; repeatable.
    """
    from resample.view.server import show
    from resample_warp3d.viewing import depth_view

    begin = eye.of_recording(file), meaning, aim, warping
    show(lambda: depth_view(file, depth, begin, further or ()), page)


app.command(fetcher("resample_warp3d", "living-room"))


app.command(demonstrator(app, "Render new views of a generated room, and a swaying camera.", DEMO))


with_settings(app)
add_command(
    app,
    "warp3d.compare",
    "Compare methods with a true view, in the generated scene or in your own pictures.",
)
add_command(
    app,
    "warp3d.figures",
    "Reproduce the paper's Figure 6: a picture, and a view by the hybrid and by McMillan.",
)


def main() -> NoReturn:
    """Run the process's command line."""
    run(app)
