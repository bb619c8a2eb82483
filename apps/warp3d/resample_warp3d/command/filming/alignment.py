"""Ranges of relative depth for the pictures of a film, and its cuts."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from resample.command.session import Session
from resample.console import say
from resample.progress import Progress
from resample_warp3d.command.filming.choices import FilmInput
from resample_warp3d.command.filming.footage import Footage
from resample_warp3d.command.inputs import DepthReader
from resample_warp3d.depth.encodings import RelativeDepth
from resample_warp3d.depth.temporal import Alignment, Thumbnail, align, thumbnail

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
