"""ICC profiles become sRGB: wide colors of phones, by matrices that are computed here."""

import io
import struct
import zlib
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from resample.colors import from_srgb, to_srgb
from resample.files.images import read_image
from resample.files.metadata.colors import converted
from resample_texture import cli
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
D65, D50 = (0.3127, 0.329), (0.3457, 0.3585)
SRGB = ((0.64, 0.33), (0.3, 0.6), (0.15, 0.06))
P3 = ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06))
ADOBE = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06))
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
SHADES = [2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045]  # sRGB's curve, as ICC has it
CURVES = {
    "formula": ("para", 3, SHADES),
    "longer formula": ("para", 4, [*SHADES, 0.0, 0.0]),
    "power": ("curv", 0, [563]),  # 563 / 256 = 2.2
    "parametric power": ("para", 0, [2.2]),
    "table": ("curv", 0, np.rint(65535 * from_srgb(np.linspace(0, 1, 1024))).astype(int)),
    "line": ("curv", 0, []),
}


def xyz(point):
    x, y = point
    return np.array([x / y, 1.0, (1 - x - y) / y])


def to_xyz(primaries, white=D65):
    """Matrix (3, 3) from light to XYZ, by the primaries' chromaticities."""
    columns = np.stack([xyz(each) for each in primaries], axis=1)
    return columns * np.linalg.solve(columns, xyz(white))


def adapted(matrix):
    """The same under D50, as profiles have it."""
    cones = np.diag((BRADFORD @ xyz(D50)) / (BRADFORD @ xyz(D65)))
    return np.linalg.inv(BRADFORD) @ cones @ BRADFORD @ matrix


def fixed(numbers):
    return np.rint(np.asarray(numbers) * 65536).astype(">i4").tobytes()


def curve(kind, form, numbers):
    if kind == "curv":
        start = struct.pack(">4sII", b"curv", 0, len(numbers))
        return start + np.asarray(numbers).astype(">u2").tobytes()
    return struct.pack(">4sIHH", b"para", 0, form, 0) + fixed(numbers)


def profile(primaries, shades):
    """An ICC profile, version 4, of primaries and a curve; None: of gray."""
    tags = {b"wtpt": b"XYZ \0\0\0\0" + fixed(xyz(D50)), b"desc": text("Test"), b"cprt": text("-")}
    if primaries is None:
        tags[b"kTRC"] = curve(*shades)
    else:
        for name, column in zip("rgb", adapted(to_xyz(primaries)).T, strict=True):
            tags[f"{name}XYZ".encode()] = b"XYZ \0\0\0\0" + fixed(column)
            tags[f"{name}TRC".encode()] = curve(*shades)
    table, body, first = b"", b"", 128 + 4 + 12 * len(tags)
    for name, data in tags.items():
        padded = data + b"\0" * (-len(data) % 4)
        table += struct.pack(">4sII", name, first + len(body), len(data))
        body += padded
    space = b"GRAY" if primaries is None else b"RGB "
    header = bytearray(128)
    header[8:12], header[12:24] = b"\x04\x30\0\0", b"mntr" + space + b"XYZ "
    header[36:40], header[68:80] = b"acsp", fixed(xyz(D50))
    header[:4] = struct.pack(">I", first + len(body))
    return bytes(header) + struct.pack(">I", len(tags)) + table + body


def text(words):
    coded = words.encode("utf-16-be")
    return struct.pack(">4sIII2s2sII", b"mluc", 0, 1, 12, b"en", b"US", len(coded), 28) + coded


@pytest.fixture
def levels():
    ramp = np.linspace(0, 255, 9).astype(np.uint8)
    return np.stack(np.meshgrid(ramp, ramp, ramp), axis=3).reshape(27, 27, 3)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_display_p3_is_srgb_by_its_primaries(levels):
    matrix = np.linalg.inv(to_xyz(SRGB)) @ to_xyz(P3)  # both are under D65
    light = from_srgb(levels / 255.0)
    found = converted(light.astype(np.float32), profile(P3, CURVES["formula"]))
    np.testing.assert_allclose(found, light @ matrix.T, atol=4e-4)  # white of profiles


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("primaries", [P3, ADOBE])
def test_conversions_are_those_of_littlecms(levels, name, primaries):
    icc = profile(primaries, CURVES[name])
    seen = ImageCms.profileToProfile(
        Image.fromarray(levels), ImageCms.ImageCmsProfile(io.BytesIO(icc)),
        ImageCms.createProfile("sRGB"), ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )  # fmt: skip
    light = from_srgb((levels / 255.0).astype(np.float32))
    found = 255 * to_srgb(np.clip(converted(light, icc), 0, 1))
    assert np.abs(found - np.asarray(seen, float)).max() < 2.0  # it computes in 8 bits


def write(name, levels, icc):
    Image.fromarray(levels).save(name, icc_profile=icc, quality=98, subsampling=0)


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif", "webp"])
def test_a_photo_of_a_phone_becomes_srgb(levels, suffix):
    icc, matrix = profile(P3, CURVES["formula"]), np.linalg.inv(to_xyz(SRGB)) @ to_xyz(P3)
    write("phone.jpg", levels, icc)
    levels = np.asarray(Image.open("phone.jpg"))
    words = ["phone.jpg", f"out.{suffix}", "--size", "100%", "--profile", "srgb"]
    words += ["--file-quality", "lossless"] if suffix == "webp" else []
    assert ended("resize", *words) == 0
    with Image.open(f"out.{suffix}") as image:
        assert not image.info.get("icc_profile")
        found = np.asarray(image.convert("RGB"), float)
    expected = 255 * to_srgb(np.clip(from_srgb(levels / 255.0) @ matrix.T, 0, 1))
    assert np.abs(found - expected).mean() < (6 if suffix == "jpg" else 0.6)


def test_profiles_are_kept_unless_that_is_asked_for(levels):
    icc = profile(P3, CURVES["formula"])
    write("phone.jpg", levels, icc)
    assert ended("resize", "phone.jpg", "out.jpg", "--size", "50%") == 0
    with Image.open("out.jpg") as image:
        assert image.info["icc_profile"] == icc


def test_opacity_and_gray_are_converted(levels):
    icc = profile(P3, CURVES["formula"])
    alpha = np.full((27, 27, 1), 128, np.uint8)
    write("clear.png", np.concatenate([levels, alpha], axis=2), icc)
    write("plain.png", levels, icc)
    for name in ("clear", "plain"):
        assert ended("resize", f"{name}.png", f"{name}-out.png", "--size=1x", "--profile=srgb") == 0
    clear, plain = (np.asarray(Image.open(f"{name}-out.png")) for name in ("clear", "plain"))
    assert np.abs(clear[..., :3].astype(int) - plain).max() <= 1
    assert (clear[..., 3] == 128).all()
    write("gray.png", levels[..., 0], profile(None, CURVES["power"]))
    assert ended("resize", "gray.png", "gray-out.png", "--size=1x", "--profile=srgb") == 0
    found = np.asarray(Image.open("gray-out.png"), float)
    expected = 255 * to_srgb((levels[..., 0] / 255.0) ** (563 / 256))
    assert np.abs(found - expected).max() <= 0.51


def test_light_of_exr_is_that_of_srgb(levels):
    write("phone.png", levels, profile(P3, CURVES["formula"]))
    assert ended("resize", "phone.png", "out.exr", "--size=1x", "--profile=srgb") == 0
    matrix = np.linalg.inv(to_xyz(SRGB)) @ to_xyz(P3)
    expected = from_srgb(levels / 255.0) @ matrix.T
    np.testing.assert_allclose(read_image("out.exr"), expected, atol=4e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda icc: icc.replace(b"rXYZ", b"zXYZ"), "its profile is not of the type matrix/TRC"),
        (lambda icc: icc.replace(b"para", b"what"), "curves of an unknown kind"),
        (lambda icc: icc[:140], "its profile is not of the type matrix/TRC"),
    ],
)
def test_other_profiles_are_refused_in_a_line(levels, change, words):
    with pytest.raises(ValueError, match=words):
        converted(levels.astype(np.float32), change(profile(P3, CURVES["formula"])))


def test_colors_by_other_marks_are_not_converted(levels, capsys):
    write("plain.png", levels, None)
    data = Path("plain.png").read_bytes()
    mark = b"cICP" + bytes([12, 13, 0, 1])
    chunk = struct.pack(">I", 4) + mark + struct.pack(">I", zlib.crc32(mark))
    Path("coded.png").write_bytes(data[:33] + chunk + data[33:])
    said = refused(capsys, "resize", "coded.png", "out.png", "--size=1x", "--profile=srgb")
    assert "Display P3" in said
    assert "leave --profile out" in said
