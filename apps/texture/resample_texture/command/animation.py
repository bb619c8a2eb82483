"""Camera flights over a picture, or around it, frame by frame."""

from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from resample.cameras.models import AnyCamera, Camera
from resample.cameras.poses import look_at
from resample.files.animations import Levels, Shots, check_count, fingerprint
from resample.files.saving import screen_levels
from resample.types import Floats
from resample_texture.drawing import Drawing, drawn
from resample_texture.geometry.cameras import plane_homography
from resample_texture.types import AnyLight, Edge, Method

FOV = 50.0  # degrees along the frame's shorter side


@dataclass(frozen=True)
class Flyover:
    """A closed path of a camera; the picture's longer side has length 1.

    `path`: `fly`, low over the picture, back and forth, or `turn`, around its center. `frames`:
    number of frames, 1 to `resample.files.animations.MOST_FRAMES`. `size`: height and width of a
    frame, px. Raises ValueError: there are too few or too many frames.
    """

    path: Literal["fly", "turn"] = "fly"
    frames: int = 48
    size: tuple[int, int] = (240, 426)

    def __post_init__(self) -> None:
        check_count(self.frames)

    def camera(self, n: int) -> AnyCamera:
        """Return the camera of frame `n`."""
        phase = 2.0 * np.pi * n / self.frames
        if self.path == "fly":
            eye = np.array([0.12 * np.sin(phase), -0.35 - 0.2 * np.cos(phase), 0.16])
            target = eye + np.array([0.06 * np.sin(phase + 0.5), 0.4, -0.18])
        else:
            elevation, target = np.radians(35.0), np.zeros(3)
            around = np.array([np.sin(phase), -np.cos(phase)]) * np.cos(elevation)
            eye = 1.3 * np.array([*around, np.sin(elevation)])
        height, width = self.size
        pose = look_at(eye, target)
        return Camera.from_fov(FOV, height=height, width=width, world_to_camera=pose)


@dataclass(frozen=True)
class FlightOptions:
    """How frames are painted: method, edge mode and background."""

    method: Method
    edge: Edge = Edge.TRANSPARENT
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear light
    light: AnyLight | None = None  # `pixels`, if the picture's levels are sRGB


def shots(source: Floats, flight: Flyover, paint: FlightOptions) -> Shots:
    """Return the frames of a flight over a picture, given as for `frame`."""
    job = {
        **asdict(flight),
        "picture": fingerprint(source),
        "method": repr(paint.method),
        "edge": paint.edge.value,
        "background": paint.background,
        "light": paint.light,
    }
    return Shots(flight.frames, lambda n: frame(source, flight, paint, n), job)


def frame(source: Floats, flight: Flyover, paint: FlightOptions, n: int) -> Levels:
    """Paint one frame (H, W, 3), sRGB-encoded, 8 bits.

    `source`: (H, W, 4) linear light, premultiplied; see `with_alpha`. `flight`, `paint`: the
    camera's path and how frames are painted. `n`: index of the frame, from 0.
    """
    texel_size = 1.0 / max(source.shape[:2])
    geometry = plane_homography(flight.camera(n), source.shape[:2], texel_size=texel_size)
    drawing = Drawing(paint.method, geometry, flight.size, paint.edge, linear_light=paint.light)
    image = drawn(source, drawing).image
    return screen_levels(image, background=paint.background)


def with_alpha(picture: Floats) -> Floats:
    """Return RGB and alpha (H, W, 4) of a gray or RGB picture with or without alpha."""
    channels = picture.shape[2]
    if channels not in (1, 2, 3, 4):
        raise ValueError(f"a picture of {channels} channels; gray and RGB ones can be shown")
    color = picture[..., [0, 0, 0]] if channels < 3 else picture[..., :3]
    alpha = picture[..., -1:] if channels in (2, 4) else np.ones_like(color[..., :1])
    return np.ascontiguousarray(np.concatenate([color, alpha], axis=2), np.float32)
