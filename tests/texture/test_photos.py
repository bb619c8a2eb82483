"""What the command line keeps of a photo's file: which way is up, color profile, camera."""

import json
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO
import pytest
from PIL import Image, ImageCms, ImageOps

from resample.files.images import read_channels
from resample.files.metadata.fields import turn, upright
from resample.files.metadata.tags import Tag, add_tags
from resample.files.pictures import loadable_picture, read_picture
from resample_texture import cli
from tests import commands

SAME = ["--matrix", "1,0,0,0,1,0"]
HALF = ["--matrix", "0.5,0,0,0,0.5,0", "--size", "12x8"]
ended = partial(commands.ended, cli.app)
EXIF, GPS = 0x8769, 0x8825


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@cache
def profile() -> bytes:
    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def exif(orientation: int) -> Image.Exif:
    tags = Image.Exif()
    tags[271], tags[272], tags[306], tags[274] = (
        "Maker",
        "Model",
        "2020:01:02 03:04:05",
        orientation,
    )
    inner = tags.get_ifd(EXIF)
    inner[0x829A], inner[0xA434], inner[0x9003] = 0.004, "Lens 50 mm", "2020:01:02 03:04:05"
    inner[0x927C], inner[0xA002], inner[0xA003] = b"maker's notes", 24, 16
    place = tags.get_ifd(GPS)
    place[1], place[2] = "N", (50.0, 5.0, 12.5)
    return tags


def photo(name: str, orientation: int, shape: tuple[int, ...] = (16, 24, 3)) -> None:
    levels = np.random.default_rng(5).integers(0, 256, shape, np.uint8)
    kept = {"exif": exif(orientation).tobytes(), "icc_profile": profile()}
    choices = {"jpg": {"quality": 95, "subsampling": 0}, "webp": {"lossless": True}}
    Image.fromarray(levels).save(name, **kept, **choices.get(name.rpartition(".")[2], {}))


def shown(name: str) -> np.ndarray:
    with Image.open(name) as image:
        return np.array(ImageOps.exif_transpose(image))


@pytest.mark.some(1)
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_sideways_photo_is_read_upright_and_written_so(orientation):
    photo("in.png", orientation)
    assert ended("warp", "in.png", "-o", "out.png", *SAME) == 0
    assert np.array_equal(shown("out.png"), shown("in.png"))
    with Image.open("out.png") as image:
        assert image.getexif().get(274, 1) == 1
        assert image.size == shown("in.png").shape[1::-1]


@pytest.mark.some(1)
@pytest.mark.parametrize("suffix", ["jpg", "webp", "tif"])
def test_all_formats_that_tell_are_turned(suffix):
    photo(f"in.{suffix}", 6)
    assert ended("warp", f"in.{suffix}", "-o", "out.png", *SAME) == 0
    assert np.abs(shown("out.png").astype(int) - shown(f"in.{suffix}")).max() <= 2  # JPEG decoders


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_matrix_of_a_turn_leads_where_the_turn_does(orientation):
    data = np.arange(35).reshape(5, 7)
    turned, matrix = upright(data, orientation), turn(orientation, (5, 7))
    for row, column in np.ndindex(5, 7):
        x, y, _ = matrix @ (column + 0.5, row + 0.5, 1.0)
        assert turned[int(y), int(x)] == data[row, column]


@pytest.mark.some(1)
@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
@pytest.mark.parametrize("source", ["jpg", "png", "webp", "tif"])
def test_camera_and_profile_are_kept(source, suffix):
    photo(f"in.{source}", 8)
    assert ended("warp", f"in.{source}", "-o", f"out.{suffix}", *HALF, "--edge", "clamp") == 0
    with Image.open(f"out.{suffix}") as image:
        tags = image.getexif()
        assert (tags[271], tags[272], tags[306]) == ("Maker", "Model", "2020:01:02 03:04:05")
        assert tags.get(274, 1) == 1
        inner = tags.get_ifd(EXIF)
        assert inner[0x829A] == pytest.approx(0.004)
        assert (inner[0xA434], inner[0x9003]) == ("Lens 50 mm", "2020:01:02 03:04:05")
        assert inner[0x927C] == b"maker's notes"
        assert (inner[0xA002], inner[0xA003]) == (12, 8)
        assert tags.get_ifd(GPS)[2] == (50.0, 5.0, 12.5)
        assert image.info["icc_profile"] == profile()


@pytest.mark.some(2)
@pytest.mark.parametrize("suffix", ["tif", "png", "jpg", "exr"])
@pytest.mark.parametrize(
    ("words", "told", "kept"),
    [
        (SAME, {"shape": [16, 24, 3]}, {"shape": [16, 24, 3]}),
        (HALF, {"shape": [16, 24, 3]}, None),
        (HALF, {"shape": [1, 16, 24, 3], "um": 0.5}, {"um": 0.5}),
    ],
)
def test_a_description_of_another_shape_is_dropped(words, told, kept, suffix):
    description = json.dumps(told)
    Image.new("RGB", (24, 16)).save("in.tif", tiffinfo={270: description})
    assert ended("warp", "in.tif", "-o", f"out.{suffix}", *words, "--edge", "clamp") == 0
    if suffix == "exr":
        spec = OpenImageIO.ImageInput.open("out.exr").spec()
        found = spec.get_string_attribute("ImageDescription")
    else:
        with Image.open(f"out.{suffix}") as image:
            found = image.getexif().get(270, "")
    assert (json.loads(found) if found else None) == kept


def test_a_png_with_a_profile_does_not_say_srgb_as_well():
    photo("in.jpg", 1)
    assert ended("warp", "in.jpg", "-o", "out.png", *SAME) == 0
    with Image.open("out.png") as image:
        assert image.info["icc_profile"] == profile()
        assert "srgb" not in image.info
        assert "gamma" not in image.info


def test_exr_keeps_the_camera_and_no_profile_of_encoded_values():
    photo("in.jpg", 1)
    assert ended("warp", "in.jpg", "-o", "out.exr", *SAME) == 0
    spec = OpenImageIO.ImageInput.open("out.exr").spec()
    assert spec.get_string_attribute("Make") == "Maker"
    assert spec.get_string_attribute("Exif:DateTimeOriginal") == "2020:01:02 03:04:05"
    assert spec.getattribute("ICCProfile") is None


def test_exr_keeps_texts_of_cameras_that_write_latin_1():
    block = Image.Exif()
    block[33432] = "XX Me"
    block = block.tobytes().replace(b"XX", b"\xa9\xb7")  # of "© Me" and the like
    Image.new("RGB", (24, 16)).save("in.jpg", exif=block)
    assert ended("warp", "in.jpg", "-o", "out.exr", *SAME) == 0
    spec = OpenImageIO.ImageInput.open("out.exr").spec()
    assert spec.get_string_attribute("Copyright") == "©· Me"


@pytest.mark.parametrize("stored", [0, 9, 114])
def test_a_number_that_is_no_orientation_turns_nothing(stored):
    photo("in.png", 1)
    levels = shown("in.png")
    Image.fromarray(levels).save("in.png", exif=exif(stored).tobytes())
    picture = read_picture(Path("in.png"), as_data=True)
    loaded = loadable_picture(Path("in.png")).load()
    assert picture.data.shape == loaded.data.shape == levels.shape
    assert np.array_equal(loaded.data, levels)


@pytest.mark.parametrize(
    ("shape", "words"), [((16, 24), ["--background", "red"]), ((16, 24, 3), ["--bits", "32"])]
)
def test_a_profile_that_is_not_true_any_more_is_dropped(shape, words):
    photo("in.png", 1, shape)
    assert ended("warp", "in.png", "-o", "out.tif", *HALF, *words) == 0
    assert OpenImageIO.ImageInput.open("out.tif").spec().getattribute("ICCProfile") is None


def test_rectified_pages_keep_the_camera():
    photo("in.jpg", 6)
    corners = ["--corners", "1,1 15,2 14,22 2,23"]
    assert ended("rectify", "in.jpg", "-o", "out.jpg", *corners) == 0
    with Image.open("out.jpg") as image:
        assert image.getexif()[271] == "Maker"


def test_makers_notes_too_long_for_jpeg_are_left_out():
    tags = exif(1)
    tags.get_ifd(EXIF)[0x927C] = bytes(70_000)
    Image.new("RGB", (24, 16)).save("in.png", exif=tags)
    assert ended("warp", "in.png", "-o", "out.jpg", *SAME) == 0
    with Image.open("out.jpg") as image:
        assert image.getexif()[271] == "Maker"
        assert 0x927C not in image.getexif().get_ifd(EXIF)


def test_a_damaged_exif_block_does_no_harm():
    photo("in.png", 1)
    with Image.open("in.png") as image:
        image.save("bad.png", exif=b"Exif\0\0MM\0*\0\0\xff\xff")
    assert ended("warp", "bad.png", "-o", "out.png", *SAME) == 0
    assert np.array_equal(cv2.imread("bad.png"), cv2.imread("out.png"))


@pytest.mark.some(1)
@pytest.mark.parametrize("kind", ["int16", "int32", "uint32", "int8"])
def test_numbers_of_other_integers_stay_what_they_are(kind):
    limits = np.iinfo(kind)
    values = np.random.default_rng(3).integers(
        limits.min, limits.max, (16, 24, 1), kind, endpoint=True
    )
    cv2.imwrite("in.tif", values)
    if kind == "uint32":  # which OpenCV writes for signed ones only
        add_tags(Path("in.tif"), [{339: Tag(3, np.array([1], np.uint16))}])
    assert np.array_equal(read_picture("in.tif", as_data=True).data, values)
    shades = read_picture("in.tif").data
    assert np.abs(shades).max() <= 1
    np.testing.assert_array_equal(shades, read_picture("in.tif", as_data=False).data)
    assert ended("warp", "in.tif", "-o", "out.tif", *SAME) == 0
    source = OpenImageIO.ImageInput.open("out.tif")
    name = kind.removesuffix("32")  # as OpenImageIO calls it
    assert str(source.spec().format) == name
    assert np.array_equal(source.read_image(name), values)


def test_numbers_that_a_format_has_no_room_for_are_refused(capsys):
    target = OpenImageIO.ImageOutput.create("in.tif")
    target.open("in.tif", OpenImageIO.ImageSpec(24, 16, 1, "int16"))
    target.write_image(np.full((16, 24, 1), -7, np.int16))
    target.close()
    refused = partial(commands.refused, cli.app)
    error = refused(capsys, "warp", "in.tif", "-o", "out.png", *SAME)
    assert "numbers of int16 do not fit into .png; take .tif or .exr" in error
    error = refused(capsys, "warp", "in.tif", "-o", "out.tif", *SAME, "--bits", "8")
    assert "numbers of int16 are not written in 8 bits" in error
    assert ended("warp", "in.tif", "-o", "out.exr", *SAME) == 0
    assert (read_channels("out.exr")["Y"] == -7).all()


@pytest.mark.sweep
def test_numbers_without_a_word_for_missing_ones_are_0_beyond_the_picture(capsys):
    cv2.imwrite("in.tif", np.full((16, 24), -700, np.int16))
    assert ended("warp", "in.tif", "-o", "out.tif", *HALF[:2]) == 0
    assert capsys.readouterr().err == (
        "resample: out.tif cannot mark missing values: pixels that are not covered are 0\n"
    )
    values = cv2.imread("out.tif", cv2.IMREAD_UNCHANGED)
    assert values.dtype == np.int16
    assert (values[:7, :11] == -700).all()
    assert not values[9:].any()
    assert ended("warp", "in.tif", "-o", "out.exr", *HALF[:2]) == 0
    assert np.isnan(read_channels("out.exr")["Y"][9:]).all()
    assert capsys.readouterr().err == ""


def test_large_numbers_keep_their_digits_when_they_are_mixed():
    cv2.imwrite("in.tif", np.full((16, 24), 2_000_000_001, np.int32))
    assert ended("warp", "in.tif", "-o", "out.tif", *HALF, "--edge", "clamp") == 0
    assert (cv2.imread("out.tif", cv2.IMREAD_UNCHANGED) == 2_000_000_001).all()


@pytest.mark.parametrize("method", ["nearest", "majority"])
def test_labels_of_32_bits_are_copied(method):
    labels = np.random.default_rng(8).integers(1, 1 << 31, (8, 12), np.int32)
    cv2.imwrite("in.tif", np.repeat(np.repeat(labels, 2, axis=0), 2, axis=1))
    assert ended("warp", "in.tif", "-o", "out.tif", *HALF, "--method", method) == 0
    assert np.array_equal(cv2.imread("out.tif", cv2.IMREAD_UNCHANGED), labels)
