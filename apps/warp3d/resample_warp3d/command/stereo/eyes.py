"""Eye distance and zero parallax of stereo pairs."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from resample.cameras.pixels import directions, pixel_centers
from resample.console import say
from resample.types import Doubles
from resample_warp3d.command.inputs import DepthInput, Inputs
from resample_warp3d.command.stereo.choices import Parallax

COMFORT = 0.015  # default parallax before and behind the screen, as a share of the width
COMFORT_AROUND = math.radians(2.0)  # default parallax of the nearest things to the farthest
STRAY = 0.01  # share of the depth at each end that may exceed this parallax


class Eyes(NamedTuple):
    """Parallax of two eyes: `gain` (n − `zero`) px at nearness n."""

    gain: float
    zero: float
    apart: float = 0.0  # distance between the eyes, scene units; 0: unknown

    @classmethod
    def of(cls, taken: Sequence[Inputs], choice: Parallax) -> "Eyes":
        """Choose eyes for a flat picture, or some of a film, and report them."""
        first = taken[0].views[0]
        known = np.concatenate([_known(inputs.views[0]) for inputs in taken])
        width, focal = first.shape[1], abs(float(first.pinhole.matrix[0, 0]))
        far, middle, near = np.quantile(known, [STRAY, 0.5, 1.0 - STRAY])
        zero = float(middle) if choice.zero_plane is None else 1.0 / choice.zero_plane
        if choice.eyes is None:
            gain = COMFORT * width / max(near - zero, zero - far, 1e-12)
        else:
            gain = focal * choice.eyes
        before, behind = gain * (near - zero), gain * (far - zero)
        say(
            f"the eyes are {gain / focal:.3g} apart, the screen is {1.0 / zero:.3g} away: "
            f"parallax from {behind:.1f} to {before:.1f} px"
        )
        return cls(gain, zero, gain / focal)

    @classmethod
    def around(cls, taken: Sequence[Inputs], choice: Parallax) -> "Eyes":
        """Choose parallel eyes for pictures of directions, and report them."""
        known = np.concatenate([_by_distance(v) for inputs in taken for v in inputs.views])
        far, near = np.quantile(known, [STRAY, 1.0 - STRAY])
        usual = COMFORT_AROUND / max(near - far, 0.5 * near)
        apart = usual if choice.eyes is None else choice.eyes
        least, most = (math.degrees(apart * each) for each in (far, near))
        say(f"the eyes are {apart:.3g} apart: parallax from {least:.2f} to {most:.2f} degrees")
        return cls(0.0, 0.0, float(apart))


def _known(view: DepthInput) -> Doubles:
    """Return the known nearness of a view."""
    nearness = view.image.nearness
    return nearness[nearness > 0].astype(np.float64)


def _by_distance(view: DepthInput) -> Doubles:
    """Return 1 / distance from the camera of the known points of a view."""
    image, camera = view.image, view.pinhole
    place = image.place if image.place.size else pixel_centers(view.shape)
    flat = directions(camera, place)
    length = np.sqrt(1.0 + (flat * flat).sum(axis=2))
    return np.asarray((image.nearness / length)[image.nearness > 0], np.float64)
