"""Textures and depth images by `resample.hybrid` are those of its twin in NumPy."""

from typing import NamedTuple

import numpy as np
import pytest

from resample_texture import Edge, ForwardMap, Homography
from resample_texture.methods.paper import Paper as TexturePaper
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.methods.paper import EDGE, LOOSE, TURN, Paper, Point, Splat
from resample_warp3d.types import DepthImage, Equation
from tests.paper import twin

# A floor of 15 × 13 texels: 2 px per texel in front, less than half at the back, and turned.
FLOOR = np.array([[1.2, 0.6, 3.3], [-0.3, 2.1, 2.1], [0.01, 0.09, 1.0]])
SIZE = (20, 24)
# Tables of footprints have 1024 steps of d², those of the filter's sums 128 per px; sums are
# float32. All of it is below a part in 30,000 of a color.
CLOSE = 3e-5


class Widths(NamedTuple):
    """Sizes of footprints."""

    threshold: float = 1.0  # px
    filter: float = 1.2  # px, radius
    kernel: float = 1.35  # samples, radius
    largest: float = 64.0  # px; of a depth image's splats


def followed(x, y):
    """Where the floor's matrix takes a texel."""
    seen = FLOOR @ [x, y, 1.0]
    return seen[:2] / seen[2]


def noise(channels=3):
    return np.random.default_rng(3).random((13, 15, channels), np.float32)


def mean(image, coverage):
    return image / np.where(coverage > 0, coverage, 1)[..., None]


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("threshold", "points"), [(1e-3, range(1)), (1.2, range(120, 140)), (99.0, range(195, 196))]
)
@pytest.mark.parametrize("channels", [1, 4])
def test_a_texture_is_that_of_the_twin(threshold, points, channels):
    method, picture = TexturePaper(threshold), noise(channels)
    warped = method(picture, Homography(FLOOR), SIZE, Edge.TRANSPARENT)
    sums, weight, count = twin.texture(picture, followed, SIZE, Widths(threshold))
    assert count in points
    seen = weight > 0
    np.testing.assert_array_equal(warped.coverage[weight == 0], 0)
    found, truth = mean(warped.image, warped.coverage), mean(sums, weight)
    np.testing.assert_allclose(found[seen], truth[seen], atol=CLOSE)
    partly = warped.coverage < 1
    np.testing.assert_allclose(warped.coverage[partly], weight[partly], atol=CLOSE)


@pytest.mark.parametrize("threshold", [1e-3, 1.2, 99.0])
def test_totals_are_those_of_the_twin(threshold):
    method, picture = TexturePaper(threshold, total=True), noise()
    warped = method(picture, Homography(FLOOR), SIZE, Edge.TRANSPARENT)
    area = [
        abs(np.linalg.det(twin.jacobian(followed, u + 0.5, v + 0.5)))
        for v, u in np.ndindex(picture.shape[:2])
    ]
    density = picture / np.reshape(area, (*picture.shape[:2], 1))
    sums, _, _ = twin.texture(density, followed, SIZE, Widths(threshold))
    np.testing.assert_allclose(warped.image, sums, rtol=CLOSE, atol=CLOSE)


def test_a_map_gives_what_the_twin_gives_along_it():
    def bent(u, v):
        return np.array([1.2 * u + 0.3 * v - 1, 0.9 * v + 0.1 * u + 2])

    v, u = np.mgrid[:13, :15] + 0.5
    x, y = bent(u, v)
    method, picture = TexturePaper(), noise()
    warped = method(picture, ForwardMap(x, y), SIZE, Edge.TRANSPARENT)
    sums, weight, _ = twin.texture(picture, bent, SIZE, Widths())
    seen = weight > 0
    found, truth = mean(warped.image, warped.coverage), mean(sums, weight)
    np.testing.assert_allclose(found[seen], truth[seen], atol=CLOSE)


class Choices(NamedTuple):
    """What decides which samples are on one surface."""

    core: float
    close: float
    loose: float
    edge: float = EDGE
    turn: float = TURN


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("zoom", "points"), [(0.6, range(252, 253)), (1.0, range(100, 200)), (1.7, range(1))]
)
@pytest.mark.parametrize(
    ("method", "widths"),
    [
        (Paper(), Widths()),
        (Splat(), Widths(0.0, 0.75)),
        (Point(), Widths(np.inf)),
        (Paper(0.6, 0.5, 0.02, 0.6), Widths(1.0, 1.5, 1.8)),
    ],
    ids=repr,
)
def test_a_depth_image_is_that_of_the_twin(method, widths, zoom, points):
    # Source of 14 × 18: a bent wall, a slanted plate before it, and the camera of both
    rows, columns = np.mgrid[:14, :18]
    z = 3.0 + 0.03 * rows + 0.02 * columns + 0.02 * np.sin(columns)
    z[4:10, 6:12] = 1.6 + 0.01 * rows[4:10, 6:12]
    color = np.random.default_rng(3).random((14, 18, 3), np.float32)
    depth = DepthImage(color, np.float32(1 / z))
    source, first = prepare(depth, noise=0.0), np.array([[18.0, 0, 9], [0, 18.0, 7], [0, 0, 1]])
    size = round(14 * zoom), round(18 * zoom)
    second = np.diag([zoom, zoom, 1.0]) @ first
    c, s = np.cos(0.1), np.sin(0.1)
    pose = np.column_stack([[[c, 0, s], [0, 1, 0], [-s, 0, c]], [-0.25, 0.05, 0.1]])
    equation = Equation(second @ pose[:, :3] @ np.linalg.inv(first), second @ pose[:, 3])
    rendered = method(source, equation, size)
    choices = Choices(method.core, method.tolerance, LOOSE * method.tolerance)
    image, weight, nearness, count = twin.depth_image(
        source, (first, second, pose), size, widths, choices
    )
    np.testing.assert_array_equal(rendered.coverage > 0, weight > 0)
    np.testing.assert_allclose(rendered.image, image, atol=CLOSE)
    np.testing.assert_allclose(rendered.nearness, nearness * (weight > 0), rtol=1e-6)
    if method == Paper():
        assert count in points
