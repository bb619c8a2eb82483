"""Composites along rays against a loop of short steps through SciPy's spline."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from resample.cameras.viewpoints import Orbit
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume.appearance import Appearance, Classification
from resample_volume.classification.transfer import from_points
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from resample_volume.voxels.shading import DepthCue, Light
from tests import ray_truth

LOOK = from_points(
    [(40.0, (0.1, 0.2, 0.9), 0.0), (90.0, (0.2, 0.9, 0.2), 0.3), (200.0, (0.9, 0.3, 0.1), 0.9)]
)
SIZE = (20, 24)
NOISE = gaussian_filter(np.random.default_rng(3).normal(size=(10, 12, 11)), 1.5)
BLOBS = as_volume(np.clip(NOISE / NOISE.std() * 80 + 60, 0, 255).astype(np.float32))
GAPS = BLOBS._replace(values=np.where(np.arange(11) < 4, np.float32(np.nan), BLOBS.values))
FLAT = BLOBS._replace(spacing=np.array([1.0, 0.8, 2.0]))
C, S = np.cos(0.5), np.sin(0.5)
TURNED = BLOBS._replace(direction=np.array([[C, -S, 0], [S, C, 0], [0, 0, -1.0]]))
ORBIT, UNLIT = Orbit(30, 20, 1.5), {"light": None}
# Volume, appearance and camera.
CASES = {
    "unlit": (BLOBS, UNLIT, ORBIT),
    "parallel": (BLOBS, UNLIT, Orbit(30, 20, 1.2, 0)),
    "inside": (BLOBS, UNLIT, Orbit(30, 20, 0.2)),
    "depth cue": (BLOBS, {"light": None, "cue": DepthCue(0.8)}, ORBIT),
    "clipped": (BLOBS, {"light": None, "clip": ("1/0/0",)}, ORBIT),
    "clipped, lit": (BLOBS, {"clip": ("1/0/0", "0/1/-1")}, ORBIT),
    "cropped": (BLOBS, {"light": None, "crop": "2:8,:,3:"}, ORBIT),
    "gaps": (GAPS, UNLIT, ORBIT),
    "headlight": (BLOBS, {}, ORBIT),
    "direction": (BLOBS, {"light": Light((1, -1, 2))}, ORBIT),
    "anisotropic": (FLAT, {}, ORBIT),
    "turned": (TURNED, {}, ORBIT),
    "gradients": (BLOBS, {"gradient_opacity": (0.1, 0.6)}, ORBIT),
}


@pytest.mark.sweep
@pytest.mark.parametrize("is_fine", [False, True])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=pytest.mark.sweep
            if name in ("unlit", "cropped", "clipped", "direction", "headlight")  # parts of others
            else (),
        )
        for name in CASES
    ],
)
def test_light_along_rays_is_that_of_short_steps(name, is_fine, record):
    volume, choice, viewpoint = CASES[name]
    appearance = Appearance(LOOK, classification=Classification.POST, **choice)
    resampler = Resampler(order=Rays(0.1 if is_fine else 1.0), subpixels=1)
    subject = Subject.of(volume, appearance, resampler)
    camera = subject.camera(viewpoint, *SIZE)
    field = subject.samples_for(camera)
    found = resampler(field, camera, height=SIZE[0], width=SIZE[1], clip=subject.clip).rgba
    met = ray_truth.along_rays(volume.values, field, camera, SIZE, subject.clip)
    truth = ray_truth.composite(met, field, subject.clip)
    assert truth[..., 3].max() > 0.5
    record.quality("picture", -10 * np.log10(np.mean((found - truth) ** 2)))
