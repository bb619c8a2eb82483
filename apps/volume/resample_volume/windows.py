"""Pictures of volumes in bricks, window by window: by this process, or by several."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Viewpoint
from resample.memory import available_memory
from resample.painting.scene import nothing_painted
from resample.resampler import Resampler
from resample.types import Doubles, Frame, Indices, Samples, Statistics
from resample.watching import Executor, Progress
from resample_volume.looks.labels import Labels
from resample_volume.looks.regions import Faded
from resample_volume.media.lattices import Lattice, common_lattice, first_in
from resample_volume.media.mixing import Mixed, added
from resample_volume.media.together import (
    Member,
    Together,
    in_grid,
    mixed_by_bricks,
    resampled_bricks,
)
from resample_volume.rendering import (
    BY_DEFAULT,
    NO_VOXELS,
    Appearance,
    Classification,
    Fit,
    Medium,
    Subject,
    kept_look,
    lit_samples,
    placement,
    transfer_of,
)
from resample_volume.types import Volume
from resample_volume.voxels.bricks import Bricks, Recent, Step
from resample_volume.voxels.cropping import Steeps, faced, kept_index, planes
from resample_volume.voxels.cropping import chosen as chosen_of
from resample_volume.voxels.dense.ball import ball_of
from resample_volume.voxels.dense.classified import Classifying, classified_by_bricks
from resample_volume.voxels.dense.light import Reaching, light_reached
from resample_volume.voxels.dense.looked import Finish, Outline, ToSee, outlined
from resample_volume.voxels.dense.passes import Looking
from resample_volume.voxels.dense.steepness import Slopes, steepness_by_bricks
from resample_volume.voxels.framing import ball_around, centered, sphere_around
from resample_volume.voxels.shading import cue_range, cued
from resample_volume.voxels.visible import Voxels, check_gradient, lattice_of
from resample_volume.voxels.windowed import (
    Work,
    keep_looked_at,
    known_of,
    painted_in_windows,
    surveyed,
)

OF_FILES = 8  # share of memory, inverted, that takes pages of volumes that were resampled
OF_LABELS = 8  # share of memory, inverted, that takes bricks of labels which were read lately


class Spent(NamedTuple):
    """What painting in windows may take, and who does it.

    Examples
    --------
    >>> from resample_volume.windows import Spent
    >>> Spent(memory=1 << 30).executor is None  # windows are painted here, one after the other
    True
    """

    memory: int  # bytes that the voxels and bricks of a window may take, in each process
    threads: int | None = None  # of each process; None: all
    folder: Path | None = None  # windows are written there by whoever paints them
    executor: Executor | None = None  # of threads or processes; None: this one


class Sighting(NamedTuple):
    """How a picture sees its volumes."""

    look: Appearance  # of the first, whose light is that of all
    camera: AnyCamera
    clip: Doubles  # (M, 4) planes
    cue: tuple[float, float]  # depths between which light fades, scene units
    reaching: Reaching | None = None  # where not all light gets to all voxels


@dataclass(frozen=True, eq=False)
class Cutting:
    """What of voxels is left."""

    clip: Doubles  # (M, 4) planes
    radius: float  # of the kernels around voxels, voxels

    def __call__(self, place: Indices, voxels: Voxels) -> tuple[Indices, Voxels]:
        """Voxels and their places, without those that are wholly cut away."""
        if not len(self.clip):
            return place, voxels
        index = kept_index(voxels, self.clip, self.radius)
        return place[index], chosen_of(voxels, index)


@dataclass(frozen=True, eq=False)
class Dense:
    """Volumes in bricks, whose voxels are seen brick by brick."""

    members: tuple[Member, ...]
    lattice: Lattice | None  # of several together
    cut: Cutting
    beside: int  # bytes that bricks of labels take which were read last

    @property
    def kind(self) -> "Dense":
        """What is the same where the same is seen."""
        return replace(self, beside=0)

    @property
    def sifts(self) -> bool:
        """Whether voxels that may be seen turn out to be transparent."""
        return any(member.by.sifts for member in self.members)

    def __call__(self, volume: Volume, finish: Finish) -> Iterator[Any]:
        """What a job makes of visible voxels of a volume of bricks, brick by brick."""
        members = [self._with_labels(member) for member in self.members]
        if self.lattice is None:
            (member,) = members
            return classified_by_bricks(volume, member.by, lambda *one: finish(*self.cut(*one)))
        together: Any = volume.values
        return mixed_by_bricks(together, self.lattice, members, self.cut, finish)

    def _with_labels(self, member: Member) -> Member:
        """Volume whose bricks of labels are kept for a while."""
        labels = member.by.labels
        if labels is None or not isinstance(labels.values, Bricks):
            return member
        values = labels.values.within(None, Recent(self.beside // len(self.members)))
        return member._replace(by=member.by._replace(labels=replace(labels, values=values)))


def render_in_windows(
    volume: Volume,
    appearance: Appearance,
    viewpoint: Viewpoint,
    size: tuple[int, int],
    spent: Spent,
    resampler: Resampler | None = None,
    progress: Progress | None = None,
) -> tuple[Frame, int]:
    """Picture of a volume in bricks, of which one window's voxels are in memory at a time.

    Parameters
    ----------
    volume
        Whose values are `Bricks`, without padding.
    appearance
        Its look, without what depends on all voxels that are seen.
    viewpoint
        Orbits are around the whole volume, whatever of it is seen.
    size
        Height and width of the picture, px.
    spent
        How much memory a process may take, and who paints windows.
    resampler
        Paints splats of voxels; None is the default one.
    progress
        Called with the share of the work that is done, 0 to 1.

    Returns
    -------
    frame
        With the bits of a volume in memory, whoever painted it; of its statistics the samples alone
        are known.
    windows
        How many there were.

    Raises
    ------
    ValueError
        A choice needs all visible voxels together, or those of a single tile do not fit.
    OSError
        Windows cannot be written or read.
    """
    media = [(volume, appearance)]
    subject = unseen_together(media)
    return paint_unseen(
        media, subject, subject.camera(viewpoint, *size), size, spent, resampler, progress
    )


def paint_in_windows(
    volume: Volume,
    appearance: Appearance,
    camera: AnyCamera,
    size: tuple[int, int],
    spent: Spent,
    resampler: Resampler | None = None,
    progress: Progress | None = None,
) -> tuple[Frame, int]:
    """As `render_in_windows`, by a camera of the volume's `unseen` subject."""
    media = [(volume, appearance)]
    return paint_unseen(media, unseen_together(media), camera, size, spent, resampler, progress)


def paint_unseen(
    media: Sequence[Medium],
    subject: Subject,
    camera: AnyCamera,
    size: tuple[int, int],
    spent: Spent,
    resampler: Resampler | None = None,
    progress: Progress | None = None,
) -> tuple[Frame, int]:
    """As `render_in_windows`, of one volume or of several that are seen together.

    Parameters
    ----------
    media
        Volumes in bricks, each with its look.
    subject
        What `unseen_together` gives for them.
    camera
        One of the subject's.
    size, spent, resampler, progress
        As of `render_in_windows`.

    Raises
    ------
    ValueError, OSError
        As of `render_in_windows`.
    """
    painter, tell = resampler or BY_DEFAULT, progress or _unheard
    looking = Looking(spent.executor, spent.threads, tell)
    scene, dense = _dense(media, painter, spent.memory, looking)
    reaching = _reaching(scene, dense, media[0][1], subject, spent, looking)
    cue = cue_range(camera, subject.sphere)
    work = Work(
        scene,
        dense,
        partial(_lit, Sighting(media[0][1], camera, subject.clip, cue, reaching)),
        painter,
        camera,
        size,
        subject.clip,
        *spent[:3],
        sifts=dense.sifts,
        beside=dense.beside + (0 if reaching is None else reaching.bytes_held),
        volumes=len(media),
        depends=dense.kind,
    )
    whole, count = nothing_painted(*size).film, 0
    known = surveyed(work, tell, spent.executor)
    if known is None:
        return Frame(*whole, Statistics(0, 0, 0, 0, 1, {})), 0
    for (x0, y0, x1, y1), film in painted_in_windows(work, known, tell, spent.executor):
        for layer, part in zip(whole, film, strict=True):
            layer[y0:y1, x0:x1] = part
        count += 1
    samples = int(known.blocks.seen.sum())
    return Frame(*whole, Statistics(samples, 0, 0, 0, 1, {})), count


def _reaching(
    scene: Volume,
    dense: Dense,
    look: Appearance,
    subject: Subject,
    spent: Spent,
    looking: Looking,
) -> Reaching | None:
    """Light that gets to voxels past others, if that is not all; found once."""
    light = look.light
    if light is None or not light.is_blocked:
        return None
    seen = ToSee(scene, dense, subject.clip)
    outline = _outline(seen, dense, looking)
    if not outline.total:
        return None
    by = (seen, outline, light, subject.voxels.lattice, spent.memory, looking)
    depends = ("light", dense.kind, light.direction, light.shadows, light.occlusion)
    return known_of(scene, depends, lambda: light_reached(*by)).kept_in(spent.folder)


def _outline(seen: ToSee, dense: Dense, looking: Looking) -> Outline:
    """Where voxels are seen; found once, and pictures do with it, too."""
    found = known_of(seen.volume, ("outline", dense.kind), lambda: outlined(seen, looking))
    if found.total:
        keep_looked_at(seen.volume, dense.kind, found.looked)
    return found


def _dense(
    media: Sequence[Medium], painter: Resampler, memory: int, looking: Looking
) -> tuple[Volume, Dense]:
    """Volumes as they are seen brick by brick, and the scene that they make up."""
    check_windows(media)
    light, beside = media[0][1].light, 0
    if any(is_in_store(look.labels) for _, look in media):
        beside = memory // OF_LABELS
    if len(media) == 1:
        scene, _ = centered(media[0][0])
        lattice, clip = None, planes(scene, media[0][1].crop, media[0][1].clip)
        placed = [(scene, media[0][1])]
    else:
        given, lattice, _, clip = placement(media)
        placed = [_on_lattice(medium, lattice, memory // OF_FILES) for medium in given]
        beside += memory // OF_FILES * (not share_lattice(media))
        scene = _together(placed, lattice)
    members = []
    for volume, look in placed:
        by = _classifying(volume, replace(look, light=light), looking)
        first = (0, 0, 0) if lattice is None else _first(volume, lattice)
        members.append(Member(volume, by, first))
    cut = Cutting(clip, painter.reconstruction.radius)
    return scene, Dense(tuple(members), lattice, cut, beside)


def share_lattice(media: Sequence[Medium]) -> bool:
    """Whether no volume needs to be resampled to be seen with the others."""
    lattice = common_lattice([volume for volume, _ in media])
    return all(first_in(volume, lattice) is not None for volume, _ in media)


def _on_lattice(medium: Medium, lattice: Lattice, most: int) -> Medium:
    """Volume on the lattice of all, and its look; of pages of files, memory holds so many bytes."""
    volume, look = medium
    if first_in(volume, lattice) is not None:
        return medium

    def make() -> Volume:
        return resampled_bricks(volume, lattice, most)

    there = known_of(volume, ("resampled", volume.values, lattice), make)
    return there, kept_look(volume, look)


def _together(placed: Sequence[Medium], lattice: Lattice) -> Volume:
    """Volumes in bricks as one on the lattice of all, which is made once."""
    x, y, z = map(int, lattice.size)
    bricks: list[Any] = [volume.values for volume, _ in placed]
    firsts = [_first(volume, lattice) for volume, _ in placed]

    def make() -> Together:
        pairs = zip(bricks, firsts, strict=True)
        parts = [in_grid(own, first, (z, y, x), bricks[0].side) for own, first in pairs]
        return Together(parts, bricks[0].found)

    values: Any = known_of(placed[0][0], ("together", bricks, firsts, lattice), make)
    return lattice.volume()._replace(values=values)


def _first(volume: Volume, lattice: Lattice) -> Step:
    """Place of the lattice of all that a volume's first voxel is at."""
    first = first_in(volume, lattice)
    if first is None:
        raise RuntimeError(f"{volume.name} is not on the lattice that it was resampled to")
    return first


def _classifying(volume: Volume, look: Appearance, looking: Looking) -> Classifying:
    """What voxels get their looks by; slopes of all of them are looked at once, if need be."""
    transfer = transfer_of(volume, look)
    if look.gradient_opacity is not None:
        transfer = Faded(transfer, look.gradient_opacity)
    gradient = look.gradient if transfer.needs_gradient else look.needed_gradient
    check_gradient(transfer, gradient)
    steep = 0.0
    if transfer.needs_gradient:
        slopes = Slopes(volume, transfer, look.gradient)
        steep = known_of(volume, (transfer, gradient), lambda: steepness_by_bricks(slopes, looking))
    return Classifying(transfer, gradient, steep, look.labels)


def is_in_store(labels: Labels | None) -> bool:
    """Whether labels stay in their file."""
    return labels is not None and isinstance(labels.values, Bricks)


def _lit(shown: Sighting, place: Indices, voxels: Voxels | Mixed, steeps: Steeps) -> Samples:
    """Voxels with their light, of which all together have these gradients."""
    look, camera, clip, (near, far), reaching = shown
    lit, parts = [], voxels.parts
    if reaching is not None:
        share = reaching.at(place)
        each = voxels.place if isinstance(voxels, Mixed) else (np.arange(len(share)),)
        parts = tuple(
            part._replace(reached=share[at]) for part, at in zip(parts, each, strict=True)
        )
    for part, steep in zip(parts, steeps, strict=True):
        across = part if steep is None else faced(part, clip, steep.longest)
        all_of_them = None if steep is None else steep.components(clip)
        lit.append(lit_samples(across, look.light, camera, all_of_them))
    if isinstance(voxels, Mixed):
        samples = added(voxels, [part.color for part in lit])
    else:
        (samples,) = lit
    return samples if look.cue is None else cued(samples, camera, look.cue, near, far)


def _unheard(share: float) -> None:
    """Progress that nobody wants to know."""


def unseen(volume: Volume, appearance: Appearance) -> Subject:
    """As `unseen_together`, of a single volume."""
    return unseen_together([(volume, appearance)])


def unseen_together(
    media: Sequence[Medium],
    fit: Fit = "volume",
    resampler: Resampler | None = None,
    spent: Spent | None = None,
    progress: Progress | None = None,
) -> Subject:
    """Volumes in bricks of which nothing is in memory: where they are, and cameras around them.

    Parameters
    ----------
    media
        Volumes, each with its look.
    fit
        Cameras are placed around all of the volumes, or around what is visible, for which all
        voxels are looked at.
    resampler, spent, progress
        As of `render_in_windows`: who looks at them, and how much memory that may take.

    Raises
    ------
    ValueError
        They cannot be painted window by window.
    """
    check_windows(media)
    look, painter = media[0][1], resampler or BY_DEFAULT
    if len(media) == 1:
        whole, middle = centered(media[0][0])
        clip, steps = planes(whole, look.crop, look.clip), lattice_of(whole)
    else:
        _, lattice, middle, clip = placement(media)
        whole, steps = lattice.volume(), lattice.steps
    nothing = NO_VOXELS._replace(lattice=steps)
    if fit == "volume":
        return Subject(nothing, look, ball_around(whole), middle, clip)
    allowed = Spent(available_memory() or 0) if spent is None else spent
    looking = Looking(allowed.executor, allowed.threads, progress or _unheard)
    scene, dense = _dense(media, painter, allowed.memory, looking)
    seen = ToSee(scene, dense, clip)
    outline = _outline(seen, dense, looking)
    if not outline.total:
        return Subject(nothing, look, sphere_around(nothing, whole), middle, clip)
    voxel = float(np.linalg.norm(steps, axis=0).max())
    ball = known_of(scene, ("ball", dense.kind), lambda: ball_of(seen, outline, voxel, looking))
    return Subject(nothing, look, ball, middle, clip)


def check_windows(media: Sequence[Medium]) -> None:
    """Refuse what depends on all visible voxels together, or is not in bricks."""
    for volume, look in media:
        is_pre = look.classification is Classification.PRE
        if look.meshes or not is_pre:
            what = "a mesh" if is_pre else "the classification post"
            raise ValueError(
                f"{what} needs rays through a field, which cannot be painted window by window; "
                "render it as a whole by classify post: a file holds the field if memory does not"
            )
        if not isinstance(volume.values, Bricks):
            raise ValueError(
                f"{volume.name} is in memory as a whole and cannot be painted window by window; "
                "convert it to OME-Zarr"
            )
        if look.labels is not None:
            look.labels.check(volume)
