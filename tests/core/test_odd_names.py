"""Names of files that are no text, as Linux allows them: read, written and said like any other."""

import os
from pathlib import Path

import pytest

from resample.cli import app
from resample.files.metadata.tags import settings_in, stating
from resample.files.pictures import read_picture
from resample.files.sequences import frames_of
from resample.messages import visible
from resample.reading import native
from resample.reading.native import plain
from resample_zarr.volumes import state_of_files
from tests.commands import ended
from tests.core.test_full_disk import STORES, WRITERS
from tests.fuzz import corpus
from tests.fuzz.readers import READERS

ODD = os.fsdecode(b"caf\xe9")


@pytest.fixture(autouse=True)
def odd_folder(tmp_path, monkeypatch):
    """A folder of such a name."""
    try:
        (tmp_path / ODD).mkdir()
    except (OSError, UnicodeError):
        pytest.skip("the file system has no such names")
    monkeypatch.chdir(tmp_path / ODD)


def files() -> list[str]:
    """Of all that is here."""
    return sorted(os.listdir())


@pytest.mark.parametrize("name", [*(n for n in WRITERS if n[0] not in "w"), *STORES])
def test_every_writer_takes_any_name(name):
    if name == "rows.csv":  # which has no name of its own
        return
    target = Path(f"{ODD}-{name}" if name in WRITERS else f"{ODD}.zarr")
    (WRITERS | STORES)[name](target)
    assert files() == [target.name]


TRIANGLE = b"solid\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendfacet\nendsolid\n"
READ = {
    "picture": ("a.png", lambda: corpus._picture("a.png", (4, 5, 3))),
    "depth": ("a.exr", lambda: corpus._picture("a.exr", (4, 5, 1), "float")),
    "volume": ("a.tif", corpus._pages),
    "grid": ("a.vti", lambda: corpus._vti("Binary")),
    "mesh": ("a.obj", lambda: corpus.OBJ),
    "scene-mesh": ("a.obj", lambda: corpus.OBJ),
    "film": ("a.webp", lambda: corpus._animated("a.webp")),
}


@pytest.mark.parametrize("kind", READ)
def test_every_library_that_reads_takes_any_name(kind):
    if kind == "grid":
        pytest.importorskip("vtkmodules")
    name, made = READ[kind]
    Path(f"{ODD}-{name}").write_bytes(made())
    Path("a.mtl").write_bytes(corpus.MTL)  # of meshes
    Path("a.png").write_bytes(corpus._picture("a.png", (4, 4, 3)))
    READERS[kind.replace("grid", "volume")](Path(f"{ODD}-{name}"))


def test_films_take_any_name():
    pytest.importorskip("av")
    WRITERS["frames.mp4"](Path(f"{ODD}.mp4"))
    assert len(list(frames_of(Path(f"{ODD}.mp4")).read())) == 3


def test_settings_are_found_in_a_picture_of_any_name():
    with stating("size = 30\n"):
        WRITERS["a.png"](Path(f"{ODD}.png"))
    assert settings_in(Path(f"{ODD}.png")) == "size = 30\n"


def test_a_picture_that_is_replaced_is_read_anew_by_the_same_name():
    path = Path(f"{ODD}.png")
    for name, size in (("a.png", (40, 50)), ("screen.png", (40, 50)), ("holes.png", (30, 40))):
        WRITERS[name](path)
        assert read_picture(path).data.shape[:2] == size


def test_a_store_may_hold_files_of_any_name():
    STORES["volumes"](Path("a.zarr"))
    before = state_of_files(Path("a.zarr"), "0")
    (Path("a.zarr") / "0" / ODD).write_text("of others")
    assert state_of_files(Path("a.zarr"), "0").mark != before.mark


def test_names_that_are_text_stay_and_links_go_with_the_process(monkeypatch):
    leave = []
    monkeypatch.setattr(native.atexit, "register", leave.append)
    native._folder.cache_clear()
    assert plain("café.png") == "café.png"
    Path(f"{ODD}.nii.gz").write_text("content")
    link = plain(f"{ODD}.nii.gz")
    assert link == plain(Path(f"{ODD}.nii.gz").resolve())
    assert link.isascii()
    assert link.endswith(".nii.gz")
    assert Path(link).read_text() == "content"
    monkeypatch.setattr(os, "getpid", lambda: 1)
    leave[0]()  # in a fork
    assert Path(link).exists()
    monkeypatch.undo()
    leave[0]()
    assert not Path(link).parent.exists()
    native._folder.cache_clear()


def test_commands_show_such_names_as_codes(capsys):
    WRITERS["picture.png"](Path(f"{ODD}.png"))
    assert (
        ended(app, "compare", f"{ODD}.png", "-R", f"{ODD}.png", "-o", f"{ODD}-2.png", "--json") == 0
    )
    capsys.readouterr()
    assert files() == [f"{ODD}-2.png", f"{ODD}.png"]
    assert ended(app, "compare", f"{ODD}-3.png", "-R", f"{ODD}.png") == 2
    assert (
        "caf\\xe9-3.png: there is no such file; did you mean caf\\xe9-2.png or caf\\xe9.png?\n"
        in capsys.readouterr().err
    )
    assert visible("caf\udce9 \ud800") == "caf\\xe9 \\ud800"
