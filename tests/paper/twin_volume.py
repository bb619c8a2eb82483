"""Section 4 of the paper in NumPy, a voxel at a time over the whole picture.

It shares no formula with `resample.hybrid`: ellipses are fitted to the outline of the tangent cone,
line integrals found by quadrature along rays.
"""

import numpy as np


def lowered(distance, sigma, radius):
    """Gaussian that ends at a radius without a step."""
    rim = np.exp(-0.5 * (radius / sigma) ** 2)
    return np.where(distance < radius, np.exp(-0.5 * (distance / sigma) ** 2) - rim, 0.0)


def chord(d, sigma, radius):
    """Line integral of the kernel along a ray at the distance d, of a kernel of mass 1."""
    node, weight = np.polynomial.legendre.leggauss(80)
    half = np.sqrt(np.maximum(radius**2 - d**2, 0.0))
    along = half[..., None] * node
    value = lowered(np.sqrt(d[..., None] ** 2 + along**2), sigma, radius)
    t = (np.arange(20000) + 0.5) * radius / 20000
    mass = (4 * np.pi * t**2 * lowered(t, sigma, radius)).sum() * radius / 20000
    return (value * weight).sum(axis=-1) * half / mass


def pixels(size):
    """Centers x, y of all pixels."""
    rows, columns = np.indices(size) + 0.5
    return columns, rows


def tangent_cone(Q, to_unit):
    """Directions (60, 3) in which the eye touches the ellipsoid around Q, and the cone's α."""
    center = to_unit @ Q
    length = np.linalg.norm(center)
    axis = center / length
    one = np.cross(axis, [0.3, 0.5, 0.8])
    one /= np.linalg.norm(one)
    other, alpha = np.cross(axis, one), np.arcsin(1 / length)
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)[:, None]
    rim = axis + np.tan(alpha) * (np.cos(turn) * one + np.sin(turn) * other)
    return rim @ np.linalg.inv(to_unit).T, alpha


def index_in_ellipse(outline, x, y, center=None):
    """Index i of places x, y: the affine map of the outline (60, 2) to the unit circle."""
    u, v = outline.T
    form = np.linalg.lstsq(np.column_stack([u * u, u * v, v * v, u, v]), np.ones(60), rcond=None)[0]
    A = np.array([[form[0], form[1] / 2], [form[1] / 2, form[2]]])
    midpoint = -np.linalg.solve(A, form[3:]) / 2
    A = A / (1 + midpoint @ A @ midpoint)
    dx, dy = np.moveaxis(np.stack([x, y], -1) - (midpoint if center is None else center), -1, 0)
    return np.sqrt(A[0, 0] * dx**2 + 2 * A[0, 1] * dx * dy + A[1, 1] * dy**2)


def true_distance(i, alpha):
    """Section 4.2, with the sine that its own derivation gives."""
    return np.sin(np.arctan(i * np.tan(alpha))) / np.sin(alpha)


def render(samples, lattice, pose, focal, middle, size, **choice):
    """Premultiplied image (H, W, 4) of voxels, front to back.

    `choice`: threshold px, kernel and filter (sigma, radius), layer, is_projected.
    """
    (position, color, extinction), (x, y) = samples, pixels(size)
    image, waiting, layer = np.zeros((*size, 4)), np.zeros((*size, 4)), np.zeros(size, int)
    kernel, pixel_filter = choice["kernel"], choice["pixel_filter"]
    turned = pose[:, :3] @ lattice  # steps in camera axes
    to_unit = np.linalg.inv(turned * kernel[1])
    cell = abs(np.linalg.det(lattice))
    thickness = choice["layer"] * np.cbrt(cell)
    Q = position @ pose[:, :3].T + pose[:, 3]

    def flush(where):
        share = ((1 - image[..., 3]) / np.maximum(waiting[..., 3], 1))[where]
        image[where] += share[:, None] * waiting[where]
        waiting[where] = 0

    for n in np.argsort(Q[:, 2].astype(np.float32), kind="stable"):
        q, seen = Q[n], np.append(color[n], 1)
        place = np.array(middle) + focal * q[:2] / q[2]
        J = focal / q[2] * np.column_stack([np.eye(2), -q[:2] / q[2]]) @ turned
        if np.linalg.norm(J, 2) <= choice["threshold"]:
            # A point: the circular filter at each pixel, composited as a sum of its layer.
            weight = lowered(np.hypot(x - place[0], y - place[1]), *pixel_filter)
            area = cell / thickness * (focal / q[2]) ** 2
            opacity = 1 - np.exp(-extinction[n] * thickness * np.linalg.norm(q) / q[2])
            reached, now = weight > 0, int(q[2] // thickness)
            flush(reached & (layer != now))
            layer[reached] = now
            share = opacity * area * weight / _sum_in_all_pixels(place, pixel_filter)
            waiting[reached] += (share[..., None] * seen)[reached]
            continue
        # A splat: the ellipse of its tangent cone, F at the corrected index.
        rays, alpha = tangent_cone(q, to_unit)
        if rays[:, 2].min() <= 0:  # no ellipse: the cone meets the eye's plane
            continue
        outline = np.array(middle) + focal * rays[:, :2] / rays[:, 2:]
        i = index_in_ellipse(outline, x, y, place if choice["is_projected"] else None)
        inside = i <= 1
        d = np.minimum(true_distance(np.minimum(i, 1), alpha), 1)
        per_voxel = np.linalg.norm(q) / np.linalg.norm(to_unit @ q) / kernel[1]
        length = per_voxel * chord(d * kernel[1], *kernel)
        flush(inside)
        opacity = ((1 - image[..., 3]) * (1 - np.exp(-extinction[n] * length)))[inside]
        image[inside] += opacity[:, None] * seen
    flush(np.ones(size, bool))
    return image


def _sum_in_all_pixels(place, pixel_filter):
    """Sum of a point's weights in all pixels, those beyond the picture as well."""
    reach = np.arange(-8, 9) + 0.5
    dx, dy = reach - place[0] % 1, reach - place[1] % 1
    return lowered(np.hypot(dx[None, :], dy[:, None]), *pixel_filter).sum()
