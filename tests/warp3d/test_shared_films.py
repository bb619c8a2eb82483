"""Films whose frames several processes make."""

import os
from pathlib import Path

import pytest

from resample_warp3d.cli import app
from tests.commands import ended, refused
from tests.elsewhere import (
    assert_killed_costs_own_frames,
    assert_same_film,
    frames,
    pickle_for_workers,
)

ROOM = ["animate", "sample:room", "--frames", "3", "--size", "40x30"]


@pytest.fixture(autouse=True)
def in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.sweep
def test_frames_of_depth_images_are_the_same_elsewhere(monkeypatch):
    pickle_for_workers(monkeypatch)
    assert_same_film(app, ROOM)
    (Path("two") / "frame-0001.png").unlink()
    assert ended(app, *ROOM, "-o", "two", "--workers", "1", "--resume") == 0
    assert frames("one") == frames("two")


def test_what_workers_cannot_do_is_refused_in_a_line(capsys):
    error = refused(app, capsys, *ROOM, "-o", "a", "--workers", "2", "--depth-output", "depth")
    assert "depth of frames can only be written by one process; leave workers out" in error
    error = refused(app, capsys, *ROOM, "-o", "a", "--workers", "2", "--scheduler", "tcp://a:1")
    assert "give only one" in error


@pytest.mark.sweep
def test_processes_make_the_same_films():
    assert_same_film(app, ROOM)
    assert sorted(os.listdir()) == ["one", "two"]


@pytest.mark.sweep
def test_a_killed_worker_costs_a_film_its_own_frames_alone(tmp_path, monkeypatch):
    assert_killed_costs_own_frames(app, ROOM, tmp_path, monkeypatch, is_late=True)
