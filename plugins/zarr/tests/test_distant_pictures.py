"""Pictures of zarr at addresses and in zip files: made of them is what is made of other files."""

import socket
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from resample.files.pictures import read_picture
from resample.files.sequences import batch_of, is_batch
from resample.files.stores import Address
from resample_texture import cli, warp
from resample_texture.command import rendering
from tests import commands
from tests.servers import Server

zarr = pytest.importorskip("zarr")
pytest.importorskip("obstore", reason="the extra remote is not installed")

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
TURN = ["warp", "--matrix", ".8,-.2,30,.2,.8,5", "--size", "130x110"]
SHAPE = (120, 150, 3)


@pytest.fixture
def values():
    rng = np.random.default_rng(5)
    return rng.integers(0, 256, SHAPE, np.uint8)


@pytest.fixture
def server(httpserver, tmp_path, monkeypatch):
    """Server of the folder that commands work in."""
    monkeypatch.chdir(tmp_path)
    return Server(tmp_path, httpserver)


def image_of(place, values):
    """OME-Zarr of a picture, in a folder or in a zip file."""
    store = zarr.storage.ZipStore(place, mode="w") if place.endswith(("zip", "ozx")) else place
    axes = [{"name": "y", "type": "space"}, {"name": "x", "type": "space"}]
    axes.append({"name": "c", "type": "channel"})
    scale = [{"type": "scale", "scale": [1.0, 1.0, 1.0]}]
    levels = [{"path": "0", "coordinateTransformations": scale}]
    told = {"version": "0.5", "multiscales": [{"axes": axes, "datasets": levels}]}
    group = zarr.create_group(store, attributes={"ome": told})
    group.create_array("0", data=values, chunks=(32, 32, 3))
    if not isinstance(store, str):
        store.close()


def array_of(place, values):
    zarr.create_array(place, data=values, chunks=(32, 32, 3))


def made(source, target):
    assert ended(*TURN, source, "-o", target) == 0
    return Path(target).read_bytes()


@pytest.mark.sweep
@pytest.mark.parametrize("is_large", [False, True])
@pytest.mark.parametrize("write", [image_of, array_of])
def test_a_picture_at_an_address_is_warped_as_that_on_disk(
    write, is_large, values, server, monkeypatch
):
    if is_large:
        monkeypatch.setattr(rendering, "MOST_AT_ONCE", 0)
        monkeypatch.setattr(rendering, "MOST_IN_STRIP", 20_000)
    write("a.zarr", values)
    assert made(f"{server.url}a.zarr", "far.png") == made("a.zarr", "near.png")
    chunks = [asked for asked in server.asked if "/c/" in asked]
    assert len(chunks) == len(set(chunks)) == 20
    assert len(server.asked) - len(chunks) <= (8 if is_large else 32)  # metadata


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["a.ome.zarr.zip", "a.ozx"])
@pytest.mark.usefixtures("server")
def test_a_picture_in_a_zip_file_is_warped_as_that_in_a_folder(name, values):
    image_of(name, values)
    image_of("a.ome.zarr", values)
    assert made(name, "packed.png") == made("a.ome.zarr", "plain.png")


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["a.zarr", "b.ozx"])
def test_only_chunks_that_are_shown_are_fetched(name, values, server, monkeypatch):
    monkeypatch.setattr(rendering, "MOST_AT_ONCE", 0)
    array_of("a.zarr", values)
    image_of("b.ozx", values)
    words = ["warp", "--matrix", "1,0,0.5,0,1,0.5", "--roi", "40,70,15,15"]
    assert ended(*words, name, "-o", "near.png") == 0
    assert ended(*words, f"{server.url}a.zarr", "-o", "far.png") == 0
    assert Path("near.png").read_bytes() == Path("far.png").read_bytes()
    assert sum("/c/" in asked for asked in server.asked) == 9  # of 20
    monkeypatch.undo()
    monkeypatch.chdir(server.folder)
    assert ended(*words, name, "-o", "whole.png") == 0
    assert Path("whole.png").read_bytes() == Path("far.png").read_bytes()


@pytest.mark.sweep
def test_other_commands_and_python_take_addresses_too(values, server):
    array_of("a.zarr", values)
    Image.fromarray(values).save("a.png")
    far = f"{server.url}a.zarr"
    for command, *words in (["resize", "--size", "50%"], ["rotate", "--degrees", "7"]):
        for source, target in (("a.png", "near.png"), (far, "far.png")):
            assert ended(command, source, target, *words) == 0
        assert Path("near.png").read_bytes() == Path("far.png").read_bytes()
    assert ended("rectify", far, "-o", "b.png", "--corners", "9,9 90,12 95,80 8,85") == 0
    np.testing.assert_array_equal(read_picture(far).data, read_picture("a.png").data)
    matrix = [[0.5, 0, 3], [0, 0.5, 4], [0, 0, 1]]
    image = warp(values, matrix, (50, 60)).image
    np.testing.assert_array_equal(warp(far, matrix, (50, 60)).image, image)


def test_several_addresses_are_a_batch(values, server):
    array_of("a.zarr", values)
    image_of("b.ozx", values)
    far = Address(f"{server.url}a.zarr")
    assert is_batch([far, far], Path("out"))
    assert not is_batch([far], Path("out.png"))
    assert not is_batch([Path("b.ozx")], Path("out.png"))
    found = batch_of([far, Path("b.ozx")], Path("out"))
    assert found == [(far, Path("out/a.png")), (Path("b.ozx"), Path("out/b.png"))]
    assert ended(*TURN, far, "b.ozx", "-o", "out") == 0
    assert Path("out/a.png").read_bytes() == Path("out/b.png").read_bytes()


@pytest.mark.sweep
def test_what_is_no_picture_at_an_address_is_said_in_one_line(values, server, capsys):
    array_of("a.zarr", values[..., :2])
    error = refused(capsys, *TURN, f"{server.url}a.zarr", "-o", "b.png")
    assert "a.zarr has 2 channels; 1, 3 (RGB) or 4 (RGBA) are supported" in error
    error = refused(capsys, *TURN, f"{server.url}none.zarr", "-o", "b.png")
    assert "is not zarr, or damaged" in error
    Path("a.zip").write_bytes(b"PK nothing")
    assert "a.zip is not zarr, or damaged" in refused(capsys, *TURN, "a.zip", "-o", "b.png")


def test_servers_that_fail_are_said_in_one_line(values, server, capsys):
    array_of("a.zarr", values)
    far = f"{server.url}a.zarr"
    server.cut = "c/0/0/0"
    error = refused(capsys, *TURN, far, "-o", "b.png")
    assert "fetched" in error or "damaged" in error
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    error = refused(capsys, *TURN, f"http://127.0.0.1:{port}/a.zarr", "-o", "b.png")
    assert "cannot be fetched" in error


@pytest.mark.usefixtures("server")
def test_pictures_are_not_written_to_addresses(values, capsys):
    array_of("a.zarr", values)
    error = refused(capsys, "rotate", "a.zarr", "s3://bucket/b.zarr", "--degrees", "9")
    assert "s3://bucket/b.zarr lies elsewhere; pictures are written to files" in error
    refused(capsys, *TURN, "a.zarr", "-o", "s3://bucket/b.zarr")
