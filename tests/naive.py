"""The obvious, slow twins of the kernels, in NumPy and float64: what the tests believe.

Nothing here knows of quadratic forms, tables or tiles. A ray is cast per pixel, the density is
summed along it, samples are composited one by one.
"""

import numpy as np
from scipy.integrate import quad

NODE, WEIGHT = np.polynomial.legendre.leggauss(96)
PART_NODE, PART_WEIGHT = np.polynomial.legendre.leggauss(24)


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


def line_integrals(camera, center, lattice, reconstruction, *, height, width, between=None):
    """Integral of one sample's kernel along every pixel's ray from the near plane on (H, W).

    `center` (3,) is in camera axes, `lattice` in the scene's; `between` are two depths, or (H, W)
    of each, where the integral begins and ends. Gauss-Legendre over the chord.
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
    if between is not None:
        low, high = np.maximum(low, between[0]), np.minimum(high, between[1])
    met = high > low
    result = np.zeros((height, width))
    middle, reach = 0.5 * (low + high)[met], 0.5 * (high - low)[met]
    node, weight = (NODE, WEIGHT) if between is None else (PART_NODE, PART_WEIGHT)
    along = middle[:, None] + reach[:, None] * node
    place = o[met][:, None, :] + along[..., None] * v[met][:, None, :]
    density = reconstruction(np.linalg.norm(place, axis=-1)) / kernel_mass(reconstruction)
    length = np.linalg.norm(direction[met], axis=-1)  # scene units per step
    result[met] = (density * weight).sum(axis=1) * reach * length
    return result


def all_line_integrals(samples, camera, reconstruction, *, height, width, between=None):
    """Line integrals (N, H, W) of all samples."""
    return np.array(
        [
            line_integrals(
                camera,
                center,
                samples.lattice,
                reconstruction,
                height=height,
                width=width,
                between=between,
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


def nearest_depths(samples, camera, *, height, width):
    """Depths (N, H, W) at which the pixels' rays pass nearest to samples, as their lattice lies."""
    origin, ray = rays(camera, height, width)
    to_unit = np.linalg.inv(camera.view().rotation @ samples.lattice)
    center = in_camera(camera, samples.position)[:, None, None]
    away, along = (center - origin) @ to_unit.T, ray @ to_unit.T
    return (away * along).sum(axis=-1) / (along**2).sum(axis=-1)


def layered(alpha, value, depth):
    """Sum (H, W) of values (N, H, W) of layers, each as far as it is seen."""
    result, passed = np.zeros(alpha.shape[1:]), np.ones(alpha.shape[1:])
    for n in np.argsort(depth, kind="stable"):
        result += passed * alpha[n] * value[n]
        passed *= 1 - alpha[n]
    return result


def reach(camera, lattice, reconstruction):
    """How far before and behind its center a kernel reaches, scene units."""
    turned = camera.view().rotation @ lattice * reconstruction.radius
    return np.linalg.norm(turned[2])


def put_behind(picture, alpha, color):
    """Composite straight color (H, W, 3) of opacity alpha (H, W) behind a picture (H, W, 4)."""
    light = np.concatenate([color, np.ones((*alpha.shape, 1))], axis=-1)
    picture += (1 - picture[..., 3:]) * alpha[..., None] * light


def axis_sheets(samples, camera, reconstruction, *, height, width):
    """Picture (H, W, 4) by the lattice's sheets of whole kernels, those nearest the eye first."""
    view = camera.view()
    cosine = view.rotation[2] @ samples.lattice / np.linalg.norm(samples.lattice, axis=0)
    axis = np.argmax(np.abs(cosine))
    to_lattice = np.linalg.inv(samples.lattice)
    place = samples.position.astype(float) @ to_lattice[axis]
    if view.perspective:
        eye = -view.rotation.T @ view.translation
        order = np.abs(place - to_lattice[axis] @ eye)
    else:
        order = np.sign(cosine[axis]) * place
    integral = all_line_integrals(samples, camera, reconstruction, height=height, width=width)
    picture = np.zeros((height, width, 4))
    left = np.ones(len(place), bool)
    while left.any():
        nearest = np.flatnonzero(left)[order[left].argmin()]
        chosen = left & (np.abs(place - place[nearest]) < 0.5)
        some = samples._replace(color=samples.color[chosen], extinction=samples.extinction[chosen])
        # Sum the optical depths of samples and composite the sum with the mean of their colors
        depth = integral[chosen] * some.extinction.astype(float)[:, None, None]
        total = depth.sum(axis=0)
        color = np.einsum("nhw,nc->hwc", depth, some.color.astype(float))
        put_behind(picture, 1 - np.exp(-total), color / np.where(total > 0, total, 1)[..., None])
        left &= ~chosen
    return picture


def kept_by(camera, planes, *, height, width):
    """Depths (2, H, W) between which the pixels' rays are inside clipping planes of the scene."""
    view = camera.view()
    origin, direction = rays(camera, height, width)
    origin = (origin - view.translation) @ view.rotation
    direction = direction @ view.rotation
    front, back = np.full((height, width), -np.inf), np.full((height, width), np.inf)
    for *normal, offset in np.asarray(planes, float):
        at_start, rise = origin @ normal + offset, direction @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -at_start / rise
        front = np.where(rise > 0, np.maximum(front, crossing), front)
        back = np.where(rise < 0, np.minimum(back, crossing), back)
        back = np.where((rise == 0) & (at_start < 0), -np.inf, back)
    return np.stack([front, back])


def box_shares(center, size, count):
    """What of a box `size` long around `center` lies in each of `count` pixels (count,)."""
    edge = np.arange(count)
    low, high = np.maximum(edge, center - size / 2), np.minimum(edge + 1, center + size / 2)
    return np.maximum(high - low, 0) / size


def scatter(position, value, jacobian, *, height, width, sigma, filter_sigma, rim, longest, turned):
    """Sums of w v and of w (height, width) of samples, those up to `longest` px boxes, else splats.

    Those whose bounds are `turned[0]` times as large as they are: up to `turned[1]` of that.

    A splat's Gaussian ends where its squared distance is `rim`; its weights, summed over pixels
    wherever they lie, are the sample's area.
    """
    total, coverage = np.zeros((height, width)), np.zeros((height, width))
    for (x, y), v, j in zip(position, value, jacobian, strict=True):
        area = abs(np.linalg.det(j))
        box = np.linalg.norm(j, axis=1)
        is_turned = np.abs(j).sum(axis=1).prod() > turned[0] * area
        if np.linalg.svd(j)[1][0] <= longest * (turned[1] if is_turned else 1):
            wide, high = np.minimum(box, 1)
            weight = np.outer(box_shares(y, high, height), box_shares(x, wide, width)) * area
        else:
            form = np.linalg.inv(sigma**2 * j @ j.T + filter_sigma**2 * np.eye(2))
            beyond = 100  # px around the picture in which splats are weighed, too
            row, column = np.mgrid[-beyond : height + beyond, -beyond : width + beyond] + 0.5
            away = np.stack([column - x, row - y], axis=-1)
            squared = np.einsum("hwi,ij,hwj->hw", away, form, away)
            weight = np.where(squared <= rim, np.exp(-squared / 2), 0)
            weight = (weight * area / weight.sum())[beyond:-beyond, beyond:-beyond]
        total += weight * v
        coverage += weight
    return total, coverage
