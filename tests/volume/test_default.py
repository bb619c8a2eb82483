"""What paints a volume if nothing is said of it: rays, or voxels where these cannot be."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from resample.cameras.viewpoints import Orbit
from resample.files.images import read_image
from resample.painting.rays import spacing_of
from resample.resampler import Resampler
from resample_volume import Appearance, as_volume, render
from resample_volume.appearance import BY_DEFAULT
from resample_volume.classification.labels import Labels, Rule
from resample_volume.cli import app
from resample_volume.files.generated import vessel_tree
from resample_volume.rendering import Subject
from resample_volume.voxels.visible import lattice_of
from tests import commands
from tests.volume.of_voxels import of_voxels
from tests.volume.test_streaming import in_bricks

ended = partial(commands.ended, app)
TREE, SIZE = vessel_tree(16), (32, 24)
COLORED = as_volume(np.random.default_rng(3).integers(0, 255, (8, 8, 8, 3), np.uint8))
LABELS = Labels(np.zeros(TREE.values.shape, np.uint8), {0: Rule(opacity=0.5)})


@pytest.mark.parametrize(
    ("volume", "look"),
    [(TREE, Appearance()), (COLORED, Appearance()), (TREE, Appearance(labels=LABELS))],
    ids=["values", "colors", "labels"],
)
def test_a_volume_is_a_field_along_rays(volume, look):
    found = render(volume, look, size=SIZE)
    assert found.statistics.rays > 0
    same = render(volume, look, size=SIZE, resampler=BY_DEFAULT)
    assert np.array_equal(found.rgba, same.rgba)


@pytest.mark.parametrize(
    ("volume", "look"),
    [
        (TREE, Appearance(gradient="sobel")),
        (TREE._replace(values=TREE.values * 1e40), Appearance("gray")),
    ],
    ids=["gradients of voxels", "huge"],
)
def test_voxels_are_painted_where_rays_cannot_be(volume, look):
    found = render(volume, look, size=SIZE)
    assert found.statistics.rays == 0
    voxels = render(volume, replace(look, classification="pre"), size=SIZE)
    assert np.array_equal(found.rgba, voxels.rgba)
    assert found.rgba.any()


def test_several_volumes_are_fields():
    media = [(TREE, Appearance("vessels")), (TREE, Appearance("200..255"))]
    post = [(volume, replace(look, classification="post")) for volume, look in media]
    found = render(post, size=SIZE, resampler=BY_DEFAULT)
    assert np.array_equal(render(media, size=SIZE).rgba, found.rgba)


def test_a_renderer_of_samples_paints_voxels():
    found = render(TREE, size=SIZE, resampler=Resampler())
    assert np.array_equal(found.rgba, render(TREE, of_voxels(), size=SIZE).rgba)


def test_a_store_has_the_bits_of_an_array():
    found = render(in_bricks(TREE, (8, 8, 8)), size=SIZE)
    assert np.array_equal(found.rgba, render(TREE, size=SIZE).rgba)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("words", "classified"),
    [
        ([], "post"),
        (["--subpixels", 2], "post"),
        (["--filter", "gaussian:sigma=0.6"], "post"),
        (["--method", "points"], "pre"),
        (["--method", "hybrid"], "pre"),
        (["--kernel", "gaussian:sigma=0.7"], "pre"),
        (["--order", "every-sample"], "pre"),
        (["--order", "rays:step=0.5"], "post"),
        (["--gradient", "sobel"], "pre"),
    ],
)
def test_statistics_say_what_was_painted(words, classified, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ("--size", 16, *words, "--stats", "s.json", "-o", "out.exr")
    assert ended("render", "vessel-tree:size=16", *words) == 0
    stats = json.loads(Path("s.json").read_text())
    assert (stats["classify"], stats["rays"] > 0) == (classified, classified == "post")
    assert read_image("out.exr").any()


@pytest.mark.sweep
@pytest.mark.parametrize(
    "spacing", [0.9, 0.7 / 2, 0.7 / 3]
)  # px per voxel, where a ray more is cast
def test_the_number_of_rays_changes_without_a_seam(spacing, record):
    look = Appearance("vessels")
    subject = Subject.of(TREE, look)
    once = subject.camera(Orbit(30, 20, fov=0), 64, 64).view()
    usual = spacing_of(lattice_of(TREE), np.zeros(3), once)
    frames = [
        render(TREE, look, Orbit(30, 20, share * spacing / usual, fov=0), size=(64, 64))
        for share in (1.0001, 0.9999)
    ]
    more, fewer = (frame.statistics.subpixels for frame in frames)
    error = np.mean((frames[0].rgba - frames[1].rgba).astype(np.float64) ** 2)
    assert fewer != more
    record.quality("picture", -10 * np.log10(error))
