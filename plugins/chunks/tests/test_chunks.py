"""Pictures warped chunk by chunk have the bits of those warped at once, and read what they show."""

from itertools import product

import numpy as np
import pytest

from resample_chunks import warp_chunks
from resample_texture import BackwardMap, Hybrid, warp
from resample_texture import drawing as drawings
from resample_texture.texels import forward, gather

RNG = np.random.default_rng(9)
IMAGE = RNG.random((230, 310, 3)).astype(np.float32)
FRAME = 200, 170
WAYS = {
    "turned": [[0.8, -0.3, 60], [0.25, 0.9, 3], [0, 0, 1]],
    "seen aslant": [[0.7, -0.2, 30], [0.1, 0.6, 9], [4e-4, 2e-4, 1]],
    "enlarged": [[7.3, 0.4, -300], [0.2, 6.1, -200], [0, 0, 1]],
    "moved": [[1, 0, 7], [0, 1, -5], [0, 0, 1]],
    "made small": [[0.11, 0.02, 60], [0.01, 0.09, 50], [0, 0, 1]],
    "made tiny": [[0.02, 0.003, 60], [0.001, 0.015, 50], [0, 0, 1]],
    "to the horizon": [[1.0, 0.6, 10], [0.0, 0.55, 30], [0.0, 9e-3, 0.4]],
}


class Counting:
    """A picture that counts the texels that are read."""

    def __init__(self, image):
        self.image, self.shape, self.dtype, self.read = image, image.shape, image.dtype, 0
        self.largest = 0  # texels read at once

    def __getitem__(self, where):
        part = self.image[where]
        self.read += part.shape[0] * part.shape[1]
        self.largest = max(self.largest, part.shape[0] * part.shape[1])
        return part


@pytest.mark.some(3)
@pytest.mark.parametrize("side", [64, (50, 33), 500])
@pytest.mark.parametrize("way", WAYS)
def test_chunks_have_the_bits_of_the_whole(way, side):
    whole = warp(IMAGE, WAYS[way], FRAME).image
    made = np.full((*FRAME, 3), np.nan, np.float32)
    assert warp_chunks(IMAGE, WAYS[way], FRAME, out=made, side=side) is made
    np.testing.assert_array_equal(made, whole)


@pytest.mark.sweep
def test_bytes_and_maps_are_warped_in_chunks_too():
    y, x = np.mgrid[: FRAME[0], : FRAME[1]] + 0.5
    places = BackwardMap(x + 9 * np.sin(y / 20), 0.9 * y + 5 * np.cos(x / 30))
    levels = (IMAGE * 255).astype(np.uint8)
    made = np.zeros((*FRAME, 3), np.uint8)
    warp_chunks(levels, places, FRAME, out=made, side=48, edge="mirror")
    np.testing.assert_array_equal(made, warp(levels, places, FRAME, edge="mirror").image)


def test_a_chunk_reads_what_it_shows():
    source, shape = Counting(IMAGE), (230, 310)
    made = np.zeros(IMAGE.shape, np.float32)
    warp_chunks(source, [[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], shape, out=made, side=128)
    assert source.read < 1.7 * 230 * 310  # with some texels around each of six chunks
    enlarged = Counting(IMAGE)
    made = np.zeros((*FRAME, 3), np.float32)
    warp_chunks(enlarged, WAYS["enlarged"], FRAME, out=made, side=128)
    assert enlarged.read < 0.3 * 230 * 310


@pytest.mark.sweep
def test_zarr_and_dask_arrays_are_read_and_zarr_is_written(tmp_path):
    zarr = pytest.importorskip("zarr")
    array = pytest.importorskip("dask.array")
    stored = zarr.create_array(tmp_path / "a.zarr", data=IMAGE, chunks=(64, 64, 3))
    made = zarr.create_array(tmp_path / "b.zarr", shape=(*FRAME, 3), chunks=(64, 64, 3), dtype="f4")
    whole = warp(IMAGE, WAYS["turned"], FRAME).image
    warp_chunks(stored, WAYS["turned"], FRAME, out=made)
    np.testing.assert_array_equal(made[...], whole)
    again = np.zeros((*FRAME, 3), np.float32)
    warp_chunks(array.from_array(IMAGE, chunks=100), WAYS["turned"], FRAME, out=again, side=90)
    np.testing.assert_array_equal(again, whole)


@pytest.mark.some(1)
@pytest.mark.parametrize("edge", ["transparent", "clamp", "wrap"])
@pytest.mark.parametrize("way", WAYS)
def test_chunks_of_dask_are_warped_when_they_are_asked_for(way, edge):
    array = pytest.importorskip("dask.array")
    whole = warp(IMAGE, WAYS[way], FRAME, edge=edge).image
    counting = Counting(IMAGE)
    lazy = warp_chunks(counting, WAYS[way], FRAME, side=64, edge=edge)
    assert counting.read == 0
    assert (lazy.shape, lazy.dtype, lazy.chunksize) == ((*FRAME, 3), np.float32, (64, 64, 3))
    np.testing.assert_array_equal(lazy[70:90, 100:130].compute(), whole[70:90, 100:130])
    source = array.from_array(IMAGE, chunks=100)
    np.testing.assert_array_equal(
        warp_chunks(source, WAYS[way], FRAME, side=(90, 70), edge=edge).compute(), whole
    )


TEXELS = [
    ("to the horizon", "transparent", np.uint8),
    ("made small", "clamp", np.float16),
    ("made small", "wrap", np.float32),
    ("made small", "mirror", np.uint8),
]
MORE_TEXELS = product(
    ("made small", "to the horizon"),
    ("transparent", "clamp", "wrap", "mirror"),
    (np.uint8, np.float16, np.float32),
)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("way", "edge", "kind"),
    [
        *TEXELS,
        *(
            pytest.param(*each, marks=pytest.mark.sweep)
            for each in MORE_TEXELS
            if each not in TEXELS
        ),
    ],
)
def test_texels_are_projected_from_parts_of_the_source(way, edge, kind, monkeypatch):
    monkeypatch.setattr(forward, "MOST_VALUES", 20_000)
    monkeypatch.setattr(drawings, "MOST_IN_WINDOW", 20_000)
    image = (IMAGE * (255 if kind == np.uint8 else 1)).astype(kind)
    if kind == np.float32:
        image[50:70, 60:90, 1] = np.nan
        image[3, 4] = np.inf
    source = Counting(image)
    made = np.zeros((*FRAME, 3), kind)
    warp_chunks(source, WAYS[way], FRAME, out=made, side=90, edge=edge)
    np.testing.assert_array_equal(made, warp(image, WAYS[way], FRAME, edge=edge).image)
    if edge == "transparent":
        assert source.largest < 0.5 * 230 * 310


class Unclean:
    """NumPy whose new arrays hold what might have been in memory before."""

    def __getattr__(self, name):
        return getattr(np, name)

    @staticmethod
    def empty(shape, kind=np.float64):
        return np.full(shape, 1e-44 if np.size(shape) == 3 else -1.0, kind)


@pytest.mark.sweep
def test_pixels_that_others_fill_are_empty_before(monkeypatch):
    image = IMAGE.copy()
    image[3, 4] = np.inf
    whole = warp(image, WAYS["to the horizon"], FRAME).image
    monkeypatch.setattr(forward, "MOST_VALUES", 20_000)
    monkeypatch.setattr(drawings, "MOST_IN_WINDOW", 20_000)
    monkeypatch.setattr(gather, "np", Unclean())
    made = np.zeros((*FRAME, 3), np.float32)
    warp_chunks(image, WAYS["to the horizon"], FRAME, out=made, side=90)
    np.testing.assert_array_equal(made, whole)


@pytest.mark.sweep
def test_a_block_of_many_texels_is_read_strip_by_strip(monkeypatch):
    image = RNG.random((1000, 700, 3)).astype(np.float32)
    matrix = [[0.004, 0, 10], [0, 0.004, 10], [0, 0, 1]]
    whole = warp(image, matrix, (32, 40)).image
    monkeypatch.setattr(forward, "MOST_VALUES", 70_000)
    monkeypatch.setattr(drawings, "MOST_IN_WINDOW", 70_000)
    source, made = Counting(image), np.zeros((32, 40, 3), np.float32)
    warp_chunks(source, matrix, (32, 40), out=made)
    np.testing.assert_array_equal(made, whole)
    assert source.largest < 0.1 * 1000 * 700


@pytest.mark.sweep
def test_a_clamped_picture_is_not_clamped_to_what_a_chunk_shows():
    method, made = Hybrid(interpolation="lanczos", clamp=True), np.zeros((*FRAME, 3), np.float32)
    warp_chunks(IMAGE, WAYS["enlarged"], FRAME, method, out=made, side=50)
    np.testing.assert_array_equal(made, warp(IMAGE, WAYS["enlarged"], FRAME, method).image)


def test_gaps_leave_the_bits_of_other_parts_alone():
    image = IMAGE.copy()
    image[200:, 250:] = np.nan
    method, made = Hybrid(interpolation="lanczos"), np.zeros((*FRAME, 3), np.float32)
    warp_chunks(image, WAYS["turned"], FRAME, method, out=made, side=50)
    np.testing.assert_array_equal(made, warp(image, WAYS["turned"], FRAME, method).image)


@pytest.mark.parametrize("way", ["turned", "made small"])
def test_gaps_in_gray_leave_the_bits_of_other_parts_alone(way):
    image = np.ascontiguousarray(IMAGE[..., 0])
    image[200:, 250:] = np.nan
    made = np.zeros(FRAME, np.float32)
    warp_chunks(image, WAYS[way], FRAME, out=made, side=50)
    np.testing.assert_array_equal(made, warp(image, WAYS[way], FRAME).image)


@pytest.mark.sweep
def test_a_lazy_chunk_asks_for_the_chunks_that_it_shows():
    array = pytest.importorskip("dask.array")
    asked = []

    def chunk(block_info):
        asked.append(block_info[None]["chunk-location"])
        return np.zeros((50, 50), np.uint8)

    source = array.map_blocks(chunk, chunks=((50,) * 8, (50,) * 8), dtype=np.uint8)
    lazy = warp_chunks(source, [[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], (400, 400), side=50)
    lazy[210:220, 210:220].compute()
    assert (4, 4) in asked
    assert len(asked) <= 9


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"out": np.zeros((3, 3))}, "the result is"),
        ({"edge": "reflect-101"}, "pictures in memory"),
        ({"side": 0}, "give 1 px or more"),
    ],
)
def test_what_cannot_be_done_is_refused(choice, message):
    given = {"out": np.zeros((*FRAME, 3), np.float32), **choice}
    with pytest.raises(ValueError, match=message):
        warp_chunks(IMAGE, WAYS["turned"], FRAME, **given)
