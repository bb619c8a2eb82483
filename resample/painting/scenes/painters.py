"""The role of painters: what paints the samples of prepared scenes."""

from typing import Protocol

from resample.painting.scenes.scene import PaintTarget, PreparedScene
from resample.progress import Progress
from resample.types import Samples, Statistics


class SamplePainter(Protocol):
    """Paints the samples of a prepared scene."""

    def paint(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        """Picture of samples."""
