"""The obvious slow ways to warp a depth image, one sample, triangle and sub-pixel at a time.

And the small scenes they are compared on.
"""

import math
from itertools import product

import numpy as np

from resample.cameras.models import Camera
from resample_warp3d.depth.equation import between, places
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage, Equation, Rendered

EMPTY = np.empty((0, 0, 2))
IDENTITY = Equation(np.eye(3), np.zeros(3))
# Moves and bends; what is nearer than 1 / 0.9 is behind the eye.
BENT = Equation(
    np.array([[1.1, 0.08, -1.5], [-0.06, 1.05, 0.7], [0.002, -0.003, 1.0]]),
    np.array([-6.0, 5.0, -0.9]),
)
SMALLER = Equation(np.diag([0.45, 0.4, 1.0]), np.array([2.0, -1.0, 0.1]))
LARGER = Equation(
    np.array([[2.2, 0.3, -14.0], [-0.2, 2.5, -16.1], [0.0, 0.001, 1.0]]), np.array([1.5, 2.0, 0.05])
)
MIRRORED = Equation(
    np.array([[-1.1, 0.1, 24.0], [0.1, 1.2, -1.0], [0.0, 0.0, 1.0]]), np.array([1.0, 1.0, 0.1])
)
EQUATIONS = {"bent": BENT, "smaller": SMALLER, "larger": LARGER, "mirrored": MIRRORED}


def random_source(height=20, width=24, channels=5, *, is_placed=False):
    """Slanted surfaces with cuts between them, some noise, some unknown, some very near."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:height, :width]
    nearness = 0.3 + 0.004 * x - 0.003 * y
    nearness[4:12, 3:11] = 0.6 + 0.01 * y[4:12, 3:11]
    nearness[9:17, 12:20] = 0.9 - 0.01 * x[9:17, 12:20]
    nearness[14:18, 2:7] = rng.uniform(0.2, 1.5, (4, 5))
    nearness[2:4, 14:17] = 0.0
    place = EMPTY
    if is_placed:
        place = places(DepthImage(EMPTY, nearness, EMPTY))
        place = place + 0.3 * np.stack([np.sin(0.3 * y), np.cos(0.4 * x)], axis=2)
    color = rng.random((height, width, channels), np.float32)
    return prepare(DepthImage(color, nearness.astype(np.float32), place))


def blocks(side=96):
    """A wall and upright rectangles before it, as a camera of 80 px focal length sees them."""
    rng = np.random.default_rng(7)
    nearness = np.full((side, side), 0.1, np.float32)
    for _ in range(8):
        row, column = rng.integers(0, side - 24, 2)
        height, width = rng.integers(8, 24, 2)
        nearness[row : row + height, column : column + width] = rng.uniform(0.15, 0.5)
    return prepare(DepthImage(rng.random((side, side, 3), np.float32), nearness, EMPTY))


def moved(x, y, z, *, side=96):
    """Equation from the camera of `blocks` to one that has moved and turned a little."""
    matrix = np.array([[80.0, 0, side / 2], [0, 80.0, side / 2], [0, 0, 1]])
    yaw = np.array(
        [[math.cos(0.02), 0, -math.sin(0.02)], [0, 1, 0], [math.sin(0.02), 0, math.cos(0.02)]]
    )
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = yaw, -yaw @ [x, y, z]
    return between(Camera(matrix, np.eye(4)), Camera(matrix, pose))


def nearest_pixels(source, equation, shape):
    """Every sample at its nearest pixel, with a z-buffer; the first of equally near ones stays."""
    rendered = blank(source, shape)
    place = places(DepthImage(source.color, source.nearness, source.place))
    for row, column in np.ndindex(source.nearness.shape):
        if source.nearness[row, column] <= 0:
            continue
        x, y, w = homogeneous(equation, place[row, column], source.nearness[row, column])
        if w <= 0 or not (0 <= x / w < shape[1] and 0 <= y / w < shape[0]):
            continue
        pixel = int(y / w), int(x / w)
        near = np.float32(source.nearness[row, column] / w)
        if near > rendered.nearness[pixel]:
            area = magnification(source, equation, row, column)
            put(rendered, pixel, source.color[row, column], near, area)
    return rendered


def magnification(source, equation, row, column):
    """px² per px² by the slopes of the source, differentiated numerically."""
    place = places(DepthImage(source.color, source.nearness, source.place))
    steps = [np.gradient(place, axis=1)[row, column], np.gradient(place, axis=0)[row, column]]
    small, ends = 1e-5, []
    for axis, sign in product(range(2), (-1, 1)):
        change = sign * small * float(source.slope[row, column, axis])
        point = place[row, column] + sign * small * steps[axis]
        x, y, w = homogeneous(equation, point, float(source.nearness[row, column]) + change)
        ends.append(np.array([x / w, y / w]))
    across, down = (ends[1] - ends[0]) / (2 * small), (ends[3] - ends[2]) / (2 * small)
    return abs(across[0] * down[1] - across[1] * down[0])


def triangles(source, equation, shape, samples, step=None):
    """Triangles of the mesh, tested at every sub-pixel's center; cut at links or at steps."""
    fine = blank(source, (shape[0] * samples, shape[1] * samples))
    rows, columns = np.mgrid[: fine.coverage.shape[0], : fine.coverage.shape[1]] + 0.5
    corner = corners(source, equation)
    for quad in np.ndindex(source.nearness.shape[0] - 1, source.nearness.shape[1] - 1):
        for here, beside, below, is_bridge in divided(source, quad, step):
            points = [corner[key] for key in (here, beside, below)]
            if any(point is None for point in points):
                continue
            a, b, c = (samples * np.array(point[:2]) for point in points)
            area = cross(b - a, c - a)
            is_turned = (here[0] < below[0]) != (here[1] < beside[1])
            mirror = np.sign(np.linalg.det(equation.matrix)) * (-1 if is_turned else 1)
            if area * mirror <= 0:
                continue
            inside = np.stack([columns, rows], axis=2)
            shares = np.stack(
                [cross(c - b, inside - b), cross(a - c, inside - c), cross(b - a, inside - a)]
            )
            near = np.tensordot([point[3] for point in points], shares / area, 1)
            weights = np.array([point[2] for point in points])[:, None, None] * shares / area
            along, across = weights[1:] / np.maximum(weights.sum(0), 1e-12)
            is_whole = is_linked_around(source, quad)
            is_shown = (shares / area >= 0).all(0) & (near > fine.nearness)
            for pixel in zip(*np.nonzero(is_shown), strict=True):
                color = mixed(source, (here, beside, below), along[pixel], across[pixel], is_whole)
                put(fine, pixel, color, near[pixel], abs(area) / samples**2, is_bridge)
    return shrunk(fine, samples)


def divided(source, quad, step):
    """Triangles of a quad: right-angled corner, its neighbours, and whether they fill a cut."""
    found = {}
    for part in range(4):
        here = quad[0] + part // 2, quad[1] + part % 2
        beside = here[0], quad[1] + 1 - part % 2
        below = quad[0] + 1 - part // 2, here[1]
        near = [source.nearness[key] for key in (here, beside, below)]
        bits = (RIGHT if part % 2 == 0 else LEFT) | (DOWN if part // 2 == 0 else UP)
        is_linked = source.links[here] & bits == bits
        if min(near) > 0 and (is_linked if step is None else max(near) <= (1 + step) * min(near)):
            found[part] = here, beside, below, not is_linked
    rising, falling = (
        [found[n] for n in (0, 3) if n in found],
        [found[n] for n in (1, 2) if n in found],
    )
    if len(rising) != len(falling):
        return rising if len(rising) > len(falling) else falling
    values = source.nearness[quad[0] : quad[0] + 2, quad[1] : quad[1] + 2]
    return (
        rising if abs(values[0, 1] - values[1, 0]) <= abs(values[0, 0] - values[1, 1]) else falling
    )


def subsamples(source, equation, shape, samples, most):
    """Grids of subsamples between linked samples, each at its nearest sub-pixel."""
    fine = blank(source, (shape[0] * samples, shape[1] * samples))
    corner = corners(source, equation)
    front = np.sign(np.linalg.det(equation.matrix))
    height, width = source.nearness.shape
    for row, column in np.ndindex(height, width):
        if is_linked_around(source, (row, column)):
            quad = [(row + n // 2, column + n % 2) for n in range(4)]
            points = [corner[key] for key in quad]
            if all(point is not None for point in points):
                fill(source, quad, points, front, fine, samples, most)
        point = corner[row, column]
        around = [(row - n // 2, column - n % 2) for n in range(4)]
        if point is None or all(is_linked_around(source, quad) for quad in around):
            continue
        place = samples * point[0], samples * point[1]
        area = magnification(source, equation, row, column)
        if is_free(fine, place, point[3]):
            put(fine, pixel_of(place), source.color[row, column], point[3], area)
    return shrunk(fine, samples)


def fill(source, quad, points, front, fine, samples, most):
    """Subsamples of one quad, bilinear between homogeneous corners."""
    p = np.array([point[:2] for point in points])
    area = 0.5 * (cross(p[1] - p[0], p[2] - p[0]) + cross(p[2] - p[3], p[1] - p[3]))
    if area * front <= 0:
        return
    sides = np.maximum(abs(p[1] - p[0]), abs(p[3] - p[2]))
    sides = sides + np.maximum(abs(p[2] - p[0]), abs(p[3] - p[1]))
    n = max(1, math.ceil(min(most, samples * sides.max())))
    vectors = np.array([(x / w, y / w, 1 / w, near / w) for x, y, w, near in points])
    colors = np.array([source.color[key] for key in quad])
    for i, j in np.ndindex(n, n):
        s, t = (j + 0.5) / n, (i + 0.5) / n
        shares = np.array([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
        x, y, w, near = shares @ vectors
        place = samples * x / w, samples * y / w
        if is_free(fine, place, np.float32(near / w)):
            put(fine, pixel_of(place), shares @ colors, near / w, abs(area))


def corners(source, equation):
    """Place in the target of each sample, 1 / w and nearness, rounded as stored; None: unseen."""
    place = places(DepthImage(source.color, source.nearness, source.place))
    found = {}
    for key in np.ndindex(source.nearness.shape):
        x, y, w = homogeneous(equation, place[key], source.nearness[key])
        is_seen = w > 0 and source.nearness[key] > 0
        values = np.array([x / w, y / w, 1 / w, source.nearness[key] / w], np.float32)
        found[key] = values.astype(np.float64) if is_seen else None
    return found


def is_linked_around(source, quad):
    """Whether a quad lies inside and all its four sides are links."""
    row, column = quad
    height, width = source.links.shape
    if not (0 <= row < height - 1 and 0 <= column < width - 1):
        return False
    links = source.links
    right = links[row, column] & RIGHT and links[row + 1, column] & RIGHT
    return bool(right and links[row, column] & DOWN and links[row, column + 1] & DOWN)


def mixed(source, keys, along, across, is_whole):
    """Color in a triangle: bilinear where its quad is whole, else linear between the corners."""
    here, beside, below = keys
    twist = along * across if is_whole else 0.0
    shares = [1 - along - across + twist, along - twist, across - twist, twist]
    return sum(
        share * source.color[key]
        for share, key in zip(shares, (here, beside, below, (below[0], beside[1])), strict=True)
    )


def homogeneous(equation, place, nearness):
    """A point in the target before the division."""
    return equation.matrix @ [*place, 1.0] + float(nearness) * equation.epipole


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def pixel_of(place):
    return math.floor(place[1]), math.floor(place[0])


def is_free(rendered, place, nearness):
    """Whether a place is in the frame and nothing as near is there."""
    row, column = pixel_of(place)
    height, width = rendered.coverage.shape
    return 0 <= row < height and 0 <= column < width and nearness > rendered.nearness[row, column]


def put(rendered, pixel, color, nearness, magnification, is_bridge=False):
    rendered.image[pixel], rendered.coverage[pixel] = color, 1.0
    rendered.nearness[pixel], rendered.magnification[pixel] = nearness, magnification
    rendered.bridged[pixel] = is_bridge


def blank(source, shape):
    return Rendered(
        np.zeros((*shape, source.color.shape[2]), np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.bool_),
    )


def shrunk(fine, samples):
    """Means of samples × samples; the nearest one says the rest."""
    rows, columns = (n // samples for n in fine.coverage.shape)

    def cells(values):
        split = values.reshape(rows, samples, columns, samples, -1).swapaxes(1, 2)
        return split.reshape(rows, columns, samples * samples, -1)

    nearest = cells(fine.nearness).argmax(axis=2, keepdims=True)

    def of_nearest(values):
        return np.take_along_axis(cells(values), nearest, axis=2)[..., 0, 0]

    return Rendered(
        cells(fine.image).mean(axis=2),
        cells(fine.coverage).mean(axis=2)[..., 0],
        of_nearest(fine.nearness),
        of_nearest(fine.magnification),
        of_nearest(fine.bridged),
    )


def assert_same(given, expected):
    """Every field of two pictures agrees.

    Colors differ by the rounding of weights in float32; magnification of numeric derivatives and of
    triangles whose corners are rounded to 1e-6 px.
    """
    np.testing.assert_allclose(given.coverage, expected.coverage, atol=1e-6)
    np.testing.assert_allclose(given.image, expected.image, atol=3e-6)
    np.testing.assert_allclose(given.nearness, expected.nearness, rtol=1e-5)
    np.testing.assert_allclose(given.magnification, expected.magnification, rtol=1e-3)
    np.testing.assert_array_equal(given.bridged, expected.bridged)
