"""The obvious, slow twins of the kernels, in NumPy and float64: what the tests believe.

Nothing here knows of quadratic forms, tables or tiles. A ray is cast per pixel, the density is
summed along it, samples are composited one by one.
"""

import numpy as np
from scipy.integrate import quad

NODE, WEIGHT = np.polynomial.legendre.leggauss(96)


def in_camera(camera, position):
    """Positions (N, 3) in camera axes."""
    view = camera.view()
    return np.asarray(position, np.float32).astype(np.float64) @ view.rotation.T + view.translation


def rays(camera, height, width):
    """Origins and directions (H, W, 3) of the pixels' rays in camera axes; one step is depth 1."""
    view = camera.view()
    row, column = np.mgrid[0:height, 0:width] + 0.5
    x = (column - view.principal[0]) / view.focal[0]
    y = (row - view.principal[1]) / view.focal[1]
    zero, one = np.zeros_like(x), np.ones_like(x)
    if view.perspective:
        return np.stack([zero, zero, zero], axis=-1), np.stack([x, y, one], axis=-1)
    return np.stack([x, y, zero], axis=-1), np.stack([zero, zero, one], axis=-1)


def kernel_mass(reconstruction):
    """Integral of the kernel over space, voxels³."""

    def shell(r):
        return 4 * np.pi * r**2 * float(reconstruction(np.array(r)))

    return quad(shell, 0, reconstruction.radius, points=[reconstruction.radius / 2], epsabs=1e-12)[
        0
    ]


def line_integrals(camera, center, lattice, reconstruction, *, height, width):
    """Integral of one sample's kernel along every pixel's ray from the near plane on (H, W).

    `center` (3,) is in camera axes, `lattice` in the scene's. Gauss-Legendre over the chord.
    """
    view = camera.view()
    start = max(view.near, 0.0) if view.perspective else view.near
    to_voxels = np.linalg.inv(view.rotation @ lattice)
    origin, direction = rays(camera, height, width)
    o, v = (origin - center) @ to_voxels.T, direction @ to_voxels.T
    vv, ov = (v * v).sum(axis=-1), (o * v).sum(axis=-1)
    nearest = o - (ov / vv)[..., None] * v
    chord = reconstruction.radius**2 - (nearest**2).sum(axis=-1)
    half = np.sqrt(np.maximum(chord, 0.0) / vv)
    low, high = np.maximum(-ov / vv - half, start), -ov / vv + half
    met = high > low
    result = np.zeros((height, width))
    middle, reach = 0.5 * (low + high)[met], 0.5 * (high - low)[met]
    along = middle[:, None] + reach[:, None] * NODE
    place = o[met][:, None, :] + along[..., None] * v[met][:, None, :]
    density = reconstruction(np.linalg.norm(place, axis=-1)) / kernel_mass(reconstruction)
    length = np.linalg.norm(direction[met], axis=-1)  # scene units per step
    result[met] = (density * WEIGHT).sum(axis=1) * reach * length
    return result


def all_line_integrals(samples, camera, reconstruction, *, height, width):
    """Line integrals (N, H, W) of all samples."""
    return np.array(
        [
            line_integrals(
                camera, center, samples.lattice, reconstruction, height=height, width=width
            )
            for center in in_camera(camera, samples.position)
        ]
    )


def composite(alpha, color, depth):
    """Picture (H, W, 4) of layers alpha (N, H, W) of straight color (N, 3), nearest depth first."""
    result = np.zeros((*alpha.shape[1:], 4))
    for n in np.argsort(depth, kind="stable"):
        share = (1 - result[..., 3:]) * alpha[n][..., None]
        result += share * np.array([*color[n], 1.0])
    return result


def paper_points(samples, camera, profile, radius, *, height, width):
    """Points under a pixel filter, summed by slabs of one voxel, slabs front to back (H, W, 4).

    `profile` gives weights by distance in px, 0 beyond `radius`. The weights of a point are made
    to sum to 1 over the pixels.
    """
    view = camera.view()
    thickness = abs(np.linalg.det(samples.lattice)) ** (1 / 3)
    center = in_camera(camera, samples.position)
    slab = np.floor(center[:, 2] / thickness)
    result = np.zeros((height, width, 4))
    for number in np.unique(slab):
        total = np.zeros((height, width, 4))
        for n in np.flatnonzero(slab == number):
            x, y, z = center[n]
            path = thickness * np.sqrt(x * x + y * y + z * z) / z
            area = thickness**2 * view.focal[0] * view.focal[1] / z**2
            alpha = area * (1 - np.exp(-samples.extinction[n] * path))
            across = weights(view.focal[0] * x / z + view.principal[0], profile, radius, width)
            down = weights(view.focal[1] * y / z + view.principal[1], profile, radius, height)
            weight = alpha * np.outer(down, across)
            total += weight[..., None] * np.array([*samples.color[n], 1.0])
        opacity = np.clip(total[..., 3], 0.0, 1.0)
        straight = total[..., :3] / np.where(opacity > 0, total[..., 3], np.inf)[..., None]
        layer = np.concatenate([straight * opacity[..., None], opacity[..., None]], axis=-1)
        result += (1 - result[..., 3:]) * layer
    return result


def weights(center, profile, radius, count):
    """Weights (count,) of the pixels of a row around `center` px; they sum to 1 if none is cut."""
    pixel = np.arange(int(np.floor(center - radius)) - 1, int(np.ceil(center + radius)) + 1)
    distance = np.abs(pixel + 0.5 - center)
    weight = np.where(distance < radius, profile(np.minimum(distance, radius)), 0.0)
    weight /= weight.sum()
    row = np.zeros(count)
    inside = (pixel >= 0) & (pixel < count)
    row[pixel[inside]] = weight[inside]
    return row
