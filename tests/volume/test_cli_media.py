"""Command lines with several volumes, channels, colors and times."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from resample.files.images import read_image
from resample.resampler import Resampler
from resample_volume import cli
from resample_volume.command.choices import Added, AppearanceChoices, ReadOptions
from resample_volume.command.inputs import held, media, others
from resample_volume.files.generated import vessel_tree
from resample_volume.files.source import write_volume
from resample_volume.rendering import Subject
from tests import commands

ended = partial(commands.ended, cli.app)
refused = partial(commands.refused, cli.app)

SMALL = ("--size", "32")


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tree = vessel_tree(16)
    write_volume(Path("a.nrrd"), tree)
    write_volume(Path("b.nrrd"), tree._replace(origin=tree.origin + np.array([8.0, 0, 0])))
    z, y, x = np.mgrid[-1:1:12j, -1:1:12j, -1:1:12j]
    blobs = [np.exp(-8 * ((x - a) ** 2 + y**2 + z**2)) for a in (-0.5, 0.0, 0.5)]
    np.save("c.npy", (1000 * np.array(blobs)).astype(np.uint16))
    np.save("rgb.npy", np.moveaxis(255 * np.array(blobs), 0, -1).astype(np.uint8))


def scene(name, source=None, **added):
    return media(
        source or ReadOptions(), name, AppearanceChoices(shading=False), Added(**added), Resampler()
    )


@pytest.mark.sweep
def test_also_shows_another_volume_where_its_file_says():
    assert ended("render", "a.nrrd", "-o", "a.png", *SMALL) == 0
    words = ("--also", "b.nrrd:transfer=gray:opacity=0.5,color=blue", "--stats", "s.json")
    assert ended("render", "a.nrrd", "-o", "ab.png", *words, *SMALL) == 0
    one, both = read_image("a.png"), read_image("ab.png")
    blue = [(seen[..., 2] > 1.5 * seen[..., 0]).sum() for seen in (one, both)]
    assert blue[0] == 0
    assert blue[1] > 20
    assert json.loads(Path("s.json").read_text())["samples"] > 0


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (
            ("--also", "b.nrrd", "--classify", "post", "--order", "image-sheets"),
            "the classification post needs the order rays",
        ),
        (("--also", "b.nrrd", "--projection", "maximum"), "the values of one"),
        (("--also", "gone.nrrd:transfer=gray"), "gone.nrrd: there is no such file"),
        (("--also", "b.nrrd:window=0/5,window=1/2"), "its settings"),
        (("--also", "b.nrrd:window=,transfer=gray"), "its settings"),
        (("--also", ":transfer=gray"), "names no file"),
        (("--also", "b.nrrd:time=one"), "time, channel and level are whole numbers"),
        (("--channels", "red,green"), "a has 1 channels, channels gives 2 looks"),
        (("--channel", "1"), "a has 1 channels, 0 to 0; there is no channel 1"),
    ],
)
def test_what_cannot_be_shown_with_another_is_one_line(words, complaint, capsys):
    assert complaint in refused(capsys, "render", "a.nrrd", "-o", "x.png", *words)


def test_what_is_said_of_another_volume_is_read():
    text = "vessel-tree:size=16:channel=0,units=none,window=40/80,transfer=skin:opacity=0.1+bone"
    ((name, source, look),) = others([text])
    assert name == "vessel-tree:size=16"
    assert (source.channel, source.units) == (0, "none")
    assert look == {"window": "40/80", "transfer": "skin:opacity=0.1+bone"}
    assert others(["b.nrrd"]) == [("b.nrrd", ReadOptions(), {})]


def test_channels_have_looks_of_their_own():
    shown = scene("c.npy", channels="red,none,gray:opacity=0.5,low=0.2")
    held_ = np.load("c.npy")
    assert [volume.name for volume, _ in shown] == ["c (channel 0)", "c (channel 2)"]
    for (volume, _), channel in zip(shown, (0, 2), strict=True):
        assert np.array_equal(volume.values, held_[channel])
    tables = [field.table.table[0] for field in Subject.of_several(shown).voxels]
    np.testing.assert_allclose(tables[0][:, :3], [[1, 0, 0]] * len(tables[0]), atol=1e-6)
    assert np.ptp(tables[1][:, :3], axis=1).max() < 1e-6
    of_color = scene("rgb.npy", channels="red,lime,blue")
    assert [volume.name for volume, _ in of_color] == [f"rgb (channel {n})" for n in range(3)]
    assert ended("render", "rgb.npy", "--channels", "red,lime,blue", "-o", "c.png", *SMALL) == 0
    seen = read_image("c.png").reshape(-1, 3)
    assert (seen.max(axis=0) > 0.5).all()


def test_colors_are_rendered_and_channels_of_them_are_values(capsys):
    assert ended("render", "rgb.npy", "-o", "a.png", *SMALL) == 0
    assert (read_image("a.png").reshape(-1, 3).max(axis=0) > 0.15).all()
    capsys.readouterr()
    assert ended("info", "rgb.npy", "--channel", "1", "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["range"] == [0, int(np.load("rgb.npy")[..., 1].max())]
    said = refused(capsys, "render", "rgb.npy", "-o", "x.png", "--color-bar")
    assert "a color bar is of values, but rgb has colors" in said
    assert "a comparison is of values" in refused(capsys, "compare", "rgb.npy")


def test_looks_of_channels_are_said_once_and_not_all_hidden(capsys):
    for words, complaint in (
        (("--channels", "red,lime,blue", "--channel", "1"), "give one of both"),
        (("--channels", "red,lime,blue", "--transfer", "gray"), "leave transfer out"),
        (("--channels", "none,none,none"), "all channels are hidden"),
        (("--channels", "red,lime"), "c has 3 channels, channels gives 2 looks"),
    ):
        assert complaint in refused(capsys, "render", "c.npy", "-o", "x.png", *words)


def test_the_first_of_several_times_is_shown_and_said(capsys):
    for words in (("render", "c.npy", "-o", "x.png", *SMALL), ("info", "c.npy", "--json")):
        assert ended(*words) == 0
        found = capsys.readouterr()
        assert "c has 3 times, 0 to 2; the first is shown (--time)" in found.err
    facts = json.loads(found.out)
    assert (facts["name"], facts["times"], facts["channels"]) == ("c (time 0)", 3, 1)


def test_one_of_several_times_is_chosen(capsys):
    assert ended("info", "c.npy", "--time", "-1", "--json", "--spacing", "1x1x2") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["name"] == "c (time -1)"
    assert facts["spacing"] == [1, 1, 2]
    assert held(ReadOptions(spacing="1x1x2"), "c.npy").spacing.tolist() == [1, 1, 2]


@pytest.mark.sweep
def test_the_note_of_a_reader_is_said(capsys):
    x = np.arange(8.0)
    values = np.random.default_rng(3).random((8, 8, 8)).astype(np.float32)
    np.savez("g.npz", x=x, y=x, z=x**1.5, values=values)
    assert ended("render", "g.npz", "-o", "g.png", *SMALL) == 0
    assert "uneven distances (z 1 to " in capsys.readouterr().err
    assert ended("info", "g.npz") == 0
    assert "uneven distances (z 1 to " in capsys.readouterr().out


IN_CHUNKS = ("--size", "64", "--fit", "volume", "--camera", "30/10/1.3")


def in_chunks(name, *counts):
    """Writes noise as a file and as a store."""
    shape = *counts, 90, 60, 64
    np.save(f"{name}.npy", np.random.default_rng(5).integers(0, 200, shape).astype(np.uint8))
    assert ended("convert", f"{name}.npy", f"{name}.zarr", "--chunk", "16") == 0


@pytest.mark.sweep
def test_channels_in_chunks_have_the_same_bits():
    in_chunks("a", 1, 2)
    channels = [*IN_CHUNKS, "--channels", "red,120..190"]
    few = ["--memory", "52MB", "--threads", "1"]
    assert ended("render", "a.npy", *channels, "-o", "a.exr") == 0
    assert ended("render", "a.zarr", *channels, *few, "-o", "b.exr") == 0
    assert np.array_equal(read_image("a.exr"), read_image("b.exr"))


@pytest.mark.sweep
def test_others_in_chunks_are_painted_by_workers(capsys):
    in_chunks("b")
    beside = [*IN_CHUNKS, "--transfer", "80..190", "--no-shading", "--also"]
    assert ended("render", "b.npy", *beside, "b.npy:transfer=0..70", "-o", "a.exr") == 0
    few = ["--memory", "80MB", "--workers", "1"]
    beside = [*beside, "b.zarr:transfer=0..70", *few]
    assert ended("render", "b.zarr", *beside, "-o", "b.exr") == 0
    assert np.array_equal(read_image("a.exr"), read_image("b.exr"))
    words = ["b.zarr", *IN_CHUNKS, "--transfer", "80..190", "--also", "b.npy", *few, "-o", "c.exr"]
    assert ended("render", *words) == 2
    assert "b is in memory as a whole" in capsys.readouterr().err
