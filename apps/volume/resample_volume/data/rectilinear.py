"""Resample rectilinear grids with uneven planes onto a regular lattice."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Doubles
from resample_volume.data.values import require_memory
from resample_volume.types import Volume

EVEN = 1e-3  # of a step: smaller differences are rounding
MOST_PER_PLANE = 8  # even planes per uneven one, on average along an axis
MOST = 1 << 28  # samples, upper limit of the result unless the grid has more
BYTES_PER_SAMPLE = 12


class Even(NamedTuple):
    """An even axis that replaces an uneven one."""

    place: Doubles  # (N,) coordinates, evenly spaced
    step: float
    is_capped: bool  # whether steps are coarser than the least distance of the given planes


def rectilinear(
    values: NDArray[Any], x: ArrayLike, y: ArrayLike, z: ArrayLike, name: str = "grid"
) -> Volume:
    """Make a volume of values on a rectilinear grid.

    Along uneven axes, values are interpolated at the least distance of two planes, by Akima's
    modified cubics: through the given values, without ringing at edges. If that gave more than 8
    planes for each, the distance is larger. Even axes are unchanged.

    Parameters
    ----------
    values
        (Z, Y, X). Missing ones (NaN) make interpolation linear.
    x, y, z
        Coordinates of the planes, scene units, all ascending or all descending.
    name
        For messages.

    Returns
    -------
    The volume; its `note` describes the conversion.

    Raises
    ------
    ValueError
        Coordinates do not fit, are not monotonic or not finite; or too much memory is needed.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import rectilinear
    >>> grid = rectilinear(np.zeros((3, 2, 2)), [0, 1], [0, 1], [0, 1, 3])  # z is uneven
    >>> grid.values.shape, grid.spacing.tolist()
    ((4, 2, 2), [1.0, 1.0, 1.0])
    """
    if values.ndim != 3:
        raise ValueError(f"{name}: a grid has values (Z, Y, X), not {values.shape}")
    axes, sign = [], []
    for axis, given, count in zip("xyz", (x, y, z), values.shape[::-1], strict=True):
        place = np.asarray(given, np.float64)
        if place.shape != (count,):
            raise ValueError(
                f"{name} has {count} planes along {axis}, but coordinates of the shape "
                f"{place.shape}"
            )
        with np.errstate(invalid="ignore", over="ignore"):
            gaps = np.diff(place)
        is_sorted = np.isfinite(place).all() and ((gaps > 0).all() or (gaps < 0).all())
        if count < 2 or not is_sorted:
            raise ValueError(
                f"{name}: {axis} must be two or more finite coordinates that ascend or descend"
            )
        sign.append(-1 if place[0] > place[-1] else 1)
        axes.append(place[:: sign[-1]])
    values = values[tuple(slice(None, None, step) for step in reversed(sign))]
    even = [evened(place) for place in axes]
    sizes = [axis.place.size for axis in even]
    wide = np.prod([float(size) for size in sizes]) / MOST
    uneven = sum(axis.place is not place for axis, place in zip(even, axes, strict=True))
    if wide > 1 and uneven and values.size < MOST:
        even = [evened(place, float(wide ** (1 / uneven))) for place in axes]
    # Interpolate along uneven axes
    sizes = [axis.place.size for axis in even]
    listed = " x ".join(map(str, sizes))
    changed = [n for n in range(3) if even[n].place is not axes[n]]
    origin = np.array([axis.place[0] for axis in even])
    steps = np.array([axis.step for axis in even])
    plain = Volume(values, steps, origin, np.eye(3), name)
    if not changed:
        return plain
    what = f"{name} on an even lattice of {listed} voxels"
    require_memory(BYTES_PER_SAMPLE * int(np.prod(sizes)), what)
    for n in changed:
        values = along(values, axes[n], even[n], 2 - n)
    uneven_by = {"xyz"[n]: np.diff(axes[n]) for n in changed}
    low = ", ".join(f"{axis} {gap.min():.4g} to {gap.max():.4g}" for axis, gap in uneven_by.items())
    capped = ", not finer than memory and sense allow" if any(a.is_capped for a in even) else ""
    spacing = " x ".join(f"{step:.4g}" for step in steps)
    note = (
        f"uneven distances ({low}) were interpolated onto an even lattice of {listed} voxels, "
        f"{spacing} apart{capped}"
    )
    return plain._replace(values=values, note=note)


def evened(place: Doubles, coarser: float = 1.0) -> Even:
    """Return an even axis between the ends of an ascending one.

    `place`: (N,) coordinates. `coarser`: ratio of the steps to the least distance, if it is uneven.
    """
    gaps = np.diff(place)
    extent = place[-1] - place[0]
    if np.ptp(gaps) <= EVEN * gaps.mean():
        return Even(place, float(gaps.mean()), is_capped=False)
    least = max(coarser * gaps.min(), extent / (MOST_PER_PLANE * gaps.size))
    count = max(2, round(extent / least) + 1)
    even, step = np.linspace(place[0], place[-1], count), float(extent / (count - 1))
    nearest = place[np.abs(even[:, np.newaxis] - place).argmin(axis=1)]
    even = np.where(np.abs(even - nearest) <= EVEN * step, nearest, even)
    return Even(even, step, bool(least > (1 + EVEN) * gaps.min()))


def along(values: NDArray[Any], place: Doubles, even: Even, axis: int) -> NDArray[Any]:
    """Interpolate values along one axis; see `rectilinear`."""
    if even.place is place:
        return values
    from scipy.interpolate import Akima1DInterpolator

    given = np.asarray(values, np.float32)
    found = np.empty((*given.shape[:axis], even.place.size, *given.shape[axis + 1 :]), np.float32)
    other = 0 if axis else 1  # in parts, since SciPy computes in float64
    known = bool(np.isfinite(given).all())
    for n in range(given.shape[other]):
        at = (slice(None),) * other + (slice(n, n + 1),)
        if known:
            curve = Akima1DInterpolator(place, given[at], axis=axis, method="makima")
            found[at] = np.clip(curve(even.place), given[at].min(), given[at].max())
            continue
        # Linearly; at given planes, missing neighbours do not matter.
        first = np.clip(np.searchsorted(place, even.place, "right") - 1, 0, place.size - 2)
        share = (even.place - place[first]) / (place[first + 1] - place[first])
        share = share.reshape([-1 if n == axis else 1 for n in range(given.ndim)])
        below, above = given[at].take(first, axis), given[at].take(first + 1, axis)
        between = (1 - share) * below + share * above
        found[at] = np.where(share <= 0, below, np.where(share >= 1, above, between))
    return found
