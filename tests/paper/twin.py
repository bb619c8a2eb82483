"""Section 3 of the paper in NumPy, a sample at a time over the whole picture.

What `resample.hybrid` must give on small cases, without any of its formulas: Jacobians are
differences, ellipses come from singular values, and planes are met by rays in space.
"""

import numpy as np

from resample_warp3d.types import DOWN, LEFT, RIGHT, UP

STEP = 1e-5  # of a sample, of differences
SIDES = {LEFT: (0, -1), RIGHT: (0, 1), UP: (-1, 0), DOWN: (1, 0)}  # row, column
# Integral over the unit disc of `gaussian`.
MASS = 2 * np.pi * ((1 - np.exp(-4.5)) / 9 - np.exp(-4.5) / 2)


def gaussian(index):
    """Gaussian that ends at the index 1, which is three standard deviations, without a step."""
    return np.where(index < 1, np.exp(-4.5 * index**2) - np.exp(-4.5), 0.0)


def pixels(size):
    """Centers (height, width, 2) of pixels: x, y."""
    return np.stack(np.indices(size)[::-1], axis=-1) + 0.5


def jacobian(to_screen, u, v):
    """J (2, 2) of a function from source to screen, px per step."""
    steps = ((STEP, 0), (0, STEP))
    both = [to_screen(u + a, v + b) - to_screen(u - a, v - b) for a, b in steps]
    return np.column_stack(both) / (2 * STEP)


def flat(place, j, size, widths):
    """Index and weight (height, width) of a sample at a place in pixels, and whether it is a point.

    Its weights sum or integrate to its area on the screen, |det J|.
    """
    area, offset = abs(np.linalg.det(j)), pixels(size) - place
    turned, stretch, _ = np.linalg.svd(j)
    if stretch[0] <= widths.threshold:
        # All pixels around it, within the frame or not.
        around = 2 * int(widths.filter + 2)
        near = pixels((around, around)) - around // 2 - np.mod(place, 1)
        total = gaussian(np.linalg.norm(near, axis=-1) / widths.filter).sum()
        index = np.linalg.norm(offset, axis=-1) / widths.filter
        return index, area * gaussian(index) / total, True
    axes = np.clip(widths.kernel * stretch, widths.filter, widths.largest)
    index = np.linalg.norm(offset @ turned / axes, axis=-1)
    return index, area * gaussian(index) / (MASS * axes.prod()), False


def texture(picture, to_screen, size, widths):
    """Sums of weights times colors and of weights, and how many texels are points."""
    sums, weights, points = np.zeros((*size, picture.shape[2])), np.zeros(size), 0
    for v, u in np.ndindex(picture.shape[:2]):
        place = to_screen(u + 0.5, v + 0.5)
        j = jacobian(to_screen, u + 0.5, v + 0.5)
        _, weight, is_point = flat(place, j, size, widths)
        sums += weight[..., None] * picture[v, u]
        weights, points = weights + weight, points + is_point
    return sums, weights, points


def depth_image(source, cameras, size, widths, choices):
    """Mean colors, weights and nearness of a source, and how many of its samples are points.

    `cameras` are K of the source, K of the target, and the pose (3, 4) from one to the other.
    """
    color, nearest, found = source.color, np.zeros(size), -np.ones(size, int)
    seen, label = list(samples(source, cameras, size, widths, choices)), labels(source.links)
    # The nearest core of each pixel.
    for k, (_, _, nearness, index, _, core, _) in enumerate(seen):
        wins = (index <= core) & (nearness > nearest)
        nearest[wins], found[wins] = nearness[wins], k
    # All that lies on its surface; everything, where there is no core.
    normals = np.array([normal for _, normal, *_ in seen])
    of_found = np.array([label[at] for at, *_ in seen])[found]
    sums, weights, points = np.zeros((*size, color.shape[2])), np.zeros(size), 0
    shown = nearest.copy()
    for at, normal, nearness, _, weight, _, is_point in seen:
        behind = 1 - nearness / np.where(found >= 0, nearest, np.inf)
        is_even = (of_found == label[at]) & (normals[found] @ normal >= choices.turn)
        is_same = (behind <= choices.close) | (behind <= choices.loose) & is_even
        given = np.where(is_same | (found < 0), weight, 0)
        shown = np.where((found < 0) & (given > 0), np.maximum(shown, nearness), shown)
        sums += given[..., None] * color[at]
        weights, points = weights + given, points + is_point
    return sums / np.where(weights > 0, weights, 1)[..., None], weights, shown, points


def samples(source, cameras, size, widths, choices):
    """Samples as small planes N · X = 1 in space, where the target sees their front.

    Row and column, normal, nearness (height, width) where the pixels' rays meet the plane, index
    and weight, the index up to which it hides what is behind, and whether it is a point.
    """
    first, second, pose = cameras
    eye = -pose[:, :3].T @ pose[:, 3]
    rays = np.concatenate([pixels(size), np.ones((*size, 1))], -1)
    rays = rays @ np.linalg.inv(second).T @ pose[:, :3]
    for at in np.ndindex(source.nearness.shape):
        slope, w = source.slope[at].astype(float), float(source.nearness[at])
        v, u = np.add(at, 0.5)
        plane = first.T @ [*slope, w - slope @ [u, v]]
        if w <= 0 or plane @ eye >= 1:
            continue

        def to_screen(s, t, plane=plane):
            ray = np.linalg.solve(first, [s, t, 1.0])
            x = second @ (pose[:, :3] @ (ray / (plane @ ray)) + pose[:, 3])
            return x[:2] / x[2]

        index, weight, is_point = flat(to_screen(u, v), jacobian(to_screen, u, v), size, widths)
        nearness = rays @ plane / (1 - plane @ eye)
        is_inside = all(source.links[at] & side for side in SIDES)
        core = choices.core if is_inside else min(choices.core, choices.edge)
        normal = plane / np.linalg.norm(plane)
        yield at, normal, nearness, index, weight, core / widths.kernel, is_point


def labels(links):
    """Number (H, W) of what links lead to, by flooding."""
    label = -np.ones(links.shape, int)
    for n, start in enumerate(np.ndindex(links.shape)):
        todo = [start]
        while todo:
            at = todo.pop()
            if label[at] < 0:
                label[at] = n
                todo += [tuple(np.add(at, way)) for bit, way in SIDES.items() if links[at] & bit]
    return label
