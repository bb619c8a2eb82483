"""Volumes that stay in their file: brick by brick they give the bits that arrays give."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resample.memory import available_memory, bytes_of, physical_memory
from resample_volume.classification.surveys import survey, without_padding
from resample_volume.classification.transfer import from_points
from resample_volume.data.bricks import Bricks
from resample_volume.data.values import as_array
from resample_volume.files.source import generate, read_labels
from resample_volume.media.appearance import Appearance
from resample_volume.rendering import Subject, render
from resample_volume.scenes import Scene
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light
from resample_volume.voxels.streaming import (
    BYTES_PER_VOXEL,
    TooManyVoxelsError,
    visible_bricks,
)
from resample_volume.voxels.visible import classify
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


def same_voxels(found, given):
    for part, whole in zip(found, given, strict=True):
        assert part.dtype == whole.dtype
        assert np.array_equal(part, whole)


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
@pytest.mark.parametrize(
    "kind",
    [
        "float32",
        *(
            pytest.param(
                kind,
                marks=pytest.mark.sweep,
            )
            for kind in ("int8", "int16", "int32", "uint16", "float64")
        ),
    ],
)
@pytest.mark.parametrize("side", SIDES)
def test_voxels_of_every_type_are_those_of_an_array_in_its_order(kind, side, volume, rng):
    values = (volume.values.astype(np.float64) / 2).astype(kind)
    if values.dtype.kind == "f":
        values[rng.random(values.shape) < 0.02] = np.nan
        values[7, 8, 9], values[0, 0] = np.inf, -np.inf
    whole = volume._replace(values=values)
    for gradient in ("central", "sobel", None):
        transfer = from_points([(30, (1, 0, 0), 0.0), (70, (1, 1, 0), 0.6)])
        given = classify(whole, transfer, gradient=gradient)
        assert len(given.position) > 500
        same_voxels(classify(in_bricks(whole, side), transfer, gradient=gradient), given)


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


@pytest.mark.sweep
@settings(max_examples=15)
@given(
    shape=st.tuples(*[st.integers(2, 30)] * 3),
    side=st.tuples(*[st.integers(1, 34)] * 3),
    share=st.sampled_from([0.0, 0.02, 0.4, 1.0]),
    gradient=st.sampled_from(["central", "sobel", None]),
)
def test_any_shape_in_any_bricks_gives_the_same_voxels(shape, side, share, gradient):
    rng = np.random.default_rng(sum(shape))
    values = np.where(rng.random(shape) < share, rng.integers(90, 250, shape), 3).astype(np.uint8)
    whole = Volume(values, np.ones(3), np.zeros(3), np.eye(3), "any")
    found = classify(in_bricks(whole, side), SOLID, gradient=gradient)
    same_voxels(found, classify(whole, SOLID, gradient=gradient))


# What is read


def sparse(side=8, *, is_even=False):
    """Volume of 8³ bricks in which one in the middle and one in a corner show something."""
    values = np.zeros((64, 64, 64), np.uint8)
    if not is_even:
        values[::4, ::4, ::4] = 1
    values[27:30, 28:30, 26:30], values[61:, 62:, 63:] = 200, 150
    return in_bricks(Volume(values, np.ones(3), np.zeros(3), np.eye(3), "sparse"), (side,) * 3)


def test_each_brick_is_read_once_where_its_slopes_matter_and_never_elsewhere():
    volume = sparse()
    chosen = visible_bricks(volume.values, SOLID, (0.0, 200.0))
    assert chosen == [(3, 3, 3), (7, 7, 7)]
    volume.values.read.boxes.clear()
    classify(volume, SOLID)
    read = volume.values.read.boxes
    assert len(read) == len(set(read)) == 27 + 8


@pytest.mark.sweep
def test_bricks_of_a_single_value_are_not_read_again():
    volume = sparse(is_even=True)
    assert volume.values.statistics.greatest.max() == 200
    volume.values.read.boxes.clear()
    given = volume._replace(values=as_array(sparse(is_even=True)).values)
    same_voxels(classify(volume, SOLID), classify(given, SOLID))
    assert len(volume.values.read.boxes) == 2


def test_without_slopes_bricks_beside_are_not_read():
    volume = sparse()
    assert volume.values.statistics.greatest.max() == 200
    volume.values.read.boxes.clear()
    classify(volume, SOLID, gradient=None)
    assert len(volume.values.read.boxes) == 2


def test_a_picture_reads_all_bricks_once_and_those_that_are_seen_once_more():
    volume = sparse()
    render(volume, of_voxels(SOLID), size=(16, 16))
    assert len(volume.values.read.boxes) == 8**3 + 27 + 8


@pytest.mark.sweep
def test_bricks_that_are_held_together_are_two_layers_at_most(volume):
    streamed = in_bricks(volume._replace(values=np.full((64, 40, 40), 150, np.uint8)), (8, 8, 8))
    classify(streamed, SOLID)
    layer = 5 * 5 * 8**3
    assert streamed.values.most_held <= 2 * layer + 20 * 8**3


# Memory


def test_voxels_that_do_not_fit_are_refused_with_a_remedy(volume):
    with pytest.raises(
        ValueError, match=r"blobs with \d+ visible voxels or more needs .* MiB are allowed"
    ):
        render(in_bricks(volume, (8, 8, 8), memory=100_000), of_voxels())


@pytest.mark.parametrize("beside", [0, 1 << 16])
def test_bytes_that_do_not_fit_are_refused_before_they_are_read_again(volume, beside):
    visible = int((volume.values > 80).sum())
    memory = BYTES_PER_VOXEL * visible + beside  # nothing, or a layer, for bricks beside each other
    streamed = in_bricks(volume, (16, 16, 16), memory=memory)
    streamed.values.statistics  # noqa: B018
    reads = streamed.values.reads
    with pytest.raises(TooManyVoxelsError, match=f"blobs with {visible} visible voxels or more"):
        render(streamed, of_voxels("80.5/white/0,81/white/0.5,255/white/0.9"))
    assert streamed.values.reads == reads


def test_floats_are_refused_once_so_many_are_visible_that_they_do_not_fit(volume):
    """How many they are is not known before they are read."""
    floats = volume._replace(values=volume.values.astype(np.float32))
    visible = int((volume.values > 80).sum())
    streamed = in_bricks(floats, (8, 8, 8), memory=BYTES_PER_VOXEL * visible)
    with pytest.raises(TooManyVoxelsError, match=r"blobs with (\d+) visible voxels") as told:
        render(streamed, of_voxels("80.5/white/0,81/white/0.5,255/white/0.9"))
    assert 0 < int(str(told.value).split()[2]) <= visible


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
