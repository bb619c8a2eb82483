"""Pictures painted from records of all samples, a plain way: the truth for what streams."""

from resample.painting.scene import check_samples
from resample.resampler import Resampler


def from_records(samples, camera, *, height, width, clip=None, **choices):
    """Frame of samples that are composited one by one, or as points in layers."""
    resample, checked = Resampler(**choices), check_samples(samples)
    scene = resample._scene(checked, camera.view(), (height, width), None, clip)
    return resample._render(resample._project(scene, checked), checked, None)
