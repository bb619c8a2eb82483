"""Depth images warped for the command line, with their times kept."""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.colors import Background
from resample.command.console import progress_bar, say
from resample.files.animations import fingerprint, write_film
from resample.files.pictures import Kind, Picture
from resample.memory import require_memory
from resample.types import Floats
from resample_warp3d.cameras.models import Camera
from resample_warp3d.command.animation import Range, on_screen, poses_of, shots
from resample_warp3d.command.choices import Aim, Shape, Warping, with_intrinsics
from resample_warp3d.command.inputs import Reader, TrueView, View, read_truth, read_view
from resample_warp3d.depth.equation import between, of_rectified
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.sheet.filling import fill
from resample_warp3d.types import Equation, Hole, Source, Warped

if TYPE_CHECKING:
    from resample_warp3d.clouds.files import Cloud
    from resample_warp3d.showing.compare import Comparison
    from resample_warp3d.showing.figures import Figure

BYTES_PER_PIXEL = 160  # of a target and the copies that are made when it is warped and written
DEMO_SIZE, DEMO_FRAMES, DEMO_FPS = 256, 24, 12.0
FEW = 1e-4  # of the pixels; fewer are not spoken about


class Prepared(NamedTuple):
    """A source and the camera that took it."""

    source: Source
    camera: Camera


class Film(NamedTuple):
    """Frames of a camera that moves."""

    frame: Callable[[Camera], Floats]
    job: Mapping[str, object]


@dataclass
class Session:
    """Stages of a warp, timed; what the user should know goes to stderr."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Book the time of a block under a name."""
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def prepared(self, views: Sequence[View], choice: Warping) -> list[Prepared]:
        """Sources ready to be warped."""
        announce_compilation()
        with self.stage("prepare"), progress_bar("preparing"):
            return [
                Prepared(prepare(view.image, noise=choice.noise, step=view.step), view.camera)
                for view in views
            ]

    def warped(
        self, sources: Sequence[Prepared], target: Camera, shape: Shape, choice: Warping
    ) -> Warped:
        """Sources as a camera sees them together in a frame (height, width)."""
        equations = [between(prepared.camera, target) for prepared in sources]
        return self._rendered([prepared.source for prepared in sources], equations, shape, choice)

    def shifted(self, source: Source, fraction: float, shape: Shape, choice: Warping) -> Warped:
        """Picture of a rectified pair as seen from a fraction of the way to the other eye."""
        return self._rendered([source], [of_rectified(fraction)], shape, choice)

    def _rendered(
        self,
        sources: Sequence[Source],
        equations: Sequence[Equation],
        shape: Shape,
        choice: Warping,
    ) -> Warped:
        from resample_warp3d.merging import merge
        from resample_warp3d.warping import render

        method = choice.built()
        with self.stage("warp"):
            each = [
                render(source, equation, shape, method, choice.threads, filter=choice.filter)
                for source, equation in zip(sources, equations, strict=True)
            ]
            together = each[0] if len(each) == 1 else merge(each)
        if not choice.fill:
            return together
        with self.stage("fill"):
            return fill(together)

    def report(self, views: Sequence[View], warped: Warped, choice: Warping) -> dict[str, Any]:
        """Sizes, shares and times, for `--stats`."""
        covered = warped.magnification > 0
        return {
            "sources": [list(view.image.nearness.shape[::-1]) for view in views],
            "size": list(warped.coverage.shape[::-1]),
            "method": choice.method,
            "covered": round(float(warped.coverage.mean()), 6),
            "holes": {
                hole.name.lower(): round(float((warped.holes == hole).mean()), 6) for hole in Hole
            },
            "magnification": (
                round(float(np.median(warped.magnification[covered])), 6) if covered.any() else None
            ),
            "seconds": {name: round(seconds, 6) for name, seconds in self.seconds.items()},
        }


def film_of(
    session: Session, view: View, shape: Shape, choice: Warping, background: Background
) -> Film:
    """Film of a view: what its frames (H, W, 3) look like, and what they depend on."""
    sources = session.prepared([view], choice)

    def frame(camera: Camera) -> Floats:
        warped = session.warped(sources, camera, shape, choice)
        return on_screen(warped, has_alpha=view.picture.kind.has_alpha, background=background)

    job = {
        "source": fingerprint(view.image.color, view.image.nearness, view.image.place),
        "camera": [view.camera.matrix.tolist(), view.camera.world_to_camera.tolist()],
        "size": list(shape),
        "choices": choice.model_dump(exclude={"threads"}),
        "background": list(background),
        "version": version("hybrid-resample"),
    }
    return Film(frame, job)


def compare_files(given: TrueView, reader: Reader, aim: Aim, names: Sequence[str]) -> "Comparison":
    """Methods compared with a true picture.

    Parameters
    ----------
    given
        Files, all but the mask there.
    reader, aim
        How they are understood, and from where the true picture was taken.
    names
        Methods.

    Raises
    ------
    OSError, ValueError, LookupError
        A file cannot be read, or a choice cannot be worked with.
    """
    from resample_warp3d.showing.compare import compare_view

    truth = read_truth(Path(str(given.truth)), given.mask)
    size = f"{truth.color.shape[1]}x{truth.color.shape[0]}"
    if aim.size not in (None, size):
        raise ValueError(f"{given.truth} has {size} pixels; leave out the size")
    seen = read_view(reader, str(given.color), str(given.depth))
    source, equation, _ = _placed(seen, reader, aim.model_copy(update={"size": size}))
    return compare_view(source, equation, truth.color, truth.mask, names)


def figure_of_files(
    files: tuple[str, str], reader: Reader, aim: Aim, names: Sequence[str]
) -> "Figure":
    """The paper's Figure 6 of color and depth files; see `compare_files`."""
    from resample_warp3d.showing.figures import figure_of

    source, equation, shape = _placed(read_view(reader, *files), reader, aim)
    return figure_of(source, equation, shape, names)


def _placed(seen: View, reader: Reader, aim: Aim) -> tuple[Source, Equation, Shape]:
    """Prepared source, equation that leads to its new view, and the frame of that."""
    full = seen.image.nearness.shape[0], seen.image.nearness.shape[1]
    target = aim.camera(seen.camera, full, reader.eye.convention)
    announce_compilation()
    return prepare(seen.image, step=seen.step), between(seen.camera, target), aim.shape(full)


def write_demo(folder: Path) -> None:
    """Write a figure of the generated scene and an animation in it."""
    from resample_warp3d.showing.figures import generated_figure, write_figures
    from resample_warp3d.showing.scenes import generated

    announce_compilation()
    write_figures(folder, generated_figure(DEMO_SIZE, "oblique", ("hybrid", "mcmillan")))
    scene, session, choice = generated(DEMO_SIZE), Session(), Warping()
    image = scene.depth_image()
    kind = Kind(("R", "G", "B"), 8, is_encoded=True)
    view = View(Picture(image.color, kind), image, scene.source, None)
    film = film_of(session, view, scene.shape, choice, (0.0, 0.0, 0.0))
    distance = Range.of(image.nearness)
    poses = poses_of("sway", DEMO_FRAMES, None, scene.source.world_to_camera, distance)
    with progress_bar("moving") as progress:
        made = shots(poses, scene.source, film.frame, film.job)
        write_film(folder / "sway.gif", made, DEMO_FPS, progress=progress)


def cloud_camera(
    cloud: "Cloud",
    shape: Shape,
    angles: tuple[float, float, float],
    up: str,
    calibrated: tuple[str, str] | None,
) -> Camera:
    """Camera that looks at a cloud.

    Parameters
    ----------
    cloud
        Points.
    shape
        Height and width of the picture, px.
    angles, up
        Azimuth and elevation in degrees, and zoom; and the axis that points upwards.
    calibrated
        In their place, if not None, the words of a pose and of intrinsics.

    Raises
    ------
    ValueError, LookupError, OSError
        The numbers are no camera's, or a file cannot be read.
    """
    from resample_warp3d.cameras.poses import read_pose
    from resample_warp3d.clouds.framing import framed

    if calibrated is not None:
        pose, intrinsics = calibrated
        return with_intrinsics("intrinsics", intrinsics, "corner", read_pose(pose), None)
    azimuth, elevation, zoom = angles
    if not 0.0 < zoom < math.inf:
        raise ValueError(f"a zoom of {zoom:g}; give a factor above 0")
    camera = framed(cloud, size=shape, azimuth=azimuth, elevation=elevation, up=up)
    matrix = camera.matrix.copy()
    matrix[:2, :2] *= zoom
    return Camera(matrix, camera.world_to_camera)


def check_memory(shape: Shape, channels: int) -> None:
    """Refuse a target that this machine cannot hold, before any work is done."""
    height, width = shape
    needed = (BYTES_PER_PIXEL + 16 * channels) * height * width
    require_memory(needed, f"a picture of {width} x {height} pixels", "take a smaller size")


def mention_holes(warped: Warped) -> None:
    """Say what of a picture no source shows."""
    if not warped.coverage.any():
        say("nothing of the source is in view; check the poses and the depth's scale")
        return
    shares = [(hole, float((warped.holes == hole).mean())) for hole in HOLES]
    told = [f"{share:.2%} {HOLES[hole]}" for hole, share in shares if share > FEW]
    if told:
        say(f"holes: {', '.join(told)}; --holes shows them, --fill makes them up")


HOLES = {
    Hole.DISOCCLUDED: "hidden in the source",
    Hole.OUTSIDE: "outside of it",
    Hole.NO_DEPTH: "without depth",
}


def announce_compilation() -> None:
    """Say on stderr that the first run takes longer, if this is one."""
    from resample.engine.jit import is_stored
    from resample_warp3d.depth.kernels.linking import link_rows

    if not is_stored(link_rows):
        say("compiling kernels, once per installation: about 20 seconds")
