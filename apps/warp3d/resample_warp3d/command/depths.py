"""Write the depth of every frame of a film, as files that `render` can read."""

import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from resample.colors import Background, as_levels
from resample.command.session import Session
from resample.command.settings import Sharing
from resample.console import say
from resample.files.animations import Levels, Shots
from resample.files.writing import check_targets
from resample.types import Doubles, Floats
from resample_warp3d.command.animation import shots
from resample_warp3d.command.choices import Depth, DepthWarping
from resample_warp3d.command.inputs import DepthReader, read_views
from resample_warp3d.command.rendering import CameraFilm, film_of
from resample_warp3d.command.writing import MILLIMETERS, check_depth, write_depth
from resample_warp3d.wide import CameraModel

ALONE = Sharing.usual()
FRAME = "frame-*.png"  # in a folder without a pattern
KEPT = ".depths"  # folder of finished files, until the film is complete


@dataclass(frozen=True)
class DepthFrames:
    """Depth files of a film; a star in the name stands for the frame's number.

    They are written to a hidden folder and appear when the film is complete.

    Parameters
    ----------
    pattern
        Folder, for 16-bit PNGs, or `folder/name-*.png`, `.exr` or `.npy`.
    scale
        Values of a PNG per scene unit; None: `MILLIMETERS`.

    Raises
    ------
    ValueError, OSError
        The pattern is neither, or the folder cannot be created.
    """

    pattern: Path
    scale: float | None = None
    _lost: list[int] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        folder, name = self.folder, self.name
        if "*" in str(folder) or name.count("*") != 1:
            raise ValueError(
                f"{self.pattern}: depth of a film is written to a folder, or to files with one * "
                "for the number of the frame, such as depth/*.exr"
            )
        check_depth(Path(name.replace("*", "0")))
        if folder.exists() and not folder.is_dir():
            raise OSError(f"{folder} is not a folder")
        check_targets((folder if folder.is_dir() else folder.parent) / f"{KEPT}.tried")

    @property
    def folder(self) -> Path:
        """Folder where the files appear."""
        return self.pattern if self._is_folder else self.pattern.parent

    @property
    def name(self) -> str:
        """File name, with a star."""
        return FRAME if self._is_folder else self.pattern.name

    @property
    def _is_folder(self) -> bool:
        return self.pattern.is_dir() or not (self.pattern.suffix or "*" in self.pattern.name)

    @property
    def job(self) -> list[object]:
        """What the files depend on besides the film, as JSON values."""
        return [str(self.folder.resolve() / self.name), self.scale]

    def holds(self, n: int) -> bool:
        """Whether a frame's depth is written."""
        return self._file(n).is_file()

    def write(self, n: int, depth: Floats) -> None:
        """Write a frame's depth (H, W), scene units."""
        scale = MILLIMETERS if self.scale is None else self.scale
        self._lost.append(write_depth(self._file(n), depth, scale))

    @contextmanager
    def appearing(self, *, resume: bool | None = None) -> Iterator[None]:
        """Publish the files written in the block when it ends.

        Then files of earlier films of the same pattern are removed. After an error the finished
        files are kept, and a later block with `resume` continues with them; None keeps nothing.
        """
        kept, is_new = self._kept, not self.folder.exists()
        if not resume:
            shutil.rmtree(kept, ignore_errors=True)
        kept.mkdir(parents=True, exist_ok=True)
        try:
            yield
        except BaseException:
            if resume is None or not self._files(kept):
                shutil.rmtree(kept, ignore_errors=True)
                with suppress(OSError):  # the folder holds other files
                    if is_new:
                        self.folder.rmdir()
            raise
        for earlier in self._files(self.folder):
            earlier.unlink()
        for file in self._files(kept):
            file.replace(self.folder / file.name)
        shutil.rmtree(kept)
        if sum(self._lost):
            say(f"{self.pattern}: {sum(self._lost)} pixels are too far for 16 bits and dropped")

    @property
    def _kept(self) -> Path:
        return self.folder / KEPT

    def _file(self, n: int) -> Path:
        return self._kept / self.name.replace("*", f"{n:04d}")

    def _files(self, folder: Path) -> list[Path]:
        before, after = map(re.escape, self.name.split("*"))
        named = re.compile(f"{before}[0-9]{{4,}}{after}")
        return sorted(file for file in folder.iterdir() if named.fullmatch(file.name))


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


class ToFilm(NamedTuple):
    """Inputs of a film's frames, by name, for workers."""

    reader: DepthReader
    color: str
    depth: str
    warping: DepthWarping
    shape: tuple[int, int]  # height and width, px
    background: Background


def frames_of(
    given: ToFilm, poses: Sequence[Doubles], camera: CameraModel, threads: int
) -> Callable[[int], Levels]:
    """Return the function that makes frames without depth; raises as `read_views` does."""
    taken = read_views(given.reader, given.color, given.depth)
    warping = given.warping.model_copy(update={"threads": threads})
    film = film_of(Session(), taken, given.shape, warping, given.background)
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
