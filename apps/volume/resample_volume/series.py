"""Several volumes: the times of a recording, and a lattice that covers several."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from resample.painting.choices import Projection
from resample.types import Doubles
from resample_volume import appearance as looks
from resample_volume.appearance import Appearance, XRay
from resample_volume.classification.transfer import Faded, Windowed
from resample_volume.classification.value_statistics import Survey, survey, without_padding
from resample_volume.data.recordings import alone, volume_at, volume_of, with_times_first
from resample_volume.data.values import bricks_of, is_streamed, with_bricks
from resample_volume.types import Chunked, Recording, Volume
from resample_volume.voxels.visible import (
    finite_range,
    lattice_of,
    max_gradient,
    visible_with_slopes,
)

SAME = 1e-3  # voxels by which the ends of volumes may differ from places of the lattice


def common_lattice(volumes: Sequence[Volume]) -> tuple[Volume, Doubles]:
    """Return the finest volume's lattice, extended to cover all volumes, and its center.

    It is a volume of zeros without memory, and does not depend on the order of the volumes.
    """
    # The finest has the smallest voxels; others decide if several are as fine.
    keys = []
    for volume in volumes:
        size = round(float(abs(np.linalg.det(lattice_of(volume)))), 9)
        keys.append((size, *lattice_of(volume).ravel(), *volume.origin, *volume.values.shape))
    finest = volumes[min(range(len(keys)), key=keys.__getitem__)]
    steps = lattice_of(finest)
    firsts, lasts = [], []
    for volume in volumes:  # first and last place of the lattice in it, with half voxels
        ends = np.array([[-0.5] * 3, np.array(volume.values.shape[::-1]) - 0.5])
        corners = np.stack(np.meshgrid(*ends.T, indexing="ij")).reshape(3, 8)
        away = lattice_of(volume) @ corners + (volume.origin - finest.origin)[:, np.newaxis]
        place = np.linalg.solve(steps, away)
        firsts.append(np.ceil(place.min(axis=1) - SAME).astype(np.int64))
        end = np.floor(place.max(axis=1) + SAME).astype(np.int64)
        lasts.append(np.maximum(firsts[-1], end))
    first = np.min(firsts, axis=0)
    size = np.max(lasts, axis=0) - first + 1
    nothing = np.broadcast_to(np.uint8(0), tuple(size[::-1]))
    spacing, origin = np.linalg.norm(steps, axis=0), finest.origin + steps @ first
    whole = Volume(nothing, spacing, origin, steps / spacing, "scene")
    return whole, origin + steps @ (size - 1.0) / 2


Ready = Callable[[Volume], Volume]  # sets the memory limit of a volume in bricks


@dataclass(frozen=True, eq=False)
class Series:
    """The volumes of a recording, one per time, with statistics over all times."""

    recording: Recording  # with times first; of a store `Chunked`, read time by time
    known: Survey  # of all values
    together: Volume | None = None  # all times without padding, in bricks with statistics
    ready: Ready = lambda volume: volume

    @classmethod
    def of(cls, recording: Recording, ready: Ready = lambda volume: volume) -> "Series":
        """Make a series of a recording's times, or of its channels if it has only these."""
        ordered = with_times_first(recording)
        every = ready(whole(ordered))
        known = survey(every)
        together = without_padding(every, known) if is_streamed(every) else None
        return cls(ordered, known, together, ready)

    @classmethod
    def again(cls, recording: Recording, known: Survey, ready: Ready) -> "Series":
        """Rebuild the series in another process, from given statistics."""
        ordered = with_times_first(recording)
        every = None
        if chunked(ordered) is not None:
            every = without_padding(whole(ordered), known)
            every = every if bricks_of(every).is_kept() else None
        return cls(ordered, known, every, ready)

    def __len__(self) -> int:
        return int(self.recording.values.shape[0])

    def __getitem__(self, time: int) -> Volume:
        """Return the volume of a time, without padding that all times share."""
        own = self.ready(volume_at(self.recording, time, None))
        volume = without_padding(own._replace(name=self.recording.name), self.known)
        if self.together is None:
            return volume
        return with_bricks(volume, bricks_of(self.together).one_of(bricks_of(volume), time))

    def all(self) -> Volume:
        """All times stacked in one volume, for looks that depend on values."""
        if self.together is not None:
            return self.together
        return without_padding(whole(self.recording), self.known)

    def appearance(
        self, look: Appearance, projection: Projection = Projection.COMPOSITE
    ) -> Appearance:
        """Return a look for all times, with ranges and slopes over all of them."""
        together = self.all()
        if projection is Projection.XRAY:
            xray = look.xray or XRay()
            every = [looks.settled(xray, volume, self.known) for volume in self]
            look = replace(look, xray=max(every, key=lambda one: one.window or (0.0, 0.0)))
        transfer = looks.transfer_of(together, look, projection)
        if look.gradient_opacity is not None:
            transfer = Faded(transfer, look.gradient_opacity)
        span, steep = finite_range(together.values), None
        if transfer.needs_gradient:
            found = (visible_with_slopes(each, transfer, span, look.gradient)[2] for each in self)
            slopes = (np.linalg.norm(slope, axis=1) for slope in found)
            steep = max(map(max_gradient, slopes), default=0.0)
        if steep is not None or transfer.normalized:
            transfer = Windowed(transfer, span, steep=steep)
        framing = look.framing
        if framing is not None:
            framing = Windowed(looks.transfer_of(together, framing), span)
        return replace(look, transfer=transfer, framing=framing, gradient_opacity=None)

    def __iter__(self) -> Iterator[Volume]:
        return (self[time] for time in range(len(self)))


def whole(recording: Recording) -> Volume:
    """Stack all times of a recording in one volume."""
    times, parts, *size = recording.values.shape
    if not recording.is_color and parts != 1:
        return volume_at(recording, 0, None)  # the message says that there are channels
    if (values := chunked(recording)) is not None:
        return volume_of(recording, values.stacked_along_z(), recording.name)
    across = np.moveaxis(recording.values[:], 0, 1).reshape(1, parts, times * size[0], *size[1:])
    return alone(recording._replace(values=across))


def chunked(recording: Recording) -> Chunked | None:
    """Return values that stay in their file; None if these do not."""
    return recording.values if isinstance(recording.values, Chunked) else None
