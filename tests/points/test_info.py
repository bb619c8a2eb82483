"""`resample-points info`."""

import json
from functools import partial

import numpy as np

from resample_points import Gaussians, cli, write_gaussians
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


def test_a_cloud_s_columns_and_bounds_are_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    np.savez("cloud.npz", position=np.eye(3), intensity=np.array([3.0, np.nan, 1.0]))
    assert ended("info", "cloud.npz", "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["kind"] == "points"
    assert facts["count"] == 3
    assert facts["bounds"] == [[0, 0, 0], [1, 1, 1]]
    assert facts["columns"]["intensity"] == [1, 3]
    assert not facts["normals"]


def test_gaussians_say_their_degree_and_sizes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    parts = (np.float32(rng.uniform(0.1, 1, (5, n))) for n in (3, 3, 4))
    some = Gaussians(*parts, np.full(5, 0.5, np.float32), np.zeros((5, 3), np.float32))
    write_gaussians("scene.ply", some._replace(harmonics=np.ones((5, 8, 3), np.int16)))
    assert ended("info", "scene.ply") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split(maxsplit=1) == ["kind", '"3D Gaussians"']
    assert "degree            2" in lines
    assert "opacity           [0.5, 0.5, 0.5]" in lines


def test_a_file_of_something_else_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "words.txt").write_text("no numbers here")
    assert refused(capsys, "info", "words.txt").count("\n") == 1
