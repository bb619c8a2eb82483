"""Pictures in chunks, of zarr: what is made of them is what is made of the same in a file."""

from functools import partial
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest
import zarr
from PIL import Image

from resample.files.images import open_file, read_image
from resample.files.pictures import picture_at, read_picture
from resample.memory import mapped
from resample_texture import cli
from resample_texture.command import rendering
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
TURN = ["warp", "--matrix", ".8,-.2,30,.2,.8,5", "--size", "130x110"]
SHAPE = (120, 150)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / ".cache"))


def texels(channels, kind):
    rng = np.random.default_rng(5)
    coarse = rng.random((12, 15, 4)).repeat(10, axis=0).repeat(10, axis=1)
    shares = coarse[..., :channels] if channels else coarse[..., 0]
    most = 1 if np.dtype(kind).kind == "f" else np.iinfo(kind).max
    return (shares * most).astype(kind)


def store(name, values, chunk=32, **told):
    chunks = tuple(min(chunk, size) for size in values.shape)
    made = zarr.create_array(name, shape=values.shape, chunks=chunks, dtype=values.dtype, **told)
    made[...] = values
    return made


def pixels(name):
    found = zarr.open_array(name)[...]
    return found if found.ndim == 3 else found[..., None]


@pytest.mark.sweep
@pytest.mark.parametrize("is_large", [False, True])
@pytest.mark.parametrize("channels", [0, 3, 4])
def test_a_store_is_warped_as_the_file_is_and_into_one(channels, is_large, monkeypatch):
    if is_large:
        monkeypatch.setattr(rendering, "MOST_AT_ONCE", 0)
        monkeypatch.setattr(rendering, "MOST_IN_STRIP", 20_000)
    values = texels(channels, np.uint8)
    Image.fromarray(values).save("a.png")
    store("a.zarr", values)
    for source in ("a.png", "a.zarr"):
        for target in ("png", "zarr"):
            assert ended(*TURN, source, "-o", f"{source}.{target}") == 0
    given = np.array(Image.open("a.png.png"))
    assert np.array_equal(np.array(Image.open("a.zarr.png")), given)
    for name in ("a.png.zarr", "a.zarr.zarr"):
        made = pixels(name)
        assert made.dtype == np.uint8
        assert np.array_equal(made, given.reshape(made.shape))


@pytest.mark.sweep
@pytest.mark.parametrize("kind", [np.uint16, np.float16, np.float32, np.float64])
def test_other_types_keep_theirs(kind):
    values = texels(3, kind)
    store("a.zarr", values)
    assert ended(*TURN[:2], "1,0,0,0,1,0", "a.zarr", "-o", "b.zarr") == 0
    made = pixels("b.zarr")
    assert made.dtype == (np.uint16 if kind == np.uint16 else np.float32)
    assert np.array_equal(made, values.astype(made.dtype))


@pytest.mark.sweep
def test_an_image_of_ome_zarr_is_read_whatever_its_axes():
    values = texels(3, np.uint8)
    group = zarr.open_group("a.ome.zarr", mode="w", zarr_format=3)
    axes = [{"name": "t", "type": "time"}, {"name": "c", "type": "channel"}]
    axes += [{"name": name, "type": "space"} for name in "yx"]
    scale = [{"type": "scale", "scale": [1.0, 1.0, 0.5, 0.5]}]
    levels = [{"path": "0", "coordinateTransformations": scale}]
    group.attrs["ome"] = {"version": "0.5", "multiscales": [{"axes": axes, "datasets": levels}]}
    turned = values.transpose(2, 0, 1)[None]
    group.create_array("0", shape=turned.shape, chunks=(1, 1, 40, 50), dtype="u1")[...] = turned
    Image.fromarray(values).save("a.png")
    found, given = read_picture("a.ome.zarr"), read_picture("a.png")
    assert found.kind == given.kind
    assert np.array_equal(found.data, given.data)
    store("b.zarr", turned[0], dimension_names=["c", "y", "x"])
    assert np.array_equal(picture_at(Path("b.zarr")).load().data, values)


def test_chunks_that_are_missing_hold_what_fills_them():
    made = zarr.create_array("a.zarr", shape=SHAPE, chunks=(32, 32), dtype="u1", fill_value=9)
    made[:32, :32] = 200
    found = picture_at(Path("a.zarr")).load().data[..., 0]
    assert (found[:32, :32] == 200).all()
    assert (found[32:] == 9).all()


@pytest.mark.sweep
def test_what_memory_should_not_hold_is_in_a_file_meanwhile(monkeypatch):
    values = texels(3, np.uint8)
    store("a.zarr", values)
    Image.fromarray(values).save("a.tif")
    monkeypatch.setattr(rendering, "MOST_AT_ONCE", 0)
    for name in ("a.zarr", "a.tif"):
        assert ended(*TURN, name, "-o", f"{name}.png") == 0
    monkeypatch.setattr(mapped, "pages_of", lambda _: 1 << 20)
    assert mapped.is_in_file(picture_at(Path("a.zarr")).load().data)
    assert mapped.is_in_file(picture_at(Path("a.tif")).load().data)
    for name in ("a.zarr", "a.tif"):
        assert ended(*TURN, name, "-o", "b.png") == 0
        assert Path("b.png").read_bytes() == Path(f"{name}.png").read_bytes()


def in_tiles_and_in_rows():
    """Two files of one picture."""
    values = texels(3, np.uint8)
    Image.fromarray(values).save("rows.tif")
    spec = OpenImageIO.ImageSpec(SHAPE[1], SHAPE[0], 3, "uint8")
    spec.tile_width = spec.tile_height = 32
    target = OpenImageIO.ImageOutput.create("tiles.tif")
    assert target.open("tiles.tif", spec)
    assert target.write_image(values)
    assert target.close()


@pytest.mark.parametrize(("height", "rows"), [(40, 64), (32, 32), (1, 32), (33, 64)])
def test_strips_of_tiles_are_whole_rows_of_them(height, rows):
    """At least as high as asked for; the last one may be lower."""
    in_tiles_and_in_rows()
    strips = list(open_file("tiles.tif").light_strips(height))
    assert {len(strip) for strip in strips[:-1]} <= {rows}
    assert len(strips) == -(-SHAPE[0] // rows)
    assert np.array_equal(np.concatenate(strips), read_image("rows.tif"))


@pytest.mark.sweep
def test_files_in_tiles_are_read_as_those_in_rows(monkeypatch):
    in_tiles_and_in_rows()
    monkeypatch.setattr(rendering, "MOST_AT_ONCE", 0)
    for name in ("rows.tif", "tiles.tif"):
        assert ended(*TURN, name, "-o", f"{name}.png") == 0
    made = [np.array(Image.open(f"{name}.png")) for name in ("rows.tif", "tiles.tif")]
    assert np.array_equal(*made)


@pytest.mark.some(2)
@pytest.mark.parametrize(
    ("shape", "kind", "complaint"),
    [
        ((20, 20, 5), "u1", "a.zarr has 5 channels; 1, 3 (RGB) or 4 (RGBA) are supported"),
        ((20, 20, 3), "i4", "a.zarr is of int32; supported are uint8, uint16, float16"),
        ((20, 20), "?", "a.zarr is of bool; supported are uint8"),
        ((20, 20), "c8", "a.zarr is of complex64; supported are uint8"),
        ((20,), "u1", "a.zarr is an array 20; a picture is (y, x), or (y, x, channels)"),
        ((4, 5, 20, 20), "u1", "a.zarr is an array 4 x 5 x 20 x 20; a picture is (y, x)"),
        ((0, 20), "u1", "a.zarr is an array 0 x 20 in chunks of"),
    ],
)
def test_arrays_that_are_no_pictures_are_refused(shape, kind, complaint, capsys):
    zarr.create_array("a.zarr", shape=shape, chunks=tuple(max(1, n) for n in shape), dtype=kind)
    assert complaint in refused(capsys, *TURN, "a.zarr", "-o", "b.png")


def test_stores_that_are_damaged_are_refused(capsys):
    store("a.zarr", texels(3, np.uint8))
    chunk = next(path for path in Path("a.zarr").rglob("*") if path.is_file() and "c" in path.parts)
    chunk.write_bytes(chunk.read_bytes()[:20])
    assert "a.zarr is not zarr, or damaged" in refused(capsys, *TURN, "a.zarr", "-o", "b.png")
    volume = zarr.open_group("v.ome.zarr", mode="w")
    volume.attrs["ome"] = {"version": "0.5", "multiscales": [{"axes": [], "datasets": []}]}
    assert "v.ome.zarr, multiscales:" in refused(capsys, *TURN, "v.ome.zarr", "-o", "b.png")
    store("z.zarr", np.zeros((4, 20, 20), np.uint8), dimension_names=["z", "y", "x"])
    error = refused(capsys, *TURN, "z.zarr", "-o", "b.png")
    assert "not a single picture; volumes are for resample-volume" in error


@pytest.mark.sweep
def test_a_store_is_never_replaced(capsys):
    store("a.zarr", texels(3, np.uint8))
    before = pixels("a.zarr")
    refused(capsys, *TURN, "a.zarr", "-o", "a.zarr")
    assert np.array_equal(pixels("a.zarr"), before)
    assert sorted(path.name for path in Path().iterdir()) == ["a.zarr"]


def test_an_error_on_the_way_leaves_no_store(monkeypatch, capsys):
    store("a.zarr", texels(3, np.uint8))
    monkeypatch.setattr(rendering, "MOST_AT_ONCE", 0)
    monkeypatch.setattr(rendering, "MOST_IN_STRIP", 20_000)
    one = rendering.Large.paint

    def failing(self, first, count):
        if first:
            raise OSError(28, "No space left on device")
        return one(self, first, count)

    monkeypatch.setattr(rendering.Large, "paint", failing)
    assert "b.zarr: cannot be written: No space left" in refused(
        capsys, *TURN, "a.zarr", "-o", "b.zarr"
    )
