"""The application of the documents stands on what ours share, and on nothing else."""

import importlib.util
import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from resample import registry
from resample.files.images import read_image
from resample.progress import Cancel

FILE = Path(__file__).parents[2] / "examples" / "stations.py"
MOST_LINES = 150


@pytest.fixture(scope="module")
def stations():
    spec = importlib.util.spec_from_file_location("stations", FILE)
    module = importlib.util.module_from_spec(spec)
    sys.modules["stations"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["stations"]


@pytest.fixture
def table(tmp_path):
    x, y, time = (part.ravel() for part in np.meshgrid(range(6), range(4), range(3)))
    rows = np.stack([x, y, x + 10 * time, time], axis=1)
    path = tmp_path / "stations.csv"
    np.savetxt(path, rows, "%d", ",", header="x,y,value,time", comments="")
    return path


def called(stations, *words):
    with pytest.raises(SystemExit) as end:
        stations.app(list(map(str, words)))
    return end.value.code


def test_it_is_short():
    assert len(FILE.read_text("utf-8").splitlines()) <= MOST_LINES


def test_a_map_shows_values_from_left_to_right_as_they_grow(stations, table, tmp_path):
    out = tmp_path / "map.png"
    words = ("--camera", "0/90", "--colors", "gray", "--size", "60x60", "-o", out)
    assert called(stations, "map", table, *words) in (0, None)
    with Image.open(out) as picture:
        row = np.asarray(picture)[30].astype(int)
    shown = row[row[:, 3] > 250, 0]
    assert len(shown) > 20
    assert (np.diff(shown) >= 0).all()
    assert shown[-1] - shown[0] > 20


def test_a_film_has_a_frame_for_each_time(stations, table, tmp_path):
    out = tmp_path / "film.gif"
    assert called(stations, "film", table, "--size", "24x24", "-o", out) in (0, None)
    with Image.open(out) as film:
        assert film.n_frames == 3


def test_a_page_shows_and_saves_what_the_command_writes(stations, table, tmp_path):
    settings = {"camera": "20/35", "radius": 0.8}
    painter = stations.Stations(table)
    seen = painter.paint(settings, (40, 30), quick=False, cancel=Cancel())
    painter.save(settings, (40, 30), tmp_path / "saved.png")
    words = ("--camera", "20/35", "--radius", "0.8", "--size", "40x30", "-o", tmp_path / "map.png")
    called(stations, "map", table, *words)
    saved, written = (read_image(tmp_path / name) for name in ("saved.png", "map.png"))
    assert seen.levels.shape == (30, 40, 3)
    np.testing.assert_array_equal(saved, written)


def test_it_is_mounted_by_an_entry_point(stations, monkeypatch):
    point = EntryPoint("stations", "stations:app", "resample.apps")
    vars(point)["dist"] = SimpleNamespace(name="outside")
    monkeypatch.setattr(registry, "entry_points", EntryPoints([point]).select)
    assert registry.load("apps", "stations") is stations.app


@pytest.mark.parametrize("content", ["a,b\n1,2\n", "x,y,value,time\n"])
def test_other_files_are_refused_in_a_line(stations, tmp_path, content):
    (tmp_path / "other.csv").write_text(content)
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        stations.Stations(tmp_path / "other.csv")
