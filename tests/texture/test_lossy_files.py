"""Quality of JPEG, WebP and AVIF files."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, features

from resample_texture import cli
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
SAME = ("--size", "48x32")
LOSSY = [
    "jpg",
    "webp",
    pytest.param(
        "avif",
        marks=pytest.mark.skipif(
            "avif" not in features.get_supported(), reason="this Pillow has no AVIF"
        ),
    ),
]


@pytest.fixture(autouse=True)
def photo(tmp_path, monkeypatch):
    """The levels of photo.png, in the working folder."""
    monkeypatch.chdir(tmp_path)
    small = np.random.default_rng(2).integers(0, 256, (2, 3, 3), np.uint8)
    image = Image.fromarray(small).resize((48, 32), Image.Resampling.BICUBIC)
    block = Image.Exif()
    block[271] = "Maker"
    image.save("photo.png", exif=block)
    return np.array(image)


def written(name, *words):
    """The levels of what `resize` writes, and its size in bytes."""
    assert ended("resize", "photo.png", name, *SAME, *words) == 0
    with Image.open(name) as image:
        return np.array(image).astype(int), Path(name).stat().st_size


@pytest.mark.sweep
@pytest.mark.parametrize("suffix", LOSSY)
def test_a_lower_quality_makes_a_smaller_and_a_worse_file(suffix, photo):
    errors, sizes = [], []
    for words in (("--file-quality", "15"), (), ("--file-quality", "100")):
        levels, size = written(f"out.{suffix}", *words)
        errors.append(np.abs(levels - photo).mean())
        sizes.append(size)
    assert sizes == sorted(sizes)
    assert errors == sorted(errors, reverse=True)
    assert errors[1] < 4
    with Image.open(f"out.{suffix}") as image:
        assert image.getexif()[271] == "Maker"


def test_a_lossless_webp_has_the_levels_of_a_png(photo):
    levels, _ = written("out.webp", "--file-quality", "lossless")
    np.testing.assert_array_equal(levels, photo)


@pytest.mark.some(1)
@pytest.mark.parametrize("suffix", LOSSY[1:])
def test_transparency_is_kept_and_gray_is_shown(suffix):
    words = ("--fit", "pad", "--file-quality", "95")
    assert ended("resize", "photo.png", f"out.{suffix}", "--size", "48", *words) == 0
    with Image.open(f"out.{suffix}") as image:
        assert np.array(image)[[0, 24], 24, 3].tolist() == [0, 255]
    Image.new("L", (4, 4), 90).save("photo.png")
    levels, _ = written(f"gray.{suffix}")
    assert np.abs(levels - 90).max() <= 1


@pytest.mark.parametrize(
    ("name", "words", "complaint"),
    [
        ("out.jpg", ("--file-quality", "0"), "--file-quality '0'; give 1 to 100, or lossless"),
        ("out.jpg", ("--file-quality", "good"), "give 1 to 100, or lossless"),
        ("out.jpg", ("--file-quality", "lossless"), "out.jpg: .jpg is never lossless"),
        ("out.avif", ("--file-quality", "lossless"), "out.avif: .avif is never lossless"),
        ("out.png", ("--file-quality", "90"), "out.png: .png has no quality"),
        ("out.webp", ("--bits", "16"), "out.webp: .webp has 8 bits per channel, not 16"),
        ("out.webp", ("--width", "16384", "--height", "1"), ".webp has sides of 16383 px at most"),
    ],
)
def test_what_a_format_cannot_is_one_line(name, words, complaint, capsys):
    size = () if "--width" in words else SAME
    assert complaint in refused(capsys, "resize", "photo.png", name, *size, *words)


def test_a_format_that_pillow_was_built_without_is_one_line(capsys, monkeypatch):
    monkeypatch.setattr(features, "get_supported", list)
    complaint = refused(capsys, "resize", "photo.png", "out.avif", *SAME)
    assert "out.avif: the installed Pillow cannot write it; take .png or .jpg" in complaint


def test_a_quality_of_films_is_refused(capsys):
    frames = [Image.new("RGB", (8, 8), color) for color in ("red", "blue")]
    frames[0].save("in.gif", save_all=True, append_images=frames[1:])
    words = ("resize", "in.gif", "out.webp", "--size", "4", "--file-quality", "50")
    assert "a quality is of files of one picture" in refused(capsys, *words)


@pytest.mark.skipif("avif" not in features.get_supported(), reason="this Pillow has no AVIF")
def test_avif_is_read_with_its_alpha_its_profile_and_its_exif(photo):
    from PIL import ImageCms

    block = Image.Exif()
    block[271] = "Maker"
    block[274] = 6
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    levels = np.dstack([photo, np.full(photo.shape[:2], 200, np.uint8)])
    options = {"quality": 100, "subsampling": "4:4:4", "exif": block, "icc_profile": profile}
    Image.fromarray(levels).save("photo.avif", **options)
    assert ended("resize", "photo.avif", "out.png", "--size", "32x48") == 0
    with Image.open("out.png") as image:
        assert image.getexif()[271] == "Maker"
        assert image.info["icc_profile"] == profile
        np.testing.assert_allclose(np.asarray(image), np.rot90(levels, -1), atol=6)


@pytest.mark.sweep
@pytest.mark.skipif("avif" not in features.get_supported(), reason="this Pillow has no AVIF")
def test_damaged_avif_is_refused_in_a_line(photo, capsys):
    Image.fromarray(photo).save("photo.avif")
    whole = Path("photo.avif").read_bytes()
    for end in (16, 60, len(whole) // 2, len(whole) - 9):
        Path("photo.avif").write_bytes(whole[:end])
        assert ended("resize", "photo.avif", "out.png", *SAME) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
        assert not Path("out.png").exists()


@pytest.mark.parametrize("suffix", LOSSY)
def test_pictures_of_a_folder_keep_their_format(suffix):
    Path("many").mkdir()
    with Image.open("photo.png") as image:
        image.save(f"many/one.{suffix}")
    assert ended("resize", "many", "-o", "small", *SAME) == 0
    assert [file.name for file in Path("small").iterdir()] == [f"one.{suffix}"]
