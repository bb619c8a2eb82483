"""Lengths have units: in pictures, scale bars, scenes, X-rays and written files."""

import json
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from resample.files.images import read_image
from resample_volume import annotations, as_volume, render
from resample_volume.appearance import Appearance
from resample_volume.classification.value_statistics import label_count
from resample_volume.cli import app
from resample_volume.data.recordings import unit_of_space
from resample_volume.files.source import generate, open_recording, open_volume, write_volume
from resample_volume.rendering import placement
from tests.commands import ended, refused
from tests.metadata import volumes
from tests.metadata.volumes import SPACING, directions, nrrd, ome_tiff, ome_zarr

SMALL = ("--size", "64x48")
BLOB = (
    np.hypot(*np.meshgrid(np.arange(7) - 3.0, np.arange(6) - 2.0))[None]
    + np.arange(5)[:, None, None]
)
VALUES = (9000 - 900 * BLOB).astype(np.int16)
COUNTS = VALUES.astype(np.uint16)
CHANNELS = np.stack([COUNTS, COUNTS[::-1]], axis=1)  # z, c, y, x
OMERO = {
    "channels": [
        {"label": "DAPI", "color": "0000FF", "window": {"start": 4000, "end": 9000}},
        {"label": "GFP", "color": "00FF00", "window": {"start": 4000, "end": 9000}},
    ]
}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(volumes, "VALUES", VALUES)
    return tmp_path


def picture(name, *words):
    """The bytes of a rendered picture."""
    assert ended(app, "render", name, "-o", "out.png", *SMALL, *words) == 0
    return sha256(Path("out.png").read_bytes()).hexdigest()


def pixels(name, *words):
    """The pixels of a rendered picture, whose file has the options in it."""
    picture(name, *words)
    return read_image("out.png")


def microns(here):
    """The same voxels in each format, in folders of their own."""
    step = np.diag(SPACING)
    units = "space: LPS\nspace units: {0} {0} {0}\n"
    nanometers = {f"PhysicalSize{axis}": 1000 * SPACING[n] for n, axis in enumerate("XYZ")}
    nanometers |= {f"PhysicalSize{axis}Unit": "nm" for axis in "XYZ"}
    made = {
        "OME-TIFF": lambda at: ome_tiff(at, COUNTS),
        "OME-TIFF in nm": lambda at: ome_tiff(at, COUNTS, **nanometers),
        "ImageJ": lambda at: volumes.imagej(at, COUNTS),
        "OME-Zarr": lambda at: ome_zarr(at, COUNTS),
        "OME-Zarr in nm": lambda at: ome_zarr(
            at, COUNTS, scale=1000 * SPACING[::-1], units=("nanometer",) * 3
        ),
        "NRRD": lambda at: nrrd(at, directions(step) + units.format('"um"'), VALUES.tobytes()),
        "NIfTI": lambda at: volumes.nifti(
            at, s=1, rows=np.column_stack([volumes.LPS * SPACING, np.zeros(3)]), units=3
        ),
    }
    for name, write in made.items():
        (here / name).mkdir()
        yield name, write(here / name)


def test_the_same_voxels_give_the_same_picture_from_every_format(here):
    found = {name: picture(path, "--scale-bar", "--cube") for name, path in microns(here)}
    cubes = {"NIfTI"}  # of a patient, whose sides have other names
    assert len({found[name] for name in found.keys() - cubes}) == 1, found
    bare = {name: picture(path, "--scale-bar") for name, path in list_again(here)}
    assert len(set(bare.values())) == 1, bare


def list_again(here):
    """The files that `microns` has written."""
    return [(at.name, next(at.iterdir())) for at in sorted(here.iterdir()) if at.is_dir()]


@pytest.mark.parametrize(("unit", "words"), [("µm", "5 µm"), ("mm", "5 mm"), ("Å", "5 Å")])
def test_a_scale_bar_has_the_unit_of_the_file(unit, words, monkeypatch):
    said = []
    letters = annotations.letters
    monkeypatch.setattr(
        annotations, "letters", lambda text, size: said.append(text) or letters(text, size)
    )
    volume = as_volume(VALUES)._replace(spacing=SPACING, length=unit)
    frame = render(volume, "4000..9000", (30, 20), size=(64, 48))
    shown = annotations.Annotations(axes=False, box=False, cube=False)
    annotations.annotate(frame, (30, 20), volume, shown)
    assert said == [words]


def test_volumes_of_different_units_share_a_scene():
    one = as_volume(VALUES)._replace(spacing=SPACING, origin=np.ones(3), length="mm")
    other = one._replace(spacing=1000 * SPACING, origin=1000 * np.ones(3), length="µm")
    (first, _), (second, _) = placement([(one, Appearance()), (other, Appearance())])[0]
    np.testing.assert_allclose(second.spacing, first.spacing)
    np.testing.assert_allclose(second.origin, first.origin)
    assert unit_of_space(second) == "mm"


def test_an_x_ray_attenuates_per_millimeter(here):
    volume = as_volume(VALUES)._replace(spacing=SPACING, units="hu", length="mm")
    write_volume(here / "mm.nrrd", volume)
    write_volume(here / "um.nrrd", volume._replace(spacing=1000 * SPACING, length="µm", units="hu"))
    words = ("--projection", "xray", "--units", "hu")
    assert picture("mm.nrrd", *words) == picture("um.nrrd", *words)
    more = pixels("mm.nrrd", *words, "--mu-water", "0.05", "--window", "0..5")
    assert not np.array_equal(more, pixels("mm.nrrd", *words, "--window", "0..5"))


def test_units_are_written_and_read_back(here):
    for unit in ("mm", "µm", "Å"):
        volume = as_volume(VALUES)._replace(spacing=SPACING, length=unit)
        for suffix in (".nrrd", ".mha", ".nii"):
            write_volume(here / f"a{suffix}", volume)
            found = open_volume(here / f"a{suffix}")
            length = found.spacing * {"mm": 1, "µm": 1e-3}.get(unit_of_space(found), 1e-7)
            np.testing.assert_allclose(
                length, SPACING * {"mm": 1, "µm": 1e-3, "Å": 1e-7}[unit], rtol=1e-6
            )


def test_a_converted_volume_keeps_its_unit_and_looks(here):
    path = ome_zarr(here, np.moveaxis(CHANNELS, 1, 0), axes="czyx", scale=(1, 2, 1, 1), omero=OMERO)
    assert ended(app, "convert", path, "b.ome.zarr") == 0
    before, after = open_recording(path), open_recording(here / "b.ome.zarr")
    assert (after.length, after.looks) == (before.length, before.looks)
    assert after.looks[0] == ("DAPI", "#0000ff", (4000, 9000), True)


# Channels


def colored(here, **changed):
    """An OME-Zarr of two channels with looks."""
    told = {"channels": [one | changed for one in OMERO["channels"]]}
    scale = (1, *SPACING[::-1])
    return ome_zarr(here, np.moveaxis(CHANNELS, 1, 0), axes="czyx", scale=scale, omero=told)


def test_channels_have_the_looks_of_their_file(here, capsys):
    shown = pixels(colored(here))
    assert "channels are shown as their file says: DAPI #0000ff, GFP" in capsys.readouterr().err
    chosen = ("--channels", "#0000ff,#00ff00")
    assert np.array_equal(shown, pixels("a.ome.zarr", *chosen, "--window", "4000..9000"))
    assert not np.array_equal(shown, pixels("a.ome.zarr", *chosen))


def test_an_inactive_channel_is_hidden(here):
    path = colored(here, active=False)
    told = json.loads((path / ".zattrs").read_text())
    told["omero"]["channels"][0]["active"] = True
    (path / ".zattrs").write_text(json.dumps(told))
    chosen = ("--channels", "#0000ff,none", "--window", "4000..9000")
    assert np.array_equal(pixels(path), pixels(path, *chosen))


def test_colors_of_ome_tiff_are_looks(here):
    color = {"Name": ["DAPI", "GFP"], "Color": [0x0000FFFF, 0x00FF00FF]}
    path = ome_tiff(here, CHANNELS, "ZCYX", Channel=color)
    assert open_recording(path).looks[1][:2] == ("GFP", "#00ff00")
    assert np.array_equal(pixels(path), pixels(path, "--channels", "#0000ff,#00ff00"))


def test_channels_without_looks_are_chosen(here, capsys):
    path = ome_tiff(here, CHANNELS, "ZCYX")
    assert "choose one by channel, 0 to 1" in refused(app, capsys, "render", path, "-o", "a.png")
    assert ended(app, "info", path, "--json") == 0
    out, error = capsys.readouterr()
    assert json.loads(out)["channels"] == 2
    assert "the first of several channels is shown (--channel)" in error


def test_names_of_channels_without_colors_are_kept(here, capsys):
    path = ome_tiff(here, CHANNELS, "ZCYX", Channel={"Name": ["DAPI", "GFP"]})
    assert [look.label for look in open_recording(path).looks] == ["DAPI", "GFP"]
    assert "choose one by channel, 0 to 1" in refused(app, capsys, "render", path, "-o", "a.png")
    assert ended(app, "info", path) == 0
    assert "DAPI" in capsys.readouterr().out


# What is assumed


def test_what_is_assumed_is_said_once(capsys):
    np.save("a.npy", VALUES)
    np.save("b.npy", VALUES)
    line = "resample: no spacing is stated; voxels of 1 x 1 x 1 are assumed (--spacing sets it)\n"
    picture("a.npy", "--also", "b.npy")
    assert capsys.readouterr().err.count(line) == 1
    assert ended(app, "animate", "a.npy", "-o", "a.gif", "--frames", "2", "--size", "16") == 0
    assert capsys.readouterr().err.count(line) == 1
    picture("a.npy", "--spacing", "1x1x2um", "--also", "b.npy:spacing=1x1x2um")
    assert "spacing" not in capsys.readouterr().err
    assert ended(app, "info", "a.npy") == 0
    assert line.removeprefix("resample: ") in capsys.readouterr().out
    assert ended(app, "info", "a.npy", "--spacing", "1x1x2um") == 0
    assert "[1.0, 1.0, 2.0] µm" in capsys.readouterr().out


def test_a_generated_volume_assumes_nothing(capsys):
    picture("checker-box:size=8,block=4")
    assert "assumed" not in capsys.readouterr().err


def test_an_unknown_unit_of_spacing_is_refused(capsys):
    np.save("a.npy", VALUES)
    error = refused(app, capsys, "info", "a.npy", "--spacing", "1x1x2ell")
    assert "'ell' is not a unit of length; give km, m, dm, cm, mm, µm, nm" in error


# Labels


def regions(*labels):
    """Cells of labels around random points."""
    rng = np.random.default_rng(7)
    seeds = rng.random((len(labels), 3)) * 24
    places = np.stack(np.mgrid[:24, :24, :24], axis=-1)[..., np.newaxis, :]
    return np.array(labels)[((places - seeds) ** 2).sum(axis=-1).argmin(axis=-1)]


@pytest.mark.parametrize("labels", [(0, 1, 7), tuple(range(40)), (0, 2, 3, 41, 42, 1017)])
@pytest.mark.parametrize("kind", ["uint8", "int16", "float32"])
def test_few_whole_numbers_in_regions_are_labels(labels, kind):
    values = regions(*labels).astype(kind)
    assert label_count(as_volume(values)) == len(np.unique(values))


def test_scans_and_masks_are_no_labels(rng):
    ball = 4000 - 30 * ((np.indices((24, 24, 24)) - 11.5) ** 2).sum(axis=0)
    noisy = ball + 100 * rng.standard_normal(ball.shape)
    bytes_ = np.interp(noisy, (noisy.min(), noisy.max()), (0, 255))
    assert label_count(as_volume(np.rint(bytes_).astype(np.uint8))) == 0
    assert label_count(as_volume(np.rint(bytes_ / 17).astype(np.uint8))) == 0  # 16 levels
    assert label_count(as_volume((ball > 0).astype(np.uint8))) == 0
    assert label_count(as_volume(ball.astype(np.float32) / 3)) == 0
    for name in ("checker-box", "vessel-tree:size=48", "marschner-lobb"):
        assert label_count(generate(name)) == 0


def test_labels_drawn_as_amounts_are_said(capsys):
    np.save("a.npy", regions(0, 1, 7).astype(np.uint8))
    picture("a.npy")
    line = "3 whole numbers in regions, as labels, are drawn as amounts (--labels FILE"
    assert line in capsys.readouterr().err
    picture("a.npy", "--labels", "a.npy", "--label", "7:color=red")
    assert "whole numbers" not in capsys.readouterr().err
    assert ended(app, "info", "a.npy") == 0
    assert "3 whole numbers in regions: are they labels? (--labels)" in capsys.readouterr().out
