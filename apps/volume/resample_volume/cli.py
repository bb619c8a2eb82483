"""The `resample-volume` command."""

import json
import math
import sys
from typing import Annotated, Any, NoReturn

from cyclopts import Parameter

from resample.command import flags
from resample.command.applications import demonstrator
from resample.command.flags import Inline, OptionTopic
from resample.command.help_formatter import CommandLine, add_command
from resample.command.session import Session, require_picture, run
from resample.command.settings import PictureFormat, Resampling, Serving, Sharing, with_settings
from resample.console import film_background
from resample.files.writing import check_targets, write_json
from resample.lazy import installed_version
from resample_volume.command.choices import (
    Added,
    AppearanceChoices,
    Extras,
    FilmExtras,
    PictureExtras,
    ReadOptions,
)

PictureOutput = Annotated[
    flags.Output,
    Parameter(
        help="Written to: .png, .jpg, .tif, or .exr with linear RGBA, depth (Z) and coverage."
    ),
]

app = CommandLine(
    name="resample-volume",
    help=(
        "Volume rendering: splats where voxels grow on screen, points where they shrink.\n\n"
        "For example:\n\n"
        "    resample-volume render sample:vessel-tree -o vessels.png\n"
        "    resample-volume view sample:vessel-tree\n"
        "    resample-volume info sample:vessel-tree\n"
    ),
    version=installed_version,
)
app.first = "methods path frames camera transfer window size bins chunk time channel"
app.register_install_completion_command()

VOXELS, RESAMPLING, PICTURE = AppearanceChoices.usual(), Resampling.usual(), PictureFormat.usual()
SOURCE, ADDED = ReadOptions.usual(), Added.usual()
EXTRAS, PICTURE_EXTRAS = Extras.usual(), PictureExtras.usual()
FILM_EXTRAS = FilmExtras.usual()
SERVING, SHARING = Serving.usual(), Sharing.usual()
BAR = 40  # characters of the longest histogram bar
# Facts that are shown in another way.
UNLISTED = ("histogram", "thresholds", "findings", "levels", "looks", "length_unit")
DEMO = {  # volumes of one dtype
    "checker-box.png": "render checker-box --camera 30,25,0.9 --background black",
    "vessel-tree.png": "render vessel-tree --camera 30,15,1 --background black",
}


@app.command
def render(
    volume: str,
    /,
    *,
    output: PictureOutput,
    look: Annotated[AppearanceChoices, flags.Flat] = VOXELS,
    resampling: Annotated[Resampling, flags.Flat] = RESAMPLING,
    picture: Annotated[PictureFormat, flags.Flat] = PICTURE,
    source: Annotated[ReadOptions, flags.Flat] = SOURCE,
    added: Annotated[Added, flags.Flat] = ADDED,
    extras: Annotated[PictureExtras, flags.Flat] = PICTURE_EXTRAS,
    sharing: Annotated[Sharing, flags.Flat] = SHARING,
    stats: flags.Stats = None,
) -> None:
    """Render a volume to a picture.

    For example:

        resample-volume render sample:vessel-tree -o vessels.png
        resample-volume render sample:vessel-tree --camera 60,30,1.5 -o near.png
        resample-volume render sample:vessel-tree --projection maximum -o maximum.png

    Parameters
    ----------
    volume
        A file, a folder of slices, or checker-box, vessel-tree, marschner-lobb.
    """
    from resample.command.workers import worker_pools
    from resample.files.saving import check_frame, write_frame
    from resample.outofcore.passes import memoizing
    from resample_volume.command import rendering
    from resample_volume.command.inputs import media, require_values, with_objects

    size = picture.height_and_width()
    background = picture.behind(output.suffix)
    check_frame(output, picture.bits, background)
    resampler = look.renderer(resampling, source.scale)
    extras.check(output, resampler, size[0])
    objects = extras.scene_objects(look, resampler)
    viewpoint = look.viewpoint()
    require_picture(size, rendering.BYTES_PER_PIXEL)
    session = Session()
    with worker_pools(sharing, picture.threads) as start_workers, memoizing({}):
        check_targets(output, stats)
        with session.stage("read"):
            shown = media(source, volume, look, added, resampler, start_workers=start_workers)
            shown = with_objects(shown, objects)
            if extras.color_bar:
                require_values(shown[0][0], "a color bar")
        scene = rendering.to_paint(
            *(session, shown, resampler, extras.fit(look), viewpoint, size),
            *(picture.threads, sharing, start_workers),
        )
        subject, camera, paint = scene
        frame = rendering.picture_of(scene, shown, resampler.projection)
        with session.stage("write"):
            if extras.deep is not None:
                from resample.files.saving import write_deep
                from resample_volume.rendering import boxed, depths, slabs

                planes = depths(camera, boxed(shown, subject), extras.deep)
                write_deep(output, slabs(paint, camera, planes))
            else:
                words = (subject, camera, frame, shown, resampler, extras, background)
                drawn = rendering.annotated_picture(*words)
                write_frame(output, drawn, picture.bits, background)
    if stats is not None:
        write_json(stats, rendering.report(session, frame, subject))


@app.command
def animate(
    volume: str,
    /,
    *,
    output: flags.FilmOutput,
    path: Annotated[str, Inline(("orbit", "zoom", "threshold", "still"))] = "orbit",
    frames: flags.AppearanceFlag[int | None] = None,
    fps: flags.FramesPerSecond = 24.0,
    look: Annotated[AppearanceChoices, flags.Flat] = VOXELS,
    resampling: Annotated[Resampling, flags.Flat] = RESAMPLING,
    size: Annotated[flags.Size, Parameter(help=flags.SQUARE)] = "400",
    background: flags.FilmBackground = "black",
    threads: Annotated[int | None, OptionTopic.RESOURCE] = None,
    source: Annotated[ReadOptions, flags.Flat] = SOURCE,
    added: Annotated[Added, flags.Flat] = ADDED,
    extras: Annotated[FilmExtras, flags.Flat] = FILM_EXTRAS,
    sharing: Annotated[Sharing, flags.Flat] = SHARING,
    resume: flags.Resume = False,
) -> None:
    """Move a camera around a volume, or away from it; a volume of several times moves itself.

    For example:

        resample-volume animate sample:vessel-tree --frames 24 -o orbit.gif
        resample-volume animate sample:vessel-tree --path zoom --frames 24 -o a.webp
        resample-volume animate checker-box --path threshold --frames 24 -o frames

    Parameters
    ----------
    volume
        A file, a folder of slices, or checker-box, vessel-tree, marschner-lobb.
    path
        Camera path: orbit, once around; zoom, from the camera to 16 times as far; threshold,
        from voxels that are splats to voxels that are points; still, no motion; or a file of
        keyframes or poses.
    frames
        Number of frames. [default: 96; for a volume of several times or a file of
        keyframes as many as its times]
    threads
        Number of threads at most; pixels do not depend on it. [default: all cores]
    """
    from resample.command.films import write_shared
    from resample.command.workers import worker_pools
    from resample.files.animations import check_film
    from resample_volume.command import animation
    from resample_volume.command.inputs import over_time
    from resample_volume.command.rendering import BYTES_PER_PIXEL

    check_film(output, fps)
    flight = animation.flight_of(path, frames, fps, look.viewpoint())
    shape = PictureFormat(size=size, threads=threads).height_and_width()
    behind = film_background(background)
    resampler = look.renderer(resampling, source.scale)
    extras.scene_objects(look, resampler)
    extras.check_bar(output, shape[0])
    require_picture(shape, BYTES_PER_PIXEL)
    paint = animation.FrameOptions(resampler, shape, behind, threads)
    script = animation.Script(volume, source, look, added, extras, resampling, frames)
    about = {"volume": volume, "path": path, "transfer": look.transfer}
    with worker_pools(sharing, threads) as start_workers:
        recording = None
        if source.time is None and not added.channels:
            recording = over_time(source, volume)
            colored = recording is not None and any(file.color for file in recording.looks)
            if recording is not None and colored and recording.values.shape[0] == 1:
                recording = None  # channels are shown together
        film = animation.film_of(script, recording, flight, paint, about, start_workers)
        crew = start_workers()
        again = animation.again(script, film, crew)
        write_shared(output, film.shots, again, crew, fps=fps, resume=resume, bar="filming")


@app.command
def view(
    volume: str,
    /,
    *,
    look: Annotated[AppearanceChoices, flags.Flat] = VOXELS,
    resampling: Annotated[Resampling, flags.Flat] = RESAMPLING,
    source: Annotated[ReadOptions, flags.Flat] = SOURCE,
    added: Annotated[Added, flags.Flat] = ADDED,
    extras: Annotated[Extras, flags.Flat] = EXTRAS,
    page: Annotated[Serving, flags.Flat] = SERVING,
) -> None:
    """Show a volume in the browser: rotate it, change its look, copy the command of the view.

    For example:

        resample-volume view sample:vessel-tree
        resample-volume view sample:vessel-tree --transfer hot --camera top
        resample-volume view sample:marschner-lobb --port 8000 --no-browser

    Parameters
    ----------
    volume
        A file, a folder of slices, or checker-box, vessel-tree, marschner-lobb.
    """
    from resample.view.server import show
    from resample_volume.viewing import volume_view

    show(lambda: volume_view(volume, source, (look, resampling, extras), added), page)


@app.command
def info(
    volume: str,
    /,
    *,
    bins: flags.AppearanceFlag[int] = 32,
    as_json: Annotated[bool, OptionTopic.APPEARANCE, Parameter(name="--json", negative="")] = False,
    source: Annotated[ReadOptions, flags.Flat] = SOURCE,
) -> None:
    """Print a volume's size, spacing, values, histogram and thresholds found in the histogram.

    For example:

        resample-volume info sample:vessel-tree
        resample-volume info sample:vessel-tree --bins 64
        resample-volume info checker-box --json

    Parameters
    ----------
    volume
        A file, a folder of slices, or checker-box, vessel-tree, marschner-lobb.
    bins
        Number of bins of the histogram.
    as_json
        Print JSON instead of a table.
    """
    from resample_volume.command.inputs import levels, of_first_channel, opened_of_several
    from resample_volume.files.source import describe

    (shown, recording), _ = of_first_channel(
        source, lambda chosen: opened_of_several(chosen, volume, streamed=True)
    )
    parts = 1 if shown.colors is None else shown.colors.shape[-1]
    times, channels = (1, parts) if recording is None else recording.values.shape[:2]
    facts = describe(shown, bins) | {"times": times, "channels": channels}
    if recording is not None and recording.looks:
        facts["looks"] = [look._asdict() for look in recording.looks]
    if sizes := levels(source, volume):
        facts["levels"] = sizes
    sys.stdout.write(json.dumps(facts, indent=2) + "\n" if as_json else _listed(facts))


@app.command
def generate(name: str, /, *, output: flags.Output) -> None:
    """Write a generated volume to a file.

    For example:

        resample-volume generate checker-box -o box.nrrd
        resample-volume generate vessel-tree:size=64 -o vessels.nii.gz
        resample-volume generate checker-box:size=64,block=4 -o box.npy

    Parameters
    ----------
    name
        checker-box, vessel-tree or marschner-lobb, with parameters: checker-box:size=64,block=8.
    output
        Written to: .nrrd, .mha, .nii or .nii.gz; or .npy, which keeps the values alone.
    """
    from resample_volume.files.source import check_suffix, write_volume
    from resample_volume.files.source import generate as generated

    check_suffix(output)
    check_targets(output)
    write_volume(output, generated(name))


@app.command
def fetch(name: str | None = None, /, *, folder: flags.Target = None) -> None:
    """Download a public volume, verify it and print its path; without a name, list all.

    For example:

        resample-volume fetch
        resample-volume fetch fuel
        resample-volume fetch fuel --folder volumes

    Parameters
    ----------
    name
        Name in the open-scivis collection.
    folder
        Folder to keep it in. [default: the user's cache]
    """
    from resample_volume.files import generated as store

    if name is None:
        entries = store.available()
        listed = [f"{key}  {entry['description']}\n" for key, entry in entries.items()]
        sys.stdout.writelines(listed)
    else:
        sys.stdout.write(f"{store.fetch(name, folder=folder)}\n")


app.command(demonstrator(app, "Render the generated volumes.", DEMO))


with_settings(app)
add_command(
    app,
    "volume.convert",
    "Write any volume as OME-Zarr 0.5, brick by brick, with coarser levels of exact means.",
)
add_command(
    app,
    "volume.compare",
    "Render a volume by several methods, footprints, orders and peers, and measure their errors.",
)
add_command(app, "volume.figures", "Reproduce the paper's Figures 1 to 4 and 7 to 9.")


def main() -> NoReturn:
    """Run the process's command line."""
    run(app)


def _listed(facts: dict[str, Any]) -> str:
    """Format facts as lines, the histogram as bars."""
    from resample_volume.classification.scales import edges_of

    shown = {key: value for key, value in facts.items() if key not in UNLISTED}
    for key in ("spacing", "origin"):
        shown[key] = f"{facts[key]} {facts['length_unit']}".rstrip()
    lines = [f"{key.replace('_', ' '):<12} {value}" for key, value in shown.items()]
    for classes, values in facts["thresholds"].items():
        lines.append(f"{f'{classes} classes':<12} {', '.join(f'{v:.6g}' for v in values)}")
    for n, look in enumerate(facts.get("looks", ())):
        words = [look["label"], look["color"], *([look["window"]] if look["window"] else [])]
        lines.append(f"{f'channel {n}':<12} {', '.join(map(str, filter(None, words)))}")
    for n, level in enumerate(facts.get("levels", ())):
        lines.append(f"{f'level {n}':<12} {level['shape']}, spacing {level['spacing']}")
    # Format a histogram as bars on a logarithmic scale, so that rare values show
    counts, by = facts["histogram"], facts["thresholds"]
    low, high = facts["robust_range"] or (0.0, 0.0)
    edges = edges_of((low, high), len(counts), facts["scale"])
    longest = math.log1p(max(*counts, 1))
    bars = ["values from   voxels; logarithmic bars"]
    for n, count in enumerate(counts):
        bar = "#" * math.ceil(BAR * math.log1p(count) / longest) if count else ""
        marks = [k for k, ends in by.items() if any(edges[n] < e <= edges[n + 1] for e in ends)]
        note = f"  <- between {' and '.join(marks)} classes" if marks else ""
        bars.append(f"{edges[n]:>12.6g}  {bar:<{BAR}}  {count}{note}")
    return "\n".join([*lines, *facts["findings"], *bars]) + "\n"
