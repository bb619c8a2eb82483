"""Ends of steps: the key up to which all samples are loaded."""

import math
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from resample.painting.scenes.plans import SLACK, SamplesInParts
from resample.painting.scenes.scene import PreparedScene
from resample.types import Film, Floats, Indices, Runs, Samples, Single, Tally, Tiles

if TYPE_CHECKING:
    from resample.engine.ellipsoids.steps import Carried

NEVER = 1 << 60  # number of a layer behind all others

Output = tuple[Film, Floats, Tally, "Carried"]  # the second are values of projections, if any


class Between(Enum):
    """Units between which a step can end."""

    SPLATS = 0  # composited one by one
    LAYERS = 1  # of points
    SHEETS = 2  # of whole splats
    SLABS = 3  # that cut splats
    NOTHING = 4  # all samples form one sum


class EndOfStep(NamedTuple):
    """End of a step."""

    last: Single  # samples from this key on are not painted yet
    again: Single  # smallest key of samples that stay in memory for the next step
    due: int  # number of the first layer that is not composited


class RunPainter(NamedTuple):
    """Painter of a planned scene by runs of samples: of all at once, or step by step."""

    runs: Callable[[Samples], Runs]
    find_spacings: Callable[[Tiles, Runs], None]
    paint: Callable[[Indices, Tiles, Runs, Output], None]  # paints tiles of given numbers
    points: Callable[[Tiles, Runs], int]  # number of visible samples that are points
    between: Between
    kept: int  # numbers per sub-pixel that are kept between steps
    is_measuring: bool = False  # values of a projection are measured


def keys_of(scene: PreparedScene, source: SamplesInParts) -> tuple[Floats, Floats, Single]:
    """Lower and upper bounds of keys in each part (P,), and the error of single keys.

    They are keys of single samples, even if sheets are summed.
    """
    layers, view = scene.layers, scene.view
    eye = -view.rotation.T @ view.translation
    if layers.is_around:
        place, per_unit = np.linalg.norm(source.center - eye, axis=1), 1.0
    else:
        place = layers.offset + source.center @ np.array(layers.axis)
        per_unit = float(np.linalg.norm(layers.axis))
    farthest = float(np.abs(source.center).max(initial=0.0)) + float(np.linalg.norm(eye))
    size = per_unit * farthest + abs(layers.offset) + float(np.abs(place).max(initial=0))
    if layers.eye > -np.inf:
        place, size = np.abs(place - layers.eye), size + abs(layers.eye)
    slack = SLACK * size
    reach = per_unit * source.radius + slack
    near = (place - reach).astype(np.float32)
    near[near == 0] = -np.finfo(np.float32).tiny  # keys of -0 sort before those of 0
    return near, (place + reach).astype(np.float32), np.float32(slack)


def cut_at(scene: PreparedScene, between: Between, key: Single, slack: Single) -> EndOfStep:
    """End of a step after which all other samples have keys of at least `key` minus `slack`."""
    is_end = key == np.inf
    thickness = np.float32(scene.layers.thickness)
    if is_end or between in (Between.SPLATS, Between.NOTHING):
        return EndOfStep(key, np.float32(key - slack), NEVER)
    if between is Between.SLABS:
        reach = math.sqrt(scene.ellipsoid.covariance[2, 2])
        due = math.floor((float(key) - float(slack) - reach) / scene.layers.thickness)
        # One more slab, since the first sample added determines its slab.
        again = (due - 1) * scene.layers.thickness - reach
        return EndOfStep(key, np.float32(again - slack), due)
    if between is Between.SHEETS and scene.layers.eye > -np.inf:
        # The middle of a sheet is at most half a sheet from its samples.
        last = np.float32(max(0.0, (float(key) - float(slack)) / float(thickness) - 0.5))
        return EndOfStep(last, last, NEVER)
    number = math.floor(key / thickness)
    if between is Between.SHEETS:
        return EndOfStep(np.float32(number), np.float32(number), NEVER)
    last = _first_of_layer(number, thickness)
    return EndOfStep(last, np.float32(last - slack), number)


def _first_of_layer(number: int, thickness: Single) -> Single:
    """Smallest key in a layer, as kernels number them."""
    key = np.float32(np.float32(number) * thickness)
    far = np.float32(np.inf)
    while math.floor(key / thickness) >= number:
        key = np.nextafter(key, -far)
    while math.floor(key / thickness) < number:
        key = np.nextafter(key, far)
    return key


def most_waiting(scene: PreparedScene, source: SamplesInParts, between: Between) -> int:
    """Upper bound on samples in memory that wait for parts that may be nearer."""
    near, far, _ = keys_of(scene, source)
    far = far + np.float32(_overlap_of_steps(scene, between))
    behind, order = np.argsort(far), np.argsort(near)
    begun = np.append(0, source.sizes[order].cumsum())[:-1]
    ended = np.append(0, source.sizes[behind].cumsum())
    ended = ended[np.searchsorted(far[behind], near[order], "left")]
    return int((begun - ended).max(initial=0))


def _overlap_of_steps(scene: PreparedScene, between: Between) -> float:
    """Distance in keys before the end of a step within which samples are kept."""
    if between is Between.SLABS:
        return 2 * math.sqrt(scene.ellipsoid.covariance[2, 2]) + 3 * scene.layers.thickness
    return 2 * scene.layers.thickness if between in (Between.LAYERS, Between.SHEETS) else 0.0
