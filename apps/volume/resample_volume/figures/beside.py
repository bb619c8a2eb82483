"""VTK pictures for comparison, updated as look or camera changes."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

from resample.cameras.models import AnyCamera
from resample.resampler import Resampler
from resample.types import Floats
from resample_volume.baselines.peers import Peer, VtkRenderer
from resample_volume.classification.transfer import Transfer
from resample_volume.figures.compare import check_vtk
from resample_volume.media.appearance import Appearance, transfer_of
from resample_volume.types import Volume


@dataclass
class VtkBeside:
    """VTK's ray caster for one volume; keeps the state of the last look.

    One thread draws everything, as a window belongs to the thread that created it.
    """

    _thread: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "vtk"))
    _kept: tuple[Any, VtkRenderer] | None = None

    def picture(
        self,
        volume: Volume,
        appearance: Appearance,
        resampler: Resampler,
        camera: AnyCamera,
        size: tuple[int, int],
    ) -> Floats:
        """Render a picture (H, W, 4), premultiplied linear RGBA, one ray per pixel.

        Parameters
        ----------
        volume
            As placed before the camera; the same in all calls.
        appearance, resampler
            As for our own picture.
        camera
            The camera.
        size
            Width and height, px.

        Raises
        ------
        ValueError
            VTK is not installed, or cannot show this.
        """
        check_vtk(appearance, resampler)
        transfer = transfer_of(volume, appearance)
        drawn = self._thread.submit(self._drawn, volume, transfer, appearance, camera, size)
        return drawn.result()

    def _drawn(
        self,
        volume: Volume,
        transfer: Transfer,
        appearance: Appearance,
        camera: AnyCamera,
        size: tuple[int, int],
    ) -> Floats:
        key = (appearance, size)
        if self._kept is None or self._kept[0] != key:
            width, height = size
            look = Peer(light=appearance.light)
            self._kept = None  # frees the window before another is created
            self._kept = key, VtkRenderer(volume, transfer, height=height, width=width, look=look)
        return self._kept[1].render(camera)
