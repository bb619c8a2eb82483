"""Pictures of 16 bits: linear numbers, unless their file or the caller says sRGB."""

import json
import struct
import zlib
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO
import pytest
from PIL import Image, ImageCms

from resample.files.images import open_file, read_image
from resample_meshes.rendering import load_mesh
from resample_texture import cli, warp
from tests import commands

ended = partial(commands.ended, cli.app)
LEVELS = np.repeat(np.uint16([[10000, 30000]]), 3).reshape(1, 2, 3)
HALF = np.diag([0.5, 1.0, 1.0])
OF_NUMBERS, OF_LIGHT = 20000, 22730  # means of both levels: as numbers, and by the sRGB curve
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
CHUNKS = {
    "sRGB": b"\0",
    "iCCP": b"sRGB\0\0" + zlib.compress(PROFILE),
    "gAMA": struct.pack(">I", 45455),
    "cICP": bytes([1, 13, 0, 1]),
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command."""
    monkeypatch.chdir(tmp_path)


def chunked(name, data):
    """Write in.png with a chunk before its pixels."""
    cv2.imwrite("in.png", LEVELS)
    content, named = Path("in.png").read_bytes(), name.encode() + data
    chunk = struct.pack(">I", len(data)) + named + struct.pack(">I", zlib.crc32(named))
    Path("in.png").write_bytes(content[:33] + chunk + content[33:])


def resized(source, target="out.png", *words):
    """The levels of a picture resized to one pixel, and its statistics."""
    assert ended("resize", source, target, "--size", "1x1", "--stats", "s.json", *words) == 0
    levels = OpenImageIO.ImageBuf(target).get_pixels(OpenImageIO.UINT16)
    return int(levels[0, 0, 0]), json.loads(Path("s.json").read_text())["encoding"]


@pytest.mark.parametrize("form", ["png", "tif", "pgm"])
def test_sixteen_bits_that_nothing_is_said_of_are_linear_and_stay_unmarked(form):
    source = f"in.{form}"
    cv2.imwrite(source, LEVELS[..., 0] if form == "pgm" else LEVELS)
    target = "out.tif" if form == "tif" else "out.png"
    assert resized(source, target) == (OF_NUMBERS, "linear")
    assert warp(source, HALF, (1, 1)).image.ravel()[0] == OF_NUMBERS
    assert not any(name in Path(target).read_bytes() for name in (b"sRGB", b"gAMA", b"iCCP"))
    assert not open_file(target).encoding.is_encoded


@pytest.mark.some(1)
@pytest.mark.parametrize("name", CHUNKS)
def test_a_png_that_says_so_is_encoded_for_displays(name):
    chunked(name, CHUNKS[name])
    assert resized("in.png") == (OF_LIGHT, "sRGB")
    assert warp("in.png", HALF, (1, 1)).image.ravel()[0] == OF_LIGHT
    assert open_file("out.png").encoding.is_encoded


def test_a_png_of_gamma_1_is_linear_and_says_so_again():
    chunked("gAMA", struct.pack(">I", 100_000))
    assert resized("in.png") == (OF_NUMBERS, "linear")
    assert b"gAMA" + struct.pack(">I", 100_000) in Path("out.png").read_bytes()


def test_a_tiff_with_a_profile_is_encoded_for_displays():
    spec = OpenImageIO.ImageSpec(2, 1, 3, "uint16")
    profile = np.frombuffer(PROFILE, np.uint8)
    spec.attribute("ICCProfile", f"uint8[{profile.size}]", profile)
    file = OpenImageIO.ImageOutput.create("in.tif")
    assert file.open("in.tif", spec)
    assert file.write_image(LEVELS)
    assert file.close()
    assert resized("in.tif", "out.tif") == (OF_LIGHT, "sRGB")
    assert open_file("out.tif").encoding.is_encoded


@pytest.mark.some(1)
@pytest.mark.parametrize("target", ["out.png", "out.tif"])
def test_an_option_says_otherwise(target):
    cv2.imwrite("in.png", LEVELS)
    assert resized("in.png", target, "--encoding", "srgb") == (OF_LIGHT, "sRGB")
    assert open_file(target).encoding.is_encoded
    assert resized(target, "again.png", "--encoding", "linear")[1] == "linear"


def test_an_option_says_so_of_pages():
    cv2.imwritemulti("in.tif", [LEVELS, LEVELS])
    for words, mean in (((), OF_NUMBERS), (("--encoding", "srgb"), OF_LIGHT)):
        assert ended("resize", "in.tif", "out.tif", "--size", "1x1", *words) == 0
        _, pages = cv2.imreadmulti("out.tif", flags=cv2.IMREAD_UNCHANGED)
        assert [int(page[0, 0, 0]) for page in pages] == [mean, mean]


def test_eight_bits_are_encoded_unless_an_option_says_otherwise():
    cv2.imwrite("in.png", np.uint8([[40, 120]]))
    for words, mean in (((), 91), (("--encoding", "linear"), 80)):
        assert resized("in.png", "out.png", *words)[0] == mean * 257


def test_linear_light_becomes_levels_for_displays_in_8_bits_and_a_line_says_so(capsys):
    cv2.imwrite("in.png", np.full((4, 4), 13_107, np.uint16))  # 0.2
    for target, words in (("out.jpg", ()), ("out.png", ("--bits", "8"))):
        assert ended("resize", "in.png", target, "--size", "2", *words) == 0
        assert int(cv2.imread(target)[0, 0, 0]) == 124  # the sRGB curve at 0.2
        assert "16 bits are taken for linear light" in capsys.readouterr().err
    assert ended("resize", "in.png", "out.jpg", "--size", "2", "--encoding", "srgb") == 0
    assert int(cv2.imread("out.jpg")[0, 0, 0]) == 51
    assert "linear light" not in capsys.readouterr().err


def test_light_of_16_bits_is_read_alike_by_all():
    cv2.imwrite("in.png", LEVELS)
    np.testing.assert_array_equal(read_image("in.png"), (LEVELS / np.float32(65535)))
    chunked("sRGB", b"\0")
    curve = ((LEVELS / 65535 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(read_image("in.png"), curve, atol=1e-6)


def test_films_are_never_linear(capsys):
    images = [np.full((4, 4, 3), level, np.uint8) for level in (10, 90)]
    frames = [Image.fromarray(image) for image in images]
    frames[0].save("in.gif", save_all=True, append_images=frames[1:])
    words = ["resize", "in.gif", "out.gif", "--size", "2", "--encoding", "linear"]
    assert "in.gif: films and animations are sRGB" in commands.refused(cli.app, capsys, *words)


def test_textures_of_meshes_are_colors_for_displays():
    cv2.imwrite("in.png", LEVELS)
    Path("in.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    curve = ((LEVELS / 65535 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(load_mesh("in.obj", "in.png").textures[0], curve, atol=1e-6)
