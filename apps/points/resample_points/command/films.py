"""Films around what a file holds: a cloud, 3D Gaussians, or what packages of plugins read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from resample_points.command import gaussians as of_gaussians
from resample_points.command.choices import Aimed, CloudOptions, CloudStart
from resample_points.command.gaussians import GaussianOptions

if TYPE_CHECKING:
    from resample.command.session import Session
    from resample.command.settings import Sharing
    from resample.files.animations import Frames, Shots
    from resample_points.data.cloud import Cloud
    from resample_points.geometry.spacing import Surfels
    from resample_points.scenes import Shape


class Filmed(Protocol):
    """A scene that films go around."""

    @property
    def framing(self) -> "Surfels | Cloud":
        """What cameras are framed around."""

    def upright(self, aim: Aimed, /) -> Aimed:
        """Return cameras with the scene's own axis up, unless another is given."""

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film."""


def holds_gaussians(file: Path, look: CloudOptions, gaussians: GaussianOptions) -> bool:
    """Whether a file holds 3D Gaussians, not points; refuse options of the other."""
    from resample_points.files.gaussians.reading import is_gaussians

    is_of_gaussians = is_gaussians(file)
    others, owner, held = gaussians.model_fields_set, "3D Gaussians", "none"
    if is_of_gaussians:
        others = look.model_fields_set - set(of_gaussians.SHARED)
        owner, held = "clouds of points", "3D Gaussians"
    if others:
        name = "look" if min(others) == "appearance" else min(others).replace("_", "-")
        raise ValueError(
            f"--{name} is an option of {owner}, and {file.name} holds {held}; leave it out"
        )
    return is_of_gaussians


def scene_in(
    files: Sequence[Path],
    look: CloudOptions,
    gaussians: GaussianOptions,
    session: "Session",
    threads: int | None = None,
) -> Filmed:
    """Read what a file holds, or the first of several that are a frame each."""
    from resample_points.command.rendering import ColoredScene, scene_of

    if threads is not None:
        look = look.model_copy(update={"threads": threads})
    if len(files) > 1:
        first = scene_in(files[:1], look, gaussians, session)
        if isinstance(first, ColoredScene) and first.scale is not None:
            look = look.model_copy(update={"span": "{!r},{!r}".format(*first.scale.span)})
        return Sweep(first, files, partial(scene_in, look=look, gaussians=gaussians))
    if holds_gaussians(files[0], look, gaussians):
        return of_gaussians.gaussians_of(session, files[0], look, gaussians)
    return scene_of(session, files[0], look)


@dataclass(frozen=True)
class Sweep:
    """Files that are a frame each, framed as the first."""

    first: Filmed
    files: Sequence[Path]
    read: Callable[..., Filmed]  # of a list with one file, and a session

    @property
    def framing(self) -> "Surfels | Cloud":
        """What cameras are framed around."""
        return self.first.framing

    def upright(self, aim: Aimed) -> Aimed:
        """Return cameras with the scene's own axis up, unless another is given."""
        return self.first.upright(aim)

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film; a frame's file is read when it is made."""
        from resample.command.session import Session
        from resample.files.animations import Shots

        def frame(n: int) -> Any:
            scene = self.read(self.files[n : n + 1], session=Session(is_quiet=True))
            return scene.film(cameras[n : n + 1], shape, background).frame(0)

        job = dict(self.first.film(cameras, shape, background).job)
        known = [(file.resolve(), file.stat()) for file in self.files]
        job["files"] = [[str(file), stat.st_size, stat.st_mtime_ns] for file, stat in known]
        return Shots(len(cameras), frame, job)


def write_animation(
    output: Path,
    files: Sequence[Path],
    read: Callable[..., Filmed],
    *,
    path: str | None,
    frames: int | None,
    fps: float,
    start: CloudStart,
    shape: "Shape",
    background: Any,
    threads: int | None,
    resume: bool,
    sharing: "Sharing",
) -> None:
    """Write a film around what files hold.

    Parameters
    ----------
    read
        Function of a session, and of a number of threads or none, that reads the files; workers
        get it pickled.
    path, frames, fps, resume, sharing
        As for `resample-points animate`.
    shape
        Height and width, px.
    background
        Linear light.
    """
    from resample.command.films import write_shared
    from resample.command.session import Session
    from resample.command.workers import at_work, share_memory
    from resample_points.command.rendering import PATHS, path_of, paths_over
    from resample_points.scenes import cameras_of

    path, frames = paths_over(files, path, frames)
    viewpoints = path_of(path, frames, fps, start.start())
    share_memory(sharing)
    scene = read(session=Session())
    if path in PATHS:
        viewpoints = path_of(path, frames, fps, scene.upright(start).start())
    cameras = cameras_of(scene.framing, viewpoints, shape, steady=start.steady)
    film = scene.film(cameras, shape, background)
    again = partial(frames_of, read, cameras, shape, background)
    with at_work(sharing, threads) as crew:
        write_shared(output, film, again, crew, fps=fps, resume=resume)


def frames_of(
    read: Callable[..., Filmed],
    cameras: Sequence[Any],
    shape: "Shape",
    background: Any,
    threads: int,
) -> "Frames":
    """Return the function that makes frames, in a worker."""
    from resample.command.session import Session

    return read(session=Session(), threads=threads).film(cameras, shape, background).frame
