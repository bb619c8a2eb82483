"""A volume made ready once and painted as often as is asked for, with its times kept."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from resample.cameras import Camera
from resample.console import progress_bar, say
from resample.resampler import Resampler
from resample.types import Frame, Samples
from resample_volume.choices import Look
from resample_volume.framing import Orbit, Shifted, centered, placed
from resample_volume.rendering import lit_samples, visible_voxels
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

    def samples(self, volume: Volume, look: Look, size: tuple[int, int]) -> tuple[Samples, Camera]:
        """Lit samples of a volume, and the camera that sees them in a picture (height, width)."""
        appearance, viewpoint = look.appearance(volume), look.viewpoint()
        announce_compilation()
        scene, middle = centered(volume)
        with self.stage("classify"):
            voxels = visible_voxels(scene, appearance)
        if not voxels.extinction.size:
            say("nothing to see: the transfer function makes every voxel transparent")
        camera = placed(viewpoint, voxels, scene, *size)
        if not isinstance(viewpoint, Orbit):
            camera = Shifted(camera, middle)
        with self.stage("shade"):
            return lit_samples(voxels, appearance.light, camera), camera

    def paint(
        self,
        resampler: Resampler,
        samples: Samples,
        camera: Camera,
        size: tuple[int, int],
        threads: int | None,
    ) -> Frame:
        """Picture (height, width) of samples, with a bar while it takes long."""
        with progress_bar("painting") as progress:
            frame = resampler(
                samples, camera, height=size[0], width=size[1], threads=threads, progress=progress
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
            "seconds": {name: round(seconds, 6) for name, seconds in self.seconds.items()},
        }


def announce_compilation() -> None:
    """Say on stderr that the first run takes longer, if this is one."""
    from resample.kernels.jit import is_stored
    from resample.kernels.paint import paint_tiles

    if not is_stored(paint_tiles):
        say("compiling kernels, once per installation: about half a minute")
