import math

import numpy as np
import pytest
from scipy.ndimage import map_coordinates, spline_filter

from resample_comparisons.texture import scenes
from resample_comparisons.texture.scenes import ComparedView, scene_of, tiled, truth, zones
from resample_texture.geometry.mappings import Homography


def plain(source: np.ndarray, matrix: object, shape: tuple[int, int]) -> ComparedView:
    return ComparedView(source.astype(np.float32), Homography(np.array(matrix, float)), shape)


def scaled(factor: float, x: float = 0.0, y: float = 0.0) -> list[list[float]]:
    return [[factor, 0, x], [0, factor, y], [0, 0, 1]]


def naive(scene: ComparedView, x: float, y: float) -> np.ndarray:
    """Spline of degree 4, with the source's texels as means, where a place of the target looks."""
    u, v, d = scene.geometry.inverse() @ np.array([x, y, 1.0])
    at = np.array([[v / d - 0.5], [u / d - 0.5]])
    return np.array([_spline(channel, at) for channel in np.moveaxis(scene.source, 2, 0)])


def _spline(channel: np.ndarray, at: np.ndarray) -> float:
    coefficient = spline_filter(channel.astype(float), 5, mode="reflect")
    return map_coordinates(coefficient, at, order=4, prefilter=False, mode="reflect")[0]


@pytest.mark.some(1)
@pytest.mark.parametrize("kind", ["box", "gaussian"])
def test_the_truth_is_the_filtered_mean_of_naive_rays(kind, rng):
    scene = plain(rng.random((12, 14, 2)), [[0.9, 0.2, 0], [-0.1, 0.7, 2], [0.01, 0.02, 1]], (8, 9))
    radius = {"box": 0.5, "gaussian": 2.0}[kind]
    offset = (np.arange(-radius * 16, radius * 16) + 0.5) / 16
    weight = np.ones_like(offset) if kind == "box" else np.exp(-2 * offset**2)
    weight /= weight.sum()
    expected = sum(
        weight[m] * weight[n] * naive(scene, 5.5 + offset[n], 4.5 + offset[m])
        for m in range(offset.size)
        for n in range(offset.size)
    )
    assert np.allclose(truth(scene, kind)[4, 5], expected, atol=1e-6)  # stored as float32


def test_the_truth_of_the_view_at_hand_is_the_picture(rng):
    scene = plain(rng.random((20, 24, 3)), scaled(1), (20, 24))
    assert np.allclose(truth(scene), scene.source, atol=2e-3)  # by 16 rays


@pytest.mark.some(1)
@pytest.mark.parametrize("factor", [0.5, 1.0, 1.25, 8.0])
def test_the_truth_of_a_fine_picture_is_its_means(factor, rng):
    fine = rng.random((64, 64, 2)).astype(np.float32)
    shape = (int(16 * factor), int(16 * factor))
    scene = plain(scenes.means(fine, 4), scaled(factor), shape)._replace(fine=fine)
    common = math.gcd(shape[0], 64)  # parts of texels, and of pixels, of one size
    each, group = shape[0] // common, 64 // common
    big = np.kron(fine, np.ones((each, each, 1)))
    expected = big.reshape(shape[0], group, shape[1], group, 2).mean(axis=(1, 3))
    assert np.allclose(truth(scene), expected, atol=0.06 if factor == 1.25 else 1e-6)  # 256 rays


def test_where_rays_would_skip_fine_texels_they_hit_means(rng):
    fine = rng.random((512, 512, 1)).astype(np.float32)
    scene = plain(scenes.means(fine, 4), scaled(1 / 16), (8, 8))._replace(fine=fine)
    expected = fine.reshape(8, 64, 8, 64, 1).mean(axis=(1, 3))
    assert np.allclose(truth(scene), expected, atol=1e-6)


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["box", "gaussian"])
def test_white_stays_white(kind):
    white = plain(np.ones((40, 40, 1)), scaled(1.3, -4, -4), (40, 40))
    assert np.abs(truth(white, kind) - 1).max() < 1e-6  # float32


def test_beyond_the_source_there_is_nothing():
    picture = truth(plain(np.ones((8, 8, 1)), scaled(1, 2.5), (8, 12)))[..., 0]
    assert picture[4, :3] == pytest.approx([0, 0, 0.5], abs=1e-6)


def test_behind_the_eye_there_is_nothing():
    tilted = plain(np.ones((8, 8, 1)), [[1, 0, 0], [0, 1, 0], [0, -0.2, 1]], (40, 8))
    inverse = tilted.geometry.inverse()
    behind = inverse[2, 1] * np.arange(1.0, 41.0) + inverse[2, 2] < 0
    assert not truth(tilted)[behind].any()


def test_the_truth_tells_its_progress():
    shares: list[float] = []
    truth(plain(np.ones((8, 8, 1)), scaled(1), (70, 8)), progress=shares.append)
    assert shares == [32 / 70, 64 / 70, 1]


def test_blocks_leave_no_seam(rng, monkeypatch):
    scene = plain(rng.random((16, 16, 1)), scaled(1.1), (16, 16))
    whole = truth(scene, "gaussian")
    monkeypatch.setattr(scenes, "BLOCK", 5)
    assert np.array_equal(whole, truth(scene, "gaussian"))


def test_an_unknown_truth_lists_the_known():
    with pytest.raises(ValueError, match="truth 'disk'; known: box, gaussian"):
        truth(plain(np.ones((8, 8, 1)), scaled(1), (8, 8)), "disk")


def test_the_floor_has_the_benchmarks_numbers():
    matrix = scene_of(np.zeros((1024, 1024, 1), np.float32), "floor").geometry.matrix
    corners = np.array([[0, 0, 1], [1024, 0, 1], [576, 1024, 1], [448, 1024, 1]]).T
    places = matrix @ corners
    expected = [[0, 0], [512, 0], [512, 512], [0, 512]]
    assert np.allclose((places[:2] / places[2]).T, expected, atol=1e-6)


def test_the_yawed_floor_turns_the_texture_by_30_degrees_around_its_point():
    source = np.zeros((1024, 1024, 1), np.float32)
    floor = scene_of(source, "floor").geometry.matrix
    turn = np.linalg.inv(floor) @ scene_of(source, "floor-yaw").geometry.matrix
    turn /= turn[2, 2]
    assert np.allclose(turn[:2, :2], [[0.75**0.5, -0.5], [0.5, 0.75**0.5]])
    assert np.allclose(turn @ [512, 700, 1], [512, 700, 1])


@pytest.mark.parametrize("name", scenes.NAMES)
def test_a_scenes_size_scales_the_view(name, rng):
    source = rng.random((1024, 1024, 1)).astype(np.float32)
    large, small = scene_of(source, name), scene_of(source, name, (128, 256))
    scale = np.diag([0.5, 0.25, 1])
    assert large.shape == (512, 512)
    assert np.allclose(scale @ large.geometry.matrix, small.geometry.matrix)


def test_a_small_picture_is_tiled_with_its_mirror_images(rng):
    picture = rng.random((300, 512, 1)).astype(np.float32)
    wall = tiled(picture)
    assert wall.shape == (600, 1024, 1)
    assert np.array_equal(wall[:300, 512:], picture[:, ::-1])
    assert np.array_equal(wall[300:, :512], picture[::-1])


def test_a_matrix_is_a_scene_of_the_pictures_size(rng):
    scene = scene_of(rng.random((6, 9, 3)).astype(np.float32), "0.5,0,0,0,0.5,0")
    assert scene.shape == (6, 9)
    assert scene.source.shape == (6, 9, 3)


@pytest.mark.parametrize(
    ("side", "name", "complaint"),
    [
        (8, "sea", "unknown scene 'sea'; known: floor,"),
        (8, "1,2", "a matrix has three lines"),
        (5000, "floor", "scenes take 4096 along a side at most"),
    ],
)
def test_a_scene_that_cannot_be_is_refused(side, name, complaint):
    with pytest.raises(ValueError, match=complaint):
        scene_of(np.zeros((side, 8, 1), np.float32), name)


@pytest.mark.parametrize(("factor", "zone"), [(0.5, "minified"), (2.0, "magnified")])
def test_zones_tell_what_shrinks_from_what_grows(factor, zone):
    masks = zones(plain(np.zeros((100, 100, 1)), scaled(factor), (40, 40)))
    assert set(masks) == {"whole", zone}
    assert np.array_equal(masks["whole"], masks[zone])


def test_what_grows_along_one_axis_is_mixed():
    scene = plain(np.zeros((100, 100, 1)), [[2, 0, 0], [0, 0.5, 0], [0, 0, 1]], (40, 40))
    assert set(zones(scene)) == {"whole", "mixed"}


@pytest.mark.sweep
def test_the_zones_are_the_whole():
    masks = zones(scene_of(np.zeros((1024, 1024, 1), np.float32), "floor"))
    parts = [mask for name, mask in masks.items() if name != "whole"]
    assert np.array_equal(np.sum(parts, axis=0), masks["whole"])


def test_the_scales_are_those_of_small_steps():
    scene = scene_of(np.zeros((1024, 1024, 1), np.float32), "floor-yaw")
    least, most = scenes._scales(scene)
    h = scene.geometry.matrix
    u, v, d = scene.geometry.inverse() @ [256.5, 400.5, 1]
    ends = h @ np.array([[u / d + 1e-4, v / d, 1], [u / d, v / d + 1e-4, 1], [u / d, v / d, 1]]).T
    ends = ends[:2] / ends[2]
    steps = (ends[:, :2] - ends[:, 2:]) / 1e-4
    expected = np.linalg.svd(steps, compute_uv=False)
    assert np.allclose([most[400, 256], least[400, 256]], expected, rtol=1e-4)  # of the step


def test_a_view_that_misses_the_picture_is_refused():
    with pytest.raises(ValueError, match="no pixel of the scene looks into the picture"):
        zones(plain(np.zeros((8, 8, 1)), scaled(1, 1000), (40, 40)))


@pytest.mark.parametrize(("make", "channels"), [(scenes.checker, 1), (scenes.bricks, 3)])
def test_generated_pictures_are_light_and_always_the_same(make, channels):
    picture = make(64)
    assert picture.shape == (64, 64, channels)
    assert 0 <= picture.min() < picture.max() <= 1
    assert np.array_equal(picture, make(64))
