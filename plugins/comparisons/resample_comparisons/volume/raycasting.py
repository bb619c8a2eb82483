"""Reference ray caster: integrates the reconstructed field along rays. Accurate and slow.

Splats sum contributions per sample; this evaluates the field per point: extinction τ(p) = Σ τᵢ
kᵢ(p) and color c(p) = Σ τᵢ cᵢ kᵢ / Σ τᵢ kᵢ, with k the reconstruction around each sample, scaled so
that a constant field stays constant. A step of the ray has the opacity 1 − exp(−τ Δ) of its
midpoint (the error falls with the square of the step), steps are composited front to back, and a
pixel is the mean of N × N rays through its box.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.cameras.models import AnyCamera
from resample.painting.scenes import check_samples
from resample.profiles.reconstruction import GaussianKernel, Reconstruction
from resample.progress import Progress
from resample.types import Doubles, Floats, Samples, View
from resample_volume.data.values import require_memory

if TYPE_CHECKING:
    from resample_comparisons.volume.kernels.raycasting import CastingOptions, Grid

TABLE = 4096  # steps of the kernel's table; linear between them, it errs by under 2e-7 of the peak
QUADRATURE = np.polynomial.legendre.leggauss(200)
OFF_LATTICE = 0.02  # voxels; float32 keeps positions to 1/1000 of a voxel up to 10000 voxels away
ROWS_PER_CHECK = 8  # between two updates of progress, which also handle Ctrl-C


@dataclass(frozen=True, eq=False)
class Casting:
    """Options of ray casting.

    Raises ValueError: a number is outside its range.
    """

    rays: int = 4  # per side of a pixel: this number squared, evenly spread over the pixel's box
    step: float = 0.25  # longest step along a ray, voxels (cube roots of the lattice's volume)
    # Kernel around every sample.
    reconstruction: Reconstruction = field(default_factory=GaussianKernel)
    # (M, 4) planes n, d in scene units: points p with n · p + d >= 0 for all are kept.
    clip: ArrayLike | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.rays <= 64:
            raise ValueError(f"{self.rays} rays per side of a pixel; 1 to 64 are allowed")
        if not 0 < self.step < np.inf:
            raise ValueError(f"a step of {self.step} voxels; it must be above 0")
        given = np.zeros((0, 4)) if self.clip is None else self.clip
        planes = np.atleast_2d(np.asarray(given, np.float64))
        if planes.ndim != 2 or planes.shape[1] != 4:
            raise ValueError(f"clipping planes have the shape (M, 4), not {planes.shape}")
        if not np.isfinite(planes).all():
            raise ValueError("clipping planes must be finite")
        object.__setattr__(self, "clip", planes)


class Cast(NamedTuple):
    """Result of ray casting."""

    rgba: Floats  # (H, W, 4) premultiplied, linear light
    depth: Floats  # (H, W) z-depth weighted by opacity, scene units; inf where empty


class _RaySource(NamedTuple):
    """Samples, prepared for rays."""

    position: Floats  # (N, 3) scene units
    properties: Floats  # (N, 4) see `kernels.raycasting.Grid`
    visible: NDArray[np.bool_]  # (N,) whether a sample alone may be visible
    lattice: Doubles  # (3, 3)


DEFAULT = Casting()


def cast_rays(
    samples: Samples,
    camera: AnyCamera,
    *,
    height: int,
    width: int,
    look: Casting = DEFAULT,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Cast:
    """Render samples.

    `samples`: they must lie on their lattice: at an origin plus integer steps, at most one per
    node. `height`, `width`: of the picture, px. `progress`: called with the share of the work that
    is done, 0 to 1, and may raise to stop.
    """
    if height < 1 or width < 1:
        raise ValueError(f"a picture of {width} x {height} pixels; both must be at least 1")
    checked = check_samples(samples)
    color = checked.color * checked.extinction[:, None]
    properties = np.column_stack([checked.extinction, color])
    source = _RaySource(checked.position, properties, checked.extinction > 0, checked.lattice)
    picture = np.zeros((height, width, 5))
    if len(source.position):
        with _threads(threads):
            _cast(source, camera.view(), look, picture, progress)
    alpha = picture[..., 3]
    depth = np.divide(picture[..., 4], alpha, out=np.full(alpha.shape, np.inf), where=alpha > 0)
    return Cast(picture[..., :4].astype(np.float32), depth.astype(np.float32))


def _cast(
    source: _RaySource, view: View, look: Casting, picture: Doubles, progress: Progress | None
) -> None:
    """Fill a picture (H, W, 5), some rows at a time."""
    from resample_comparisons.volume.kernels.raycasting import cast_rows

    grid, plan = _grid(source, view, look.reconstruction), _plan(source, view, look)
    height = len(picture)
    for first in range(0, height, ROWS_PER_CHECK):
        count = min(ROWS_PER_CHECK, height - first)
        cast_rows(first, count, view, grid, plan, picture)
        if progress is not None:
            progress((first + count) / height)


def _grid(source: _RaySource, view: View, reconstruction: Reconstruction) -> "Grid":
    """Arrange samples on their lattice, for traversal by the camera's rays."""
    from resample_comparisons.volume.kernels.raycasting import Grid

    radius = float(reconstruction.radius)
    index, origin = _on_lattice(source.position, source.lattice)
    brick = max(4, int(np.ceil(2 * radius)))
    to_nodes = np.linalg.inv(source.lattice)
    eye = -view.rotation.T @ view.translation
    return Grid(
        index,
        np.ascontiguousarray(source.properties, np.float32),
        _occupied(index, source.visible, radius, brick),
        _density(reconstruction),
        radius,
        brick,
        np.ascontiguousarray(source.lattice),
        origin,
        to_nodes @ (eye - origin),
        np.ascontiguousarray(to_nodes @ view.rotation.T),
    )


def _on_lattice(position: Floats, lattice: Doubles) -> tuple[NDArray[np.int32], Doubles]:
    """Return the sample at each node (Z, Y, X), -1 for none, and the first node's position."""
    place = (position.astype(np.float64) - position[0]) @ np.linalg.inv(lattice).T
    node = np.rint(place)
    shift = (place - node).mean(axis=0)  # of all, as the first sample was rounded as well
    if np.abs(place - node - shift).max() > OFF_LATTICE:
        raise ValueError(
            "the samples do not stand on their lattice, at an origin plus whole steps; the "
            "reference ray caster needs that, the renderers do not"
        )
    first = node.min(axis=0)
    node = (node - first).astype(np.int64)
    size = node.max(axis=0) + 1
    require_memory(4 * int(np.prod(size.astype(object))), "the lattice around these samples")
    index = np.full(size[::-1], -1, np.int32)
    index[node[:, 2], node[:, 1], node[:, 0]] = np.arange(len(node))
    if (index >= 0).sum() < len(node):
        raise ValueError("two samples stand on one node of their lattice; leave one out")
    return index, position[0] + lattice @ (first + shift)


def _occupied(
    index: NDArray[np.int32], visible: NDArray[np.bool_], radius: float, brick: int
) -> NDArray[np.bool_]:
    """Return the bricks of `brick`³ nodes that visible samples' kernels overlap."""
    node = np.argwhere((index >= 0) & visible[index])
    size = np.floor((np.array(index.shape) - 1 + 2 * radius) / brick).astype(np.int64) + 1
    occupied = np.zeros(size, np.bool_)
    for corner in product((0, 2 * radius), repeat=3):
        reached = np.floor((node + corner) / brick).astype(np.int64)
        occupied[tuple(np.clip(reached, 0, size - 1).T)] = True
    return occupied


def _density(reconstruction: Reconstruction) -> Doubles:
    """Tabulate the kernel (K + 1,) over squared distance in radii; it integrates to one voxel."""
    radius = reconstruction.radius
    node, weight = QUADRATURE
    r = (node + 1) / 2 * radius
    mass = float((4 * np.pi * r**2 * reconstruction(r) * weight).sum() * radius / 2)
    if not 0 < mass < np.inf:
        raise ValueError(f"the integral of {reconstruction} is {mass}; it must be above 0")
    squared = np.linspace(0, 1, TABLE + 1)
    return np.asarray(reconstruction(np.sqrt(squared) * radius) / mass, np.float64)


def _plan(source: _RaySource, view: View, look: Casting) -> "CastingOptions":
    from resample_comparisons.volume.kernels.raycasting import CastingOptions

    voxel = float(abs(np.linalg.det(source.lattice)) ** (1 / 3))
    planes = np.array(look.clip, np.float64)
    normal = planes[:, :3] @ view.rotation.T
    offset = planes[:, 3] - normal @ view.translation
    return CastingOptions(
        int(look.rays),
        float(look.step * voxel),
        np.column_stack([normal, offset]),
    )


@contextmanager
def _threads(count: int | None) -> Iterator[None]:
    from resample.engine.jit import threads

    with threads(count):
        yield
