"""Paint volumes in bricks window by window, in this process or in several."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Sphere
from resample.memory import available_memory
from resample.outofcore.bricks import SHARE
from resample.outofcore.passes import PassContext
from resample.outofcore.samples import SHARE_OF_SCAN, PictureQuery, nothing_shown, paint_planned
from resample.outofcore.windows import Budget
from resample.resampler import Resampler
from resample.types import Doubles, Frame, Indices, Samples
from resample.watching import Progress
from resample_volume.data.bricks import Bricks
from resample_volume.data.values import bricks_of, streamed
from resample_volume.media.appearance import (
    OF_VOXELS,
    Appearance,
    Classification,
    VolumeLayer,
    of_voxels,
)
from resample_volume.media.mixing import MixedMedia, added
from resample_volume.outofcore.ball import ball_of
from resample_volume.outofcore.caching import cache_visible, cached
from resample_volume.outofcore.dense import Dense, check_windows, dense_of
from resample_volume.outofcore.light import LightGrid, transmittance_grid
from resample_volume.outofcore.outline import OutlineQuery, VisibleOutline, outlined
from resample_volume.outofcore.windowed import VoxelBlocks, surveyed
from resample_volume.rendering import NO_VOXELS, Fit, Subject, lit_samples, placement
from resample_volume.types import Volume
from resample_volume.voxels.cropping import Steeps, faced, planes
from resample_volume.voxels.framing import ball_around, centered, sphere_around
from resample_volume.voxels.shading import cue_range, cued
from resample_volume.voxels.visible import Voxels, lattice_of

__all__ = ["Budget", "paint_streamed", "streamed_subject"]


class ViewSetup(NamedTuple):
    """Camera, light and clipping that windows of a picture share."""

    appearance: Appearance  # of the first, whose light is that of all
    camera: AnyCamera
    clip: Doubles  # (M, 4) planes
    cue: tuple[float, float]  # depths between which light fades, scene units
    light_grid: LightGrid | None = None  # if voxels are shadowed


def paint_streamed(
    media: Sequence[VolumeLayer],
    subject: Subject,
    camera: AnyCamera,
    size: tuple[int, int],
    budget: Budget,
    resampler: Resampler | None = None,
    progress: Progress | None = None,
) -> tuple[Frame, int]:
    """Render volumes in bricks, with one window's voxels in memory at a time.

    Parameters
    ----------
    media
        Their values are `Bricks`, without padding; looks do not need all visible voxels together.
    subject, camera
        From `streamed_subject`, and its camera.
    size
        Height and width of the picture, px.
    budget
        Memory limit of each process, and who paints windows.
    resampler
        Paints splats of voxels; None: the default one.
    progress
        Called with the fraction of the work done, 0 to 1.

    Returns
    -------
    frame
        Bit-identical to the frame of volumes in memory; its statistics hold only the number of
        samples.
    windows
        Number of windows.

    Raises
    ------
    ValueError
        A choice needs all visible voxels together, or those of a single tile do not fit in memory.
    OSError
        Windows cannot be written or read.
    """
    painter = of_voxels(resampler or OF_VOXELS)
    context = budget.context(progress)
    _pin_bricks(media, budget)
    scene, dense = dense_of(media, painter, budget.memory, context)
    light_grid = _light_grid(scene, dense, media[0][1], subject, budget, context)
    setup = ViewSetup(
        media[0][1], camera, subject.clip, cue_range(camera, subject.sphere), light_grid
    )
    noted = sum(bricks.noted for bricks in _bricks_of(media))  # bytes of statistics
    source = VoxelBlocks(
        scene,
        dense,
        partial(_lit, setup),
        dense.kind,
        dense.beside + noted + (0 if light_grid is None else light_grid.size_bytes),
        budget.threads,
        len(media),
        sifts=dense.sifts,
    )
    picture = PictureQuery(painter, camera, size, subject.clip)
    known = surveyed(source, picture, context.portion(0.0, SHARE_OF_SCAN))
    if known is None:
        return nothing_shown(size), 0
    plan, (source.steep, *parts) = known
    painted = paint_planned(source, (parts[0], parts[1]), picture, plan, budget, progress)
    bricks_of(scene).reads += source.reads
    return painted


def _light_grid(
    scene: Volume,
    dense: Dense,
    look: Appearance,
    subject: Subject,
    budget: Budget,
    context: PassContext,
) -> LightGrid | None:
    """Return the light that reaches voxels, if any are shadowed; cached."""
    light = look.light
    if light is None or not light.is_blocked:
        return None
    seen = OutlineQuery(scene, dense, subject.clip)
    outline = _outline(seen, dense, context)
    if not outline.total:
        return None
    by = (seen, outline, light, subject.lattice, budget.memory, context)
    depends = ("light", dense.kind, light.direction, light.shadows, light.occlusion)
    return cached(scene, depends, lambda: transmittance_grid(*by)).stored_in(budget.folder)


def _outline(seen: OutlineQuery, dense: Dense, context: PassContext) -> VisibleOutline:
    """Return where voxels are visible; cached, and reused for pictures."""
    found = cached(seen.volume, ("outline", dense.kind), lambda: outlined(seen, context))
    if found.total:
        cache_visible(seen.volume, dense.kind, found.blocks)
    return found


def _lit(shown: ViewSetup, place: Indices, voxels: Voxels | MixedMedia, steeps: Steeps) -> Samples:
    """Return shaded voxels, given the steepest gradient of all."""
    look, camera, clip, (near, far), light_grid = shown
    lit, parts = [], voxels.parts
    if light_grid is not None:
        share = light_grid.at(place)
        each = voxels.place if isinstance(voxels, MixedMedia) else (np.arange(len(share)),)
        parts = tuple(
            part._replace(reached=share[at]) for part, at in zip(parts, each, strict=True)
        )
    for part, steep in zip(parts, steeps, strict=True):
        across = part if steep is None else faced(part, clip, steep.longest)
        all_of_them = None if steep is None else steep.components(clip)
        lit.append(lit_samples(across, look.light, camera, all_of_them))
    if isinstance(voxels, MixedMedia):
        samples = added(voxels, [part.color for part in lit])
    else:
        (samples,) = lit
    return samples if look.cue is None else cued(samples, camera, look.cue, near, far)


def streamed_subject(
    media: Sequence[VolumeLayer],
    fit: Fit = "volume",
    resampler: Resampler | None = None,
    budget: Budget | None = None,
    progress: Progress | None = None,
) -> Subject:
    """Return the subject of volumes in bricks without voxels: it places cameras only.

    Parameters
    ----------
    fit
        Cameras orbit all of the volumes, or what is visible, which needs a scan of all voxels.
    """
    check_windows(media)
    look = replace(media[0][1], classification=Classification.PRE)
    painter = of_voxels(resampler or OF_VOXELS)
    if len(media) == 1:
        whole, middle = centered(media[0][0])
        clip, steps = planes(whole, look.crop, look.cuts), lattice_of(whole)
    else:
        _, lattice, middle, clip = placement(media)
        whole, steps = lattice.volume(), lattice.steps
    nothing = NO_VOXELS._replace(lattice=steps)
    if fit == "volume":
        return Subject(nothing, look, ball_around(whole), middle, clip)
    allowed = Budget(available_memory() or 0) if budget is None else budget
    context = allowed.context(progress)
    scene, dense = dense_of(media, painter, allowed.memory, context)
    seen = OutlineQuery(scene, dense, clip)

    def find() -> Sphere:
        outline = _outline(seen, dense, context)
        if not outline.total:
            return sphere_around(nothing, whole)
        return ball_of(seen, outline, float(np.linalg.norm(steps, axis=0).max()), context)

    ball = cached(scene, ("ball", dense.kind), find, lasts=True)
    return Subject(nothing, look, ball, middle, clip)


def _pin_bricks(media: Sequence[VolumeLayer], budget: Budget) -> None:
    """Let volumes pin the bricks read first, in a share of a process's memory budget."""
    for bricks in _bricks_of(media):
        bricks.pin_bricks(budget.memory // SHARE // len(media))
        if budget.executor is not None:
            bricks.share_bricks()


def _bricks_of(media: Sequence[VolumeLayer]) -> list[Bricks]:
    """Return the values of those volumes that are in bricks."""
    found = [streamed(volume.values) for volume, _ in media]
    return [bricks for bricks in found if bricks is not None]
