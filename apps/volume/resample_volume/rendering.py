"""From a volume to a picture: classify, shade, resample."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from resample.cameras import Camera
from resample.resampler import Resampler
from resample.types import Frame, Samples
from resample_volume.framing import Orbit, Shifted, centered, placed
from resample_volume.presets import transfer_for
from resample_volume.shading import Light, shade
from resample_volume.transfer import TransferFunction
from resample_volume.types import Volume
from resample_volume.voxels import Voxels, classify


@dataclass(frozen=True)
class Appearance:
    """What voxels look like."""

    transfer: TransferFunction | str = "auto"  # function, or what `load_transfer` takes
    light: Light | None = field(default_factory=Light)  # None: colors as they are
    gradient: str = "central"  # or sobel
    gradient_opacity: tuple[float, float] | None = None  # see `classify`


def as_volume(values: NDArray[np.generic], name: str = "array") -> Volume:
    """Array (Z, Y, X) as a volume of spacing 1 around no origin in particular."""
    if values.ndim != 3 or 0 in values.shape:
        raise ValueError(f"a volume is an array (Z, Y, X) with voxels in it, not {values.shape}")
    return Volume(values, np.ones(3), np.zeros(3), np.eye(3), name)


def visible_voxels(volume: Volume, appearance: Appearance) -> Voxels:
    """Voxels that the transfer function lets be seen, with gradients where they are needed."""
    given = appearance.transfer
    transfer = transfer_for(given, volume) if isinstance(given, str) else given
    needed = appearance.light is not None or appearance.gradient_opacity is not None
    return classify(
        volume,
        transfer,
        gradient=appearance.gradient if needed else None,
        gradient_opacity=appearance.gradient_opacity,
    )


def lit_samples(voxels: Voxels, light: Light | None, camera: Camera) -> Samples:
    """Samples that carry the light which voxels send to a camera."""
    view = camera.view()
    if view.perspective:
        return shade(voxels, light, eye=-view.rotation.T @ view.translation)
    return shade(voxels, light, view=view.rotation[2])


def render(
    volume: Volume | NDArray[np.generic],
    appearance: Appearance | str = "auto",
    camera: Camera | Orbit | None = None,
    *,
    height: int = 400,
    width: int = 400,
    resampler: Resampler | None = None,
    progress: Callable[[float], None] | None = None,
) -> Frame:
    """Picture of a volume.

    Parameters
    ----------
    volume
        A volume, or an array (Z, Y, X) with spacing 1. NaN is transparent.
    appearance
        What voxels look like; a name stands for a transfer function.
    camera
        Any camera, or one that is placed around the volume; None is `Orbit()`.
    height, width
        Of the picture, px.
    resampler
        Renderer; None is the default `Resampler()`.
    progress
        Called with the share of the work done, 0 to 1.

    Returns
    -------
    Premultiplied linear RGBA with depth and coverage; wholly transparent if no voxel is seen.

    Raises
    ------
    ValueError
        The array is no volume, or a choice is not allowed.
    """
    scene, middle = centered(volume if isinstance(volume, Volume) else as_volume(volume))
    look = appearance if isinstance(appearance, Appearance) else Appearance(appearance)
    place = Orbit() if camera is None else camera
    if not isinstance(place, Orbit):
        place = Shifted(place, middle)
    voxels = visible_voxels(scene, look)
    eye = placed(place, voxels, scene, height, width)
    samples = lit_samples(voxels, look.light, eye)
    paint = resampler or Resampler()
    return paint(samples, eye, height=height, width=width, progress=progress)
