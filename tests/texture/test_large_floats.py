"""Large pictures of floats, numbers and other light: in strips they have the bits of the whole."""

from functools import partial
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest
import zarr
from PIL import Image, TiffImagePlugin

from resample.files.images import read_channels
from resample.files.pictures import loadable_picture, read_picture
from resample.memory import mapped
from resample_texture import cli
from resample_texture import drawing as drawings
from resample_texture.command import rendering
from resample_texture.texels import forward
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
SHAPE = (150, 260)
WARPS = {
    "perspective": ["warp", "--matrix", "1.02,.03,5,-.02,.97,9,3e-5,6e-5,1"],
    "sharp": ["warp", "--matrix", ".8,.1,9,.1,.7,20", "--interpolation", "lanczos"],
    "repeated": ["warp", "--matrix", ".5,.1,30,.1,.5,20", "--edge", "wrap"],
    "clamped": ["warp", "--matrix", ".8,.1,30,.1,.7,20", "--edge", "clamp"],
    "region": ["warp", "--matrix", ".8,.1,30,.1,.7,20", "--roi", "20,33,110,77"],
    "encoded": ["rotate", "--degrees", "7", "--no-linear"],
    "quarter": ["rotate", "--degrees", "90"],
    "thumbnail": ["resize", "--size", "24x70"],
    "horizon": ["warp", "--matrix", "1,.6,10,0,.55,30,0,9e-3,.4", "--size", "190x130"],
    "resized": ["resize", "--size", "70x90"],
}


def light(channels, *, holes="none"):
    """Light of some channels, brighter than white here and there, and what may be wrong with it."""
    rng = np.random.default_rng(11)
    coarse = rng.random((15, 26, channels), np.float32).repeat(10, axis=0).repeat(10, axis=1)
    made = coarse + rng.random((*SHAPE, channels), np.float32) * np.float32(0.3)
    made[20:22, 30:34] = 900.0
    if channels == 4:
        made[..., :3] *= made[..., 3:]
    if holes in ("nan", "both"):
        made[60:75, 100:140] = np.nan
        made[100, 200, 0] = np.nan
    if holes in ("inf", "both"):
        made[30, 40] = np.inf
        made[90, 9, 1 % channels] = -np.inf
    return made


def written(name, values, form="float", tile=0, **told):
    spec = OpenImageIO.ImageSpec(values.shape[1], values.shape[0], values.shape[2], form)
    spec.channelnames = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}[values.shape[2]]
    spec.alpha_channel = 3 if values.shape[2] == 4 else -1
    spec.tile_width = spec.tile_height = tile
    for key, value in told.items():
        spec.attribute(key.replace("_", ":"), value)
    target = OpenImageIO.ImageOutput.create(name)
    assert target.open(name, spec)
    assert target.write_image(np.ascontiguousarray(values))
    assert target.close()


def stored(name, values):
    made = zarr.create_array(name, shape=values.shape, chunks=(32, 32, 4), dtype=values.dtype)
    made[...] = values


SOURCES = {
    "float.exr": lambda name: written(name, light(3, holes="both")),
    "half.exr": lambda name: written(name, light(3, holes="nan"), "half"),
    "tiles.exr": lambda name: written(name, light(4), "half", tile=64),
    "alpha.exr": lambda name: written(name, light(4, holes="both"), tile=32),
    "depth.exr": lambda name: written(name, light(1, holes="inf")),
    "float.tif": lambda name: written(name, light(3, holes="nan")),
    "tiles.tif": lambda name: written(name, light(1), tile=64),
    "half.tif": lambda name: written(name, light(3), "half"),
    "straight.tif": lambda name: written(name, light(4), oiio_UnassociatedAlpha=1),
    "curved.tif": lambda name: written(name, light(3), oiio_ColorSpace="sRGB"),
    "sideways.tif": lambda name: written(name, light(3, holes="nan"), Orientation=6),
    "double.tif": lambda name: written(name, light(1).astype(np.float64), "double"),
    "levels.tif": lambda name: written(name, (light(4).clip(0, 1) * 255).astype(np.uint8), "uint8"),
    "numbers.tif": lambda name: written(name, (light(1) * 99).astype(np.int16), "int16"),
    "half.zarr": lambda name: stored(name, light(3, holes="nan").astype(np.float16)),
    "double.zarr": lambda name: stored(name, light(4).astype(np.float64)),
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / ".cache"))
    monkeypatch.setattr(rendering, "MOST_IN_STRIP", 40_000)
    (tmp_path / ".cache").mkdir()


def in_strips(monkeypatch):
    """Warp all pictures as if they were large, kept in files; gives the strips that were warped."""
    done, one = [], rendering.Large.paint
    monkeypatch.setattr(rendering, "MOST_AT_ONCE", 0)
    monkeypatch.setattr(drawings, "MOST_AT_ONCE", 0)
    monkeypatch.setattr(drawings, "MOST_IN_WINDOW", 20_000)
    monkeypatch.setattr(forward, "MOST_VALUES", 20_000)
    monkeypatch.setattr(mapped, "pages_of", lambda _: 1 << 20)

    def counted(self, first, count):
        done.append((first, count))
        return one(self, first, count)

    monkeypatch.setattr(rendering.Large, "paint", counted)
    return done


def same(first, second):
    """Whether two files hold the same bits."""
    one, other = read_channels(first), read_channels(second)
    assert tuple(one) == tuple(other)
    for name in one:
        np.testing.assert_array_equal(one[name].view(np.int32), other[name].view(np.int32))
    kinds = [read_picture(path, as_data=True).kind for path in (first, second)]
    assert kinds[0] == kinds[1]


def made(words, source, target):
    assert ended(words[0], source, "-o", target, *words[1:]) == 0


PAIRS = [(source, name) for source in SOURCES for name in ("perspective", "encoded")]
PAIRS += [(source, name) for source in ("float.exr", "alpha.exr") for name in WARPS]


@pytest.mark.some(1)
@pytest.mark.parametrize(("source", "name"), dict.fromkeys(PAIRS))
def test_light_in_strips_has_the_bits_of_the_whole(monkeypatch, source, name):
    SOURCES[source](source)
    words, suffix = WARPS[name], "tif" if source.startswith("numbers") else "exr"
    made(words, source, f"whole.{suffix}")
    strips = in_strips(monkeypatch)
    made(words, source, f"parts.{suffix}")
    assert len(strips) > 1
    same(f"whole.{suffix}", f"parts.{suffix}")


@pytest.mark.sweep
@pytest.mark.parametrize("suffix", ["png", "tif", "jpg"])
@pytest.mark.parametrize("holes", ["none", "nan", "inf"])
@pytest.mark.parametrize("background", [True, False])
def test_what_is_missing_is_written_as_of_the_whole(monkeypatch, suffix, holes, background):
    written("a.exr", light(3, holes=holes))
    behind = ["--background", "#20a0ff"] if background or suffix == "jpg" else []
    words = ["warp", "--matrix", ".5,0,-1.5,0,.5,-1.5", "--size", "120x70", *behind]
    made(words, "a.exr", f"whole.{suffix}")
    strips = in_strips(monkeypatch)
    made(words, "a.exr", f"parts.{suffix}")
    assert len(strips) > 1
    same(f"whole.{suffix}", f"parts.{suffix}")


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["f4", "u1", "u2"])
def test_words_for_what_is_missing_come_back(monkeypatch, kind, capsys):
    values = (light(1)[..., 0] * 50).astype(kind)
    values[30:50, 40:90] = 7
    facts = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, form, value in (
        (33550, 12, (2.0, 2.0, 0.0)),
        (33922, 12, (0.0,) * 6),
        (42113, 2, "7"),
    ):
        facts.tagtype[tag], facts[tag] = form, value
    Image.fromarray(values).save("a.tif", tiffinfo=facts)
    words = ["warp", "--matrix", ".8,.1,30,.1,.7,20"]
    made(words, "a.tif", "whole.tif")
    strips = in_strips(monkeypatch)
    made(words, "a.tif", "parts.tif")
    assert len(strips) > 1
    same("whole.tif", "parts.tif")
    assert np.isnan(loadable_picture(Path("a.tif")).load().data[30:50, 40:90]).all()
    capsys.readouterr()
    made(words, "a.tif", "parts.exr")
    assert capsys.readouterr().err.count("cannot store the picture's georeference") == 1


@pytest.mark.sweep
def test_numbers_without_a_word_for_what_is_missing_say_so_once(monkeypatch, capsys):
    written("a.tif", (light(1) * 50).astype(np.int16), "int16")
    in_strips(monkeypatch)
    made(["warp", "--matrix", "1,0,0.5,0,1,60.5"], "a.tif", "b.tif")
    assert capsys.readouterr().err.count("cannot mark missing values") == 1
    error = refused(capsys, *["warp", "a.tif", "-o", "b.png", "--matrix", "1,0,0.5,0,1,60.5"])
    assert "numbers of int16 do not fit into .png" in error


def test_halves_are_kept_as_halves(monkeypatch):
    written("half.exr", light(4), "half", tile=64)
    written("float.exr", light(4))
    in_strips(monkeypatch)
    for name, kind in (("half.exr", np.float16), ("float.exr", np.float32)):
        form = loadable_picture(Path(name))
        kept = form.load()
        assert (form.dtype, form.size) == (kind, kept.data.nbytes)
        assert kept.data.dtype == kind
        assert mapped.is_in_file(kept.data)
        np.testing.assert_array_equal(kept.data.astype(np.float32), read_picture(name).data)


def test_numbers_of_32_bits_are_read_whole():
    Image.fromarray(np.ones((4, 4), np.int32)).save("a.tif")
    assert loadable_picture(Path("a.tif")) is None


def test_a_torn_file_leaves_nothing(monkeypatch, capsys):
    written("a.exr", light(3))
    whole = Path("a.exr").read_bytes()
    Path("torn.exr").write_bytes(whole[: len(whole) // 2])
    in_strips(monkeypatch)
    error = refused(capsys, "rotate", "torn.exr", "-o", "b.exr", "--degrees", "7")
    assert "torn.exr is damaged" in error or "torn.exr is not a picture" in error
    assert not list(Path().glob("*b.exr*"))
