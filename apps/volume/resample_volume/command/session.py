"""A volume made ready once and painted as often as is asked for, with its times kept."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from resample.cameras.models import Camera
from resample.command.console import progress_bar, say
from resample.profiles.orders import Summing
from resample.resampler import Footprint, Primitive, Resampler
from resample.types import Blocked, Doubles, Field, Frame, Samples
from resample_volume.rendering import Appearance, Subject, check_together
from resample_volume.types import Volume


@dataclass
class Session:
    """Stages of a rendering, timed; what the user should know goes to stderr."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Book the time of a block under a name."""
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def subject(self, volume: Volume, appearance: Appearance, resampler: Resampler) -> Subject:
        """Volume made ready for a renderer."""
        check_together(resampler, appearance.classification, appearance.extras)
        announce_compilation(resampler)
        with self.stage("classify"):
            subject = Subject.of(volume, appearance, resampler)
        if subject.is_empty:
            say("nothing to see: all voxels are transparent, missing or cut away")
        return subject

    def lit(self, subject: Subject, camera: Camera) -> Samples | Blocked | Field:
        """What a camera sees of a subject."""
        with self.stage("shade"):
            return subject.seen_by(camera)

    def paint(
        self,
        resampler: Resampler,
        samples: Samples | Blocked | Field,
        camera: Camera,
        size: tuple[int, int],
        threads: int | None = None,
        clip: Doubles | None = None,
    ) -> Frame:
        """Picture (height, width) of samples, with a bar while it takes long."""
        with progress_bar("painting") as progress:
            frame = resampler(
                samples,
                camera,
                height=size[0],
                width=size[1],
                threads=threads,
                progress=progress,
                clip=clip,
            )
        for name, seconds in frame.statistics.seconds.items():
            self.seconds[name] = seconds
        return frame

    def report(self, frame: Frame) -> dict[str, Any]:
        """Counts and times, for `--stats`."""
        counts = frame.statistics
        return {
            "samples": counts.samples,
            "points": counts.points,
            "splats": counts.splats,
            "splat_fraction": counts.splat_fraction,
            "hidden": counts.hidden,
            "subpixels": counts.subpixels,
            "outside": counts.outside,
            "occluded": counts.occluded,
            "skipped_fraction": counts.skipped_fraction,
            "seconds": {name: round(seconds, 6) for name, seconds in self.seconds.items()},
        }


def announce_compilation(resampler: Resampler) -> None:
    """Say on stderr that the first run takes longer, if this is one."""
    from resample.engine.jit import is_stored

    if not is_stored(_painter(resampler)):
        say("compiling kernels, once per installation: about 20 seconds")


def _painter(resampler: Resampler) -> Callable[..., None]:
    """Kernel that takes longest to compile."""
    from resample.engine.ellipsoids.deferred import paint_runs
    from resample.engine.paint import paint_tiles
    from resample.engine.slabs.painting import paint_summed_runs
    from resample.engine.slabs.sheets import paint_sheet_tiles

    is_exact = resampler.footprint in (None, Footprint.EXACT)
    is_plain = resampler.primitive in (Primitive.HYBRID, Primitive.SPLATS)
    if resampler.order.summing is not Summing.POINTS:
        return paint_summed_runs if is_exact and is_plain else paint_sheet_tiles
    return paint_runs if is_exact and is_plain else paint_tiles
