"""Render films with depth: each picture has a depth map and gets the same new viewpoint."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from resample.command.session import Session
from resample.console import Progress
from resample.files.formats import WriteOptions
from resample.files.pictures import Picture
from resample.files.writing import check_targets, write_json
from resample_warp3d.command.choices import DepthWarping, Extras, Joint
from resample_warp3d.command.depths import appearing, depths_of
from resample_warp3d.command.filming.alignment import DepthRanges, ranges_of
from resample_warp3d.command.filming.choices import FilmInput
from resample_warp3d.command.filming.footage import Footage
from resample_warp3d.command.filming.sources import FilmSources, rectified, with_depth
from resample_warp3d.command.filming.targets import FilmTarget
from resample_warp3d.command.inputs import DepthReader
from resample_warp3d.command.rendering import check_memory, joined, joining_of
from resample_warp3d.command.stereo import StereoRendering
from resample_warp3d.command.target import Aim
from resample_warp3d.command.writing import made_of


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
            pair = stereo.render(session, taken, eyes, sources)
            if progress is not None:
                progress((n + 1) / len(footage))
            yield pair.picture

    with session.stage("film", bar="rendering") as progress:
        target.write(partial(pictures, progress), job)
