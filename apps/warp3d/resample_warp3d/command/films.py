"""Films with depth: pictures as prepared sources, rendered one by one to files and folders."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.command.flags import Shape
from resample.command.session import Session
from resample.console import Progress, say
from resample.files.films import PLAIN, UNMARKED, FilmCoding, StereoMarks
from resample.files.formats import FORMATS, WriteOptions, check_output
from resample.files.pictures import Picture
from resample.files.saving import write_picture
from resample.files.sequences import check_frames, write_frames, write_in_parts
from resample.files.writing import check_targets, write_json
from resample.types import Floats
from resample_warp3d.command.choices import DepthWarping, Extras, FilmInput, Joint
from resample_warp3d.command.depths import NumberedFiles, appearing, depths_of, names_folder
from resample_warp3d.command.footage import Footage
from resample_warp3d.command.inputs import (
    DepthReader,
    Inputs,
    inputs_of,
    mention_doubt,
    rectified_of,
)
from resample_warp3d.command.rendering import Prepared, check_memory, joined, joining_of, prepared
from resample_warp3d.command.stereo import StereoRendering
from resample_warp3d.command.target import Aim
from resample_warp3d.command.writing import made_of
from resample_warp3d.depth.encodings import RelativeDepth
from resample_warp3d.depth.refining.conditioning import RefinementChoice
from resample_warp3d.depth.refining.inspecting import is_sharpened
from resample_warp3d.depth.stabilization import SteadyDepth
from resample_warp3d.depth.temporal import Alignment, Thumbnail, align, thumbnail

ReadInputs = Callable[[int], Inputs]
Ends = tuple[float, float]
KEPT = ".pictures"  # folder of finished pictures, until the film is complete


class DepthRanges(NamedTuple):
    """Range of the relative depth of each picture, and the first picture of each shot."""

    ends: list[Ends] | None  # None: depth is not relative
    starts: tuple[int, ...] = (0,)
    found: Alignment | None = None  # None: depth was not aligned
    extent: float | None = None  # of the nearness of depth to be kept steady; None: it is not

    def first_of(self, n: int) -> int:
        """Return the first picture of a picture's shot."""
        return max(start for start in self.starts if start <= n)

    def reader(self, reader: DepthReader, n: int) -> DepthReader:
        """Return the reader of a picture's depth."""
        return reader if self.ends is None else reader._replace(ends=self.ends[n])

    def report(self) -> dict[str, Any]:
        """Return what was done, for `--stats`."""
        if self.found is None:
            return {"temporal": "none"}
        return {
            "temporal": "aligned" if any(self.found.aligned) else "unchanged",
            "shots": list(self.starts),
            "aligned": list(self.found.aligned),
            "scale": [round(float(each), 6) for each in self.found.scale],
            "shift": [round(float(each), 6) for each in self.found.shift],
        }


def ranges_of(
    session: Session, footage: Footage, reader: DepthReader, filming: FilmInput
) -> DepthRanges:
    """Find and report the range of relative depth for each picture; unaligned, one for all."""
    if not reader.meaning.is_relative:
        return DepthRanges(None)
    each: list[Ends] = []
    is_plain = filming.temporal == "none"

    def small(progress: Progress | None) -> Iterator[Thumbnail]:
        for n in range(len(footage)):
            raw = footage.inside(footage.depths[n])
            each.append(RelativeDepth.ends_of(raw))
            if progress is not None:
                progress((n + 1) / len(footage))
            if not is_plain:
                yield thumbnail(footage.inside(footage.pictures[n].data), raw)

    with session.stage("align", bar="aligning depth") as progress:
        found = align(small(progress))
    if is_plain:
        ends = min(low for low, _ in each), max(high for _, high in each)
        return DepthRanges([ends] * len(footage))
    parts = []
    if any(found.aligned):
        parts.append(
            f"the scales of {len(found.scale)} maps, which differ by up to {found.changes:.1%}, "
            "and their shifts are aligned"
        )
    if len(found.starts) > 1:
        cuts = ", ".join(map(str, found.starts[1:]))
        parts.append(f"each shot has its own range; cuts before picture {cuts}")
    if parts:
        say(f"depth: {'; '.join(parts)}; --temporal none takes them as they are")
    near, far = reader.meaning.range()
    return DepthRanges(found.ends(each), found.starts, found, 1.0 / near - 1.0 / far)


def with_depth(footage: Footage, reader: DepthReader, ranges: DepthRanges) -> ReadInputs:
    """Return the function that reads a picture of a film with its depth; warns of doubt once."""
    if reader.meaning.confidence is not None:
        raise ValueError("--confidence is of one picture; leave it out for films")

    softness: dict[int, bool] = {}  # of small maps, by a shot's first picture

    def read(n: int) -> Inputs:
        first, names = ranges.first_of(n), footage.names(n)
        if first not in softness and n != first:
            read(first)

        def is_soft(nearness: Floats) -> bool:
            if first not in softness:
                softness[first] = is_sharpened(nearness)
            return softness[first]

        own = ranges.reader(reader, n)._replace(is_soft=is_soft)
        taken = inputs_of(own, footage.pictures[n], footage.depths[n], names)
        softness.setdefault(first, False)
        if n == 0:
            mention_doubt(own, taken.views[0], names[1])
        return taken

    return read


@dataclass
class FilmSources:
    """Pictures of a film as sources; a shot's first picture chooses the refinement for all."""

    session: Session
    footage: Footage
    read: ReadInputs
    ranges: DepthRanges
    warping: DepthWarping
    staged: Callable[[Inputs], Inputs] = lambda taken: taken  # changes of its depth
    _chosen: dict[int, list[RefinementChoice]] = field(
        default_factory=dict, init=False
    )  # by first picture, of the last shot
    _shape: Shape | None = field(default=None, init=False)
    _last: tuple[int, Inputs] | None = field(default=None, init=False)  # picture kept steady
    _steady: list[SteadyDepth] = field(default_factory=list, init=False)  # of each view
    _steps: list[float | None] = field(default_factory=list, init=False)

    def inputs(self, n: int) -> Inputs:
        """Read a picture, and those of the shot before it, by which relative depth is steadied."""
        extent = self.ranges.extent
        if extent is None:
            return self._checked(n)
        start, taken = self.ranges.first_of(n), None
        if self._last is not None and start <= self._last[0] <= n:
            start, taken = self._last[0] + 1, self._last[1]
        for each in range(start, n + 1):
            taken = self._checked(each)
            if each in self.ranges.starts:
                self._steady = [SteadyDepth(extent) for _ in taken.views]
                self._steps = [view.step for view in taken.views]
            views = []
            for view, steady, step in zip(taken.views, self._steady, self._steps, strict=True):
                nearness = steady.added(view.image.color, view.image.nearness)
                image = view.image._replace(nearness=nearness)
                views.append(view._replace(image=image, step=step))
            taken = taken._replace(views=views)
            self._last = each, taken
        if taken is None:
            raise IndexError(n)
        return taken

    def _checked(self, n: int) -> Inputs:
        taken = self.read(n)
        if self._shape is None:
            self._shape = taken.shape
        if taken.shape != self._shape:
            (height, width), (rows, columns) = self._shape, taken.shape
            raise ValueError(
                f"{self.footage.names(n)[0]} has {columns} x {rows} pixels, pictures before it "
                f"{width} x {height}; a film needs pictures of one size"
            )
        return taken

    def prepared(self, n: int) -> tuple[Inputs, list[Prepared]]:
        """Read a picture; also return its prepared sources."""
        first = self.ranges.first_of(n)
        if n != first and first not in self._chosen:
            self.prepared(first)
        taken = self.staged(self.inputs(n))
        chosen = None if n == first else self._chosen[first]
        sources = prepared(self.session, taken.views, self.warping, chosen)
        if n == first:
            self._chosen = {n: [source.refined.choice for source in sources]}
        return taken, sources


@dataclass(frozen=True)
class FilmTarget:
    """Where a film is written to, which is not the film that it is made of."""

    path: Path  # film, animation or TIFF; folder for numbered .png files; or a name with a star
    footage: Footage  # film that it is made of
    options: WriteOptions
    coding: FilmCoding = PLAIN
    marks: StereoMarks = UNMARKED
    resume: bool | None = None  # whether a run is continued; None: nothing of one is kept

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
        """Write the pictures that a function gives from a number on, or go on with the same job."""
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
    """Write a film from another viewpoint; `others`: which options for pictures are given."""
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
    """Write a film for two eyes; without a reader depth is the disparity of a rectified pair."""
    target.check()
    footage, ranges = target.footage, DepthRanges(None)
    if reader is not None:
        if reader.meaning.is_relative and not stereo.is_around:
            footage = footage.without_bars()
        ranges = ranges_of(session, footage, reader, filming)
        read = with_depth(footage, reader, ranges)
    else:

        def read(n: int) -> Inputs:
            names = footage.names(n)
            return rectified_of(footage.pictures[n], footage.depths[n], names, disparity_scale)

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
