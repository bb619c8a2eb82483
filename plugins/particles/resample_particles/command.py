"""`resample-points density`: maps of particles, and films of maps."""

from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from resample.command import flags
from resample.command.flags import Inline
from resample.command.settings import FrameFormat, Sharing
from resample.files.animations import FILMS, check_film
from resample_particles.choices import DensityOptions, write_map
from resample_points.command.choices import CloudStart

DENSITY, START, FORMAT = DensityOptions.usual(), CloudStart.usual(), FrameFormat.usual()
SHARING = Sharing.usual()
MapOutput = Annotated[
    flags.Output,
    Parameter(
        help="Written to: .png in colors, or .exr or .npy with the numbers; as a film to .mp4, "
        ".webp, .gif, .apng, or a folder for numbered .png files."
    ),
]


def density(
    file: Path,
    /,
    *more: Path,
    output: MapOutput,
    look: Annotated[DensityOptions, flags.Flat] = DENSITY,
    start: Annotated[CloudStart, flags.Flat] = START,
    form: Annotated[FrameFormat, flags.Flat] = FORMAT,
    path: Annotated[str | None, Inline(("orbit", "sway", "still"))] = None,
    frames: flags.AppearanceFlag[int | None] = None,
    fps: flags.FramesPerSecond = 24.0,
    resume: flags.Resume = False,
    sharing: Annotated[Sharing, flags.Flat] = SHARING,
) -> None:
    """Map the particles of a simulation: column density, means of a quantity, slices; film them.

    For example:

        resample-points density sample:halo --axis x --color-bar --size 800 -o bar.png
        resample-points density sample:halo --camera 30,20,2 -o numbers.npy
        resample-points density sample:halo --frames 24 -o orbit.gif

    Parameters
    ----------
    file
        .hdf5 or .h5 of SWIFT, GADGET, AREPO or Phantom (any of several files), or .csv, .npz and
        other points with columns mass and h.
    more
        Further files, such as snapshots of later times: each is a frame of a film, framed and
        colored as the first.
    path
        Camera path: orbit, once around; sway, left and right; still; or a file of keyframes or
        poses; of films. [default: orbit; still for several files]
    frames
        Number of frames; of films. [default: 96; for a path as many as its times require]
    """
    from resample.command.session import Session
    from resample.command.workers import check_sharing
    from resample.files.writing import check_targets
    from resample_particles.pictures import density_of, scene_in
    from resample_points.command.rendering import check_memory, write_animation

    shape, files = form.height_and_width(), (file, *more)
    if output.suffix.lower() in FILMS or not output.suffix or output.is_dir():
        check_film(output, fps)
        check_sharing(sharing)
        start.start()
        check_memory(shape, output, sharing.workers or 0)
        look.check_film(output, shape[0], form)
        write_animation(
            output,
            files,
            partial(scene_in, files, look),
            path=path,
            frames=frames,
            fps=fps,
            start=start,
            shape=shape,
            background=form.behind() or (0.0, 0.0, 0.0),
            threads=look.threads,
            resume=resume,
            sharing=sharing,
        )
        return
    look.check(output, shape[0], start)
    if more or path or frames or resume or sharing.model_fields_set:
        raise ValueError(
            f"{output} is one map; give a film ({', '.join(FILMS)} or a folder), or leave out "
            "further files, --path, --frames, --resume and --workers"
        )
    check_targets(output)
    check_memory(shape, output)
    found = density_of(Session(), file, look, start, shape)
    write_map(output, found, look, form)
