"""Numbered files of a film's frames, and the depth of each, as files that `render` can read."""

import re
import shutil
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from resample.command.settings import Sharing
from resample.console import say
from resample.files.writing import check_targets
from resample.types import Floats
from resample_warp3d.command.choices import Depth
from resample_warp3d.command.writing import MILLIMETERS, check_depth, write_depth

FRAME = "frame-*.png"  # in a folder without a pattern
ALONE = Sharing.usual()
KEPT = ".depths"  # folder of finished files, until the film is complete


@dataclass(frozen=True)
class NumberedFiles:
    """Files of a film, which appear when it is complete; a star stands for the frame's number."""

    pattern: Path
    kept: str
    what: str

    def __post_init__(self) -> None:
        folder, name = self.folder, self.name
        if "*" in str(folder) or name.count("*") != 1:
            raise ValueError(
                f"{self.pattern}: {self.what} are written to a folder, or to files with one * "
                "for the number of the frame, such as depth/*.exr"
            )
        if folder.exists() and not folder.is_dir():
            raise OSError(f"{folder} is not a folder")
        check_targets((folder if folder.is_dir() else folder.parent) / f"{self.kept}.tried")

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
        return names_folder(self.pattern)

    def file(self, n: int) -> Path:
        """Path of a frame's file, while the film is incomplete."""
        return self._hidden / self.name.replace("*", f"{n:04d}")

    @contextmanager
    def appearing(self, *, resume: bool | None = None) -> Iterator[None]:
        """Publish the files written in the block when it ends.

        Then files of earlier films of the same pattern are removed. After an error the finished
        files are kept, and a later block with `resume` continues with them; None keeps nothing.
        """
        kept, is_new = self._hidden, not self.folder.exists()
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

    @property
    def _hidden(self) -> Path:
        return self.folder / self.kept

    def _files(self, folder: Path) -> list[Path]:
        before, after = map(re.escape, self.name.split("*"))
        named = re.compile(f"{before}[0-9]{{4,}}{after}")
        return sorted(file for file in folder.iterdir() if named.fullmatch(file.name))


def names_folder(path: Path) -> bool:
    """Whether a target is a folder by its name: an existing one, or a name without a suffix."""
    return path.is_dir() or not (path.suffix or "*" in path.name)


@dataclass(frozen=True)
class DepthFrames:
    """Depth files of a film; a star in the name stands for the frame's number."""

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


def appearing(
    depths: DepthFrames | None, *, resume: bool | None = None
) -> AbstractContextManager[None]:
    """Return `DepthFrames.appearing`, or a context that does nothing."""
    return nullcontext() if depths is None else depths.appearing(resume=resume)
