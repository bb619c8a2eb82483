"""Formats of microscopes that bioio reads."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from resample.reading.native import damage, plain
from resample_volume.data.values import require_memory
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    header,
    recording,
)
from resample_volume.types import VOXEL, ChannelLook, Recording


@dataclass(frozen=True)
class BioIo(OneOfAll):
    """CZI, LIF, ND2 and others that a plugin of bioio reads: times and channels of one scene."""

    scene: str = ""  # its name; empty: the first

    suffixes: ClassVar[tuple[str, ...]] = (".czi", ".lif", ".nd2", ".lsm", ".oib", ".oif", ".dv")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        kind = path.suffix.lower()[1:]
        try:
            from bioio import BioImage
        except ImportError:
            raise ValueError(
                f"{path.name} is read by bioio: pip install bioio bioio-{kind}, or save it as "
                "OME-TIFF"
            ) from None
        with damage(path):
            image: Any = BioImage(plain(path))
            scenes = [str(scene) for scene in image.scenes]
        if self.scene and self.scene not in scenes:
            raise ValueError(
                f"{path.name} has no scene {self.scene!r:.80}; it has {', '.join(scenes):.200}"
            )
        with damage(path):
            image.set_scene(self.scene or scenes[0])
            times, parts, z, y, x = (int(size) for size in image.shape[-5:])
            sizes = [getattr(image.physical_pixel_sizes, axis) for axis in "XYZ"]
            labels, dtype = [str(one) for one in image.channel_names], np.dtype(image.dtype)
        is_told = all(sizes)
        known = header((x, y, z), dtype, name, spacing=sizes if is_told else (1, 1, 1))
        known = known._replace(times=times, parts=parts, length="µm" if is_told else VOXEL)
        check(known)
        require_memory(known.size, name)
        with damage(path):
            values = np.asarray(image.get_image_data("TCZYX"))
        looks = tuple(ChannelLook(label[:80]) for label in labels)
        return recording(values, known, channels_first=True)._replace(looks=looks)
