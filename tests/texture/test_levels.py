"""Levels are interpolated between texels, light is averaged under pixels."""

import dask.array
import numpy as np
import pytest
from PIL import Image

from conftest import real
from resample.colors import from_srgb, to_srgb
from resample_chunks import warp_chunks
from resample_texture import ForwardMap, PictureScene, Plan, project, resize, rotate, warp
from resample_texture.cli import app
from resample_texture.methods.forward import Hybrid
from tests.commands import ended

TURN = np.array([[0.99, -0.12, 6.0], [0.12, 0.99, -5.0], [0.0, 0.0, 1.0]])
SMALLER = np.diag([0.8, 0.7, 1.0])
FLOOR = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.004, 0.01, 1.0]])


def photo(height=60, width=80, channels=3, dtype="uint8"):
    levels = np.random.default_rng(7).random((height, width, channels))
    return np.rint(levels * np.iinfo(dtype).max).astype(dtype)


@pytest.mark.parametrize("matrix", [TURN, np.diag([2.5, 2.5, 1.0]), np.diag([0.96, 0.96, 1.0])])
def test_where_nothing_shrinks_levels_alone_are_interpolated(matrix):
    shown = warp(photo(), matrix, (60, 80), edge="mirror").image
    choices = {"linear_light": False, "interpolation": "area-spline:limit=range"}
    np.testing.assert_array_equal(
        shown, warp(photo(), matrix, (60, 80), edge="mirror", **choices).image
    )


@pytest.mark.parametrize("scale", [0.57, 0.5, 0.21])
def test_where_pixels_cover_several_texels_light_alone_is_averaged(scale):
    matrix = np.diag([scale, scale, 1.0])
    shown = warp(photo(), matrix, (12, 16)).image
    choices = {"linear_light": True, "interpolation": "area-spline:limit=levels"}
    np.testing.assert_array_equal(shown, warp(photo(), matrix, (12, 16), **choices).image)


def test_checks_of_half_the_light_are_bright_from_afar():
    checks = np.tile(np.uint8([[0, 255], [255, 0]]), (32, 32))
    assert abs(int(resize(checks, (16, 16)).image[8, 8]) - 188) <= 1


def test_between_both_there_is_no_step():
    """Flat halves in black and white, at 60 sizes: a pixel on the edge changes smoothly."""
    picture = np.zeros((40, 40), np.uint8)
    picture[:, 20:] = 255
    scales = np.linspace(1 / 0.9, 1 / 2.0, 60)
    shown = []
    for scale in scales:
        move = np.array([[scale, 0.0, 16.0 - 20.0 * scale], [0.0, scale, 0.0], [0.0, 0.0, 1.0]])
        shown.append(
            int(warp(picture, move, (20, 32), edge="mirror").image[8, 16 - 1 : 16 + 1].sum())
        )
    assert np.abs(np.diff(shown)).max() <= 4


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("matrix", [TURN, FLOOR, SMALLER], ids=["turn", "floor", "smaller"])
def test_floats_of_the_same_light_are_drawn_alike(matrix, channels, dtype):
    """As commands read pictures."""
    image, largest = photo(channels=channels, dtype=dtype), np.iinfo(dtype).max
    light = np.asarray(from_srgb(image / largest), np.float32)
    if channels == 4:
        light[..., 3] = image[..., 3] / largest
        light[..., :3] *= light[..., 3:]
    shown = warp(image, matrix, (60, 80), linear_light="pixels").image / largest
    same = warp(light, matrix, (60, 80), linear_light="pixels", fill="premultiplied").image
    color, is_there = np.clip(same[..., :3], 0, None), np.full((60, 80), True)
    if channels == 4:
        np.testing.assert_allclose(shown[..., 3], same[..., 3].clip(0, 1), atol=0.51 / largest)
        is_there = same[..., 3] > 0.02
        color = color / np.where(is_there, same[..., 3], 1.0)[..., None]
    levels = np.clip(to_srgb(color), 0, 1)
    atol = 1.01 / min(largest, 2000)
    np.testing.assert_allclose(shown[is_there, :3], levels[is_there], atol=atol)


def test_tiles_that_need_one_of_both_have_the_same_bits(monkeypatch):
    partly = warp(photo(200, 300), FLOOR, (200, 300))
    monkeypatch.delattr(Hybrid, "partly")
    whole = warp(photo(200, 300), FLOOR, (200, 300))
    np.testing.assert_array_equal(partly.image, whole.image)
    np.testing.assert_array_equal(partly.coverage, whole.coverage)


def test_every_way_to_warp_follows_the_rule(tmp_path, monkeypatch):
    """Plans, batches, regions, chunks, and commands."""
    monkeypatch.chdir(tmp_path)
    image, shape = photo(200, 300), (200, 300)
    shown = warp(image, FLOOR, shape).image
    np.testing.assert_array_equal(Plan(FLOOR, shape, shape)(image).image, shown)
    np.testing.assert_array_equal(warp(np.stack([image] * 2), FLOOR, shape).image[1], shown)
    part = warp(image, FLOOR, shape, roi=(40, 30, 90, 80)).image
    np.testing.assert_array_equal(part, shown[30:110, 40:130])
    chunks = warp_chunks(dask.array.from_array(image, 64), FLOOR, shape, side=64)
    np.testing.assert_array_equal(chunks.compute(), shown)
    Image.fromarray(image).save("photo.png")
    numbers = ",".join(f"{v:.17g}" for v in FLOOR.ravel())
    words = ["photo.png", f"--matrix={numbers}", "--size", "300x200", "--background", "black"]
    assert ended(app, "warp", *words, "-o", "a.png") == 0
    made = np.asarray(Image.open("a.png")).astype(int)
    assert np.abs(made - shown).max() <= 1


def test_a_projection_follows_the_rule():
    places = "equirectangular", "perspective:fov=60", (90, 120)
    shown, levels, light = (
        project(photo(90, 180), *places, linear_light=each).image.astype(int)
        for each in (None, False, True)
    )
    assert np.abs(shown - levels).mean() < 0.4 * np.abs(shown - light).mean()


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_forward_maps_follow_the_rule(dtype):
    image = photo(dtype=dtype)
    for scale, is_linear in ((1.0, False), (2.5, False), (0.5, True)):
        # A picture's texels, moved and `scale` times as far apart
        y, x = np.mgrid[:60, :80] + 0.5
        place, limit = ForwardMap(scale * x + 0.3, scale * y + 0.2), "area-spline:limit=range"
        shown = warp(image, place, (24, 32), linear_light="pixels")
        alone = warp(image, place, (24, 32), linear_light=is_linear, interpolation=limit)
        if is_linear:
            alone = warp(image, place, (24, 32), linear_light=True)
        inner = np.s_[3:20, 3:28]  # where pixels are covered
        np.testing.assert_array_equal(shown.image[inner], alone.image[inner])
        np.testing.assert_array_equal(shown.coverage, alone.coverage)


def test_a_forward_map_that_shrinks_ever_more_has_no_step():
    """Between both the result lies between both: pixels of 1 to 2 texels, left to right."""
    image, count = photo(60, 120), np.arange(120) + 0.5
    x = np.tile(np.cumsum(1.0 / (1.0 + count / 120)), (60, 1))
    y = np.repeat(count[:60, None], 120, axis=1)
    x[3:5, 20:24] = np.nan  # texels that are dropped
    shown, levels, light = (
        warp(image, ForwardMap(x, y), (60, 80), linear_light=kind).image.astype(int)
        for kind in ("pixels", False, True)
    )
    left, right = np.s_[8:50, 2:12], np.s_[8:50, 71:79]
    assert np.abs(shown - levels)[left].mean() < 1.0 < np.abs(light - levels)[left].mean()
    assert np.abs(shown - light)[right].mean() < 1.0 < np.abs(light - levels)[right].mean()
    lower, upper = np.minimum(light, levels) - 8, np.maximum(light, levels) + 8
    assert ((shown >= lower) & (shown <= upper)).mean() > 0.99


@pytest.mark.parametrize("scale", [3.0, 0.25])
def test_previews_are_interpolated_in_levels(scale):
    image, matrix = photo(64, 64), np.diag([scale, scale, 1.0])
    scene = PictureScene(image)
    shown, as_light = (
        one.render(matrix, size=(64, 64), quality="preview").image.astype(int)
        for one in (scene, PictureScene(image, linear_light=True))
    )
    if scale > 1.0:
        levels = PictureScene(image, linear_light=False)
        same = levels.render(matrix, size=(64, 64), quality="preview").image.astype(int)
        assert np.abs(shown - same)[4:, 4:].max() <= 1
        assert np.abs(shown - as_light)[4:, 4:].max() > 10
    else:
        assert np.abs(shown - as_light)[:15, :15].mean() < 3


def test_the_edge_of_a_picture_covers_pixels_with_light():
    """A pixel that white covers by half is half as bright, not half as high a level."""
    white = np.full((20, 20), 255, np.uint8)
    shown = warp(white, [[1, 0, 0.5], [0, 1, 0]], (20, 20)).image
    assert shown[10, 0] == 188
    assert shown[10, 10] == 255


def test_photographs_keep_more_than_under_any_flag_of_opencv(record):
    """A photograph of 8 bits moved by half a pixel, turned, and enlarged: means of finer scenes."""
    from benchmarks.scores import images
    from benchmarks.scores.pictures import eight_bits, to_levels

    scene, side = images.read_scene(real("textures") / "kodim23.png")
    source = eight_bits(to_levels(images.means(scene, np.eye(3), (side, side))[0]))
    jobs = {name: (matrix, (side, side)) for name, matrix in images.warps(side).items()}
    jobs["larger 3"] = np.diag([3.0, 3.0, 1.0]), (3 * side, 3 * side)
    jobs["smaller 1.3"] = np.diag([1 / 1.3, 1 / 1.3, 1.0]), (round(side / 1.3), round(side / 1.3))
    for name, (matrix, size) in jobs.items():
        light, known = images.means(scene, matrix, size, 12)
        true, shown = to_levels(light), warp(source, matrix, size[::-1], edge="mirror").image
        ours = images.db(shown / 255, true, known)
        if size == (side, side):
            peers = images.warped_by_peers(source, matrix).values()
            assert ours > max(images.db(each / 255, true, known) for each in peers)
        record.quality(name, ours)
        if name == "larger 3":
            assert images.beads(shown, source) == 0.0
    back = rotate(rotate(source, 7, (side, side), edge="mirror"), -7, (side, side), edge="mirror")
    inner = np.s_[side // 5 : -side // 5, side // 5 : -side // 5]
    record.quality("there and back", images.db(back.image[inner] / 255, source[inner] / 255))
