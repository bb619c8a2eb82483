"""Quality of coarser levels: `python -m benchmarks.coarser engine.nhdr vessel-tree:size=256`."""

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from resample.measuring.quality import psnr
from resample_volume.classification.materials import Windowed
from resample_volume.classification.presets import transfer_for
from resample_volume.files.source import open_recording
from resample_volume.files.stores.reader import Zarr
from resample_volume.files.stores.writing import Layered, write_store
from resample_volume.media.appearance import Appearance
from resample_volume.scenes import Scene
from resample_volume.voxels.visible import finite_range

SIZE = (500, 500)  # px


def losses(name: str, levels: Sequence[int] = (1, 2)) -> list[float]:
    """Errors in dB of pictures from coarser levels, from all sides, with one look."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "volume.zarr")
        write_store(path, open_recording(name), Layered(chunk=32))
        finest = Zarr()(path)
        window = Windowed(transfer_for("auto", finest), finite_range(finest.values))
        look = Appearance(window)
        exact = Scene(finest).render(look, size=SIZE).rgba
        found = []
        for level in levels:
            coarse = Scene(Zarr(level=level)(path)).render(look, size=SIZE).rgba
            found.append(psnr(coarse[..., :3], exact[..., :3]))
        return found


if __name__ == "__main__":
    for name in sys.argv[1:]:
        listed = ", ".join(f"{loss:.1f} dB" for loss in losses(name))
        sys.stdout.write(f"{Path(name).name}: levels 1 and 2 are {listed} from level 0\n")
