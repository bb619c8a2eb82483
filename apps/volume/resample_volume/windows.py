"""Pictures of volumes in bricks, window by window: by this process, or by several."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Viewpoint
from resample.painting.scene import nothing_painted
from resample.resampler import Resampler
from resample.types import Doubles, Frame, Indices, Samples, Statistics
from resample.watching import Executor, Progress
from resample_volume.looks.labels import Labels
from resample_volume.looks.regions import Faded
from resample_volume.rendering import (
    BY_DEFAULT,
    NO_VOXELS,
    Appearance,
    Classification,
    Subject,
    lit_samples,
    transfer_of,
)
from resample_volume.types import Volume
from resample_volume.voxels.bricks import Bricks, Recent
from resample_volume.voxels.cropping import Steep, faced, kept_index, planes
from resample_volume.voxels.cropping import chosen as chosen_of
from resample_volume.voxels.dense.classified import Classifying, classified_by_bricks
from resample_volume.voxels.dense.passes import Looking
from resample_volume.voxels.dense.steepness import Slopes, steepness_by_bricks
from resample_volume.voxels.framing import ball_around, centered
from resample_volume.voxels.shading import cue_range, cued
from resample_volume.voxels.visible import Voxels, check_gradient, lattice_of
from resample_volume.voxels.windowed import Finish, Work, known_of, painted_in_windows, surveyed

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
    """How a picture sees its volume."""

    camera: AnyCamera
    clip: Doubles  # (M, 4) planes
    cue: tuple[float, float]  # depths between which light fades, scene units


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
    camera = unseen(volume, appearance).camera(viewpoint, *size)
    return paint_in_windows(volume, appearance, camera, size, spent, resampler, progress)


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
    scene, _ = centered(volume)
    check_windows(scene, appearance)
    tell = progress or _unheard
    clip, painter = planes(scene, appearance.crop, appearance.clip), resampler or BY_DEFAULT
    by = _classifying(scene, appearance, Looking(spent.executor, spent.threads, tell))
    shown = Sighting(camera, clip, cue_range(camera, ball_around(scene)))
    beside = spent.memory // OF_LABELS if is_in_store(appearance.labels) else 0
    work = Work(
        scene,
        partial(_by_bricks, by, clip, painter.reconstruction.radius, beside),
        partial(_lit, appearance, shown),
        painter,
        camera,
        size,
        clip,
        *spent[:3],
        sifts=by.sifts,
        beside=beside,
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


def _by_bricks(
    by: Classifying, clip: Doubles, radius: float, beside: int, volume: Volume, finish: Finish
) -> Iterator[Any]:
    """What a job makes of visible voxels that are not cut away, brick by brick.

    Labels that were read last take so many bytes `beside`.
    """
    if by.labels is not None and isinstance(by.labels.values, Bricks):
        labels: Any = by.labels.values.within(None, Recent(beside))
        by = by._replace(labels=replace(by.labels, values=labels))

    def cut(place: Indices, voxels: Voxels) -> Any:
        if not len(clip):
            return finish(place, voxels)
        index = kept_index(voxels, clip, radius)
        return finish(place[index], chosen_of(voxels, index))

    return classified_by_bricks(volume, by, cut)


def _lit(look: Appearance, shown: Sighting, voxels: Voxels, steep: Steep | None) -> Samples:
    """Voxels with their light, of which all together have these gradients."""
    camera, clip, (near, far) = shown
    if steep is None:
        samples = lit_samples(voxels, look.light, camera)
    else:
        across = faced(voxels, clip, steep.longest)
        samples = lit_samples(across, look.light, camera, steep.components(clip))
    return samples if look.cue is None else cued(samples, camera, look.cue, near, far)


def _unheard(share: float) -> None:
    """Progress that nobody wants to know."""


def unseen(volume: Volume, appearance: Appearance) -> "Subject":
    """Volume in bricks of which nothing is in memory: where it is, and cameras around it.

    Raises
    ------
    ValueError
        It cannot be painted window by window.
    """
    scene, middle = centered(volume)
    check_windows(scene, appearance)
    nothing = NO_VOXELS._replace(lattice=lattice_of(scene))
    clip = planes(scene, appearance.crop, appearance.clip)
    return Subject(nothing, appearance, ball_around(scene), middle, clip)


def check_windows(volume: Volume, look: Appearance) -> None:
    """Refuse what depends on all visible voxels together."""
    needs = ["mesh"] * bool(look.meshes)
    if look.light is not None and look.light.is_blocked:
        needs.append("shadows or occlusion")
    if look.classification is not Classification.PRE:
        needs.append("the classification post")
    if needs or not isinstance(volume.values, Bricks):
        what = ", ".join(needs) or "a volume in memory"
        raise ValueError(f"{what} cannot be painted window by window; leave it out")
    if look.labels is not None:
        look.labels.check(volume)
