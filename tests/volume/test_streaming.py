"""Volumes that stay in their file: brick by brick they give the bits that arrays give."""

import numpy as np
import pytest

from resample.memory import available_memory, bytes_of, physical_memory
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.classification.transfer import from_points
from resample_volume.classification.value_statistics import survey, without_padding
from resample_volume.data.values import Bricks, as_array
from resample_volume.files.source import generate, read_labels
from resample_volume.rendering import Subject
from resample_volume.scenes import Scene
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light
from tests.volume.of_voxels import of_voxels

SIZE = (40, 36)
SIDES = [(8, 8, 8), (16, 24, 8), (64, 64, 64), (5, 7, 9)]
SOLID = from_points([(80, (1, 0, 0), 0.0), (120, (1, 1, 0), 0.6), (200, (1, 1, 1), 0.9)])


class Counting:
    """Reads boxes of an array, and remembers which."""

    def __init__(self, values):
        self.values, self.boxes = values, []

    def __call__(self, box):
        self.boxes.append(tuple((part.start, part.stop) for part in box))
        return np.ascontiguousarray(self.values[box])


def in_bricks(volume, side, memory=None):
    values = volume.values
    bricks = Bricks(Counting(values), values.shape, values.dtype, side, memory=memory)
    return volume._replace(values=bricks)


@pytest.fixture
def volume(rng):
    """Blobs whose surfaces bend, with noise, in a space that leans."""
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in (37, 42, 51)), indexing="ij")
    blob = 150 * np.exp(-4 * ((x - 0.3) ** 2 + y**2 + z**2)) + 9 * rng.normal(size=x.shape)
    lean = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    values = blob.clip(0, 255).astype(np.uint8)
    return Volume(values, np.array([1.0, 0.7, 1.3]), np.array([5.0, 0, -9]), lean, "blobs")


def same_frames(found, given):
    for name in ("rgba", "depth", "first_depth", "coverage"):
        assert np.array_equal(getattr(found, name), getattr(given, name)), name


@pytest.mark.sweep
@pytest.mark.parametrize("side", SIDES)
def test_pictures_are_the_same_for_any_size_of_bricks(side, volume):
    look = of_voxels()
    same_frames(render(in_bricks(volume, side), look, size=SIZE), render(volume, look, size=SIZE))


@pytest.mark.sweep
@pytest.mark.parametrize(
    "look",
    [
        of_voxels("80..160", gradient="sobel"),
        of_voxels(SOLID, light=None),
        of_voxels("auto:gradient=0.1/0.5"),
        of_voxels(SOLID, gradient_opacity=(0.1, 0.4), crop="3:40,:,5:"),
        of_voxels("gray", clip=("1/0/-1",), light=Light((1, -1, 2), shadows=True)),
        of_voxels("surfaces"),
    ],
    ids=["sobel", "unlit", "faded", "cropped", "shadows", "surfaces"],
)
def test_every_look_is_the_same_in_bricks(look, volume):
    same_frames(
        render(in_bricks(volume, (16, 8, 24)), look, size=SIZE), render(volume, look, size=SIZE)
    )


@pytest.mark.sweep
def test_labels_hold_in_bricks(volume, tmp_path):
    np.save(tmp_path / "a.npy", (volume.values > 130).astype(np.uint8))
    labels = read_labels(str(tmp_path / "a.npy"), ("1:color=tomato",), volume)
    look = of_voxels(SOLID, labels=labels)
    same_frames(
        render(in_bricks(volume, (8, 8, 8)), look, size=SIZE), render(volume, look, size=SIZE)
    )


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["int16", "float32"])
def test_padding_is_left_out_of_bricks_too(kind, volume):
    values = volume.values.astype(kind) - 20
    values[:, :4] = -3000
    if kind == "float32":
        values[3, 3, 3] = np.inf
    whole = volume._replace(values=values)
    streamed = in_bricks(whole, (8, 16, 8))
    known = survey(streamed)
    assert known.padding == (-3000,)
    found = as_array(without_padding(streamed, known)).values
    given = without_padding(whole, survey(whole)).values
    assert np.array_equal(found, given, equal_nan=kind == "float32")
    look = of_voxels()
    same_frames(render(streamed, look, size=SIZE), render(whole, look, size=SIZE))


# What is read


# Memory


def test_what_needs_the_whole_volume_is_refused_where_that_does_not_fit(volume):
    streamed = in_bricks(volume, (8, 8, 8), memory=10_000)
    for need in (
        lambda: Scene(streamed),
        lambda: render(streamed, Appearance(classification="post")),
    ):
        with pytest.raises(ValueError, match="blobs is needed as a whole for this"):
            need()


@pytest.mark.sweep
def test_fields_of_bricks_are_those_of_arrays(volume):
    look = Appearance("80..160", classification="post")
    same_frames(
        render(in_bricks(volume, (8,) * 3), look, size=SIZE), render(volume, look, size=SIZE)
    )


def test_several_volumes_may_be_in_bricks():
    box = generate("checker-box:size=16")
    media = [(box, "auto"), (box._replace(origin=np.array([9.0, 0, 0])), "gray")]
    streamed = [(in_bricks(volume, (8,) * 3), look) for volume, look in media]
    same_frames(render(streamed, size=SIZE), render(media, size=SIZE))


def test_an_error_while_bricks_are_read_ends_it(volume):
    streamed = in_bricks(volume, (8, 8, 8))
    assert survey(streamed).greatest > 100

    def broken(_):
        raise ValueError("blobs is not zarr, or damaged")

    streamed.values.read = broken
    with pytest.raises(ValueError, match="blobs is not zarr, or damaged"):
        Subject.of(streamed, of_voxels(SOLID))


@pytest.mark.parametrize(
    ("text", "count"),
    [("2GiB", 2 << 30), ("500MB", 500_000_000), ("1.5k", 1500), ("1tib", 1 << 40)],
)
def test_amounts_of_memory_are_read(text, count):
    assert bytes_of(text) == count


@pytest.mark.parametrize("text", ["", "2", "GiB", "-2GiB", "0G", "2GiBs"])
def test_what_is_no_amount_of_memory_is_refused(text):
    with pytest.raises(ValueError, match="is not an amount of memory; give one such as 2GiB"):
        bytes_of(text)


def test_free_memory_is_part_of_all():
    assert 0 < available_memory() <= physical_memory()
