"""Write the depth of every frame of a film, as files that `render` can read."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from resample.colors import Background, as_levels
from resample.command.session import Session
from resample.command.settings import Sharing
from resample.console import say
from resample.files.animations import Levels, Shots
from resample.types import Doubles, Floats
from resample_warp3d.command.animation import shots
from resample_warp3d.command.choices import Depth, DepthWarping
from resample_warp3d.command.inputs import DepthReader, read_views
from resample_warp3d.command.numbered import NumberedFiles
from resample_warp3d.command.rendering import CameraFilm, film_of
from resample_warp3d.command.writing import MILLIMETERS, check_depth, write_depth
from resample_warp3d.projection_models import CameraModel

ALONE = Sharing.usual()
KEPT = ".depths"  # folder of finished files, until the film is complete


@dataclass(frozen=True)
class DepthFrames:
    """Depth files of a film; a star in the name stands for the frame's number.

    They are written to a hidden folder and appear when the film is complete.
    """

    pattern: Path
    scale: float | None = None
    _lost: list[int] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_depth(Path(self.files.name.replace("*", "0")))

    @cached_property
    def files(self) -> NumberedFiles:
        """The files by number."""
        return NumberedFiles(self.pattern, KEPT, "depths of a film")

    @property
    def folder(self) -> Path:
        """Folder where the files appear."""
        return self.files.folder

    @property
    def job(self) -> list[object]:
        """What the files depend on besides the film, as JSON values."""
        return [str(self.folder.resolve() / self.files.name), self.scale]

    def holds(self, n: int) -> bool:
        """Whether a frame's depth is written."""
        return self.files.file(n).is_file()

    def write(self, n: int, depth: Floats) -> None:
        """Write a frame's depth (H, W), scene units."""
        scale = MILLIMETERS if self.scale is None else self.scale
        self._lost.append(write_depth(self.files.file(n), depth, scale))

    @contextmanager
    def appearing(self, *, resume: bool | None = None) -> Iterator[None]:
        """Publish the files written in the block when it ends, as `NumberedFiles.appearing`."""
        with self.files.appearing(resume=resume):
            yield
        if sum(self._lost):
            say(f"{self.pattern}: {sum(self._lost)} pixels are too far for 16 bits and dropped")


def depths_of(
    pattern: Path | None, output: Path, meaning: Depth, sharing: Sharing = ALONE
) -> DepthFrames | None:
    """Return the depth files of a film that is written to `output`, if requested."""
    if pattern is None:
        return None
    if sharing.has_workers:
        raise ValueError("depth of frames can only be written by one process; leave workers out")
    frames = DepthFrames(pattern, meaning.scale_of_z)
    if output.resolve() == frames.folder.resolve():
        raise ValueError(
            f"{output} is the folder of the film's frames; give the depth another folder"
        )
    return frames


def frames_of(
    files: tuple[DepthReader, str, str],
    warping: DepthWarping,
    shape: tuple[int, int],
    background: Background,
    poses: Sequence[Doubles],
    camera: CameraModel,
    threads: int,
) -> Callable[[int], Levels]:
    """Return the function that makes frames without depth; raises as `read_views` does."""
    warping = warping.model_copy(update={"threads": threads})
    film = film_of(Session(), read_views(*files), shape, warping, background)
    return shots(poses, camera, film.frame, film.job).frame


def appearing(
    depths: DepthFrames | None, *, resume: bool | None = None
) -> AbstractContextManager[None]:
    """Return `DepthFrames.appearing`, or a context that does nothing."""
    return nullcontext() if depths is None else depths.appearing(resume=resume)


def shots_with_depth(
    poses: Sequence[Doubles], camera: CameraModel, film: CameraFilm, depths: DepthFrames | None
) -> Shots:
    """Return the frames of a path, as `shots` does, that also write depth if requested."""
    if depths is None:
        return shots(poses, camera, film.frame, film.job)

    def frame(n: int) -> Levels:
        seen = film.render(camera.moved(poses[n]))
        depths.write(n, seen.depth)
        return as_levels(film.screen(seen))

    made = shots(poses, camera, film.frame, {**film.job, "depth": depths.job})
    return made._replace(frame=frame, has_more=depths.holds)
