"""A volume of several times, shown by one look in one frame, so that nothing but it changes."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from resample.cameras.viewpoints import Sphere
from resample.resampler import Projection
from resample_volume.looks.materials import Windowed
from resample_volume.looks.regions import Faded
from resample_volume.looks.surveys import Survey, survey, without_padding
from resample_volume.looks.transfer import DataRange, Transfer, places_seen
from resample_volume.media.recordings import alone, volume_at, with_times_first
from resample_volume.rendering import Appearance, Subject, named_or_own, transfer_of
from resample_volume.types import Recording, Volume
from resample_volume.voxels.parts import slabs
from resample_volume.voxels.visible import finite_range, gradients_at, steepness


@dataclass(frozen=True, eq=False)
class Series:
    """The volumes of a recording, one for each time, and what is known of all together."""

    recording: Recording  # with times first
    known: Survey  # of all values

    @classmethod
    def of(cls, recording: Recording) -> "Series":
        """Series of a recording's times, or of its channels where it has these alone.

        Raises
        ------
        ValueError
            It has channels as well.
        """
        ordered = with_times_first(recording)
        return cls(ordered, survey(whole(ordered)))

    def __len__(self) -> int:
        return len(self.recording.values)

    def __getitem__(self, time: int) -> Volume:
        """Volume of a time, without what is padding in all of them."""
        volume = volume_at(self.recording, time, None)
        return without_padding(volume._replace(name=self.recording.name), self.known)

    def all(self) -> Volume:
        """Volume of all times behind each other, for looks that ask for values."""
        return without_padding(whole(self.recording), self.known)

    def look(self, look: Appearance, projection: Projection = Projection.COMPOSITE) -> Appearance:
        """Look that treats all times alike: its ranges and slopes are those of all."""
        together = self.all()
        transfer = transfer_of(together, look, projection)
        if look.gradient_opacity is not None:
            transfer = Faded(transfer, look.gradient_opacity)
        span = finite_range(together.values)
        steep = None
        if transfer.needs_gradient:
            steep = steepest(self, transfer, span, look.gradient)
        if steep is not None or transfer.normalized:
            transfer = Windowed(transfer, span, steep=steep)
        framing = look.framing
        if framing is not None:
            framing = Windowed(named_or_own(framing, together), span)
        return replace(look, transfer=transfer, framing=framing, gradient_opacity=None)

    def __iter__(self) -> Iterator[Volume]:
        return (self[time] for time in range(len(self)))


def whole(recording: Recording) -> Volume:
    """Volume of all times of a recording, one behind the other."""
    times, parts, *size = recording.values.shape
    if recording.is_color or parts == 1:
        across = np.moveaxis(recording.values, 0, 1).reshape(1, parts, times * size[0], *size[1:])
        return alone(recording._replace(values=across))
    return volume_at(recording, 0, None)  # says that there are channels


def steepest(
    volumes: Iterable[Volume], transfer: Transfer, span: DataRange, gradient: str
) -> float:
    """Slope of a full surface in some volumes together; data units per scene unit."""
    most = 0.0
    for volume in volumes:
        parts, start = [], 0
        for slab in slabs(volume.values):
            parts.append(places_seen(transfer, slab.reshape(-1), span) + start)
            start += slab.size
        slope = gradients_at(volume, np.concatenate(parts), gradient)
        most = max(most, steepness(np.linalg.norm(slope, axis=1)))
    return most


def around(subjects: Iterable[Subject]) -> Sphere:
    """Ball around all that is seen of some subjects, where anything is."""
    spheres: list[Sphere] = []
    empty: list[Sphere] = []
    for subject in subjects:
        (empty if subject.is_empty else spheres).append(subject.sphere)
    every = spheres or empty
    center = np.array([sphere.center for sphere in every])
    radius = np.array([[sphere.radius] for sphere in every])
    middle = ((center - radius).min(axis=0) + (center + radius).max(axis=0)) / 2
    away = np.linalg.norm(center - middle, axis=1)
    return Sphere(middle, float((away + radius[:, 0]).max()))
