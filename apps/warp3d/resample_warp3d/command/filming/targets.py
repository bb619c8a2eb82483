"""Targets of films: files of several pictures, or folders and patterns of pictures."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from resample.files.formats import WriteOptions, check_output
from resample.files.pictures import Picture
from resample.files.saving import write_picture
from resample.files.sequences import check_frames, write_frames
from resample.files.writing import check_targets
from resample_warp3d.command.filming.footage import Footage
from resample_warp3d.command.numbered import NumberedFiles, names_folder

KEPT = ".pictures"  # folder of finished pictures, until the film is complete


@dataclass(frozen=True)
class FilmTarget:
    """Where a film is written to.

    Parameters
    ----------
    path
        Film, animation or TIFF; folder for numbered .png files; or a name with a star for the
        frame's number, such as `moved/*.exr`.
    footage
        The film it is made of.
    options
        How pictures are written.

    Raises
    ------
    ValueError, OSError
        The target is none of these, or would replace the film it is made of.
    """

    path: Path
    footage: Footage
    options: WriteOptions

    @cached_property
    def files(self) -> NumberedFiles | None:
        """The files by number; None: the target is one file."""
        if not names_folder(self.path) and "*" not in self.path.name:
            return None
        return NumberedFiles(self.path, KEPT, "pictures of a film")

    def check(self, *, transparent: bool) -> None:
        """Refuse what cannot be written, before any work is done."""
        if self.files is None:
            check_targets(self.path)
            check_frames(self.path, self.footage.frames, self.options)
            return
        self.footage.check_apart(self.files.folder)
        self.footage.frames.tell_tracks(self.path)
        check_output(Path(self.files.name), self.options, transparent=transparent)

    def write(self, pictures: Iterable[Picture]) -> None:
        """Write the pictures; nothing is left if one cannot be made."""
        if self.files is None:
            write_frames(self.path, pictures, self.footage.frames, self.options)
            return
        with self.files.appearing():
            for n, picture in enumerate(pictures):
                write_picture(self.files.file(n), picture, self.options)
