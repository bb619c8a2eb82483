"""Compare methods on the command line's files, and write figures and the demo."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from resample.command.intrinsics import Shape
from resample.command.session import Session
from resample.files.animations import write_film
from resample.files.pictures import Kind, Picture
from resample_warp3d.command.animation import Range, poses_of, shots
from resample_warp3d.command.choices import DepthWarping
from resample_warp3d.command.inputs import (
    DepthInput,
    DepthReader,
    Inputs,
    TrueView,
    read_truth,
    read_view,
)
from resample_warp3d.command.rendering import film_of
from resample_warp3d.command.target import Aim
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import sourced
from resample_warp3d.types import Equation, Source

if TYPE_CHECKING:
    from resample_warp3d.figures.compare import DepthComparison
    from resample_warp3d.figures.paper import Figure

DEMO_SIZE, DEMO_FRAMES, DEMO_FPS = 256, 24, 12.0


def compare_files(
    given: TrueView, reader: DepthReader, aim: Aim, names: Sequence[str], refine: str = "auto"
) -> "DepthComparison":
    """Compare methods with a true picture."""
    from resample_warp3d.figures.compare import compare_view

    truth, mask = read_truth(Path(str(given.truth)), given.mask)
    size = f"{truth.shape[1]}x{truth.shape[0]}"
    if aim.size not in (None, size):
        raise ValueError(f"{given.truth} has {size} pixels; leave out the size")
    seen = read_view(reader, str(given.color), str(given.depth))
    source, equation, _ = _placed(seen, reader, aim.model_copy(update={"size": size}), refine)
    return compare_view(source, equation, truth, mask, names)


def figure_of_files(
    files: tuple[str, str],
    reader: DepthReader,
    aim: Aim,
    names: Sequence[str],
    refine: str = "auto",
) -> "Figure":
    """Make the paper's Figure 6 from color and depth files; see `compare_files`."""
    from resample_warp3d.figures.paper import figure_of

    source, equation, shape = _placed(read_view(reader, *files), reader, aim, refine)
    return figure_of(source, equation, shape, names)


def _placed(
    seen: DepthInput, reader: DepthReader, aim: Aim, refine: str = "auto"
) -> tuple[Source, Equation, Shape]:
    """Return the prepared source, the equation of its new view, and the frame's shape."""
    full = seen.image.nearness.shape[0], seen.image.nearness.shape[1]
    target = aim.camera(seen.pinhole, full, reader.eye.convention)
    source = sourced(seen.refined(refine), noise=None)
    return source, between(seen.pinhole, target), aim.shape(full)


def write_demo(folder: Path) -> None:
    """Write a figure and an animation of the generated scene."""
    from resample_warp3d.figures.paper import generated_figure, write_figures
    from resample_warp3d.figures.scenes import generated

    write_figures(folder, generated_figure(DEMO_SIZE, "oblique", ("hybrid",)))
    scene, session, choice = generated(DEMO_SIZE), Session(), DepthWarping()
    image = scene.depth_image()
    kind = Kind(("R", "G", "B"), 8, is_encoded=True)
    view = DepthInput(Picture(image.color, kind), image, scene.source, None)
    taken = Inputs([view], view.picture, scene.source, scene.shape)
    film = film_of(session, taken, scene.shape, choice, (0.0, 0.0, 0.0))
    distance = Range.of(image.nearness)
    poses = poses_of("sway", DEMO_FRAMES, None, scene.source.world_to_camera, distance)
    with session.stage("film", bar="rendering") as progress:
        made = shots(poses, scene.source, film.frame, film.job)
        write_film(folder / "sway.gif", made, DEMO_FPS, progress=progress)
