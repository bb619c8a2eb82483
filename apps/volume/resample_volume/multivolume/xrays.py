"""X-rays of CT volumes: attenuation, and the gray levels of line integrals."""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb, to_srgb
from resample.memory.mapped import array_like, most_of
from resample.messages import check_numbers, doubles_of, shortly
from resample.outofcore.passes import memoized
from resample.types import Frame
from resample_volume.classification.automatic import BRIGHT
from resample_volume.classification.value_statistics import Survey, survey
from resample_volume.data.memory import require_memory
from resample_volume.data.parts import slabs
from resample_volume.data.recordings import how
from resample_volume.types import Volume

# Of water, per mm, near 70 keV. NIST's tables (Hubbell and Seltzer, NISTIR 5632, 2004) have 0.0206
# at 60 keV and 0.0184 at 80 keV.
MU_WATER = 0.02
WATER = 1000.0  # HU from air, which attenuates nothing, to water
LEAST_WINDOW = 1e-6  # white level of line integrals where nothing attenuates

Window = tuple[float, float]  # line integrals of black and of white


@dataclass(frozen=True)
class XRay:
    """Options of X-rays of Hounsfield units.

    The transmittance of a ray is exp(-p), with p the integral of mu_water · max(0, 1 + HU / 1000)
    along it. Gray levels are linear in p, bones are white.

    Raises
    ------
    ValueError
        A number is outside its range.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import Appearance, XRay, as_volume, render
    >>> water = as_volume(np.zeros((8, 8, 8), np.float32))._replace(units="hu")
    >>> frame = render(water, Appearance(xray=XRay(0.02)), "front", size=(32, 32))
    >>> round(float(frame.value[16, 16]), 2)  # 8 mm of it
    0.16
    """

    mu_water: float = MU_WATER  # attenuation of water per scene unit, mm
    window: Window | None = None  # None: 0 to about the greatest along the volume's own axes
    added: float | None = (
        None  # offset to Hounsfield units; None: as the volume says, or guessed from its values
    )

    def __post_init__(self) -> None:
        check_numbers(self, "mu_water", "added")
        if not 0 < self.mu_water < math.inf:
            raise ValueError(
                f"mu-water is {self.mu_water:g}; it must be above 0, such as {MU_WATER} per mm"
            )
        if self.window is not None:
            pair = doubles_of("window", self.window, "two ascending values")
            if pair.shape != (2,):
                raise ValueError(f"window {shortly(self.window)}; give two ascending values")
        if self.window is not None and not -math.inf < self.window[0] < self.window[1] < math.inf:
            raise ValueError(f"the window {self.window} of line integrals must ascend")


class Tone(NamedTuple):
    """Tone mapping of a frame's values and light."""

    scale: float = 1.0  # factor of values
    window: Window | None = None  # values of black and white; None: light is as it is
    is_negative: bool = False  # whether black and white are swapped

    def developed(self, frame: Frame) -> Frame:
        """Return the tone mapped frame; opaque if inverted or windowed."""
        if self.window is not None and frame.value is not None:
            low, high = self.window
            value = frame.value * np.float32(self.scale)
            gray = from_srgb(np.clip((value - np.float32(low)) / np.float32(high - low), 0, 1))
            rgba = np.stack([gray, gray, gray, np.ones_like(gray)], axis=-1)
            frame = frame._replace(value=value, rgba=rgba)
        if not self.is_negative:
            return frame
        rgba = np.ones_like(frame.rgba)
        rgba[..., :3] = negative(frame.rgba[..., :3])
        return frame._replace(rgba=rgba)


AS_IT_IS = Tone()


def negative(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Invert displayed levels, of linear light."""
    return np.asarray(from_srgb(1 - to_srgb(np.clip(light, 0, 1))))


def settled(xray: XRay, volume: Volume, known: Survey | None = None) -> XRay:
    """Return the options with units and window resolved for a volume.

    `known`: statistics of its values; None: computed here.
    """
    if volume.colors is not None:
        raise ValueError(
            f"{volume.name} has colors, and X-rays are of Hounsfield units; "
            + how("channel", volume.colors.shape[-1])
        )
    if xray.added is None:
        known = known or survey(volume)
        if known.units.added is None:
            why = f"its units are {volume.units}"
            if not volume.units:
                why = "neither its file nor its values show that they are Hounsfield units"
            raise ValueError(
                f"X-rays are of Hounsfield units, but {volume.name} holds {known.low:g} to "
                f"{known.high:g}, and {why}; give its units, hu or hu+1024, or take the projection "
                "additive"
            )
        xray = replace(xray, added=known.units.added)
    if xray.window is not None:
        return xray
    most = xray.mu_water * _longest(
        attenuation(volume.values, xray.added), *map(float, volume.spacing)
    )
    return replace(xray, window=(0.0, max(most, LEAST_WINDOW)))


@memoized(lambda values: values)
def attenuation(values: NDArray[Any], added: float | None) -> NDArray[Any]:
    """Return attenuation relative to water; NaN for missing values."""
    if most_of(values) is None:
        require_memory(4 * values.size, f"attenuation of {values.size} voxels")
    found = array_like(values, values.shape, np.float32, "attenuation")
    for part, given in zip(slabs(found), slabs(values), strict=True):
        part[:] = given
        np.subtract(part, np.float32((added or 0.0) - WATER), out=part)
        np.divide(part, np.float32(WATER), out=part)
        np.maximum(part, 0, out=part)
    return found


@memoized(lambda values: values)
def _longest(values: NDArray[Any], x: float, y: float, z: float) -> float:
    """Estimate the greatest integral along lines of voxels with these spacings, scene units."""
    deep, down, across = values.shape
    along_z, along_y, along_x = (
        np.zeros(size) for size in ((down, across), (deep, across), (deep, down))
    )
    for n, plane in enumerate(values):
        known = np.nan_to_num(plane.astype(np.float64), nan=0.0)
        along_z += known
        along_y[n], along_x[n] = known.sum(axis=0), known.sum(axis=1)
    ends = [z * along_z.ravel(), y * along_y.ravel(), x * along_x.ravel()]
    return float(np.percentile(np.concatenate(ends), BRIGHT))
