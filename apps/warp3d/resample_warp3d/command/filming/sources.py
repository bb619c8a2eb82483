"""Pictures of a film as prepared sources, with the range of relative depth of each."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from resample.command.flags import Shape
from resample.command.session import Session
from resample.console import say
from resample.progress import Progress
from resample.types import Floats
from resample_warp3d.command.choices import DepthWarping
from resample_warp3d.command.filming.choices import FilmInput
from resample_warp3d.command.filming.footage import Footage
from resample_warp3d.command.inputs import (
    DepthReader,
    Inputs,
    inputs_of,
    mention_doubt,
    rectified_of,
)
from resample_warp3d.command.rendering import Prepared, prepared
from resample_warp3d.depth.encodings import RelativeDepth
from resample_warp3d.depth.refining.conditioning import RefinementChoice
from resample_warp3d.depth.refining.inspecting import is_sharpened
from resample_warp3d.depth.stabilization import SteadyDepth
from resample_warp3d.depth.temporal import Alignment, Thumbnail, align, thumbnail

ReadInputs = Callable[[int], Inputs]
Ends = tuple[float, float]


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
    """Find the range of relative depth for each picture of a film, and report it.

    Without alignment there is one range for all pictures, to avoid pumping.
    """
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
    """Return the function that reads a picture of a film with its depth; warns of doubt once.

    Whether small maps are soft, and how they are enlarged, is decided by a shot's first picture.
    """
    if reader.meaning.confidence is not None:
        raise ValueError("--confidence is of one picture; leave it out for films")

    softness: dict[int, bool] = {}  # by first picture

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
            for view in taken.views[:1]:
                mention_doubt(own, view, names[1])
        return taken

    return read


def rectified(footage: Footage, scale: float | None) -> ReadInputs:
    """Return the function that reads one picture of a rectified pair's film with its disparity."""

    def read(n: int) -> Inputs:
        return rectified_of(footage.pictures[n], footage.depths[n], footage.names(n), scale)

    return read


@dataclass
class FilmSources:
    """Pictures of a film as sources.

    The refinement chosen for a shot's first picture is used for all of the shot.
    """

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
        """Read a picture; refuse one of another size than the first that was read.

        Relative depth is kept steady, for which all pictures of the shot before it are read, too.
        """
        extent = self.ranges.extent
        if extent is None:
            return self._checked(n)
        start, taken = self.ranges.first_of(n), None
        if self._last is not None and start <= self._last[0] <= n:
            start, taken = self._last[0] + 1, self._last[1]
        for each in range(start, n + 1):
            taken = self._kept_steady(each, extent)
            self._last = each, taken
        if taken is None:
            raise IndexError(n)
        return taken

    def _kept_steady(self, n: int, extent: float) -> Inputs:
        taken = self._checked(n)
        if n in self.ranges.starts:
            self._steady = [SteadyDepth(extent) for _ in taken.views]
            self._steps = [view.step for view in taken.views]
        views = []
        for view, steady, step in zip(taken.views, self._steady, self._steps, strict=True):
            nearness = steady.added(view.image.color, view.image.nearness)
            views.append(view._replace(image=view.image._replace(nearness=nearness), step=step))
        return taken._replace(views=views)

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
