"""Films of clouds whose frames several processes make."""

import os

import numpy as np
import pytest

from resample_points.cli import app
from tests.elsewhere import assert_killed_costs_own_frames, assert_same_film, pickle_for_workers

FILM = ["animate", "ball.npz", "--frames", "3", "--size", "40", "--up", "y"]


@pytest.fixture(autouse=True)
def in_folder(tmp_path, monkeypatch):
    """The working folder, with a ball of points."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    normal = rng.normal(size=(800, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    np.savez("ball.npz", position=normal, normal=normal, color=np.abs(normal))


@pytest.mark.sweep
def test_frames_of_clouds_are_the_same_elsewhere(monkeypatch):
    pickle_for_workers(monkeypatch)
    assert_same_film(app, FILM)


@pytest.mark.sweep
def test_processes_make_the_same_films():
    assert_same_film(app, FILM)
    assert sorted(os.listdir()) == ["ball.npz", "one", "two"]


@pytest.mark.sweep
def test_a_killed_worker_costs_a_film_its_own_frames_alone(tmp_path, monkeypatch):
    assert_killed_costs_own_frames(app, FILM, tmp_path, monkeypatch, is_late=False)
