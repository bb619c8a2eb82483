"""Files of a film's frames, with the frame's number in their names."""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from resample.files.writing import check_targets

FRAME = "frame-*.png"  # in a folder without a pattern


@dataclass(frozen=True)
class NumberedFiles:
    """Files of a film; a star in the name stands for the frame's number.

    They are written to a hidden folder and appear when the film is complete.
    """

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
