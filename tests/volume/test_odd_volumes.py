"""Volumes that are not as one would wish: each is a picture that shows it, or one clear line."""

from functools import partial

import numpy as np
import pytest

from resample.files.images import read_image
from resample_volume import cli
from resample_volume.calls import render
from resample_volume.classification.presets import transfer_for
from resample_volume.inputs import as_volume
from tests import commands

SIDE = 32
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def away():
    """Distances (40, 40, 40) from the middle, voxels."""
    z, y, x = np.mgrid[:40, :40, :40] - 19.5
    return np.sqrt(x**2 + y**2 + z**2)


def ball(dtype=np.int16):
    """0 around 1000 around 1800, with noise."""
    values = np.clip((16 - away()) * 100, 0, 1000) + np.clip((7 - away()) * 100, 0, 800)
    return (values + np.random.default_rng(7).normal(0, 20, values.shape)).astype(dtype)


def changed(values, place, value):
    """Values of which some are replaced."""
    values[place] = value
    return values


def ring():
    """Where a scanner's circle does not reach."""
    y, x = np.mgrid[:40, :40] - 19.5
    return np.broadcast_to(np.hypot(x, y) > 19.5, (40, 40, 40))


def flesh():
    """Bone in flesh in air, Hounsfield units."""
    values = np.where(away() < 16, 40, -1000) + np.where(away() < 8, 900, 0)
    return values + np.random.default_rng(7).normal(0, 12, values.shape)


ODD = {
    "outlier": lambda: changed(ball(), (3, 4, 5), 30000),
    "outliers": lambda: changed(ball(), ([3, 30, 9], [4, 2, 9], [5, 35, 2]), [30000, 9000, -9000]),
    "padding slice": lambda: changed(ball(), 0, -32768),
    "padding ring": lambda: changed(ball(), ring(), -32768),
    "padding above": lambda: changed((ball() + 1000).astype(np.uint16), ring(), 65535),
    "padding 1e20": lambda: changed(ball(np.float32), ring(), 1e20),
    "negative": lambda: (ball() - 5000).astype(np.int16),
    "upside down": lambda: -ball(np.float32),
    "12 bits": lambda: np.clip(ball() * 2, 0, 4095).astype(np.int16),
    "tiny": lambda: ball(np.float32) * np.float32(1e-12),
    "huge": lambda: ball(np.float64) * 1e200,
    "infinite": lambda: changed(ball(np.float32), 0, np.inf),
    "strays that are seen": lambda: changed(ball(), ([1, 38], [1, 38], [1, 38]), 1500),
    "ct": lambda: flesh().astype(np.int16),
    "ct with padding": lambda: changed(flesh().astype(np.int16), ring(), -2000),
    "ct with metal": lambda: changed(flesh().astype(np.int16), np.s_[18:22, 18:22, 18:32], 9000),
    "ct as stored": lambda: np.clip(flesh() + 1024, 0, 4095).astype(np.uint16),
}
SHAPED = {
    "constant": (lambda: np.full((12, 12, 12), 7, np.int16), 0.2),
    "two values": (lambda: (away() < 15).astype(np.uint8), 0.5),
    "two negative values": (lambda: np.where(away() < 15, -5, -100).astype(np.int16), 0.5),
    "cut out": (lambda: np.where(away() < 15, 180 + ball() % 40, 0).astype(np.uint8), 0.5),
    "missing half": (lambda: changed(ball(np.float32), np.s_[:20], np.nan), 0.2),
    "two slices": (lambda: ball()[20:22], 0.05),
    "one voxel": (lambda: changed(np.zeros((9, 9, 9), np.float32), (4, 4, 4), 1.0), 0.04),
}


def shown(values, *words):
    """Luminance (32, 32) of the picture of a volume that the command line writes."""
    np.save("odd.npy", values)
    assert ended("render", "odd.npy", "-o", "odd.exr", "--size", SIDE, *words) == 0
    return read_image("odd.exr")[..., :3].mean(axis=2)


def fills_the_picture(picture):
    """Whether a ball is seen: bright in the middle, up to near the sides, not in the corners."""
    middle, corners = picture[14:18, 14:18].mean(), picture[[0, 0, -1, -1], [0, -1, 0, -1]]
    inner = picture[5:27, 15:17].min()
    return bool(middle > 0.05 and inner > 0.1 * middle and corners.max() < 0.05 * middle)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=pytest.mark.sweep
            if name in ("outliers", "padding above", "negative", "12 bits")  # much like others
            else (),
        )
        for name in ODD
    ],
)
def test_a_ball_is_seen_whatever_else_is_in_the_volume(name):
    assert fills_the_picture(shown(ODD[name]()))


@pytest.mark.some(1)
@pytest.mark.parametrize("name", ["outlier", "padding ring", "padding above", "padding 1e20"])
def test_the_library_shows_it_too(name):
    frame = render(as_volume(ODD[name]()), size=(SIDE, SIDE))
    assert fills_the_picture(frame.rgba[..., :3].mean(axis=2))


@pytest.mark.sweep
@pytest.mark.parametrize("name", SHAPED)
def test_what_there_is_covers_part_of_the_picture(name):
    values, least = SHAPED[name]
    picture = shown(values())
    bright = picture > 0.2 * picture.max()
    assert picture.max() > 0.05
    assert bright.mean() > least


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["outlier", "padding slice", "padding ring", "padding above"])
@pytest.mark.parametrize("preset", ["bone", "gray", "viridis", "surfaces"])
def test_presets_do_not_mind_strays_and_padding(name, preset, record):
    values = ODD[name]()
    clean = ball() + 1000 if name == "padding above" else ball()
    if name in ("padding ring", "padding above"):  # of clean air some is seen
        clean[ring()] = clean.min()
    picture, expected = (
        shown(each, "--transfer", preset, "--order", "rays") for each in (values, clean)
    )
    inner = np.s_[6:26, 6:26]
    record.error("mean", np.abs(picture - expected)[inner].mean())


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["outlier", "padding slice", "ct with padding"])
@pytest.mark.parametrize(
    "words",
    [
        ["--classify", "post"],
        ["--projection", "maximum"],
        ["--projection", "average"],
        ["--projection", "first-hit", "--iso"],
    ],
)
def test_all_modes_do_not_mind_them(name, words):
    iso = [300 if name != "ct with padding" else -300] if "--iso" in words else []
    picture = shown(ODD[name](), *words, *iso)
    seen = picture > 0.15 * picture[12:20, 12:20].mean()
    assert picture[12:20, 12:20].mean() > 0.05
    assert seen[8:24, 15:17].all()
    assert picture[12:20, 12:20].mean() > 2 * picture[[0, 0, -1, -1], [0, -1, 0, -1]].max()


@pytest.mark.sweep
@pytest.mark.parametrize("far", [3e4, 1e6])
@pytest.mark.parametrize(
    "words", [["--classify", "post"], ["--projection", "maximum"], ["--projection", "average"]]
)
def test_fields_look_as_they_would_without_a_stray(far, words, record):
    clean = ball(np.float32)
    expected = shown(clean, *words)
    picture = shown(changed(clean.copy(), (38, 1, 38), far), *words)
    away_from_it = np.s_[10:22, 10:22]
    off = np.abs(picture - expected)[away_from_it].max()
    record.error("beside", off)


@pytest.mark.sweep
def test_what_is_found_is_said(capsys):
    values = changed(flesh().astype(np.int16), ring(), -2000)
    values[18:22, 18:22, 18:32] = 9000
    shown(values)
    lines = [line.removeprefix("resample: ") for line in capsys.readouterr().err.splitlines()]
    assert lines == [
        f"{ring().sum()} voxels of -2000 are taken for padding and left out",
        "values look like Hounsfield units, so they are assumed to be; if not, --units none",
        "224 voxels above 2500 HU are metal",
        "no spacing is stated; voxels of 1 x 1 x 1 are assumed (--spacing sets it)",
    ]


@pytest.mark.sweep
def test_a_stray_is_said(capsys):
    shown(ODD["outlier"]())
    line = capsys.readouterr().err.splitlines()[0]
    assert line.startswith("resample: 1 voxel is far beyond -")
    assert line.endswith(", which looks are spread over")


@pytest.mark.sweep
def test_nothing_but_missing_values_is_one_line(capsys):
    assert shown(np.full((5, 5, 5), np.nan, np.float32)).max() == 0
    assert capsys.readouterr().err.startswith("resample: nothing to see")


def test_a_single_slice_is_one_line(capsys):
    np.save("thin.npy", np.zeros((1, 9, 9), np.uint8))
    assert "thin is a single slice" in refused(capsys, "render", "thin.npy", "-o", "a.png")


@pytest.mark.sweep
def test_a_mean_is_not_black():
    values = changed(np.zeros((40, 40, 40), np.float32), away() < 6, 255)
    picture = shown(values, "--projection", "average")
    assert picture[14:18, 14:18].mean() > 0.5
    assert picture[0, 0] < 0.01


@pytest.mark.sweep
@pytest.mark.parametrize("tissue", ["lung", "skin", "ct"])
def test_tissues_are_for_hounsfield_units(tissue, capsys):
    np.save("a.npy", ball())
    line = refused(capsys, "render", "a.npy", "-o", "a.png", "--transfer", tissue)
    assert f"{tissue} is a look for Hounsfield units, but a holds" in line
    assert "give its units, hu or hu+1024" in line
    words = ["--units", "hu", "--size", SIDE]
    assert ended("render", "a.npy", "-o", "a.png", "--transfer", tissue, *words) == 0


@pytest.mark.sweep
@pytest.mark.parametrize("words", [(), ("--classify", "post"), ("--projection", "average")])
def test_a_ball_in_nothing_is_seen_without_a_warning(words):
    values = np.where(away() < 15, 20 - away(), np.nan).astype(np.float32)
    assert fills_the_picture(shown(values, *words))


@pytest.mark.sweep
def test_values_between_those_that_are_looked_at_make_a_look():
    values = np.full((160, 160, 160), np.nan, np.float32)
    values[81, 81, 80:82] = 1, 2
    assert transfer_for("auto", as_volume(values)).opacities([1.0, 2.0], (1.0, 2.0)).max() == 0.8
