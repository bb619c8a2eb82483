"""Ellipsoids with a shape each, against rays by brute force and formulas."""

import tracemalloc

import numpy as np
import pytest

from resample import Camera, Orthographic, Resampler, look_at, particles
from resample.engine.shaped.records import WHOLE
from resample.outofcore.ellipsoids import BYTES, paint_parts
from resample.painting.ellipsoids import (
    BAND,
    Ellipsoids,
    InMemory,
    ShapedStyle,
    paint_ellipsoid_parts,
    paint_ellipsoids,
)
from resample.profiles.orders import EverySample, Rays
from resample_comparisons.volume.painting import ImageSheets
from tests.shaped import twin

SIZE = (36, 44)
EYE = Camera.from_fov(60, *SIZE)
FLAT = Orthographic.from_extent(4.0, *SIZE) if hasattr(Orthographic, "from_extent") else None


def gaussians(count=60, seed=1, near=2.0, far=9.0):
    """Thin, flat and round ones of all sizes, some of them behind the eye or around it."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(near, far, count)
    place = np.column_stack([*(rng.uniform(-0.8, 0.8, (2, count)) * np.abs(z)), z])
    scale = np.exp(rng.uniform(-4, -0.5, (count, 3)))
    turn = rng.normal(size=(count, 4)) * rng.uniform(0.1, 9, (count, 1))
    opacity, color = rng.uniform(0.01, 1, count), rng.random((count, 3))
    return Ellipsoids(*(np.float32(a) for a in (place, scale, turn, opacity, color)))


def painted(given, camera=EYE, size=SIZE, **style):
    return paint_ellipsoids(given, camera, size, ShapedStyle(**{"subpixels": 1, **style}))


@pytest.mark.parametrize("order", ["depth", "distance", "rays"])
def test_a_picture_is_that_of_rays_by_brute_force(order):
    given = gaussians()
    ours = painted(given, order=order)
    np.testing.assert_allclose(ours.rgba, twin.painted(given, EYE, SIZE, order), atol=3e-4)


@pytest.mark.parametrize("count", [20, 200, 700])
def test_a_plate_hides_what_each_ray_meets_behind_it(count):
    """Faint ones whose centers are nearer than the plate's, but behind it on the ray."""
    rng = np.random.default_rng(6)
    place = np.column_stack([rng.uniform(-0.2, 0.2, (2, count)).T, rng.uniform(4.6, 5.4, count)])
    faint = place, np.tile([0.5, 0.5, 0.05], (count, 1)), np.tile([1, 0, 0, 0], (count, 1))
    # The plate stands obliquely: its center is far to the right and at 9, its left part at 4.
    plate = [[5.0, 0, 9.0]], [[90.0, 90.0, 0.01]], [[np.cos(0.3927), 0, -np.sin(0.3927), 0]]
    both = [np.concatenate(pair) for pair in zip(faint, plate, strict=True)]
    opacity = np.append(np.full(count, 0.05), 0.99)
    color = np.concatenate([np.tile([1, 0, 0], (count, 1)), [[0, 1, 0]]])
    given = Ellipsoids(*(np.float32(array) for array in (*both, opacity, color)))
    ours = painted(given, order="rays").rgba
    middle = ours[18, 22]
    assert middle[1] > 0.95
    assert middle[0] < 0.05
    np.testing.assert_allclose(ours, twin.painted(given, EYE, SIZE, "rays"), atol=3e-4)


def test_rays_that_meet_more_than_may_wait_are_sorted_all_the_same():
    rng = np.random.default_rng(8)
    place = np.column_stack([rng.uniform(-0.3, 0.3, (2, 900)).T, rng.uniform(4, 6, 900)])
    scale, turn = rng.uniform(0.3, 1.5, (900, 3)), rng.normal(size=(900, 4))
    parts = place, scale, turn, rng.uniform(0.004, 0.02, 900), rng.random((900, 3))
    given = Ellipsoids(*(np.float32(part) for part in parts))
    ours, true = painted(given, order="rays").rgba, twin.painted(given, EYE, SIZE, "rays")
    assert twin.psnr(ours, true) > 80


@pytest.mark.some(1)
@pytest.mark.parametrize("fine", [2, 3, 4])
def test_sub_pixels_are_averaged(fine):
    given = gaussians(30)
    ours = painted(given, subpixels=fine)
    np.testing.assert_allclose(ours.rgba, twin.painted(given, EYE, SIZE, fine=fine), atol=3e-4)


def test_eyes_inside_and_centers_behind_the_eye_are_exact():
    given = gaussians(40, seed=3, near=-1.0, far=2.0)
    ours = painted(given, near=0.1)
    truth = twin.painted(given, EYE, SIZE, near=0.1)
    assert np.count_nonzero(truth[..., 3] > 0.1) > 500
    np.testing.assert_allclose(ours.rgba, truth, atol=1e-3)


@pytest.mark.parametrize("order", ["depth", "rays"])
def test_parallel_rays_are_exact(order):
    pose = look_at((0, 0, -5), (0, 0, 0))
    camera = Orthographic(9.0, 9.0, 22.0, 18.0, pose)
    given = gaussians(50, seed=4, near=-2.0, far=2.0)
    ours = painted(given, camera, order=order)
    np.testing.assert_allclose(ours.rgba, twin.painted(given, camera, SIZE, order), atol=3e-4)


def test_one_gaussian_is_a_formula_with_its_depths():
    given = Ellipsoids(
        *(np.float32(a) for a in ([[0, 0, 4]], [[0.5] * 3], [[1, 0, 0, 0]], [0.9], [[1, 0.5, 0]]))
    )
    ours = painted(given)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    x, y = (x - EYE.cx) / EYE.fx, (y - EYE.cy) / EYE.fy
    square = 16 * (x * x + y * y) / (1 + x * x + y * y) / 0.25
    alpha = 0.9 * np.exp(-square / 2)
    alpha[alpha < 1 / 255] = 0
    np.testing.assert_allclose(ours.rgba[..., 3], alpha, atol=1e-5)
    seen = alpha > 0.01
    nearest = 4 / (1 + x * x + y * y)
    np.testing.assert_allclose(ours.depth[seen], nearest[seen], rtol=1e-4)
    assert (np.isfinite(ours.median) == (alpha >= 0.5)).all()
    np.testing.assert_allclose(ours.median[alpha >= 0.5], nearest[alpha >= 0.5], rtol=1e-4)
    assert (np.isinf(ours.first_depth) == (alpha <= 1 / 255)).all()


def test_a_thin_disc_is_where_rays_meet_its_plane():
    normal, middle = np.array([0.5, 0.3, 0.8124]), np.array([0.2, -0.1, 5.0])
    turn = np.append(1 + normal[2], np.cross([0, 0, 1], normal))
    given = Ellipsoids(
        *(np.float32(a) for a in ([middle], [[0.8, 0.8, 0]], [turn], [0.95], [[1, 1, 1]]))
    )
    ours = painted(given)
    _, direction = twin.rays_of(EYE, SIZE)
    t = (middle @ normal) / (direction @ normal)
    away = np.square(direction * t[..., None] - middle).sum(axis=2) / 0.64
    alpha = 0.95 * np.exp(-away / 2)
    alpha[alpha < 1 / 255] = 0
    np.testing.assert_allclose(ours.rgba[..., 3], alpha, atol=2e-3)
    np.testing.assert_allclose(ours.depth[alpha > 0.05], t[alpha > 0.05], rtol=1e-3)


def test_two_that_cross_are_ordered_along_each_ray():
    turn = [[np.cos(a), 0, np.sin(a), 0] for a in (0.2, -0.2)]
    given = Ellipsoids(
        *(
            np.float32(a)
            for a in (
                [[0, 0, 5]] * 2,
                [[1.5, 1.5, 1e-3]] * 2,
                turn,
                [0.99] * 2,
                [[1, 0, 0], [0, 1, 0]],
            )
        )
    )
    ours = painted(given, order="rays").rgba
    left, right = ours[18, 12], ours[18, 31]
    assert left[1] > 2 * left[0] > 0.1
    assert right[0] > 2 * right[1] > 0.1


def test_order_of_input_and_threads_change_no_bit():
    given = gaussians(300, seed=5)
    given = given._replace(position=np.round(given.position, 1))  # keys are equal often
    turn = np.random.default_rng(6).permutation(300)
    other = Ellipsoids(*(array[turn] for array in given[:5]))
    for order in (EverySample(), EverySample(key="distance"), Rays()):
        paint = Resampler(order=order)
        one = paint(given, EYE, height=36, width=44, threads=1)
        two = paint(other, EYE, height=36, width=44, threads=2)
        for mine, theirs in zip(one[:4], two[:4], strict=True):
            np.testing.assert_array_equal(mine, theirs)


@pytest.mark.sweep
def test_as_trained_is_what_training_sees(record):
    given = gaussians(200, seed=7)
    given = given._replace(scale=0.15 * given.scale, opacity=0.6 * given.opacity)
    camera, size = Camera.from_fov(50, 72, 88), (72, 88)
    truth = twin.as_trained(given, camera, size)
    affine = painted(given, camera, size, dilation=0.3, is_affine=True)
    np.testing.assert_allclose(affine.rgba, truth, atol=5e-4)
    exact = painted(given, camera, size, dilation=0.3)
    record.quality("picture", twin.psnr(exact.rgba, truth))  # the linear projection itself errs


def test_far_away_the_mean_of_the_near_picture_is_kept(record):
    given = gaussians(3000, seed=8, near=4.0, far=6.0)
    given = given._replace(scale=0.1 * given.scale)
    near = painted(given, Camera.from_fov(60, 144, 176), (144, 176), dilation=0.3)
    truth = near.rgba.reshape(36, 4, 44, 4, 4).mean(axis=(1, 3))
    trained = float(Camera.from_fov(60, 144, 176).fx)
    far = paint_ellipsoids(given, EYE, SIZE, ShapedStyle(dilation=0.3, trained=trained))
    assert far.statistics.subpixels >= 3
    record.quality("picture", twin.psnr(far.rgba, truth))


@pytest.mark.parametrize("eye", [EYE, Orthographic(9.0, 9.0, 22.0, 18.0, np.eye(4))])
def test_round_ellipsoids_are_spheres(eye):
    rng = np.random.default_rng(9)
    place = np.column_stack([rng.uniform(-2, 2, (40, 2)), rng.uniform(4, 8, 40)])
    color, opacity, radius = (
        rng.random((40, 3)),
        rng.uniform(0, 0.95, 40),
        rng.uniform(0.1, 0.9, 40),
    )
    paint, splats = Resampler(subpixels=2), Resampler(subpixels=2, threshold=0)
    spheres = splats(particles(place, color, opacity, radius), eye, height=36, width=44)
    three, turn = np.repeat(radius[:, None], 3, axis=1), rng.normal(size=(40, 4))
    shapes = particles(place, color, opacity, three, rotation=turn)
    ours = paint(shapes, eye, height=36, width=44)
    np.testing.assert_allclose(ours.rgba, spheres.rgba, atol=2e-4)
    np.testing.assert_allclose(ours.first_depth, spheres.first_depth, atol=1.0)


def test_an_ellipsoid_is_a_sphere_stretched():
    """What is twice as long along x, seen by a camera that sees half as much of x."""
    place, half = [[0.4, 0.1, 6]], 0.8
    round_ = particles(place, (1, 1, 1), 0.7, [[half] * 3])
    long = particles([[0.8, 0.1, 6]], (1, 1, 1), 0.7, [[2 * half, half, half]])
    flat = (
        Orthographic(8.0, 8.0, 22.0, 18.0, np.eye(4)),
        Orthographic(4.0, 8.0, 22.0, 18.0, np.eye(4)),
    )
    one, two = (
        Resampler(subpixels=1)(shape, eye, height=36, width=44).rgba[..., 3]
        for shape, eye in zip((round_, long), flat, strict=True)
    )
    # Through its center the longer one has the same depth per radius of a sphere of its volume.
    depth = np.log1p(-one) * 2 ** (-1 / 3)
    np.testing.assert_allclose(np.log1p(-two), depth, atol=2e-4)


class Parts:
    """Ellipsoids in parts of a size."""

    def __init__(self, given, size):
        self.given, self.size, self.loaded = given, size, 0

    def kernel(self):
        return self.given.kernel

    def sizes(self):
        count = len(self.given.opacity)
        return [min(self.size, count - first) for first in range(0, count, self.size)]

    def load(self, part, _view):
        self.loaded += 1
        rows = slice(part * self.size, (part + 1) * self.size)
        return Ellipsoids(*(array[rows] for array in self.given[:5]), self.given.kernel)


@pytest.mark.parametrize("subpixels", [None, 2])
@pytest.mark.parametrize(("most", "windows"), [(900, 1), (260, 3)])
def test_parts_within_a_budget_have_the_bits_of_all(subpixels, most, windows):
    given, style = gaussians(800, seed=11), ShapedStyle(subpixels=subpixels)
    given = given._replace(scale=0.2 * given.scale)
    whole = paint_ellipsoids(given, EYE, SIZE, style)
    picture, count = paint_parts(Parts(given, 150), EYE, SIZE, style, memory=most * BYTES)
    for mine, theirs in zip(picture[:5], whole[:5], strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert count == 1 if windows == 1 else count >= windows
    assert picture.statistics.subpixels == whole.statistics.subpixels


@pytest.mark.parametrize("subpixels", [None, 2])
@pytest.mark.parametrize("ahead", [True, False])
def test_parts_that_fit_are_projected_once(subpixels, ahead):
    given, style = gaussians(800, seed=11), ShapedStyle(subpixels=subpixels)
    away = np.float32([0, 0, 0] if ahead else [0, 0, -100])
    parts = Parts(given._replace(position=given.position + away), 150)
    picture, windows = paint_parts(parts, EYE, SIZE, style, memory=900 * BYTES)
    assert (parts.loaded, windows) == (len(parts.sizes()), 1)
    assert picture.rgba.any() == ahead


@pytest.mark.sweep
def test_painting_takes_little_more_memory_than_records():
    count = 200_000
    rng = np.random.default_rng(2)
    given = Ellipsoids(
        np.float32(rng.uniform(-1, 1, (count, 3))) + np.float32([0, 0, 8]),
        np.full((count, 3), 1e-3, np.float32),
        np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        np.full(count, 0.02, np.float32),
        np.full((count, 3), 0.5, np.float32),
    )
    painted(gaussians())  # kernels are compiled before memory is measured
    tracemalloc.start()
    try:
        picture = paint_ellipsoid_parts(InMemory(given), EYE, SIZE)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert picture.statistics.splats == count
    band = BAND * 4 * WHOLE  # records that are made together
    assert peak < 104 * count + 2 * band


def test_a_tile_beyond_the_budget_is_refused():
    given = gaussians(800, seed=11)
    with pytest.raises(ValueError, match="more than fit in the allowed memory; give more memory"):
        paint_parts(Parts(given, 150), EYE, SIZE, memory=5 * BYTES)


BAD = {
    "scales are 0 or more": {"scale": [[1, -1, 1]]},
    "one is above 0": {"scale": [[0, 0, 0]]},
    "scale is not finite": {"scale": [[np.nan, 1, 1]]},
    "position is not finite": {"position": [[np.inf, 0, 1]]},
    "quaternion is zero": {"rotation": [[0, 0, 0, 0]]},
    "opacity is 1.5 to 1.5; it lies from 0 to 1": {"opacity": [1.5]},
    r"color of \(1, 4\); for 1 ellipsoids it is \(1, 3\)": {"color": [[1, 1, 1, 1]]},
}


@pytest.mark.parametrize("message", BAD)
def test_bad_numbers_are_refused(message):
    good = Ellipsoids([[0, 0, 5]], [[1, 1, 1]], [[1, 0, 0, 0]], [0.5], [[1, 1, 1]])
    with pytest.raises(ValueError, match=message):
        painted(good._replace(**BAD[message]))


def test_choices_that_ellipsoids_do_not_have_are_refused():
    given = gaussians(3)
    for paint, clip in (
        (Resampler(order=ImageSheets()), None),
        (Resampler(threshold=1), None),
        (Resampler(), [0, 0, 1, 0]),
    ):
        with pytest.raises(ValueError, match="with a shape each"):
            paint(given, EYE, height=8, width=8, clip=clip)
    with pytest.raises(ValueError, match="fit 2 particles"):
        particles([[0, 0, 5]] * 2, (1, 1, 1), 0.5, [[1, 1, 1]] * 2, rotation=[[1, 0, 0]] * 2)


def test_nothing_is_an_empty_picture():
    nothing = Ellipsoids(
        *(np.zeros((0, n), np.float32) for n in (3, 3, 4)), np.zeros(0), np.zeros((0, 3))
    )
    frame = Resampler()(nothing, EYE, height=8, width=9)
    assert not frame.rgba.any()
    assert np.isinf(frame.depth).all()
