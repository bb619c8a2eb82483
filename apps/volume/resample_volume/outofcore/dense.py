"""Volumes in bricks as windows need them: their place, and how voxels are classified."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from resample.outofcore.bricks import LruCache, Step
from resample.outofcore.passes import PassContext
from resample.resampler import Resampler
from resample.types import Doubles, Indices
from resample_volume.classification.labels import Labels
from resample_volume.classification.regions import Faded
from resample_volume.data.values import bricks_of, is_streamed, streamed, with_bricks
from resample_volume.media.appearance import Appearance, Classification, VolumeLayer, transfer_of
from resample_volume.media.lattices import CommonLattice, common_lattice, first_in
from resample_volume.outofcore.caching import cached
from resample_volume.outofcore.classified import Classifying
from resample_volume.outofcore.outline import Finish
from resample_volume.outofcore.steepness import Slopes, steepness_by_bricks
from resample_volume.outofcore.together import (
    CombinedBricks,
    Member,
    classified_by_bricks,
    in_grid,
    resampled_bricks,
)
from resample_volume.rendering import placement, resampled_appearance
from resample_volume.types import Volume
from resample_volume.voxels.cropping import chosen as chosen_of
from resample_volume.voxels.cropping import inside_index, planes
from resample_volume.voxels.framing import centered
from resample_volume.voxels.visible import Voxels, check_gradient

OF_FILES = 8  # memory over that for pages of resampled volumes
OF_LABELS = 8  # memory over that for the cache of label bricks


@dataclass(frozen=True, eq=False)
class Cropping:
    """Removes voxels that planes cut away."""

    clip: Doubles  # (M, 4) planes
    radius: float  # of the kernels around voxels, voxels

    def __call__(self, place: Indices, voxels: Voxels) -> tuple[Indices, Voxels]:
        """Return voxels and their positions, without those wholly cut away."""
        if not len(self.clip):
            return place, voxels
        index = inside_index(voxels, self.clip, self.radius)
        return place[index], chosen_of(voxels, index)


@dataclass(frozen=True, eq=False)
class Dense:
    """Volumes in bricks, classified brick by brick."""

    members: tuple[Member, ...]
    lattice: CommonLattice | None  # of several together
    cut: Cropping
    beside: int  # bytes of the cache of label bricks

    @property
    def kind(self) -> "Dense":
        """Cache key: equal where the visible voxels are equal."""
        return replace(self, beside=0)

    @property
    def sifts(self) -> bool:
        """Whether possibly visible voxels may turn out to be transparent."""
        return any(member.by.sifts for member in self.members)

    def __call__(self, volume: Volume, finish: Finish) -> Iterator[Any]:
        """Run a job on the visible voxels of a volume, brick by brick."""
        members = [self._with_labels(member) for member in self.members]
        scene: Any = bricks_of(volume)
        bricks = [scene] if self.lattice is None else scene.parts
        return classified_by_bricks(bricks, self.lattice, members, self.cut, finish)

    def _with_labels(self, member: Member) -> Member:
        """Return the volume with a cache of label bricks."""
        labels = member.by.labels
        bricks = None if labels is None else streamed(labels.values)
        if labels is None or bricks is None:
            return member
        values = bricks.within(None, LruCache(self.beside // len(self.members)))
        return member._replace(by=member.by._replace(labels=replace(labels, values=values)))


def check_windows(media: Sequence[VolumeLayer]) -> None:
    """Reject options that need all visible voxels together, and volumes not in bricks."""
    for volume, look in media:
        is_pre = look.classification is not Classification.POST
        if look.scene_objects or not is_pre:
            what = f"a {look.scene_objects[0]}" if look.scene_objects else "the classification post"
            raise ValueError(
                f"{what} needs rays through a field, which cannot be painted window by window; "
                "render it as a whole by classify post: the field goes to a file if it does not "
                "fit in memory"
            )
        if look.section is not None and look.section.normal is None:
            raise ValueError(
                f"the slab {look.slab} is perpendicular to the view, which cannot be painted "
                "window by window; give its direction in the scene, as in 20,10,0,0,1"
            )
        if not is_streamed(volume):
            raise ValueError(
                f"{volume.name} is in memory as a whole and cannot be painted window by window; "
                "convert it to OME-Zarr"
            )
        if look.labels is not None:
            look.labels.check(volume)


def dense_of(
    media: Sequence[VolumeLayer], painter: Resampler, memory: int, context: PassContext
) -> tuple[Volume, Dense]:
    """Prepare volumes to be classified brick by brick, and the scene that they form."""
    check_windows(media)
    light, beside = media[0][1].light, 0
    if any(is_in_store(look.labels) for _, look in media):
        beside = memory // OF_LABELS
    if len(media) == 1:
        scene, _ = centered(media[0][0])
        lattice, clip = None, planes(scene, media[0][1].crop, media[0][1].cuts)
        placed = [(scene, media[0][1])]
    else:
        given, lattice, _, clip = placement(media)
        placed = [_on_lattice(medium, lattice, memory // OF_FILES) for medium in given]
        beside += memory // OF_FILES * (not share_lattice(media))
        scene = _combined(placed, lattice)
    members = []
    for volume, look in placed:
        by = _classifying(volume, replace(look, light=light), context)
        first = (0, 0, 0) if lattice is None else _first(volume, lattice)
        members.append(Member(volume, by, first))
    cut = Cropping(clip, painter.reconstruction.radius)
    return scene, Dense(tuple(members), lattice, cut, beside)


def share_lattice(media: Sequence[VolumeLayer]) -> bool:
    """Return whether all volumes share a lattice, so that none has to be resampled."""
    lattice = common_lattice([volume for volume, _ in media])
    return all(first_in(volume, lattice) is not None for volume, _ in media)


def _on_lattice(medium: VolumeLayer, lattice: CommonLattice, most: int) -> VolumeLayer:
    """Return a volume on the common lattice, and its look; mapped pages take limited memory."""
    volume, look = medium
    if first_in(volume, lattice) is not None:
        return medium

    def make() -> Volume:
        return resampled_bricks(volume, lattice, most)

    there = cached(volume, ("resampled", volume.values, lattice), make)
    return there, resampled_appearance(volume, look)


def _combined(placed: Sequence[VolumeLayer], lattice: CommonLattice) -> Volume:
    """Combine volumes in bricks on the common lattice; cached."""
    x, y, z = map(int, lattice.size)
    bricks = [bricks_of(volume) for volume, _ in placed]
    firsts = [_first(volume, lattice) for volume, _ in placed]

    def make() -> CombinedBricks:
        pairs = zip(bricks, firsts, strict=True)
        parts = [in_grid(own, first, (z, y, x), bricks[0].side) for own, first in pairs]
        return CombinedBricks(parts, bricks[0].found)

    combined = cached(placed[0][0], ("together", bricks, firsts, lattice), make)
    return with_bricks(lattice.volume(), combined)


def _first(volume: Volume, lattice: CommonLattice) -> Step:
    """Return the index of a volume's first voxel in the common lattice."""
    first = first_in(volume, lattice)
    if first is None:
        raise RuntimeError(f"{volume.name} is not on the lattice that it was resampled to")
    return first


def _classifying(volume: Volume, look: Appearance, context: PassContext) -> Classifying:
    """Return the parameters of classification; scans all slopes once, if needed."""
    transfer = transfer_of(volume, look)
    if look.gradient_opacity is not None:
        transfer = Faded(transfer, look.gradient_opacity)
    gradient = look.gradient if transfer.needs_gradient else look.needed_gradient
    check_gradient(transfer, gradient)
    steep = 0.0
    if transfer.needs_gradient:
        slopes = Slopes(volume, transfer, look.gradient)
        steep = cached(volume, (transfer, gradient), lambda: steepness_by_bricks(slopes, context))
    return Classifying(transfer, gradient, steep, look.labels)


def is_in_store(labels: Labels | None) -> bool:
    """Return whether labels stay in their file."""
    return labels is not None and streamed(labels.values) is not None
