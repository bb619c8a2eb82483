"""Pictures too large for memory as light: what is written of them is what is written of others."""

from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from resample.files.formats import WriteOptions
from resample.files.images import read_channels
from resample.files.pictures import Kind, Picture, picture_at
from resample.files.saving import writing_rows
from resample_texture import cli
from resample_texture.command import rendering
from resample_texture.geometry.mappings import BackwardMap
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
SHAPE = (150, 260)
LENS = "200,200,130,75,{},0.02,0,0"
WARPS = {
    "perspective": ["warp", "--matrix", "1.02,.03,5,-.02,.97,9,3e-5,6e-5,1"],
    "repeated": ["warp", "--matrix", ".5,.1,30,.1,.5,20", "--edge", "wrap"],
    "mirrored": ["warp", "--matrix", ".5,.1,30,.1,.5,20", "--edge", "mirror"],
    "region": ["warp", "--matrix", ".8,.1,30,.1,.7,20", "--roi", "20,33,110,77"],
    "encoded": ["rotate", "--degrees", "7", "--no-linear"],
    "quarter": ["rotate", "--degrees", "90"],
    "resized": ["resize", "--size", "70x90"],
    "thumbnail": ["resize", "--size", "5%"],
    "shrunk and turned": ["warp", "--matrix", ".05,.02,5,-.02,.05,9", "--size", "30x20"],
    "barrel": ["undistort", "--lens", LENS.format(-0.15)],
    "cushion": ["undistort", "--lens", LENS.format(0.2)],
    "bent": ["undistort", "--lens", LENS.format(-0.2), "--inverse"],
    "map": ["warp", "--map", "map.npy", "--convention", "opencv"],
    "flow": ["warp", "--flow", "flow.npy"],
    "filtered": ["undistort", "--lens", LENS.format(-0.15), "--filter", "gaussian:sigma=0.5"],
    "rival": ["rotate", "--degrees", "7", "--method", "lanczos4"],
    "copied": ["rotate", "--degrees", "7", "--method", "nearest"],
    "splats": ["rotate", "--degrees", "7", "--method", "paper"],
}
SOURCES = ["rgb.png", "rgba.png", "gray.png", "deep.png", "photo.jpg", "sideways.jpg", "page.tif"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command, with pictures in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rendering, "MOST_IN_STRIP", 40_000)
    rng = np.random.default_rng(3)
    smooth = rng.integers(0, 256, (16, 27, 4), np.uint8)
    levels = np.array(Image.fromarray(smooth).resize(SHAPE[::-1], Image.Resampling.BICUBIC))
    Image.fromarray(levels).save("rgba.png")
    color = Image.fromarray(levels[..., :3])
    for name in ("rgb.png", "photo.jpg", "page.tif"):
        color.save(name)
    exif = Image.Exif()
    exif[274], exif[271] = 6, "Maker"
    color.save("sideways.jpg", exif=exif)
    Image.fromarray(levels[..., 0]).save("gray.png")
    Image.fromarray(levels[..., 1].astype(np.uint16) * 257).save("deep.png")
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    np.save("map.npy", np.stack([x + 9 * np.sin(y / 20), y * 0.9 + 3], axis=2))
    np.save("flow.npy", np.stack([3 * np.sin(y / 20), 0 * y], axis=2))
    return tmp_path


def in_strips(monkeypatch):
    """Warp all pictures as if they were large; gives the list of strips that were warped."""
    done, one = [], rendering.Large.paint
    monkeypatch.setattr(rendering, "MOST_AT_ONCE", 0)

    def counted(self, first, count):
        done.append((first, count))
        return one(self, first, count)

    monkeypatch.setattr(rendering.Large, "paint", counted)
    return done


def same(first, second, levels=1):
    """Whether two files hold the same pixels, but for a rounding of few, and tell the same."""
    one, other = read_channels(first), read_channels(second)
    assert tuple(one) == tuple(other)
    for name in one:
        difference = np.abs(one[name] - other[name])
        assert difference.max() <= levels / 255 + 1e-6
        assert (difference > 1e-6).mean() < 0.01
    with Image.open(first) as one, Image.open(second) as other:
        assert one.mode == other.mode
        assert dict(one.getexif()) == dict(other.getexif())


@pytest.mark.some(1)
@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("name", ["perspective", "barrel", "cushion", "quarter", "encoded"])
def test_strips_make_the_file_that_one_go_makes(monkeypatch, source, name):
    words = [WARPS[name][0], source, "-o", "whole.png", *WARPS[name][1:]]
    assert ended(*words) == 0
    strips = in_strips(monkeypatch)
    assert ended(*[*words[:3], "parts.png", *words[4:]]) == 0
    same("whole.png", "parts.png")
    assert len(strips) > 1


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=pytest.mark.sweep
            if name in ("repeated", "cushion", "bent", "filtered", "flow")  # much like others
            else (),
        )
        for name in WARPS
    ],
)
def test_every_warp_of_a_large_picture_is_as_of_others(monkeypatch, name):
    command, *choices = WARPS[name]
    assert ended(command, "rgb.png", "-o", "whole.png", "--coverage", "share.png", *choices) == 0
    in_strips(monkeypatch)
    assert (
        ended(command, "rgb.png", "-o", "parts.png", "--coverage", "parts-share.png", *choices) == 0
    )
    same("whole.png", "parts.png")
    same("share.png", "parts-share.png")


@pytest.mark.parametrize(
    ("bounds", "is_whole"),
    [
        ((0, 0, 260, 150), True),
        ((0.1, 0.2, 259.8, 149.9), True),
        ((-0.1, 0, 260, 150), False),
        ((0, -0.1, 260, 150), False),
        ((0, 0, 260.1, 150), False),
        ((0, 0, 260, 150.1), False),
    ],
)
def test_a_map_whose_pixels_lie_within_the_picture_leaves_none_open(bounds, is_whole):
    """Edges included; places that are not numbers show nothing."""
    place = np.ones((2, 3))
    tiles = SimpleNamespace(bounds=np.array([[9, 9, 10, 10], bounds], float))
    for x, expected in ((place, is_whole), (np.where(np.eye(2, 3), np.nan, 1.0), False)):
        asked = SimpleNamespace(
            form=SimpleNamespace(shape=(*SHAPE, 3)),
            method=SimpleNamespace(visible_tiles=lambda *_: tiles),
            _drawing=lambda *_, x=x: ((None, BackwardMap(x, place), (2, 3)), None),
        )
        assert rendering.Large._covers_all(asked, 0, 2) is expected


@pytest.mark.sweep
@pytest.mark.parametrize("suffix", ["jpg", "tif", "exr"])
def test_strips_are_written_in_every_format(monkeypatch, suffix):
    choices = [*WARPS["perspective"][1:], "--background", "#20a0ff"]
    assert ended("warp", "rgb.png", "-o", f"whole.{suffix}", *choices) == 0
    assert in_strips(monkeypatch) == []
    assert ended("warp", "rgb.png", "-o", f"parts.{suffix}", *choices) == 0
    one, other = read_channels(f"whole.{suffix}"), read_channels(f"parts.{suffix}")
    for name, values in one.items():
        assert np.abs(values - other[name]).max() < (0.02 if suffix == "jpg" else 1 / 255 + 1e-6)


@pytest.mark.sweep
def test_the_statistics_of_a_large_picture_are_those_of_others(monkeypatch):
    in_strips(monkeypatch)
    assert ended("resize", "rgba.png", "small.png", "--size", "50%", "--stats", "stats.json") == 0
    told = commands.strict_json(Path("stats.json").read_text())
    assert (told["source"], told["size"], told["channels"]) == ([260, 150], [130, 75], list("RGBA"))


def test_a_jpeg_of_a_large_picture_is_black_where_a_lens_leaves_room(monkeypatch):
    words = ["undistort", "rgb.png", "out.jpg", "--lens", LENS.format(0.2)]
    assert ended(*words) == 0
    whole = np.asarray(Image.open("out.jpg")).astype(int)
    in_strips(monkeypatch)
    assert ended(*words) == 0
    shown = np.asarray(Image.open("out.jpg"))
    assert np.abs(shown - whole).max() <= 2  # levels are rounded, and JPEG's waves spread that
    assert shown[0, 0].max() < 5


@pytest.mark.sweep
def test_a_file_that_is_torn_leaves_nothing(monkeypatch, capsys):
    in_strips(monkeypatch)
    whole = Path("rgb.png").read_bytes()
    Path("torn.png").write_bytes(whole[: len(whole) // 2])
    assert "torn.png is damaged" in refused(capsys, "rotate", "torn.png", "o.png", "--degrees", "9")


def test_files_with_more_than_plain_levels_are_no_levels():
    Image.new("I;16", (4, 4)).save("numbers.tif")
    Image.new("LA", (4, 4)).save("la.png")
    found = {name: picture_at(Path(name)) for name in ("rgb.png", "sideways.jpg", "la.png")}
    assert [picture.is_plain for picture in found.values()] == [True, True, False]
    assert found["rgb.png"].shape == (150, 260, 3)
    assert found["sideways.jpg"].shape == (260, 150, 3)


def rows(count, width=5):
    return Picture(np.zeros((count, width, 3), np.float32), Kind(("R", "G", "B"), 8, True))


@pytest.mark.some(2)
@pytest.mark.parametrize(
    ("parts", "complaint"),
    [
        ([rows(3)], "only 3 of 8 rows were given"),
        ([rows(3), rows(6)], "rows 3 to 9"),
        ([rows(3), rows(5, width=6)], "rows 3 to 8"),
    ],
)
def test_rows_that_make_no_picture_leave_no_file(parts, complaint):
    def write():
        with writing_rows(Path("a.png"), 8, WriteOptions()) as put:
            for part in parts:
                put(part)

    with pytest.raises(ValueError, match=complaint):
        write()
    assert not [name for name in Path().iterdir() if name.name.startswith(("a.", ".a."))]
