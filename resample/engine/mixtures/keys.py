"""Keys of the sheets that samples lie in, for many samples at once."""

import math

import numpy as np

from resample.engine.ellipsoids.footprints import Eye, eye_of, in_camera
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.sorting import HALF, Pairs, bits_of, member_of, paired, sort_pairs
from resample.engine.vectors import Vector, dot, vector_at
from resample.types import LAST_SHEET, Floats, Layers, Runs, View

NONE = np.uint32(0xFFFFFFFF)
_SIGN = np.uint32(0x80000000)


@kernel
def _key_bits(layers: Layers, world: Vector, eye: Eye) -> np.uint32:
    """Integer key of a position, ascending in painting order."""
    # Place along the axis, or distance from the eye.
    place = layers.offset + dot(layers.axis, world)
    if layers.is_around:
        center = in_camera(eye, world)
        place = math.sqrt(dot(center, center))
    # Number of the sheet.
    number = np.floor(np.float32(place) / np.float32(layers.thickness))
    number = max(np.float32(-LAST_SHEET), min(np.float32(LAST_SHEET), number))
    # Sort by number, or by the distance from the eye; of two as far, the one ahead comes first.
    if layers.eye == -np.inf:
        return bits_of(number)
    ahead = float(number) + 0.5 - layers.eye / layers.thickness
    return bits_of(np.float32(abs(ahead))) + np.uint32(1 if ahead < 0.0 else 0)


@parallel_kernel
def find_first_sheets(counter: Counter, runs: Runs, layers: Layers, camera: View) -> None:
    """Set the key of each run to that of the nearest sheet that it reaches."""
    position, eye = runs.samples.position.reshape(-1), eye_of(camera)
    start, known = runs.start, runs.known
    for run in tasks(counter, known.size):
        # Reduce to the least key of the run's samples.
        least = NONE
        for n in range(start[run], start[run + 1]):
            least = min(least, _key_bits(layers, vector_at(position, np.uint64(n)), eye))
        # Undo the order-preserving map from floats to integers.
        bits = least ^ _SIGN if least >> np.uint32(31) else ~least
        known[run]["key"] = np.uint32(bits).view(np.float32)


@kernel
def key_by_sheets(
    pair: Pairs, position: Floats, begin: int, count: int, layers: Layers, eye: Eye
) -> None:
    """Replace the keys of samples by those of their sheets; positions are flat."""
    for n in range(count):
        sample = np.uint64(begin) + np.uint64(n)
        found = paired(_key_bits(layers, vector_at(position, sample), eye), int(sample))
        # A pair of 0 is a culled sample, and stays so.
        pair[np.uint64(n)] = found if pair[np.uint64(n)] > np.uint64(0) else np.uint64(0)


@kernel
def sort_by_depth(ready: Pairs, other: Pairs, position: Floats, eye: Eye) -> None:
    """Sort the samples of one sheet by depth; positions are flat."""
    r, shift = eye.rotation[2], eye.shift[2]
    for n in range(ready.size):
        sample = int(member_of(ready[np.uint64(n)]))
        depth = shift + dot(r, vector_at(position, np.uint64(sample)))
        ready[np.uint64(n)] = paired(bits_of(np.float32(depth)), sample)
    sort_pairs(ready, other)


@kernel
def end_of_sheet(ready: Pairs, first: int) -> int:
    """One past the last sample that lies in the same sheet as the first one."""
    last = first + 1
    while last < ready.size and ready[last] >> HALF == ready[first] >> HALF:
        last += 1
    return last
