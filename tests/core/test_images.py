import os
import resource
import stat
import subprocess
import sys

import cv2
import numpy as np
import OpenImageIO
import pytest

from resample.colors import from_srgb, over, straight, to_srgb
from resample.files.images import read_channels, read_image
from resample.files.saving import write_exr, write_frame, write_png
from resample.files.writing import replacing
from resample.types import Frame


@pytest.fixture
def rgba(rng) -> np.ndarray:
    alpha = rng.random((5, 7, 1), np.float32)
    return np.concatenate([rng.random((5, 7, 3), np.float32) * alpha, alpha], axis=2)


@pytest.fixture
def frame(rgba, rng) -> Frame:
    depth = rng.random((3, 5, 7), np.float32)
    depth[:, 0, 0] = np.inf
    return Frame(rgba, depth[0], depth[1], np.clip(depth[2], 0, 1), None)


def levels(path) -> np.ndarray:
    """Stored numbers of a PNG, by a second reader: RGB(A)."""
    stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return stored[..., [2, 1, 0, *range(3, stored.shape[2])]]


def uniform(*value: float) -> np.ndarray:
    return np.full((2, 3, 4), value, np.float32)


def test_the_srgb_curve_is_that_of_color_management():
    linear = np.linspace(0.0, 1.0, 4097, dtype=np.float32).reshape(1, -1, 1).repeat(3, axis=2)
    managed = OpenImageIO.ImageBufAlgo.colorconvert(
        OpenImageIO.ImageBuf(linear), "lin_rec709", "sRGB"
    ).get_pixels(OpenImageIO.FLOAT)
    np.testing.assert_allclose(to_srgb(linear), managed, atol=1e-5)  # OCIO's fast power function


def test_the_srgb_curves_are_inverse():
    linear = np.linspace(-0.1, 2.0, 999)
    np.testing.assert_allclose(from_srgb(to_srgb(linear)), linear, atol=1e-7)  # 0.04045 is rounded


def test_the_srgb_curve_keeps_the_type():
    assert to_srgb(np.zeros(3, np.float32)).dtype == np.float32


def test_png_divides_by_alpha_in_linear_light_before_encoding(tmp_path):
    write_png(tmp_path / "a.png", uniform(0.25, 0.125, 0.0, 0.5))
    encoded = np.round(to_srgb(np.array([0.5, 0.25, 0.0])) * 255)
    np.testing.assert_array_equal(levels(tmp_path / "a.png")[0, 0], [*encoded, 128])


def test_png_is_black_and_finite_where_alpha_is_zero(tmp_path):
    write_png(tmp_path / "a.png", uniform(0.5, 0.5, 0.5, 0.0))
    np.testing.assert_array_equal(levels(tmp_path / "a.png"), 0)


@pytest.mark.parametrize("bits", [8, 16])
def test_png_rounds_to_the_nearest_level(tmp_path, bits):
    top = 2**bits - 1
    rgba = np.ones((1, 4, 4), np.float32)
    rgba[0, :, 3] = np.array([0.49, 0.51, 100.49, 100.51]) / top
    rgba[..., :3] = 0.0
    write_png(tmp_path / "a.png", rgba, bits=bits)
    np.testing.assert_array_equal(levels(tmp_path / "a.png")[0, :, 3], [0, 1, 100, 101])


def test_png_over_a_background_is_opaque_and_composited_in_linear_light(tmp_path):
    write_png(tmp_path / "a.png", uniform(0.1, 0.0, 0.0, 0.5), background=(1.0, 1.0, 0.0))
    encoded = np.round(to_srgb(np.array([0.6, 0.5, 0.0])) * 255)
    stored = levels(tmp_path / "a.png")
    assert stored.shape == (2, 3, 3)
    np.testing.assert_array_equal(stored[0, 0], encoded)


def test_png_clips_what_a_screen_cannot_show(tmp_path):
    write_png(tmp_path / "a.png", uniform(7.0, np.inf, -3.0, 1.0))
    np.testing.assert_array_equal(levels(tmp_path / "a.png")[0, 0], [255, 255, 0, 255])


@pytest.mark.parametrize(
    ("bits", "tolerance"),
    [(8, 0.01), (16, 4e-5)],  # half a level, where the curve is steepest
)
def test_png_comes_back_linear_and_premultiplied(tmp_path, rgba, bits, tolerance):
    write_png(tmp_path / "a.png", rgba, bits=bits)
    read = read_image(tmp_path / "a.png")
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, rgba, atol=tolerance)


def test_png_refuses_what_is_not_a_number(tmp_path):
    with pytest.raises(ValueError, match="6 pixels are not numbers"):
        write_png(tmp_path / "a.png", uniform(np.nan, 0, 0, 1))
    assert not any(tmp_path.iterdir())


def test_png_refuses_other_depths_and_shapes(tmp_path):
    with pytest.raises(ValueError, match="8 or 16 bits per channel, not 12"):
        write_png(tmp_path / "a.png", uniform(0, 0, 0, 1), bits=12)
    with pytest.raises(ValueError, match=r"\(H, W, 4\), not \(2, 3, 3\)"):
        write_png(tmp_path / "a.png", uniform(0, 0, 0, 1)[..., :3])


def test_a_background_has_three_values():
    with pytest.raises(ValueError, match="3 values, not 1"):
        over(uniform(0, 0, 0, 1), [1.0])


def test_straight_color_times_alpha_is_premultiplied_color(rgba):
    color = straight(rgba)
    np.testing.assert_allclose(color[..., :3] * color[..., 3:], rgba[..., :3], rtol=1e-6)


def test_exr_returns_every_channel_exactly(tmp_path, frame):
    write_exr(tmp_path / "a.exr", frame)
    channels = read_channels(tmp_path / "a.exr")
    assert list(channels) == ["R", "G", "B", "A", "Z", "coverage", "first.Z"]
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr"), frame.rgba)
    np.testing.assert_array_equal(channels["Z"], frame.depth)
    np.testing.assert_array_equal(channels["first.Z"], frame.first_depth)
    np.testing.assert_array_equal(channels["coverage"], frame.coverage)


@pytest.mark.parametrize("suffix", [".png", ".PNG", ".exr"])
def test_a_frame_is_written_in_the_format_of_its_suffix(tmp_path, frame, suffix):
    write_frame(tmp_path / f"a{suffix}", frame)
    name = OpenImageIO.ImageInput.open(str(tmp_path / f"a{suffix}")).format_name()
    assert name == {".png": "png", ".exr": "openexr"}[suffix.lower()]


@pytest.mark.parametrize("name", ["a.bmp", "a", ".png"])
def test_an_unknown_suffix_lists_the_known_ones(tmp_path, frame, name):
    with pytest.raises(ValueError, match=f"{name}: pictures are written as .png, .exr, .jpg, "):
        write_frame(tmp_path / name, frame)


def test_an_exr_without_a_display_window_whose_header_is_damaged_is_refused(tmp_path, frame):
    """OpenImageIO opens it, and would divide by a width of zero when it reads."""
    path = tmp_path / "a.exr"
    write_frame(path, frame)
    damaged = path.read_bytes().replace(b"displayWindow", b"displayWind0w")
    path.write_bytes(damaged.replace(b"screenWindowCenter\0v2f", b"screenWindowCenter\0\0\0\0"))
    with pytest.raises(OSError, match=r"a\.exr is damaged") as caught:
        read_image(path)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(OpenImageIO.VERSION < 30200, reason="OpenImageIO 3.1 reads such a file")
def test_an_error_that_quotes_letters_of_a_damaged_file_is_one_line(tmp_path, frame):
    path = tmp_path / "a.exr"
    write_frame(path, frame)
    damaged = path.read_bytes().replace(b"compression\0compression", b"compression\0com\xffression")
    path.write_bytes(damaged)
    with pytest.raises(OSError, match=r"a\.exr is damaged: it has invalid characters"):
        read_image(path)


def test_pfm_comes_right_side_up(tmp_path):
    gray = np.arange(12, dtype=np.float32).reshape(4, 3)
    cv2.imwrite(str(tmp_path / "a.pfm"), gray)
    np.testing.assert_array_equal(read_image(tmp_path / "a.pfm")[..., 0], gray)


def test_premultiplied_tiff_is_not_multiplied_again(tmp_path, rgba):
    OpenImageIO.ImageBuf(rgba).write(str(tmp_path / "a.tif"))
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), rgba)


def test_a_missing_picture_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_image(tmp_path / "a.png")


def test_what_is_not_a_picture_is_refused(tmp_path):
    (tmp_path / "a.png").write_text("hello")
    with pytest.raises(OSError, match="is not a picture that can be read: Not a PNG file"):
        read_image(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_half_a_picture_is_refused(tmp_path, frame, suffix):
    path = tmp_path / f"a{suffix}"
    write_frame(path, frame)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(OSError, match=r"is damaged|cannot be read") as caught:
        read_image(path)
    assert "\n" not in str(caught.value)


def test_replacing_leaves_only_the_target(tmp_path):
    (tmp_path / "a.json").write_text("old")
    with replacing(tmp_path / "a.json") as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".json"
        temporary.write_text("new")
        assert (tmp_path / "a.json").read_text() == "old"
    assert [path.read_text() for path in tmp_path.iterdir()] == ["new"]


def test_replacing_keeps_the_old_file_after_an_error(tmp_path):
    (tmp_path / "a.json").write_text("old")

    def fail() -> None:
        with replacing(tmp_path / "a.json") as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_replacing_follows_a_link(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "target")
    with replacing(tmp_path / "link") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "new"


def test_replacing_gives_the_usual_permissions(tmp_path):
    with replacing(tmp_path / "a") as temporary:
        temporary.write_text("new")
    (tmp_path / "b").write_text("usual")
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == stat.S_IMODE(
        (tmp_path / "b").stat().st_mode
    )


def test_replacing_refuses_a_folder(tmp_path):
    with pytest.raises(OSError, match="is not a regular file"), replacing(tmp_path):
        pass


def test_replacing_refuses_a_device():
    with pytest.raises(OSError, match="is not a regular file"), replacing(os.devnull):
        pass
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)


def test_replacing_refuses_a_missing_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match="cannot be written"), replacing(tmp_path / "b/a"):
        pass


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_replacing_refuses_a_folder_without_permission(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError, match="cannot be written"), replacing(tmp_path / "a"):
        pass


FULL_DISK = """
import resource, sys
import numpy as np
from resample.files.saving import write_frame
from resample.types import Frame
size = int(sys.argv[2])
noise = np.random.default_rng(7).random((size, size, 4), np.float32)
plane = noise[..., 0]
resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
try:
    write_frame(sys.argv[1], Frame(noise, plane, plane, plane, None))
except OSError as error:
    sys.exit(str(error))
"""


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="no limit of a file's size")
@pytest.mark.parametrize("size", [4, 300])
@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_a_full_disk_is_reported_and_leaves_nothing(tmp_path, suffix, size):
    path = tmp_path / f"a{suffix}"
    command = [sys.executable, "-c", FULL_DISK, str(path), str(size)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "cannot be written" in ended.stderr.splitlines()[-1]  # libpng may have complained first
    assert ended.returncode == 1
    assert not any(tmp_path.iterdir())
