"""Scenes and measures of volumes in orders of samples, for tests."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import orbit
from resample.measuring.quality import psnr, rms
from resample.painting.choices import Primitive
from resample.resampler import Resampler
from resample.types import Samples
from resample_volume.classification.presets import load_transfer
from resample_volume.classification.transfer import Transfer, from_points
from resample_volume.files.generated import checker_box
from resample_volume.types import Volume
from resample_volume.voxels.framing import centered
from resample_volume.voxels.shading import Light, shade
from resample_volume.voxels.visible import Voxels, classify

SPLATS = Resampler(primitive=Primitive.SPLATS)
SEEN = 1e-4  # opacity from which on a pixel belongs to the object
RED, BLUE, WHITE = (0.9, 0.2, 0.1), (0.1, 0.3, 0.9), (1.0, 1.0, 1.0)


class Shot(NamedTuple):
    """A camera with its picture's size, px."""

    camera: Camera | Orthographic
    height: int
    width: int

    def by(self, form: Resampler, scene: Samples) -> np.ndarray:
        """RGBA of a scene."""
        return form(scene, self.camera, height=self.height, width=self.width).rgba

    @property
    def eye(self) -> np.ndarray:
        """Where the camera stands, scene units."""
        view = self.camera.view()
        return -view.rotation.T @ view.translation


@dataclass(frozen=True, eq=False)
class Scene:
    """A volume around the origin and what it looks like."""

    volume: Volume
    transfer: Transfer
    light: Light | None = None

    @cached_property
    def voxels(self) -> Voxels:
        """Those that are seen."""
        gradient = None if self.light is None else "central"
        return classify(self.volume, self.transfer, gradient=gradient)

    def samples(self, shot: Shot) -> Samples:
        """Visible voxels, lit for a camera."""
        return shade(self.voxels, self.light, eye=shot.eye)


def scene_of(values: np.ndarray, transfer: Transfer, spacing: float = 1.0) -> Scene:
    """Values (Z, Y, X) around the origin."""
    volume = Volume(values, np.full(3, spacing), np.zeros(3), np.eye(3), "scene")
    return Scene(centered(volume)[0], transfer)


@cache
def checker(size: int = 100, block: int = 10, opacity: float = 1.0) -> Scene:
    """The paper's Checker Box, by its own transfer function."""
    volume, _ = centered(checker_box(size, block))
    return Scene(volume, load_transfer(f"checker:opacity={opacity}"))


def object_psnr(picture: np.ndarray, truth: np.ndarray) -> float:
    """PSNR over premultiplied linear RGBA where there is anything to see, dB."""
    return psnr(picture, truth, mask=truth[..., 3] > SEEN)


def turned(scene: Scene, form: Resampler, azimuths: np.ndarray) -> np.ndarray:
    """Second differences of a small volume that turns, 72 × 72 px, 1.4 px per voxel."""
    shots = [
        Shot(Camera.from_intrinsics(180, 180, 36, 36, orbit((0, 0, 0), 128, azimuth, 20)), 72, 72)
        for azimuth in azimuths
    ]
    samples = scene.samples(shots[0])
    # RMS over all pixels of f(t + 1) - 2 f(t) + f(t - 1), for every frame but two
    frames = (shot.by(form, samples) for shot in shots)
    found, past = [], []
    for frame in frames:
        past = [*past[-2:], frame]
        if len(past) == 3:
            found.append(rms(past[2].astype(np.float64) + past[0], 2.0 * past[1]))
    return np.array(found)


def wall(kind: str) -> Scene:
    """An evenly colored wall across a volume of 40 × 96 × 96 voxels.

    `thin` is one layer of voxels with an opacity of 0.9, `thick` two of 0.5. `steep` and `gentle`
    are what a peak of the transfer function shows of a ramp that is tilted against the lattice: up
    to one voxel to either side of its middle (opacity 0.9), or two (0.5).
    """
    z, y, x = np.indices((40, 96, 96)) - np.array([19.5, 47.5, 47.5])[:, None, None, None]
    if kind in ("thin", "thick"):
        inside = (z == 0.5) if kind == "thin" else np.abs(z) < 1
        opacity = 0.9 if kind == "thin" else 0.5
        flat = from_points([(0, WHITE, 0.0), (255, WHITE, opacity)])
        return scene_of(np.where(inside, 255, 0).astype(np.uint8), flat)
    normal = np.array([0.22, 0.13, 1.0]) / np.linalg.norm([0.22, 0.13, 1.0])
    ramp = np.clip(128 + 20 * (x * normal[0] + y * normal[1] + z * normal[2]), 0, 255)
    width, opacity = (20, 0.9) if kind == "steep" else (40, 0.5)
    peak = [(128 - width, WHITE, 0.0), (128, WHITE, opacity), (128 + width, WHITE, 0.0)]
    return scene_of(ramp.astype(np.float32), from_points(peak))


def wall_shot(oblique: bool) -> Shot:
    """Parallel view of the wall's middle at 1.7 px per voxel: every ray has the same way in it."""
    pose = orbit((0, 0, 0), 200, *((25, 35) if oblique else (0, 60)))
    return Shot(Orthographic(1.7, 1.7, 16.13, 16.21, pose), 32, 32)


def unevenness(picture: np.ndarray) -> float:
    """Standard deviation of the colors, levels of 255."""
    return 255 * float(picture[..., :3].astype(np.float64).std())


def across(scale: float, extent: float, azimuth: float = 30.0) -> Shot:
    """Parallel view of everything up to `extent` voxels from the origin, `scale` px per voxel."""
    side = 2 * int(np.ceil(scale * (extent + 3))) + 8
    pose = orbit((0, 0, 0), 2 * extent + 10, azimuth, 25)
    return Shot(Orthographic(scale, scale, side / 2 + 0.137, side / 2 + 0.21, pose), side, side)


def total_opacity(form: Resampler, samples: Samples, shot: Shot) -> float:
    """Integral of the opacity over the plane of projection, scene units²."""
    scale = shot.camera.view().focal[0]
    return float(shot.by(form, samples)[..., 3].sum(dtype=np.float64)) / scale**2


def ball(radius: float, spacing: float, dense: float = 1.0) -> Scene:
    """A smooth field that falls from 1 to 0 at a radius in scene units, sampled at a spacing.

    Its optical depth is the same for any radius, about 0.9 in the middle where `dense` is 1.
    """
    axis = np.arange(-radius - 1, radius + 1 + spacing / 2, spacing) / radius
    squared = axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2
    transfer = from_points([(0.0, WHITE, 0.0), (1.0, WHITE, dense / radius)], opacity_unit=1.0)
    return scene_of(np.clip(1 - squared, 0, 1).astype(np.float32) ** 3, transfer, spacing)


def off_axis(angle: float) -> Samples:
    """Single voxels around the view axis, 8 and 14 voxels away, seen at `angle` degrees off it."""
    turns, aside = np.radians(np.arange(0, 360, 30)), np.radians(angle)
    way = [(np.sin(aside) * np.cos(a), np.sin(aside) * np.sin(a), np.cos(aside)) for a in turns]
    position = [distance * np.array(each) for distance in (8.0, 14.0) for each in way]
    if angle == 0:
        position = [np.array([0.0, 0.0, 8.0])]
    count = len(position)
    white = np.ones((count, 3), np.float32)
    return Samples(
        np.array(position, np.float32), white, np.full(count, 1.5, np.float32), np.eye(3)
    )


def two_colors(opacity: float) -> Scene:
    """A box of 24³ voxels, one half red and the other blue."""
    values = np.full((24, 24, 24), 100, np.uint8)
    values[:, :, 12:] = 200
    values = np.pad(values, 3)
    colors = [(50, RED, 0.0), (50, RED, opacity), (150, RED, opacity), (150, BLUE, opacity)]
    return scene_of(values, from_points(colors))


def near(scene: Scene) -> Shot:
    """A volume of at most 60 voxels per side on 96 × 96 px, more than 1.2 px per voxel."""
    size = max(scene.volume.values.shape)
    pose = orbit((0, 0, 0), 4 * size, 30, 25)
    focal = 4 * size * 96 / (1.75 * size)
    return Shot(Camera.from_intrinsics(focal, focal, 48.137, 48.21, pose), 96, 96)
