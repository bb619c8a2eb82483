import cv2
import numpy as np
import pytest

from resample import registry
from resample.cameras.models import Camera
from resample.cameras.pixels import pixel_centers, undistorted_places
from resample.measuring.quality import psnr
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.methods.hybrid import Hybrid
from resample_warp3d.types import DepthImage, Equation, Hole
from resample_warp3d.warping import as_light, nearness_of, render, warp, warp_disparity
from tests.warp3d.naive_sheet import EMPTY, camera_at, depth_image, pattern, plane

SHAPE = 24, 32
SOURCE = camera_at(focal=32.0, shape=SHAPE)
TARGET = camera_at((0.2, 0.05, 0.5), 0.03, 0.1, focal=32.0, shape=SHAPE)
RIVALS = {"mesh", "subsample", "ldi"}  # of kernels that nothing else needs


def of_every_method(test):
    """A test of each method; of rivals it is a sweep, which the same test of others keeps."""
    methods = []
    for name in registry.names("warps"):
        mark = pytest.mark.skipif(
            name == "opencv" and not hasattr(cv2, "warpFrame"),
            reason="this OpenCV has no cv2.warpFrame (5.0 brought it)",
        )
        sweep = [pytest.mark.sweep] if name in RIVALS else []
        methods.append(pytest.param(name, marks=[mark, *sweep]))
    return pytest.mark.parametrize("method", methods)(test)


def scene(channels=3):
    """Color and depth of a card before a slanted wall."""

    def is_inside(point):
        return (abs(point[..., 0]) < 0.5) & (abs(point[..., 1] - 0.1) < 0.4)

    things = [
        plane((0, 0, 1), 2.5, pattern(4.0, channels), is_inside),
        plane((0.2, 0.1, 1), 4.0, pattern(2.0, channels)),
    ]
    image = depth_image(things, SOURCE, SHAPE, rays=4)
    return image.color, 1.0 / image.nearness


def assert_whole(warped, shape, channels):
    """All shapes and ranges of a result are as promised."""
    assert warped.image.shape == (*shape, channels)
    for part in (warped.coverage, warped.depth, warped.holes):
        assert part.shape == shape
    for part in (warped.magnification, warped.confidence):
        assert part.shape == shape
        assert np.isfinite(part).all()
    assert np.isfinite(warped.image).all()
    assert 0 <= warped.coverage.min() <= warped.coverage.max() <= 1 + 1e-5  # sums in float32
    assert 0 <= warped.confidence.min() <= warped.confidence.max() <= 1 + 1e-5
    assert (warped.depth > 0).all()
    assert warped.image.dtype == warped.coverage.dtype == warped.depth.dtype == np.float32
    assert warped.holes.dtype == np.uint8
    assert set(np.unique(warped.holes)) <= set(Hole)
    assert not warped.image[warped.coverage == 0].any()


@pytest.mark.some(7)
@of_every_method
def test_every_method_warps_any_number_of_channels(method):
    color, depth = scene(channels=2)
    given = warp(color, depth, SOURCE, TARGET, method)
    assert_whole(given, SHAPE, 2)
    assert (given.coverage > 0).mean() > 0.6


@pytest.mark.some(1)
@of_every_method
def test_every_method_shows_about_the_same(method, record):
    color, depth = scene()
    given = warp(color, depth, SOURCE, TARGET, method)
    expected = warp(color, depth, SOURCE, TARGET)
    both = (given.coverage > 0.9) & (expected.coverage > 0.9)
    # Nearest pixels of waves of 8 px and more err by an eighth of them.
    record.quality("picture", psnr(given.image, expected.image, mask=both))
    np.testing.assert_allclose(
        np.median(given.depth[both] / expected.depth[both]), 1.0, atol=5e-3
    )  # a pixel of the slanted wall


@pytest.mark.some(7)
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1)])
@of_every_method
def test_every_method_takes_pictures_of_one_pixel_and_one_line(method, shape):
    camera = camera_at(focal=8.0, shape=shape)
    target = camera_at((0.1, 0, 0.5), focal=8.0, shape=(9, 7))
    given = warp(np.ones((*shape, 3), np.float32), np.ones(shape), camera, target, method)
    assert_whole(given, shape, 3)
    larger = warp(
        np.ones((*shape, 3), np.float32), np.ones(shape), camera, target, method, size=(7, 9)
    )
    assert_whole(larger, (9, 7), 3)


@pytest.mark.some(5)
@of_every_method
def test_every_method_sees_nothing_from_beyond_everything(method):
    color, depth = scene()
    given = warp(
        color, depth, SOURCE, TARGET.moved(camera_at((0, 0, 50.0)).world_to_camera), method
    )
    assert_whole(given, SHAPE, 3)
    assert not given.coverage.any()
    assert (given.holes != Hole.NONE).all()


@pytest.mark.some(2)
@of_every_method
def test_every_method_but_opencv_takes_the_sources_lens(method):
    if method == "opencv":
        pytest.skip("it takes none")
    color, depth = scene()
    lens = Camera(SOURCE.matrix, distortion=np.array([0.05, 0.01, 0.0, 0.0]))
    given = warp(color, depth, lens, TARGET, method)
    assert_whole(given, SHAPE, 3)
    plain = warp(color, depth, SOURCE, TARGET, method)
    assert not np.array_equal(given.image, plain.image)


@pytest.mark.some(7)
@of_every_method
def test_every_method_takes_disparities(method):
    color, depth = scene()
    given = warp_disparity(color, 16 / depth, 0.5, method)
    assert_whole(given, SHAPE, 3)
    assert (given.coverage > 0).mean() > 0.6


@pytest.mark.some(5)
@of_every_method
def test_every_method_can_be_filled(method):
    color, depth = scene()
    given = warp(color, depth, SOURCE, TARGET, method, fill=True)
    assert_whole(given, SHAPE, 3)
    np.testing.assert_array_equal(given.coverage, 1)
    assert np.isfinite(given.depth).all()


def test_the_targets_size_and_intrinsics_are_its_own(record):
    color, depth = scene()
    zoomed = TARGET.resized(SHAPE, (48, 64))
    given = warp(color, depth, SOURCE, zoomed, size=(64, 48))
    assert_whole(given, (48, 64), 3)
    means = given.image.reshape(24, 2, 32, 2, 3).mean(axis=(1, 3))
    expected = warp(color, depth, SOURCE, TARGET)
    both = (expected.coverage == 1) & (given.coverage.reshape(24, 2, 32, 2).min(axis=(1, 3)) == 1)
    # Pixels' means: four small pixels are one large one, but for what is bridged at silhouettes.
    record.quality("picture", psnr(means, expected.image, mask=both))


def test_gray_pictures_have_one_channel():
    color, depth = scene(channels=1)
    given = warp(color[..., 0], depth, SOURCE, TARGET)
    np.testing.assert_array_equal(given.image, warp(color, depth, SOURCE, TARGET).image)


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32])
def test_integers_are_shares_of_their_largest_value(dtype):
    given = as_light(np.array([[[0, np.iinfo(dtype).max]]], dtype))
    np.testing.assert_array_equal(given, [[[0, 1]]])
    assert given.dtype == np.float32


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_floats_are_taken_as_they_are(dtype):
    given = as_light(np.array([[[-2.0, 1000.0]]], dtype))
    np.testing.assert_array_equal(given, [[[-2, 1000]]])
    assert given.dtype == np.float32


def test_an_8_bit_picture_that_does_not_move_stays_as_it_is(rng):
    color = rng.integers(0, 256, (*SHAPE, 3), np.uint8)
    given = warp(color, scene()[1], SOURCE, SOURCE)
    np.testing.assert_array_equal(given.to_uint8()[..., :3], color)
    np.testing.assert_array_equal(given.image, as_light(color))


@pytest.mark.some(1)
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_a_photograph_is_saved_as_bright_as_it_was(channels, tmp_path):
    color = np.full((*SHAPE, channels), 200, np.uint8)
    given = warp(color, scene()[1], SOURCE, SOURCE)
    given.save(tmp_path / "saved.png")
    from_file = warp(tmp_path / "saved.png", scene()[1], SOURCE, SOURCE)
    assert set(np.unique(given.to_uint8()[..., :3])) == {200}
    np.testing.assert_array_equal(from_file.to_uint8(), given.to_uint8())


def test_means_of_8_bits_are_means_of_light():
    """Black and white stripes look as bright as half of the light."""
    color, depth = np.zeros((*SHAPE, 3), np.uint8), np.full(SHAPE, 2.0)
    color[:, ::2] = 255
    far = Camera(SOURCE.matrix / [[4], [4], [1]])
    small = warp(
        color, depth, Camera(SOURCE.matrix), far, size=(SHAPE[1] // 4, SHAPE[0] // 4)
    ).to_uint8()
    assert abs(int(np.median(small[..., 0])) - 188) <= 1


def test_8_bits_of_many_channels_are_values():
    values = np.full((4, 5, 6), 51, np.uint8)
    np.testing.assert_array_equal(as_light(values), np.float32(0.2))


def test_a_given_picture_is_not_changed():
    color, depth = scene()
    before = color.copy(), depth.copy()
    warp(color, depth, SOURCE, TARGET, fill=True)
    np.testing.assert_array_equal(color, before[0])
    np.testing.assert_array_equal(depth, before[1])


def test_unknown_depth_is_0_in_nearness():
    given = nearness_of([[2.0, 0.0, -1.0, np.nan, np.inf, -np.inf]])
    np.testing.assert_array_equal(given, [[0.5, 0, 0, 0, 0, 0]])


@pytest.mark.parametrize("unit", ["float32", "mm", "0.2 mm", "float16"])
def test_encodings_of_the_depth_give_the_same_picture(unit, record):
    color, depth = scene()
    stored = {
        "float32": depth.astype(np.float32),
        "mm": np.rint(depth * 1000).astype(np.uint16) / 1000,
        "0.2 mm": np.rint(depth * 5000).astype(np.uint16) / 5000,
        "float16": depth.astype(np.float16),
    }[unit]
    given, expected = (warp(color, each, SOURCE, TARGET) for each in (stored, depth))
    # A mm is 0.004 px of parallax here; what is nearer decides at silhouettes.
    record.quality("picture", psnr(given.image, expected.image))


def test_scaling_the_world_changes_nothing():
    color, depth = scene()
    pose = TARGET.world_to_camera.copy()
    pose[:3, 3] *= 1000
    given = warp(color, depth * 1000, SOURCE, TARGET.moved(pose))
    expected = warp(color, depth, SOURCE, TARGET)
    np.testing.assert_allclose(given.image, expected.image, atol=1e-4)  # px in float32
    np.testing.assert_allclose(given.depth, 1000 * expected.depth, rtol=1e-5)


def test_where_both_cameras_stand_in_the_world_makes_no_difference():
    color, depth = scene()
    away = camera_at((5.0, -3.0, 2.0), 1.0, 0.5).world_to_camera
    given = warp(color, depth, SOURCE.moved(away), TARGET.moved(TARGET.world_to_camera @ away))
    expected = warp(color, depth, SOURCE, TARGET)
    np.testing.assert_allclose(given.image, expected.image, atol=1e-4)  # px in float32


@pytest.mark.parametrize("fraction", [1.0, -1.0])
def test_disparities_lead_both_ways(fraction):
    color = np.zeros((8, 40, 1), np.float32)
    color[:, 15:20] = 1
    disparity = np.where(color[..., 0] > 0, 6.0, 2.0)
    given = warp_disparity(color, disparity, fraction)
    start = 15 - round(6 * fraction)
    np.testing.assert_allclose(given.image[2:-2, start : start + 5], 1, atol=1e-3)
    np.testing.assert_allclose(given.depth[2:-2, start : start + 5], 1 / 6, rtol=1e-3)
    side = (
        np.s_[2:-2, start + 6 : start + 8] if fraction > 0 else np.s_[2:-2, start - 3 : start - 1]
    )
    assert (given.holes[side] == Hole.DISOCCLUDED).all()


def test_a_disparity_of_no_fraction_moves_nothing():
    color, depth = scene()
    given = warp_disparity(color, 16 / depth, 0.0)
    np.testing.assert_array_equal(given.image, color)


def test_halves_of_the_way_are_the_whole_way():
    color = 0.5 + 0.4 * np.sin(0.3 * np.arange(60))[None, :, None] * np.ones((8, 1, 1))
    color, disparity = color.astype(np.float32), np.full((8, 60), 8.0)
    half = warp_disparity(color, disparity, 0.5)
    twice = warp_disparity(half.image, np.where(half.coverage > 0.99, disparity, 0), 0.5)
    once = warp_disparity(color, disparity, 1.0)
    np.testing.assert_allclose(twice.image[2:-2, 2:-12], once.image[2:-2, 2:-12], atol=1e-5)


def test_confidence_falls_with_magnification():
    color, depth = scene()
    near = warp(color, depth, SOURCE, camera_at((0, 0, 2.0), focal=32.0, shape=SHAPE))
    far = warp(color, depth, SOURCE, camera_at((0, 0, -4.0), focal=32.0, shape=SHAPE))
    assert np.median(near.confidence[near.coverage == 1]) < 0.3
    assert np.median(far.confidence[far.coverage == 1]) == 1


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_magnification_is_in_areas(scale):
    depth = np.full(SHAPE, 4.0)
    target = camera_at((0, 0, 4 - 4 / scale), focal=32.0, shape=SHAPE)
    given = warp(np.ones(SHAPE, np.float32), depth, SOURCE, target)
    assert given.magnification[12, 16] == pytest.approx(scale**2, rel=1e-4)


def test_a_method_may_be_an_object():
    color, depth = scene()
    given = warp(color, depth, SOURCE, TARGET, Hybrid(quality=2))
    expected = warp(color, depth, SOURCE, TARGET, "hybrid:quality=2")
    np.testing.assert_array_equal(given.image, expected.image)


@pytest.mark.parametrize("count", [1, 2, 99])
def test_the_number_of_threads_makes_no_difference(count):
    color, depth = scene()
    given = warp(color, depth, SOURCE, TARGET, threads=count)
    np.testing.assert_array_equal(given.image, warp(color, depth, SOURCE, TARGET).image)


def test_one_prepared_source_serves_many_targets():
    color, depth = scene()
    source = prepare(DepthImage(color, nearness_of(depth), EMPTY))
    for target in (TARGET, SOURCE):
        given = render(source, between(SOURCE, target), SHAPE, Hybrid())
        np.testing.assert_array_equal(given.image, warp(color, depth, SOURCE, target).image)


def test_noise_that_is_given_smooths_more():
    color, depth = scene()
    given = warp(color, depth, SOURCE, TARGET, noise=0.01)
    assert not np.array_equal(given.depth, warp(color, depth, SOURCE, TARGET).depth)


def test_very_bright_and_negative_light_is_kept():
    depth = np.full(SHAPE, 4.0)
    color = np.full((*SHAPE, 2), (1e6, -3.0), np.float32)
    given = warp(color, depth, SOURCE, TARGET)
    is_whole = given.coverage == 1
    np.testing.assert_allclose(
        given.image[is_whole], np.broadcast_to((1e6, -3.0), (is_whole.sum(), 2)), rtol=0.03
    )


@pytest.mark.parametrize("far", [1e-20, 1e30])
def test_absurd_depth_of_one_sample_does_no_harm(far):
    color, depth = scene()
    depth[0, 0] = far
    given = warp(color, depth, SOURCE, TARGET)
    assert_whole(given, SHAPE, 3)
    inside = np.s_[4:-4, 4:-4]
    expected = warp(color, scene()[1], SOURCE, TARGET)
    np.testing.assert_allclose(given.image[inside], expected.image[inside], atol=1e-6)


BAD = {
    "an unknown method": ({"method": "hybird"}, LookupError, "did you mean 'hybrid'"),
    "a bad choice": ({"method": "hybrid:quality=99"}, ValueError, r"0\.25 to 8 parts"),
    "an unknown choice": ({"method": "hybrid:sharp=1"}, ValueError, "no parameter 'sharp'"),
    "no height": ({"size": (5, 0)}, ValueError, "a picture of 5 x 0 pixels; both sides must be"),
    "a negative width": ({"size": (-1, 5)}, ValueError, "a picture of -1 x 5 pixels"),
    "a huge target": ({"size": (1 << 20, 1 << 20)}, ValueError, "at most 268435456 pixels"),
    "another size": ({"depth": np.ones((10, 32))}, ValueError, "32 × 24 px does not .* 32 × 10 px"),
    "no depth": ({"depth": np.zeros(SHAPE)}, ValueError, "no pixel has a depth"),
    "depth in channels": ({"depth": np.ones((*SHAPE, 1))}, ValueError, r"give \(H, W\) of at"),
    "an empty depth": ({"depth": np.ones((0, 32))}, ValueError, r"depth of shape \(0, 32\)"),
    "a depth of words": ({"depth": [["near", "far"]]}, TypeError, "must be real numbers"),
    "a row of color": ({"color": np.ones(5)}, ValueError, r"color of shape \(5,\); give \(H, W\)"),
    "an animation": ({"color": np.ones((2, *SHAPE, 3))}, ValueError, "color of shape"),
    "signed color": ({"color": np.ones(SHAPE, np.int32)}, ValueError, "color of type int32; give"),
    "signed levels": ({"color": np.ones(SHAPE, np.int16)}, ValueError, "color of type int16; give"),
    "complex color": ({"color": np.ones(SHAPE, complex)}, TypeError, "a picture of complex128"),
}  # fmt: skip


@pytest.mark.parametrize("bad", BAD)
def test_bad_input_is_refused_in_one_line(bad):
    color, depth = scene()
    change, error, words = BAD[bad]
    given = {"color": color, "depth": depth, "source": SOURCE, "target": TARGET, **change}
    with pytest.raises(error, match=words) as caught:
        warp(**given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("fraction", [np.nan, np.inf, -np.inf])
def test_a_fraction_that_is_no_number_is_refused(fraction):
    with pytest.raises(ValueError, match="singular or not finite"):
        warp_disparity(np.ones(SHAPE, np.float32), np.ones(SHAPE), fraction)


def test_a_disparity_of_another_size_is_refused():
    with pytest.raises(ValueError, match="color of 32 × 24 px does not fit depth of 5 × 4 px"):
        warp_disparity(np.ones(SHAPE, np.float32), np.ones((4, 5)))


def test_disparities_that_are_all_unknown_are_refused():
    with pytest.raises(ValueError, match="no pixel has a depth"):
        warp_disparity(np.ones(SHAPE, np.float32), np.zeros(SHAPE))


@pytest.mark.parametrize(
    "equation",
    [
        Equation(np.diag([1.0, 1.0, 0.0]), np.zeros(3)),
        Equation(np.diag([1.0, 1.0, np.nan]), np.zeros(3)),
        Equation(np.eye(3), np.array([0.0, np.inf, 0.0])),
        Equation(np.ones((3, 3)), np.zeros(3)),
    ],
)
def test_singular_equations_are_refused(equation):
    source = prepare(DepthImage(np.ones((4, 4, 1), np.float32), np.ones((4, 4)), EMPTY))
    with pytest.raises(ValueError, match="singular or not finite; check both cameras"):
        render(source, equation, (4, 4), Hybrid())


@pytest.mark.parametrize("focal", [1e-200, 1e200])
def test_absurd_cameras_are_refused(focal):
    color, depth = scene()
    target = Camera.from_intrinsics(focal, focal, 16, 12)
    with pytest.raises(ValueError, match="singular or not finite"):
        warp(color, depth, SOURCE, target)


def test_a_scene_far_away_is_empty():
    color, depth = scene()
    given = warp(color, depth, SOURCE, camera_at((1e9, 0, 0), focal=32.0, shape=SHAPE))
    assert_whole(given, SHAPE, 3)
    assert not given.coverage.any()


def test_opencv_refuses_a_lens():
    color, depth = scene()
    lens = Camera(SOURCE.matrix, distortion=np.array([0.1, 0.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="opencv takes sources without distortion"):
        warp(color, depth, lens, TARGET, "opencv")


def test_a_lens_that_is_undone_by_hand_shows_the_same(record):
    wall = [plane((0, 0, 1), 4.0, pattern(1.0))]  # one depth, with a lens or without one
    lens = Camera.from_intrinsics(32, 32, 16, 12, distortion=(0.08, 0.01, 0.0, 0.0))
    place = undistorted_places(lens, pixel_centers(SHAPE))
    point = 4.0 * np.concatenate([(place - (16, 12)) / 32, np.ones((*SHAPE, 1))], axis=2)
    color = wall[0].color(point).astype(np.float32)
    given = warp(color, np.full(SHAPE, 4.0), lens, TARGET)
    plain = depth_image(wall, SOURCE, SHAPE, rays=4)
    expected = warp(plain.color, np.full(SHAPE, 4.0), SOURCE, TARGET)
    both = (given.coverage == 1) & (expected.coverage == 1)
    assert both.mean() > 0.7
    record.quality(
        "picture", psnr(given.image, expected.image, mask=both)
    )  # means against centers of pixels


def test_what_the_lens_cannot_show_has_no_place():
    lens = Camera.from_intrinsics(12, 12, 16, 12, distortion=(-0.35, 0.0, 0.0, 0.0))
    color = np.ones((*SHAPE, 1), np.float32)
    given = warp(color, np.full(SHAPE, 4.0), lens, TARGET)
    assert_whole(given, SHAPE, 1)
    is_whole = given.coverage == 1
    assert is_whole.any()
    np.testing.assert_allclose(given.image[is_whole], 1, atol=0.03)


def test_millimeters_in_whole_numbers_are_warned_of(rng):
    depth = rng.integers(1500, 4000, (8, 9), dtype=np.uint16)
    camera = Camera.from_fov(60, 8, 9)
    with pytest.warns(UserWarning, match=r"depth in whole numbers: .* beyond .* divide it by 1000"):
        warp(np.ones((8, 9, 3)), depth, camera, camera)
