"""Results that are saved, shown and handed over: painted scenes and pictures that were moved."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from resample.cameras.models import Camera
from resample.colors import from_srgb
from resample.files.images import read_image
from resample.types import Frame, Statistics
from resample_texture import Warped, warp
from resample_warp3d import warp as warp_depth
from resample_warp3d.types import Warped as WarpedDepth

NO_COUNTS = Statistics(0, 0, 0, 0, 1, {})
SHIFT = np.array([[1.0, 0, 4], [0, 1, 0], [0, 0, 1]])


def frame() -> Frame:
    rng = np.random.default_rng(0)
    alpha = np.linspace(0, 1, 20, dtype=np.float32)[None, :, None] * np.ones((12, 1, 1), np.float32)
    color = alpha * rng.random((12, 20, 3), np.float32)
    depth = np.where(alpha[..., 0] > 0, np.float32(3), np.float32(np.inf))
    return Frame(np.concatenate([color, alpha], axis=2), depth, depth, alpha[..., 0], NO_COUNTS)


def picture(dtype: str = "uint8", channels: int = 3) -> NDArray[np.generic]:
    levels = np.random.default_rng(1).integers(0, 256, (12, 20, channels))
    if dtype == "float32":
        return (levels / 255).astype(dtype)
    return (levels * (257 if dtype == "uint16" else 1)).astype(dtype)


def moved() -> Warped:
    return warp(picture(), SHIFT, (12, 20))


def test_levels_are_those_that_are_written(tmp_path: Path) -> None:
    seen = frame()
    seen.save(tmp_path / "frame.png")
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "frame.png")), seen.to_uint8())
    seen.save(tmp_path / "solid.png", background=(0.2, 0.2, 0.2))
    solid = np.asarray(Image.open(tmp_path / "solid.png"))
    np.testing.assert_array_equal(solid, seen.to_uint8(background=(0.2, 0.2, 0.2)))
    assert solid.shape == (12, 20, 3)
    seen.save(tmp_path / "frame.exr")
    np.testing.assert_array_equal(read_image(tmp_path / "frame.exr"), seen.rgba)


@pytest.mark.parametrize(
    ("name", "light"),
    [("white", (1, 1, 1)), ("#808080", (0.21586, 0.21586, 0.21586)), ("none", None)],
)
def test_backgrounds_have_the_names_of_commands(name: str, light: object, tmp_path: Path) -> None:
    seen = frame()
    seen.save(tmp_path / "frame.png", background=name)
    found = np.asarray(Image.open(tmp_path / "frame.png"))
    np.testing.assert_array_equal(found, seen.to_uint8(background=light))
    np.testing.assert_array_equal(found, np.asarray(seen.to_image(background=name)))


@pytest.mark.parametrize("background", ["nocolor", (1, 1), (1, 1, 1, 1)])
def test_what_is_no_background_is_refused(background: object, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="#rrggbb or a color's name"):
        frame().save(tmp_path / "frame.png", background=background)
    assert not (tmp_path / "frame.png").exists()


def test_half_of_white_is_light_here_and_a_level_where_others_blend() -> None:
    """Browsers and Pillow mix levels; a picture with its background mixes light."""
    half = Frame(
        *(np.full(part, 0.5, np.float32) for part in ((1, 1, 4), *[(1, 1)] * 3)), NO_COUNTS
    )
    black = Image.new("RGBA", (1, 1), (0, 0, 0, 255))
    theirs = np.asarray(Image.alpha_composite(black, half.to_image()))[0, 0, 0]
    assert theirs == 128
    of_light = 255 * (1.055 * 0.5 ** (1 / 2.4) - 0.055)
    assert half.to_uint8(background="black")[0, 0, 0] == round(of_light) == 188
    whole = half._replace(rgba=np.ones_like(half.rgba))
    np.testing.assert_array_equal(
        np.asarray(Image.alpha_composite(black, whole.to_image()))[..., :3],
        whole.to_uint8(background="black"),
    )


def test_results_are_saved_as_tiff_and_jpeg_too(tmp_path: Path) -> None:
    seen = frame()
    seen.save(tmp_path / "frame.tif", bits=32)
    np.testing.assert_array_equal(read_image(tmp_path / "frame.tif"), seen.rgba)
    seen.save(tmp_path / "frame.jpg", background=(1, 1, 1))
    levels = np.asarray(Image.open(tmp_path / "frame.jpg")).astype(int)
    assert np.abs(levels - seen.to_uint8(background=(1, 1, 1))).mean() < 12
    seen.save(tmp_path / "black.jpg")
    levels = np.asarray(Image.open(tmp_path / "black.jpg")).astype(int)
    assert np.abs(levels - seen.to_uint8(background="black")).mean() < 12


@pytest.mark.parametrize("program", ["volume", "points", "texture", "warp3d"])
def test_films_have_no_transparency(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    from resample import registry
    from tests.commands import ended

    given = {"volume": "vessel-tree", "points": "sample:knot-points", "texture": "sample:bricks"}
    words = [given.get(program, "sample:room"), "--background", "none", "-o", "a.webp"]
    assert ended(registry.load("apps", program), "animate", *words) == 2
    assert "films are opaque" in capsys.readouterr().err


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_a_picture_that_was_not_moved_keeps_its_levels(dtype: str, channels: int) -> None:
    source = picture(dtype, channels)
    if channels == 4:
        source[..., 3] = 1 if dtype == "float32" else np.iinfo(dtype).max
    shown = warp(source, np.eye(3), source.shape[:2]).to_uint8(background=(0, 0, 0))
    scale = 1 if dtype == "float32" else np.iinfo(dtype).max
    share = source[..., :3] / scale
    if dtype == "float32":  # values are light
        share = share.astype(np.float32)
        np.testing.assert_allclose(from_srgb(shown / 255), share + np.zeros(3), atol=0.005)
    else:
        np.testing.assert_allclose(shown, np.rint(255 * share) + np.zeros(3), atol=1)


def test_what_is_not_covered_is_transparent() -> None:
    shown = moved()
    levels = shown.to_uint8()
    assert (levels[:, :4, 3] == 0).all()
    assert (levels[:, 4:, 3] == 255).all()
    assert (shown.to_uint8(background=(1, 1, 1))[:, :4] == 255).all()


def test_masks_and_labels_are_stretched_over_gray() -> None:
    labels = np.arange(6, dtype=np.int32).reshape(2, 3)
    levels = warp(labels, np.eye(3), (2, 3), "nearest").to_uint8(background=(0, 0, 0))
    assert levels.min() == 0
    assert levels.max() == 255
    is_inside = np.eye(8, dtype=bool)
    assert warp(is_inside, np.eye(3), (8, 8), "nearest").to_uint8()[..., 0].max() == 255


def depths() -> WarpedDepth:
    camera = Camera.from_fov(60, 12, 20)
    depth = np.full((12, 20), 2.0)
    depth[3:8, 5:9] = 1.0
    pose = np.eye(4)
    pose[0, 3] = 0.3
    aside = replace(camera, world_to_camera=pose)
    color = np.asarray(picture("float32"), np.float32)
    return warp_depth(color, depth, camera, aside)


@pytest.mark.parametrize("of", ["depth", "holes", "coverage", "magnification", "confidence"])
def test_parts_of_a_warped_depth_image_have_pictures(of: str) -> None:
    levels = depths().to_uint8(of)
    assert levels.shape == (12, 20, 3)
    assert levels.any()


def test_depth_of_a_frame_is_black_where_nothing_is() -> None:
    levels = frame().to_uint8("depth")
    assert not levels[:, 0].any()
    assert levels[:, 1:].any(axis=2).all()


@pytest.mark.parametrize("make", [frame, depths, moved])
def test_notebooks_and_pillow_get_pictures(make: Callable[[], Frame]) -> None:
    result = make()
    png = np.asarray(Image.open(BytesIO(result._repr_png_())))
    np.testing.assert_array_equal(png, np.asarray(result.to_image()))
    assert "\n" not in repr(result)
    assert "20" in repr(result)
    assert "covered" in repr(result)


def test_a_line_tells_what_a_result_is() -> None:
    assert repr(frame()) == "Frame(20 × 12 px, 95 % covered, depth from 3)"
    assert repr(moved()) == "Warped(12 × 20 × 3 uint8, 80 % covered)"


def test_results_are_still_tuples() -> None:
    seen = frame()
    assert seen._replace(value=seen.depth).value is seen.depth
    again = pickle.loads(pickle.dumps(seen))
    assert type(again) is Frame
    np.testing.assert_array_equal(again.rgba, seen.rgba)
    rgba, *_ = seen
    assert rgba is seen.rgba


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    batch = Warped(np.zeros((2, 4, 5, 3), np.uint8), np.ones((2, 4, 5), np.float32))
    with pytest.raises(ValueError, match=r"\(2, 4, 5, 3\) is not a picture .* take one of a batch"):
        batch.to_uint8()
    assert "2 × 4 × 5 × 3" in repr(batch)
    wide = Warped(np.zeros((4, 5, 7), np.float32), np.ones((4, 5), np.float32))
    with pytest.raises(ValueError, match="some of the channels"):
        wide.save(tmp_path / "wide.png")
    with pytest.raises(ValueError, match="Frame has no part 'holes'; it has color, depth"):
        frame().to_uint8("holes")
    with pytest.raises(ValueError, match="pictures are written as"):
        frame().save(tmp_path / "frame.bmp")
    assert not list(tmp_path.iterdir())
