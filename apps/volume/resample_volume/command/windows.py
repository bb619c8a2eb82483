"""Budgets of windows, and workers that share them; windows of killed commands are reused."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from resample.console import say
from resample.files.writing import beside
from resample.fingerprints import fingerprint
from resample.lazy import installed_version
from resample.memory import available_memory
from resample.outofcore.windows import NAME
from resample.watching import WorkerPool
from resample_volume.data.values import is_streamed, values_of
from resample_volume.media.appearance import Appearance, VolumeLayer
from resample_volume.outofcore.dense import is_in_store, share_lattice
from resample_volume.types import Volume
from resample_volume.windows import Budget

MARK = "picture"  # file in a folder of windows that identifies their picture


def check_workers(media: Sequence[VolumeLayer]) -> None:
    """Reject workers for volumes that they cannot paint."""
    for medium in media:
        _check_bricks(*medium)
    if not share_lattice(media):
        raise ValueError(
            "workers paint volumes that share a lattice, and others are resampled by one "
            "process; leave workers out"
        )


def _check_bricks(volume: Volume, look: Appearance) -> None:
    """Reject workers for a picture that is not painted by windows."""
    if not is_streamed(volume):
        raise ValueError(
            f"workers paint windows of a volume in chunks, and {volume.name} is in memory as a "
            "whole; convert it to OME-Zarr, composite it by classify pre, or leave workers out"
        )
    if look.labels is not None and not is_in_store(look.labels):
        raise ValueError(
            "workers read labels from a store, and these are in memory as a whole; convert them to "
            "OME-Zarr, or leave workers out"
        )


def local_budget(media: Sequence[VolumeLayer], threads: int | None) -> Budget:
    """Return the budget of windows that this process paints."""
    allowed = values_of(media[0][0].values).memory
    return Budget(allowed or available_memory() or 0, threads)


@contextmanager
def shared(
    media: Sequence[VolumeLayer],
    shown: tuple[Any, ...],
    here: Budget,
    crew: WorkerPool | None,
    output: Path,
    left: Sequence[Path],
) -> Iterator[Budget]:
    """Provide the budget and the executor of windows, until the end of the block.

    Windows that a killed command left of the same picture are reused.
    """
    if crew is None:
        yield here
        return
    allowed = here.memory
    each = allowed // crew.tasks if crew.is_local else min(allowed, crew.memory or allowed)
    mark = _mark(media, shown)
    with beside(Path(os.path.realpath(output))) as folder:
        same = [one for one in left if mark is not None and _mark_in(one) == mark]
        if same:
            same[0].rename(folder)
            count = len(list(folder.glob(NAME.format(*"****"))))
            say(f"{count} windows are reused from a command that was killed")
        else:
            folder.mkdir()
            (folder / MARK).write_text(mark or "", encoding="utf-8")
        yield Budget(each, crew.threads, folder, crew.executor)


def _mark(media: Sequence[VolumeLayer], shown: tuple[Any, ...]) -> str | None:
    """Return a key shared by pictures of equal pixels; None if values may change unnoticed."""
    known: list[Any] = [installed_version(), shown]
    for volume, look in media:
        labels = [] if look.labels is None else [look.labels.values]
        states = [values_of(stored).state() for stored in (volume.values, *labels)]
        if None in states:
            return None
        known += [states, volume[1:], replace(look, labels=None)]
        known += [] if look.labels is None else [look.labels.rules]
    return fingerprint(known)


def _mark_in(folder: Path) -> str | None:
    try:
        return (folder / MARK).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None
