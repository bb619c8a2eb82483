"""`resample-points info`."""

import json
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from resample_points import Gaussians, cli, write_gaussians
from resample_points.command import rendering
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


@pytest.mark.parametrize(
    ("origin", "single", "told"),
    [
        ((100.0, 0, 0), False, None),
        ((0, -101.0, 0), False, "a.ply is centered near 0, -101, 0; positions are exact, poses"),
        ((0, 0, 1e7), True, "0, 0, 10000000; its float32 positions are rounded to 1 there"),
    ],
)
def test_a_cloud_far_from_0_is_told_with_what_its_numbers_are_worth(
    monkeypatch, origin, single, told
):
    said = []
    monkeypatch.setattr(rendering, "say", said.append)
    surfels = SimpleNamespace(position=np.eye(3), origin=np.array(origin, np.float64))
    if single:
        rendering.mention_origin("a.ply", surfels, is_single=True)
    else:
        rendering.mention_origin("a.ply", surfels)
    assert [told in line for line in said] == ([] if told is None else [True])
