"""Public sets of files: what is listed, fetched, kept and said."""

import hashlib
import json
import os
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from resample.files import public
from resample.files.public import available, fetch
from tests.commands import ended, refused

PACKAGES = ("resample_texture", "resample_warp3d")
CONTENT = {"a.png": b"first", "b.txt": b"second, longer"}


@pytest.fixture
def listed(monkeypatch):
    """A package with one small set."""
    files = tuple(
        public.PublicFile(
            name, f"http://tiny.invalid/{name}", len(data), hashlib.sha256(data).hexdigest()
        )
        for name, data in CONTENT.items()
    )
    known = {"tiny": public.PublicSet("Two files.", "free", "resample-texture warp a.png", files)}
    monkeypatch.setattr(public, "available", lambda _: known)


@pytest.fixture
def serving(httpserver):
    for name, data in CONTENT.items():
        httpserver.expect_request(f"/{name}").respond_with_data(data)
    return httpserver


@pytest.mark.parametrize("package", PACKAGES)
def test_sets_say_what_they_are_and_on_which_terms(package):
    for name, each in available(package).items():
        assert each.description.endswith(".")
        assert each.terms
        assert each.example.startswith("resample-")
        assert len({file.name for file in each.files}) == len(each.files) > 0
        for file in each.files:
            assert urlsplit(file.url).scheme == "https"
            assert len(file.digest) == 64
            assert file.size > 0
            assert os.path.basename(file.name) == file.name, name


@pytest.mark.parametrize("package", PACKAGES)
def test_a_set_lists_the_files_that_we_know(package):
    folder = os.environ.get("RESAMPLE_TEST_DATA")
    if not folder:
        pytest.skip("RESAMPLE_TEST_DATA names no folder of data")
    every = {
        hashlib.sha256(path.read_bytes()).hexdigest(): path
        for path in Path(folder).rglob("*")
        if path.is_file() and path.suffix in (".png", ".obj", ".mtl", ".md")
    }
    for each in available(package).values():
        for file in each.files:
            assert every[file.digest].stat().st_size == file.size


@pytest.mark.usefixtures("listed")
def test_a_set_is_fetched_once(serving, tmp_path):
    place = fetch("any", "tiny", folder=tmp_path, base_url=serving.url_for(""))
    assert {path.name: path.read_bytes() for path in place.iterdir()} == CONTENT
    serving.clear()
    assert fetch("any", "tiny", folder=tmp_path) == place == tmp_path / "tiny"


@pytest.mark.usefixtures("listed")
def test_another_file_is_refused(httpserver, tmp_path):
    httpserver.expect_request("/a.png").respond_with_data(b"wrong")
    with pytest.raises(ValueError, match="wrong SHA-256"):
        fetch("any", "tiny", folder=tmp_path, base_url=httpserver.url_for(""))
    assert not list(tmp_path.rglob("*.*"))


@pytest.mark.usefixtures("listed")
@pytest.mark.parametrize("package", PACKAGES)
def test_the_command_lists_sets_and_says_their_terms(
    package, serving, tmp_path, capsys, monkeypatch
):
    from importlib import import_module

    monkeypatch.chdir(tmp_path)

    app = import_module(f"{package}.cli").app
    assert ended(app, "fetch") == 0
    assert capsys.readouterr().out == "tiny  Two files.\n"
    fetch(package, "tiny", folder=tmp_path, base_url=serving.url_for(""))
    assert ended(app, "fetch", "tiny", "--folder", str(tmp_path)) == 0
    out, told = capsys.readouterr()
    assert out == f"{tmp_path / 'tiny'}\n"
    assert "tiny: free\n" in told
    assert "unknown set 'large'; known are tiny" in refused(app, capsys, "fetch", "large")


@pytest.mark.parametrize("package", PACKAGES)
def test_lists_are_as_they_are_written(package):
    from importlib.resources import files

    text = files(package).joinpath("data/public.json").read_text("utf-8")
    assert json.dumps(json.loads(text), indent=1) + "\n" == text
