import numpy as np
import pytest

from benchmarks.degraded import SHARPNESS, SPOILS, by_rvs, by_softmax
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DepthImage
from tests.warp3d.naive_sheet import EMPTY, camera_at

SHAPE = 64, 64
Y, X = np.mgrid[:64, :64] + 0.5
ROOM = np.where((abs(X - 32) < 10) & (abs(Y - 32) < 10), 2.0, 5.0)


def source(rng, depth):
    color = rng.random((*SHAPE, 3)).astype(np.float32)
    return prepare(DepthImage(color, (1 / depth).astype(np.float32), EMPTY), refine="none")


@pytest.mark.sweep
@pytest.mark.parametrize("method", [by_rvs, by_softmax])
def test_rivals_leave_a_picture_that_stays_as_it_is(method, rng):
    given = source(rng, np.full(SHAPE, 4.0))
    shown = method(given, between(camera_at(), camera_at()), SHAPE)
    inner = slice(1, -1)  # triangles end at the outermost samples
    np.testing.assert_allclose(shown.image[inner, inner], given.color[inner, inner], atol=1e-5)
    assert (shown.coverage[inner, inner] == 1).all()


@pytest.mark.sweep
@pytest.mark.parametrize("method", [by_rvs, by_softmax])
def test_rivals_show_what_is_in_front(method, rng):
    given = source(rng, ROOM)
    given.color[:] = (1 / ROOM)[..., None]
    right = camera_at((5 / 16, 0.0, 0.0))  # 10 px of what is at 2, 4 px of what is at 5
    shown = method(given, between(camera_at(), right), SHAPE)
    # What is behind counts exp(−5 × 0.6) in softmax splatting, and is 0.2.
    leaked = 0.0 if method is by_rvs else 0.6 * np.exp(-SHARPNESS * 0.6)
    np.testing.assert_allclose(shown.image[24:40, 14:30], 0.5, rtol=1e-2 + leaked)


@pytest.mark.sweep
def test_a_stretched_triangle_gives_way_to_one_that_is_not(rng):
    given = source(rng, ROOM)
    given.color[:] = (1 / ROOM)[..., None]
    right = camera_at((5 / 4, 0.0, 0.0))  # 40 px, and 16 px
    shown = by_rvs(given, between(camera_at(), right), SHAPE).image[32, :, 0]
    assert ((shown > 0.21) & (shown < 0.49)).any()  # where nothing else is, it shows
    np.testing.assert_allclose(shown[30:46], 0.2, rtol=1e-5)  # beyond what was hidden


@pytest.mark.parametrize("name", SPOILS)
def test_spoiled_depth_is_another_that_is_much_the_same(name):
    spoiled = SPOILS[name](ROOM * (1 + 0.001 * X), 64.0)
    assert spoiled.shape == SHAPE
    known = spoiled > 0
    assert known.mean() > 0.6
    is_same = name in ("exact", "jpeg")
    assert np.array_equal(spoiled, ROOM * (1 + 0.001 * X)) == is_same
    assert np.median(np.abs(spoiled[known] / ROOM[known] - 1)) < 0.1
