"""Every writer on a disk that is full: an OSError that says so, the target as it was, no more."""

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from resample.files import images, saving
from resample.files.animations import Shots, write_film
from resample.files.formats import WriteOptions, page_of
from resample.files.images import BufferedJpeg
from resample.files.metadata.fields import FileMetadata
from resample.files.metadata.tags import ASCII, Tag
from resample.files.pictures import Kind, Picture
from resample.files.saving import (
    DepthSlab,
    spec_of,
    write_deep,
    write_pages,
    write_picture,
    writing_rows,
)
from resample.files.sequences import Frames, write_frames
from resample.files.writing import check_end, load_arrays, refused, store_arrays, write_json
from resample.measuring.compare import contact_sheet, write_screen
from resample.types import Frame
from resample_figures.volumes import write_numbers
from resample_volume.files.source import write_volume
from resample_volume.types import Recording, Volume
from resample_warp3d.command.writing import write_depth, write_geometry, write_holes
from resample_zarr.writing import Layered, write_store
from tests.warp3d.test_export import camera, plane

resource = pytest.importorskip("resource", reason="limits of Unix")
RANDOM = np.random.default_rng(5)
NOISE = RANDOM.random((40, 50, 4), np.float32)
RGB = Kind(("R", "G", "B"), 8, is_encoded=True)
TAKEN = FileMetadata(camera={271: Tag(ASCII, np.frombuffer(b"Camera\0", np.uint8))})
COLORS = Picture(NOISE[..., :3], RGB, TAKEN)
SHADES = [Picture(RANDOM.random((16, 20, 3), np.float32), RGB) for _ in range(3)]
LEVELS = RANDOM.integers(0, 255, (3, 16, 20, 3)).astype(np.uint8)
FRAME = Frame(NOISE, NOISE[..., 0], NOISE[..., 1], NOISE[..., 2], None)
VALUES = RANDOM.integers(0, 1000, (8, 9, 10)).astype(np.int16)
PLACE = np.ones(3), np.zeros(3), np.eye(3)
VOLUME = Volume(VALUES, *PLACE, "noise")


@contextmanager
def room(most: int) -> Iterator[None]:
    """Let no file of this process grow beyond so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def picture(path: Path) -> None:
    write_picture(path, COLORS, WriteOptions())


def rows(path: Path) -> None:
    with writing_rows(path, 40, WriteOptions()) as put:
        for part in np.split(COLORS.data, [24]):
            put(COLORS._replace(data=part))


def frames(path: Path) -> None:
    write_frames(path, SHADES, Frames(Path("in.gif"), (0.1, 0.2, 0.1)), WriteOptions())


def film(path: Path) -> None:
    write_film(path, Shots(3, LEVELS.__getitem__, {}), 24)


def volume(path: Path) -> None:
    write_volume(path, VOLUME)


def depth(path: Path) -> None:
    write_depth(path, NOISE[..., 0])


def geometry(path: Path) -> None:
    write_geometry(path, plane(), camera())


FIRST = ("animation.json", "frame-0000.png")  # that are written for a film
WRITERS = {
    "a.png": partial(saving.write_png, rgba=NOISE, bits=16),
    "a.exr": partial(saving.write_exr, frame=FRAME),
    "deep.exr": partial(write_deep, slabs=[DepthSlab(0, 1, NOISE)]),
    **{f"picture{suffix}": picture for suffix in (".png", ".jpg", ".jpeg", ".tif", ".exr")},
    **{f"rows{suffix}": rows for suffix in (".png", ".jpg", ".tif", ".exr")},
    "pages.tif": partial(write_pages, pictures=SHADES, look=WriteOptions()),
    **{f"frames{suffix}": frames for suffix in (".gif", ".webp", ".apng", ".mp4")},
    **{f"film{suffix}": film for suffix in (".gif", ".webp", ".apng", ".mp4")},
    "facts.json": partial(write_json, content={"a": [1, 2, 3]}),
    "sheet.png": lambda path: contact_sheet({"a": NOISE}, path),
    "screen.png": partial(write_screen, screen=NOISE[..., :3]),
    "holes.png": partial(write_holes, holes=np.ones((30, 40), np.uint8)),
    **{f"depth{suffix}": depth for suffix in (".npy", ".exr", ".png")},
    **{f"mesh{suffix}": geometry for suffix in (".ply", ".glb")},
    **{f"a{suffix}": volume for suffix in (".nrrd", ".mha", ".nii", ".nii.gz", ".npy")},
    "rows.csv": lambda path: write_numbers(path.parent, "rows", [{"a": 1}], {}),
}  # fmt: skip


@pytest.fixture(autouse=True)
def folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def names() -> list[str]:
    """Of all files here."""
    return sorted(file.name for file in Path().iterdir())


@pytest.mark.some(32)
@pytest.mark.parametrize("name", WRITERS)
def test_no_writer_loses_what_a_full_disk_does_not_take(name):
    path, kept = Path(name), Path(f".{name}.frames")
    WRITERS[name](path)
    size = path.stat().st_size
    for file in names():
        Path(file).unlink()
    path.write_bytes(b"old")
    for most in (0, size // 2, size - 1):
        full = pytest.raises(OSError, match="cannot be written: File too large")
        with full as caught, room(most):
            WRITERS[name](path)
        assert caught.value.errno == errno.EFBIG
        assert Path(caught.value.filename).name in (
            name,
            "rows.json",
            "frame-0000.png",
            "animation.json",
        )
        shutil.rmtree(kept, ignore_errors=True)  # frames of films that are done stay
        assert names() == [name]
        assert path.read_bytes() == b"old"


def test_a_cache_goes_without_a_file_that_a_full_disk_does_not_take():
    file, arrays = Path("cache.npz"), {"noise": NOISE}
    assert store_arrays(file, arrays, 1 << 30)
    size = file.stat().st_size
    file.unlink()
    for most in (0, size // 2, size - 1):
        with room(most):
            assert not store_arrays(file, arrays, 1 << 30)
        assert names() == []
    assert load_arrays(file) is None


STORES = {
    "pictures": lambda path: write_picture(path, SHADES[0], WriteOptions()),
    "rows": rows,
    "volumes": lambda path: write_store(
        path, Recording(VALUES[None, None], *PLACE, "noise"), Layered(chunk=8)
    ),
}


@pytest.mark.parametrize("kind", STORES)
def test_nothing_of_a_store_stays_on_a_full_disk(kind):
    full = pytest.raises(OSError, match="cannot be written: File too large")
    with full as caught, room(700):
        STORES[kind](Path("a.zarr"))
    assert (caught.value.errno, caught.value.filename) == (errno.EFBIG, "a.zarr")
    assert names() == []


def test_a_film_that_cannot_be_begun_leaves_no_folder():
    with pytest.raises(OSError, match="File too large"), room(0):
        film(Path("a.gif"))
    assert names() == []
    Path("mine").mkdir()
    with pytest.raises(OSError, match="File too large"), room(0):
        film(Path("mine"))
    assert names() == ["mine"]


def jpeg(path: Path) -> None:
    """Write a JPEG strip by strip to a file that is there."""
    page = page_of(Path("a.jpg"), COLORS, WriteOptions())
    target = BufferedJpeg(path, spec_of(".jpg", page, 40))
    assert target.write_scanlines(0, 24, 0, page.pixels[:24])
    assert target.write_scanlines(24, 40, 0, page.pixels[24:])
    assert target.close()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_jpeg_that_has_no_room_is_an_error_and_no_end_of_the_process():
    with pytest.raises(OSError, match="No space left") as caught:
        jpeg(Path("/dev/full"))
    assert caught.value.errno == errno.ENOSPC


def test_a_jpeg_is_the_same_where_the_system_has_no_files_in_memory(monkeypatch):
    jpeg(Path("a.jpg"))
    monkeypatch.setattr(images, "_memory", lambda: None)
    jpeg(Path("b.jpg"))
    assert Path("a.jpg").read_bytes() == Path("b.jpg").read_bytes()
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=80_000))
    with pytest.raises(OSError, match="No space left"):
        jpeg(Path("b.jpg"))


def test_no_jpeg_is_larger_than_the_room_that_it_asks_for():
    hard = (RANDOM.random((64, 64, 3)) > 0.5).astype(np.float32)
    write_picture(path := Path("a.jpg"), Picture(hard, RGB), WriteOptions())
    assert path.stat().st_size < images.MOST_BYTES * hard.size // 2


def test_what_a_library_could_not_write_has_its_own_reason_where_the_disk_has_room():
    Path("a.png").write_bytes(b"half")
    error = refused("b.png", Path("a.png"), "it did not like it")
    assert str(error) == "b.png cannot be written: it did not like it"
    with pytest.raises(OSError, match=r"b\.png cannot be written: the file is incomplete"):
        check_end("b.png", Path("a.png"))


def test_what_shows_when_a_file_is_brought_to_the_disk_keeps_the_target(monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "there was no room after all")

    Path("a.json").write_text("old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"cannot be written: No space left on device: 'a\.json'"):
        write_json(Path("a.json"), {})
    assert (names(), Path("a.json").read_text()) == (["a.json"], "old")
