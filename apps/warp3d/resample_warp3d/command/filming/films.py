"""Render films with depth: each picture has a depth map and gets the same new viewpoint."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.command.session import Session
from resample.console import Progress
from resample.files.formats import WriteOptions
from resample.files.pictures import Picture
from resample.files.writing import check_targets, write_json
from resample_warp3d.command.choices import DepthWarping, Extras, Joint, Showing
from resample_warp3d.command.depths import appearing, depths_of
from resample_warp3d.command.filming.alignment import DepthRanges, ranges_of
from resample_warp3d.command.filming.choices import FilmInput
from resample_warp3d.command.filming.footage import Footage, footage_of
from resample_warp3d.command.filming.sources import FilmSources, rectified, with_depth
from resample_warp3d.command.filming.targets import FilmTarget
from resample_warp3d.command.inputs import DepthReader
from resample_warp3d.command.rendering import check_memory, joined, joining_of
from resample_warp3d.command.stereo import StereoRendering
from resample_warp3d.command.target import Aim
from resample_warp3d.command.writing import made_of


class FilmWriting(NamedTuple):
    """How a film is read and written."""

    output: Path
    options: WriteOptions
    filming: FilmInput
    extras: Extras
    further: Sequence[object] = ()  # views of the same scene
    showing: Showing | None = None

    def footage(self, color: str, depth: str, *, labels: bool = False) -> Footage | None:
        """Open a film, and refuse what is for pictures only; None if it is a picture."""
        footage = footage_of(color, depth, self.filming.fps, labels=labels)
        if footage is None:
            return None
        for name in ("holes", "coverage", "export"):
            if getattr(self.extras, name) is not None:
                raise ValueError(f"--{name} is for pictures, not for films")
        if self.showing is not None:
            self.showing.check_still()
        if self.further:
            raise ValueError("--view is for pictures, not for films")
        return footage


def rendered_film(
    color: str, depth: str, writing: FilmWriting, reader: DepthReader, aim: Aim,
    warping: DepthWarping,
) -> bool:  # fmt: skip
    """Write a film from another viewpoint, and its depth if requested; False for a picture."""
    footage = writing.footage(color, depth, labels=warping.unmixed)
    if footage is None:
        return False
    extras = writing.extras
    depths = depths_of(extras.depth_output, writing.output, reader.meaning)
    if depths is not None:
        footage.check_apart(depths.folder)
    target = FilmTarget(writing.output, footage, writing.options)
    target.check()
    check_targets(extras.stats)
    session = Session()
    ranges = _ranges(session, footage, reader, writing.filming)
    read = with_depth(footage, reader, ranges)
    film = FilmSources(session, footage, read, ranges, warping)

    def pictures(progress: Progress | None, start: int) -> Iterator[Picture]:
        for n in range(start, len(footage)):
            taken, sources = film.prepared(n)
            shape = aim.shape(taken.shape)
            if n == 0:
                check_memory(taken.views, shape, writing.output)
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
    return True


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
        ranges = _ranges(session, footage, reader, filming)
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


def _ranges(
    session: Session, footage: Footage, reader: DepthReader, filming: FilmInput
) -> DepthRanges:
    with session.stage("align", bar="aligning depth") as progress:
        return ranges_of(footage, reader, filming, progress)
