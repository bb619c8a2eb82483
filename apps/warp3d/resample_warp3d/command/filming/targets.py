"""Targets of films: files of several pictures, or folders and patterns of pictures."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any

from resample.files.films import FORMATS, PLAIN, UNMARKED, FilmCoding, StereoMarks
from resample.files.formats import WriteOptions, check_output
from resample.files.pictures import Picture
from resample.files.saving import write_picture
from resample.files.sequences import check_frames, write_frames, write_in_parts
from resample.files.writing import check_targets
from resample_warp3d.command.filming.footage import Footage
from resample_warp3d.command.numbered import NumberedFiles, names_folder

KEPT = ".pictures"  # folder of finished pictures, until the film is complete


@dataclass(frozen=True)
class FilmTarget:
    """Where a film is written to: a film, animation or TIFF; a folder; or a name with a star."""

    path: Path
    footage: Footage
    options: WriteOptions
    coding: FilmCoding = PLAIN
    marks: StereoMarks = UNMARKED
    resume: bool | None = None

    @cached_property
    def files(self) -> NumberedFiles | None:
        """The files by number; None: the target is one file."""
        if not names_folder(self.path) and "*" not in self.path.name:
            return None
        return NumberedFiles(self.path, KEPT, "pictures of a film")

    @property
    def _is_film(self) -> bool:
        return self.files is None and self.path.suffix.lower() in FORMATS

    def check(self) -> None:
        """Refuse what cannot be written, before any work is done."""
        if self.files is None:
            check_targets(self.path)
            check_frames(self.path, self.footage.frames, self.options)
            if self.resume and not self._is_film:
                raise ValueError(
                    f"{self.path}: --resume is for folders and {', '.join(FORMATS)}; leave it out"
                )
            return
        self.footage.check_apart(self.files.folder)
        self.footage.frames.tell_tracks(self.path)
        check_output(Path(self.files.name), self.options)

    def write(self, pictures: Callable[[int], Iterable[Picture]], job: Mapping[str, Any]) -> None:
        """Write the pictures that a function gives from a number on.

        Films and folders can be resumed, the former if the job is the same; of other files nothing
        is left if a picture cannot be made.
        """
        if self.files is None and not self._is_film:
            write_frames(self.path, pictures(0), self.footage.frames, self.options)
            return
        if self.files is None:
            whole = {**job, "coding": list(self.coding), "frames": len(self.footage)}
            write_in_parts(
                self.path, pictures, self.footage.frames, self.options, self.coding, self.marks,
                whole, resume=self.resume,
            )  # fmt: skip
            return
        with self.files.appearing(resume=self.resume):
            first = next(n for n in count() if not self.files.file(n).is_file())
            for n, picture in enumerate(pictures(first), first):
                write_picture(self.files.file(n), picture, self.options)
