"""The paper's Figure 6: what its files are, and what it measures."""

from dataclasses import dataclass

import numpy as np
import pytest

from resample import registry
from resample.files.images import read_image
from resample_figures import figure_6 as paper
from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DepthImage, Rendered

SIZE = 32
SHAPE = (SIZE, SIZE)


@dataclass(frozen=True)
class Fixed:
    """The source's colors wherever they were, with a given coverage."""

    coverage: float

    def __call__(self, source, equation, shape):  # noqa: ARG002 - a method's role
        full = np.full(shape, self.coverage, np.float32)
        image = np.asarray(source.color * self.coverage, np.float32)
        return Rendered(image, full, full, full, np.zeros(shape, np.bool_))


METHODS = {"copy": Fixed(1.0), "nothing": Fixed(0.0)}


@pytest.fixture(autouse=True)
def simple_methods(monkeypatch):
    monkeypatch.setattr(registry, "build", lambda _, name: METHODS[name])


@pytest.fixture
def source(rng):
    color = rng.random((*SHAPE, 3)).astype(np.float32)
    nearness = np.full(SHAPE, 1.0, np.float32)
    nearness[8:20, 8:20] = 2.0
    return prepare(DepthImage(color, nearness))


@pytest.fixture
def figure(source):
    return paper.figure_of(source, of_rectified(0.0), SHAPE, ["copy", "nothing"])


@pytest.mark.sweep
def test_a_figure_is_written_with_all_its_parts(figure, tmp_path):
    numbers = paper.write_figures(tmp_path, figure)
    names = {f"{name}{part}.png" for name in ("copy", "nothing") for part in ("", "-zoom")}
    assert {path.name for path in tmp_path.iterdir()} == {
        *names,
        *("reference.png", "figure-6.png", "figure-6.json"),
    }
    assert [row["hole %"] for row in numbers["methods"]] == [0.0, 100.0]


@pytest.mark.sweep
def test_pictures_of_a_figure_are_1_to_1(figure, tmp_path):
    paper.write_figures(tmp_path, figure)
    assert read_image(tmp_path / "copy.png").shape == (*SHAPE, 3)


def test_the_figure_of_the_generated_scene_has_a_truth(record):
    figure = paper.generated_figure(SIZE, "roll", ["copy", "nothing"])
    assert list(figure.pictures) == ["truth", "copy", "nothing"]
    record.quality("copy", figure.rows[0]["psnr"])
    assert list(figure.notes) == ["copy", "nothing"]


def test_a_figure_of_nothing_is_refused(source):
    with pytest.raises(ValueError, match="shows nothing of the depth image"):
        paper.figure_of(source, of_rectified(1000.0), SHAPE, ["copy"])
