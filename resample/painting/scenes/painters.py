"""The role of painters: what paints the samples of prepared scenes."""

from collections.abc import Sequence
from typing import Protocol

from resample.painting.scenes.cuts import RunPainter
from resample.painting.scenes.plans import PicturePlan, PlansOfPart, SamplesInParts
from resample.painting.scenes.scene import PaintTarget, PreparedScene
from resample.types import Floats, Samples, Statistics
from resample.watching import Progress


class SamplePainter(Protocol):
    """Paints the samples of a prepared scene: all of it, a window, or step by step."""

    @property
    def needs_together(self) -> str | None:
        """Why the samples of a window are painted together; None: in steps if need be."""

    def paint(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        """Picture of samples; that of the window `NOTHING` is only planned."""

    def plans(self, scene: PreparedScene, samples: Samples, asked: Sequence[str]) -> PlansOfPart:
        """Plans of some of a picture's samples, in the ways of `ALL_PAINTERS` that are asked."""

    def plan_of_all(self, scene: PreparedScene, parts: Sequence[PlansOfPart]) -> PicturePlan | None:
        """Plan of all samples from those of all parts; None: plans in other ways are needed."""

    def plan_of_parts(self, scene: PreparedScene, source: SamplesInParts) -> PicturePlan | None:
        """Plan from bounds of parts alone; None: their samples are needed."""

    def margin(self, scene: PreparedScene, plan: PicturePlan) -> tuple[bool, float]:
        """Extent of painted samples beyond their exact footprints.

        Result: whether they are symmetric about their center, and a bound on the extent, px.
        """

    def spacings(self, scene: PreparedScene, samples: Samples) -> Floats:
        """Smallest spacing of samples in each tile (T,) of a planned scene; inf where empty."""

    def by_runs(self, scene: PreparedScene) -> tuple[PreparedScene, RunPainter]:
        """Painter of a planned scene by runs of samples, and the scene to use."""
