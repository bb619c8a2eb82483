"""Scenes and measurements of splats and points, for tests."""

import itertools
from functools import cache
from typing import NamedTuple

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.poses import orbit
from resample.measuring.quality import psnr, rms
from resample.painting.choices import Footprint, Primitive
from resample.resampler import Resampler
from resample.types import Frame, Samples

HYBRID = Resampler()
POINTS = Resampler(primitive=Primitive.POINTS)
SPLATS = Resampler(primitive=Primitive.SPLATS)
PAPER = Resampler(primitive=Primitive.PAPER, footprint=Footprint.CORRECTED)
TRUTH = Resampler(primitive=Primitive.SPLATS, subpixels=16)
FORMS = {"points": POINTS, "splats": SPLATS, "hybrid": HYBRID, "paper": PAPER}

SCALES = (0.8, 0.5, 0.25, 0.125)  # px per voxel
CRUST = {0.9: 8, 0.3: 30}  # voxels of that opacity behind which nothing is seen
DEPTH = 1.2  # optical depth of the block along its axis: a transmittance of 0.30


@cache
def checker_box(alpha: float, crust: int | None = None) -> Samples:
    """Box of 100³ voxels in blocks of 10, every voxel of one of two colors and opacity `alpha`.

    `crust` keeps only voxels that near to the three sides which `distant` sees.
    """
    z, y, x = np.indices((100, 100, 100)).reshape(3, -1)
    if crust is not None:
        seen = (x >= 100 - crust) | (y < crust) | (z >= 100 - crust)
        x, y, z = x[seen], y[seen], z[seen]
    even = (x // 10 + y // 10 + z // 10) % 2 == 1
    color = np.where(even[:, None], [0.9, 0.2, 0.1], [0.1, 0.3, 0.9])
    extinction = np.full(x.size, -np.log1p(-alpha))
    position = (np.stack([x, y, z], axis=1) - 49.5).astype(np.float32)
    return Samples(position, color.astype(np.float32), extinction.astype(np.float32), np.eye(3))


class Shot(NamedTuple):
    """A camera with its picture's size."""

    camera: Camera
    height: int
    width: int

    def by(self, resample: Resampler, samples: Samples) -> Frame:
        """Frame of the samples."""
        return resample(samples, self.camera, height=self.height, width=self.width)


def distant(scale: float, azimuth: float = 30.0, shift: float = 0.0) -> Shot:
    """View of the whole checker box with `scale` px per voxel, moved to the right by `shift` px."""
    side = int(200 * scale) + 4
    pose = orbit((0, 0, 0), 400, azimuth, 25)
    # No symmetric place of the box among the pixels.
    camera = Camera.from_intrinsics(
        400 * scale, 400 * scale, side / 2 + 0.137 + shift, side / 2 + 0.21, pose
    )
    return Shot(camera, side, side)


@cache
def checker_truth(alpha: float, scale: float) -> np.ndarray:
    """Distant checker box with 16 × 16 rays per pixel, RGBA."""
    return distant(scale).by(TRUTH, checker_box(alpha, CRUST[alpha])).rgba


def object_psnr(picture: np.ndarray, truth: np.ndarray) -> float:
    """PSNR over premultiplied linear RGBA where there is anything to see, dB."""
    return psnr(picture, truth, mask=truth[..., 3] > 1e-4)


def minification(alpha: float, scale: float) -> dict[str, float]:
    """PSNR of every form of the distant checker box, dB."""
    samples, truth = checker_box(alpha), checker_truth(alpha, scale)
    return {
        name: object_psnr(distant(scale).by(form, samples).rgba, truth)
        for name, form in FORMS.items()
    }


@cache
def block() -> Samples:
    """Uniform block of 64³ white voxels around the origin."""
    z, y, x = np.indices((64, 64, 64)).reshape(3, -1)
    position = (np.stack([x, y, z], axis=1) - 31.5).astype(np.float32)
    white = np.ones((x.size, 3), np.float32)
    return Samples(position, white, np.full(x.size, DEPTH / 64, np.float32), np.eye(3))


class Place(NamedTuple):
    """From where the block is seen."""

    distance: float  # voxels from its middle, whose front lies at 32
    azimuth: float  # degrees
    elevation: float  # degrees

    def shot(self, scale: float) -> Shot:
        """View with `scale` px per voxel in the block's middle; a zoom changes the focal length."""
        pose = orbit((0, 0, 0), self.distance, self.azimuth, self.elevation)
        return Shot(
            Camera.from_intrinsics(self.distance * scale, self.distance * scale, 12.4, 12.4, pose),
            24,
            24,
        )


def block_transmittance(shot: Shot) -> tuple[np.ndarray, np.ndarray]:
    """Analytic transmittance of the block per pixel, and which pixels are interior.

    A pixel is interior when the rays through its corners enter by the front face, leave by the back
    face and stay more than 3 voxels away from the four sides.
    """
    parts = (np.arange(4) - 1.5) / 4  # px; a pixel may be as wide as a quarter of the block
    paths = [_through_block(shot, right, down)[0] for right in parts for down in parts]
    transmittance = np.mean(np.exp(-DEPTH / 64 * np.clip(paths, 0.0, 1e4)), axis=0)
    corners = [(x, y) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    interior = np.all([_through_block(shot, *corner)[1] for corner in corners], axis=0)
    return transmittance, interior


def _through_block(shot: Shot, right: float, down: float) -> tuple[np.ndarray, np.ndarray]:
    """Length of every pixel's ray in the block, voxels, and whether it stays off the sides."""
    camera = shot.camera
    row, column = np.indices((shot.height, shot.width)) + 0.5
    x, y = (column + right - camera.cx) / camera.fx, (row + down - camera.cy) / camera.fy
    rotation, translation = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    eye = -rotation.T @ translation
    ray = np.stack([x, y, np.ones_like(x)], axis=-1) @ rotation
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    front, back = ((face - eye[1]) / ray[..., 1] for face in (-32, 32))  # it is seen along +y
    sides = [np.abs(eye + t[..., None] * ray)[..., [0, 2]].max(axis=-1) for t in (front, back)]
    return back - front, np.maximum(*sides) < 29


class Still(NamedTuple):
    """One frame of a zoom at the block."""

    transmittance: np.ndarray  # (H, W) as rendered
    analytic: np.ndarray  # (H, W)
    interior: np.ndarray  # (H, W)
    frame: Frame

    @property
    def error(self) -> np.ndarray:
        """Relative error of the transmittance."""
        return self.transmittance / self.analytic - 1


def zoom(place: Place, scales: np.ndarray, form: Resampler) -> list[Still]:
    """The block at every scale."""
    samples, stills = block(), []
    for scale in scales:
        frame = place.shot(scale).by(form, samples)
        stills.append(Still(1 - frame.rgba[..., 3], *block_transmittance(place.shot(scale)), frame))
    return stills


class Jumps(NamedTuple):
    """Largest changes from one frame of a zoom to the next."""

    mean: float  # of the mean transmittance of pixels interior to both
    pixel: float  # of any of these pixels
    error: float  # of the relative error of any of these pixels


def jumps(stills: list[Still]) -> Jumps:
    """Largest changes from frame to frame."""
    steps = []
    for before, after in itertools.pairwise(stills):
        both = before.interior & after.interior
        change = (after.transmittance - before.transmittance)[both]
        error = (after.error - before.error)[both]
        steps.append((abs(change.mean()), np.abs(change).max(), np.abs(error).max()))
    return Jumps(*map(float, np.max(steps, axis=0)))


def rotation(form: Resampler, scale: float, azimuths: np.ndarray) -> np.ndarray:
    """RMS difference of consecutive frames while the checker box turns, over all pixels."""
    samples = checker_box(0.9, CRUST[0.9])
    frames = (distant(scale, azimuth).by(form, samples).rgba for azimuth in azimuths)
    before, found = next(frames), []
    for after in frames:
        found.append(rms(after, before))
        before = after
    return np.array(found)


@cache
def shifted_truths(alpha: float, scale: float, frames: int) -> list[np.ndarray]:
    """Truths of the box moved by 1/16 px per frame: one fine picture, averaged from 16 offsets."""
    camera, height, width = distant(scale)
    # A pixel more to the left, from where the box moves in.
    focal, x, y = 16 * camera.fx, 16 * (camera.cx + 1), 16 * camera.cy
    fine = Camera.from_intrinsics(focal, focal, x, y, camera.world_to_camera)
    samples = checker_box(alpha, CRUST[alpha])
    rays = SPLATS(samples, fine, height=16 * height, width=16 * (width + 1)).rgba
    moved = (rays[:, 16 - frame : 16 - frame + 16 * width] for frame in range(frames))
    return [each.reshape(height, 16, width, 16, 4).mean(axis=(1, 3)) for each in moved]


def flicker(form: Resampler, alpha: float, scale: float, frames: int = 16) -> float:
    """Temporal rms of a form's error, in levels of 255, while the box moves 1/16 px a frame.

    The standard deviation of a pixel's error over the frames, root mean square over pixels.
    """
    truths = np.array(shifted_truths(alpha, scale, frames))
    moved = (distant(scale, shift=frame / 16) for frame in range(frames))
    error = np.array([shot.by(form, checker_box(alpha)).rgba for shot in moved]) - truths
    seen = truths[..., 3].max(axis=0) > 1e-4
    return 255 * float(np.sqrt(error[:, seen].var(axis=0).mean()))
