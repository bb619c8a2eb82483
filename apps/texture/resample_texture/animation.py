"""A camera that flies over a picture, or turns around it, frame by frame."""

import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from resample.cameras import Camera, Pinhole, look_at
from resample.compare import shown
from resample.images import over, replacing
from resample.kernels.jit import threads
from resample.types import Doubles, Floats
from resample_texture.planes import plane_seen_by
from resample_texture.types import Edge, Method

if TYPE_CHECKING:
    from PIL.Image import Image

ANIMATED = {".gif": "GIF", ".apng": "PNG"}
MOST_FRAMES = 10_000
FOV = 50.0  # degrees along the frame's shorter side

Progress = Callable[[float], None]
Levels = NDArray[np.uint8]


@dataclass(frozen=True)
class Flight:
    """A closed path of a camera; the picture's longer side has length 1.

    Parameters
    ----------
    path
        `fly`: low over the picture, forth and back; `turn`: around its middle.
    frames
        How many, 1 to `MOST_FRAMES`.
    size
        Height and width of a frame, px.

    Raises
    ------
    ValueError
        There are too few or too many frames.
    """

    path: Literal["fly", "turn"] = "fly"
    frames: int = 48
    size: tuple[int, int] = (240, 426)

    def __post_init__(self) -> None:
        if not 1 <= self.frames <= MOST_FRAMES:
            raise ValueError(f"{self.frames} frames; 1 to {MOST_FRAMES} are allowed")

    def camera(self, n: int) -> Camera:
        """Camera of a frame."""
        eye, target = self._fly(n) if self.path == "fly" else self._turn(n)
        height, width = self.size
        pose = look_at(eye, target)
        return Pinhole.from_fov(FOV, height=height, width=width, world_to_camera=pose)

    def _fly(self, n: int) -> tuple[Doubles, Doubles]:
        phase = 2.0 * np.pi * n / self.frames
        eye = np.array([0.12 * np.sin(phase), -0.35 - 0.2 * np.cos(phase), 0.16])
        ahead = np.array([0.06 * np.sin(phase + 0.5), 0.4, -0.18])
        return eye, eye + ahead

    def _turn(self, n: int) -> tuple[Doubles, Doubles]:
        angle, elevation = 2.0 * np.pi * n / self.frames, np.radians(35.0)
        around = np.array([np.sin(angle), -np.cos(angle)]) * np.cos(elevation)
        return 1.3 * np.array([*around, np.sin(elevation)]), np.zeros(3)


@dataclass(frozen=True)
class Paint:
    """How frames are made: by which method, with what at the edges and behind the picture."""

    method: Method
    edge: Edge = Edge.TRANSPARENT
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear light


def frames(
    picture: Floats, flight: Flight, paint: Paint, progress: Progress | None = None
) -> Iterator[Levels]:
    """Frames (H, W, 3) as a screen takes them.

    Parameters
    ----------
    picture
        (H, W, C) linear light: gray, RGB, or RGB and alpha, premultiplied.
    flight, paint
        Where the camera is and what it shows.
    progress
        Told the share that is done.
    """
    source = with_alpha(picture)
    texel_size = 1.0 / max(source.shape[:2])
    for n in range(flight.frames):
        geometry = plane_seen_by(flight.camera(n), source.shape[:2], texel_size=texel_size)
        with threads(None):
            image = paint.method(source, geometry, flight.size, paint.edge).image
        screen = shown(over(image, paint.background))
        yield np.floor(screen * 255.0 + 0.5).astype(np.uint8)
        if progress is not None:
            progress((n + 1) / flight.frames)


def with_alpha(picture: Floats) -> Floats:
    """RGB and alpha (H, W, 4) of a gray or RGB picture with or without alpha.

    Raises
    ------
    ValueError
        It has another number of channels.
    """
    channels = picture.shape[2]
    if channels not in (1, 2, 3, 4):
        raise ValueError(f"a picture of {channels} channels; gray and RGB ones can be shown")
    color = picture[..., [0, 0, 0]] if channels < 3 else picture[..., :3]
    alpha = picture[..., -1:] if channels in (2, 4) else np.ones_like(color[..., :1])
    return np.ascontiguousarray(np.concatenate([color, alpha], axis=2), np.float32)


def check_target(path: Path) -> None:
    """Refuse a target that `write` would refuse, before any work is done.

    Raises
    ------
    ValueError
        The suffix is neither an animation's nor missing.
    OSError
        A file stands where a folder should be made.
    """
    if path.suffix and path.suffix.lower() not in ANIMATED and not path.is_dir():
        raise ValueError(f"{path}: animations are written as .gif, .apng or a folder of .png files")
    if not path.suffix and path.exists() and not path.is_dir():
        raise OSError(f"{path} is not a folder")


def write(path: Path, levels: Iterator[Levels], fps: float) -> None:
    """Write frames as an animated picture, or as numbered PNG files of a folder; whole or not.

    Raises
    ------
    ValueError
        The suffix is unknown, or the rate is not above 0.
    OSError
        The target cannot be written.
    """
    from PIL import Image

    check_target(path)
    if not 0.0 < fps <= 1000.0:
        raise ValueError(f"{fps:g} frames per second; above 0 to 1000 are allowed")
    images = (Image.fromarray(frame) for frame in levels)
    form = ANIMATED.get(path.suffix.lower())
    if form is None:
        _write_folder(path, images)
        return
    with replacing(path) as temporary:
        _write_animated(temporary, images, form, fps)


def _write_animated(path: Path, images: Iterator["Image"], form: str, fps: float) -> None:
    first, *more = images  # pillow goes through them twice
    duration = 1000.0 / fps
    choices: dict[str, Any] = {"duration": duration, "loop": 0, "append_images": more}
    if form == "GIF":
        choices |= {"duration": max(20, 10 * round(duration / 10)), "optimize": False}
    first.save(path, format=form, save_all=True, **choices)


def _write_folder(path: Path, images: Iterator["Image"]) -> None:
    with _staged(path) as folder:
        for n, image in enumerate(images):
            image.save(folder / f"frame-{n:04d}.png")


@contextmanager
def _staged(path: Path) -> Iterator[Path]:
    """Folder beside another, whose files are moved there when all went well."""
    target = Path(os.path.realpath(path))
    stage = target.with_name(f".{target.name}.tmp{secrets.token_hex(4)}")
    stage.mkdir()
    try:
        yield stage
        target.mkdir(exist_ok=True)
        for file in sorted(stage.iterdir()):
            file.replace(target / file.name)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
