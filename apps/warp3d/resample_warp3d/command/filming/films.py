"""Render films with depth, each picture from the same new viewpoint, to files and folders."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from resample.command.session import Session
from resample.console import Progress
from resample.files.films import PLAIN, UNMARKED, FilmCoding, StereoMarks
from resample.files.formats import FORMATS, WriteOptions, check_output
from resample.files.pictures import Picture
from resample.files.saving import write_picture
from resample.files.sequences import check_frames, write_frames, write_in_parts
from resample.files.writing import check_targets, write_json
from resample_warp3d.command.choices import DepthWarping, Extras, Joint
from resample_warp3d.command.depths import appearing, depths_of
from resample_warp3d.command.filming.choices import FilmInput
from resample_warp3d.command.filming.footage import Footage
from resample_warp3d.command.filming.sources import (
    DepthRanges,
    FilmSources,
    ranges_of,
    rectified,
    with_depth,
)
from resample_warp3d.command.inputs import DepthReader
from resample_warp3d.command.numbered import NumberedFiles, names_folder
from resample_warp3d.command.rendering import check_memory, joined, joining_of
from resample_warp3d.command.stereo import StereoRendering
from resample_warp3d.command.target import Aim
from resample_warp3d.command.writing import made_of

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
    coding
        How films are encoded.
    marks
        What players have to know of two eyes.
    resume
        Whether an interrupted run is continued; None: nothing of one is kept.

    Raises
    ------
    ValueError, OSError
        The target is none of these, or would replace the film it is made of.
    """

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


def render_film(
    footage: Footage, output: Path, options: WriteOptions, filming: FilmInput, extras: Extras,
    others: Mapping[str, bool], reader: DepthReader, aim: Aim, warping: DepthWarping,
) -> None:  # fmt: skip
    """Write a film from another viewpoint, and its depth if requested.

    `others`: whether further options that are for pictures are given.
    """
    for name in ("holes", "coverage", "export", *others):
        if others.get(name, getattr(extras, name, None)):
            raise ValueError(f"--{name} is for pictures, not for films")
    depths = depths_of(extras.depth_output, output, reader.meaning)
    if depths is not None:
        footage.check_apart(depths.folder)
    target = FilmTarget(output, footage, options)
    target.check()
    check_targets(extras.stats)
    session = Session()
    ranges = ranges_of(session, footage, reader, filming)
    read = with_depth(footage, reader, ranges)
    film = FilmSources(session, footage, read, ranges, warping)

    def pictures(progress: Progress | None, start: int) -> Iterator[Picture]:
        for n in range(start, len(footage)):
            taken, sources = film.prepared(n)
            shape = aim.shape(taken.shape)
            if n == 0:
                check_memory(taken.views, shape, output)
            camera = aim.camera_model(taken.camera, taken.shape, reader.eye.convention)
            joining = joining_of(taken, Joint.usual(), unmixed=warping.unmixed)
            seen = joined(session, sources, camera, shape, warping, joining).warped
            if depths is not None:
                depths.write(n, seen.depth)
            if progress is not None:
                progress((n + 1) / len(footage))
            yield made_of(seen, taken.picture.kind, warping)

    with session.stage("film", bar="rendering") as progress, appearing(depths):
        target.write(partial(pictures, progress), {})
    if extras.stats is not None:
        about = {"pictures": len(footage), **ranges.report(), "seconds": session.times()}
        write_json(extras.stats, about)


def stereo_film(
    session: Session, target: FilmTarget, filming: FilmInput, reader: DepthReader | None,
    stereo: StereoRendering, disparity_scale: float | None, job: Mapping[str, Any],
) -> None:  # fmt: skip
    """Write a film for two eyes.

    `reader`: of depth; None: disparity of a rectified pair, in `disparity_scale` values per px.
    `job`: JSON values that the pictures depend on, to continue an interrupted run.
    """
    target.check()
    footage, ranges = target.footage, DepthRanges(None)
    if reader is None:
        read = rectified(footage, disparity_scale)
    else:
        if reader.meaning.is_relative and not stereo.is_around:
            footage = footage.without_bars()
        ranges = ranges_of(session, footage, reader, filming)
        read = with_depth(footage, reader, ranges)
    film = FilmSources(session, footage, read, ranges, stereo.warping)
    surveyed = [film.read(n) for n in footage.surveyed()]
    bars = np.ones(surveyed[0].shape, bool)
    footage.inside(bars)[...] = False
    stereo = replace(stereo, bars=bars if bars.any() else None)
    eyes = stereo.eyes(surveyed, is_pair=reader is None)
    film.staged = partial(stereo.staged, eyes=eyes)

    def pictures(progress: Progress | None, start: int) -> Iterator[Picture]:
        for n in range(start, len(footage)):
            taken, sources = film.prepared(n)
            if n == start:
                check_memory(taken.views, stereo.shape(taken), target.path)
            picture, *_ = stereo.render(session, taken, eyes, sources)
            if progress is not None:
                progress((n + 1) / len(footage))
            yield picture

    with session.stage("film", bar="rendering") as progress:
        target.write(partial(pictures, progress), job)
