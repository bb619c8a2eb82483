"""Networks that estimate the depth of single pictures, from files in ONNX by onnxruntime."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from resample.colors import to_srgb
from resample.files.pictures import Picture
from resample.messages import numbers_in
from resample.types import Floats
from resample_warp3d.command.filming.choices import MEAN, SHORTER, SPREAD, Estimating
from resample_warp3d.depth.encodings import Raw

SQUEEZED = 0.01  # difference of proportions below which a map is of its picture
MULTIPLE = 14  # px of a network's patches, whose multiples sides are


@dataclass(frozen=True, eq=False)
class DepthModel:
    """A network that estimates the depth of single pictures."""

    choice: Estimating
    session: Any  # of onnxruntime

    def __post_init__(self) -> None:
        form = self.session.get_inputs()[0].shape
        if len(form) != 4 or (isinstance(form[1], int) and form[1] != 3):
            raise ValueError(
                f"{self.path} takes arrays {form}; a network of depth takes pictures (N, 3, H, W)"
            )

        mean, spread = self._levels
        if mean.shape != (3,) or spread.shape != (3,) or not (spread > 0).all():
            raise ValueError("--model-mean and --model-std are three numbers, the latter above 0")

    @cached_property
    def _levels(self) -> tuple[Floats, Floats]:
        """Levels that the network takes for 0, and by which they are then divided."""
        about = self.session.get_modelmeta().custom_metadata_map
        return (
            np.array(numbers_in("mean", self.choice.model_mean or about.get("mean", MEAN)), "f4"),
            np.array(numbers_in("std", self.choice.model_std or about.get("std", SPREAD)), "f4"),
        )

    @property
    def path(self) -> Path:
        """File of the network."""
        assert self.choice.depth_model is not None
        return self.choice.depth_model

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the file and the options."""
        digest = hashlib.sha256(
            self.choice.model_dump_json(exclude={"depth_model", "model_batch"}).encode()
        )
        with self.path.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
        return digest.hexdigest()

    @property
    def batch(self) -> int:
        """Pictures at a time."""
        given = self.session.get_inputs()[0].shape[0]
        return given if isinstance(given, int) else self.choice.model_batch

    def estimate(self, pictures: Sequence[Picture]) -> list[Raw]:
        """Return the depth of pictures of one size, in the network's numbers and at its size."""
        import cv2

        mean, spread = self._levels
        small = [self._reduced(picture) for picture in pictures]
        array = np.stack([(each - mean) / spread for each in small]).transpose(0, 3, 1, 2)
        form, count = self.session.get_inputs()[0], len(pictures)
        if isinstance(form.shape[0], int) and form.shape[0] > count:
            array = np.concatenate([array, np.repeat(array[-1:], form.shape[0] - count, axis=0)])
        kind = np.float16 if form.type == "tensor(float16)" else np.float32
        (made, *_) = self.session.run(None, {form.name: np.ascontiguousarray(array, kind)})
        made = np.asarray(made, np.float32)
        height, width = made.shape[-2:]
        if made.size != len(array) * height * width:
            raise ValueError(f"{self.path} gives arrays {made.shape}, not one map per picture")
        maps = made.reshape(-1, height, width)[:count]
        rows, columns = pictures[0].data.shape[:2]
        size = round(height * columns / rows), height  # networks of one size squeeze pictures
        if abs(size[0] / width - 1.0) < SQUEEZED:
            return list(maps)
        return [cv2.resize(each, size, interpolation=cv2.INTER_LINEAR) for each in maps]

    def _reduced(self, picture: Picture) -> Floats:
        """Return the levels (h, w, 3) of a picture at the network's size, 0..1."""
        import cv2

        color = picture.data[..., :3] if picture.data.shape[2] > 2 else picture.data[..., [0, 0, 0]]
        height, width = color.shape[:2]
        about = self.session.get_modelmeta().custom_metadata_map
        shorter = self.choice.model_size or int(about.get("size", SHORTER))
        form, scale = self.session.get_inputs()[0].shape, shorter / min(height, width)
        rows, columns = (
            given if isinstance(given, int) else max(1, round(side * scale / MULTIPLE)) * MULTIPLE
            for given, side in zip(form[2:], (height, width), strict=True)
        )
        way = cv2.INTER_AREA if rows * columns < height * width else cv2.INTER_CUBIC
        color = np.ascontiguousarray(color, np.float32)
        light = cv2.resize(color, (columns, rows), interpolation=way)
        return np.asarray(to_srgb(np.clip(light, 0.0, 1.0)), np.float32)


def opened(choice: Estimating, threads: int | None) -> DepthModel | None:
    """Open a network, if there is one."""
    if choice.depth_model is None:
        given = ("model_size", "model_mean", "model_std")
        for name in given:
            if getattr(choice, name) is not None:
                raise ValueError(f"--{name.replace('_', '-')} belongs to --depth-model")
        return None
    if not choice.depth_model.is_file():
        raise FileNotFoundError(2, "No such file", str(choice.depth_model))
    try:
        import onnxruntime
    except ImportError:
        raise ValueError(
            "--depth-model needs onnxruntime, which is not installed: "
            "pip install 'hybrid-resample[depth]'"
        ) from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads or 0
    options.log_severity_level = 3
    try:
        session = onnxruntime.InferenceSession(str(choice.depth_model), options)
    except Exception as error:
        text = str(error).partition("\n")[0]
        raise ValueError(f"{choice.depth_model} is not a network that runs: {text}") from None
    return DepthModel(choice, session)
