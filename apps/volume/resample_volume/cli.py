"""The `resample-volume` command."""

import json
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, NoReturn

from cyclopts import App, Parameter

from resample.options import run
from resample.settings import Picture, Resampling, linear_color
from resample_volume.choices import Look, Source

Flat = Parameter(name="*")  # a model's fields are flags of their own
Output = Annotated[Path, Parameter(alias="-o")]

app = App(
    name="resample-volume",
    help="Volume rendering: splats where voxels grow on screen, points where they shrink.\n\n"
    "Example: resample-volume render checker-box -o box.png",
    version=lambda: version("hybrid-resample"),
)

LOOK, RESAMPLING, PICTURE, SOURCE = Look(), Resampling(), Picture(), Source()
FAR_LOOK = Look(camera="30/20/0.8")  # in a small picture voxels shrink, and primitives differ
MOST_RAYS = 32
DEMO_FOLDER = Path("demo")
DEMO = {  # camera and side of the picture, px
    "checker-box": ("30/25/0.9", 64),  # 0.3 px per voxel, where primitives differ
    "vessel-tree": ("30/15/1", 400),
    "marschner-lobb": ("30/40/1", 400),
}


@app.command
def render(
    volume: str,
    /,
    *,
    output: Output,
    look: Annotated[Look, Flat] = LOOK,
    resampling: Annotated[Resampling, Flat] = RESAMPLING,
    picture: Annotated[Picture, Flat] = PICTURE,
    source: Annotated[Source, Flat] = SOURCE,
    stats: Path | None = None,
) -> None:
    """Render a volume to a picture.

    Example: resample-volume render engine.nhdr -o engine.png --camera 30/20/1.2

    Parameters
    ----------
    volume
        A file, a folder of slices, or checker-box, vessel-tree, marschner-lobb.
    output
        Picture: .png, or .exr with linear RGBA, depth (Z) and coverage.
    stats
        Also write counts and times (.json).
    """
    from resample.console import check_targets, write_json
    from resample.images import check_suffix, write_frame
    from resample_volume.session import Session
    from resample_volume.writing import check_memory

    check_suffix(output)
    size = picture.height_and_width()
    background = _background(picture.background, output)
    resampler = resampling.resampler()
    check_targets(output, stats)
    check_memory(*size)
    session = Session()
    with session.stage("read"):
        scene = source.open(volume)
    samples, camera = session.samples(scene, look, size)
    frame = session.paint(resampler, samples, camera, size, picture.threads)
    with session.stage("write"):
        write_frame(output, frame, bits=picture.bits, background=background)
    if stats is not None:
        write_json(stats, session.report(frame))


@app.command
def compare(
    volume: str,
    /,
    *,
    primitive: str = "points,splats,hybrid",
    footprint: str = "",
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    rays: int = 8,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
    look: Annotated[Look, Flat] = FAR_LOOK,
    size: str = "96",
    source: Annotated[Source, Flat] = SOURCE,
) -> None:
    """Render a volume by several primitives or footprints and measure them.

    The reference is made of exact splats at many rays per pixel.

    Example: resample-volume compare checker-box --primitive points,splats,hybrid -o compare.png

    Parameters
    ----------
    volume
        As in render.
    primitive
        Some of hybrid, points, splats, paper.
    footprint
        Some of exact, corrected, small-angle, affine.
    output
        All pictures side by side (.png).
    rays
        Rays of the reference per side of a pixel, 1 to 32.
    as_json
        Print JSON instead of a table; the PSNR of equal pictures is null.
    """
    from resample.compare import check_sheet, contact_sheet, plain
    from resample.console import check_targets, rows_as_json
    from resample_volume.compare import compare as measured
    from resample_volume.compare import variants
    from resample_volume.session import Session
    from resample_volume.writing import check_memory

    pixels = Picture(size=size).height_and_width()
    choice = variants(Resampling().resampler(), _words(primitive), _words(footprint))
    if not 1 <= rays <= MOST_RAYS:
        raise ValueError(f"{rays} rays per side of a pixel; 1 to {MOST_RAYS} are allowed")
    if output is not None:
        check_sheet(output)
    check_targets(output)
    check_memory(*pixels)
    scene = source.open(volume)
    samples, camera = Session().samples(scene, look, pixels)
    rows, pictures = measured(choice, samples, camera, pixels, rays)
    if output is not None:
        notes = {str(row["picture"]): f"{row['psnr']:.2f} dB, {row['ms']:.0f} ms" for row in rows}
        contact_sheet(pictures, output, captions=notes)
    sys.stdout.write(rows_as_json(rows) if as_json else plain(rows))


@app.command
def info(
    volume: str,
    /,
    *,
    bins: int = 16,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
    source: Annotated[Source, Flat] = SOURCE,
) -> None:
    """Print a volume's size, spacing, range of values and histogram.

    Example: resample-volume info engine.nhdr

    Parameters
    ----------
    volume
        As in render.
    bins
        Of the histogram.
    as_json
        Print JSON.
    """
    from resample_volume.source import describe

    facts = describe(source.open(volume), bins)
    sys.stdout.write(json.dumps(facts, indent=2) + "\n" if as_json else _listed(facts))


@app.command
def generate(name: str, /, *, output: Output) -> None:
    """Write a generated volume to a file.

    Example: resample-volume generate vessel-tree:size=256 -o vessels.nrrd

    Parameters
    ----------
    name
        checker-box, vessel-tree or marschner-lobb, with parameters: checker-box:size=64,block=8.
    output
        .nrrd, .mha, .nii or .nii.gz; or .npy, which keeps the values alone.
    """
    from resample.console import check_targets
    from resample_volume.source import generate as generated
    from resample_volume.writing import check_suffix, write_volume

    check_suffix(output)
    check_targets(output)
    write_volume(output, generated(name))


@app.command
def fetch(name: str | None = None, /, *, folder: Path | None = None) -> None:
    """Download a public volume, check it and print where it is; without a name, list them.

    Example: resample-volume render $(resample-volume fetch engine) -o engine.png

    Parameters
    ----------
    name
        Of the open-scivis collection.
    folder
        Where to keep it; the user's cache.
    """
    from resample_volume import fetch as store

    if name is None:
        entries = store.available()
        sys.stdout.write(
            "".join(f"{key}  {entry['description']}\n" for key, entry in entries.items())
        )
    else:
        sys.stdout.write(f"{store.fetch(name, folder=folder)}\n")


@app.command
def demo(*, output: Output = DEMO_FOLDER) -> None:
    """Render the generated volumes by all three primitives.

    Parameters
    ----------
    output
        Folder; created if missing.
    """
    from resample.compare import contact_sheet
    from resample.console import say
    from resample.images import write_frame
    from resample_volume.session import Session
    from resample_volume.source import generate as generated

    output.mkdir(parents=True, exist_ok=True)
    for name, (camera_angles, side) in DEMO.items():
        session, size, pictures = Session(), (side, side), {}
        samples, camera = session.samples(generated(name), Look(camera=camera_angles), size)
        for primitive in ("hybrid", "points", "splats"):
            resampler = Resampling(primitive=primitive).resampler()
            frame = session.paint(resampler, samples, camera, size, None)
            path = output / f"{name}-{primitive}.png"
            write_frame(path, frame, background=(0.0, 0.0, 0.0))
            say(f"{path}: {frame.statistics.points} points, {frame.statistics.splats} splats")
            pictures[primitive] = frame.rgba
        contact_sheet(pictures, output / f"{name}.png", columns=3)
    sys.stdout.write(f"The pictures are in {output.resolve()}\n")


def main() -> NoReturn:
    """Run the process's command line."""
    run(app)


def _background(name: str | None, output: Path) -> Any:
    """Linear color behind the picture; None leaves it transparent."""
    if name is None:
        name = "none" if output.suffix.lower() == ".exr" else "black"
    return linear_color(name)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _listed(facts: dict[str, Any]) -> str:
    """Facts as lines, the histogram as bars."""
    lines = [f"{key:<10} {value}" for key, value in facts.items() if key != "histogram"]
    counts = facts["histogram"]
    low, high = facts["range"] or (0.0, 0.0)
    for n, count in enumerate(counts):
        bar = "#" * round(40 * count / max(*counts, 1))
        lines.append(f"{low + (high - low) * n / len(counts):>12.6g}  {bar:<40}  {count}")
    return "\n".join(lines) + "\n"
