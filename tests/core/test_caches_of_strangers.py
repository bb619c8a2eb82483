"""Caches that others can write: they neither add words to commands nor have code run."""

import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest

from resample import registry
from resample.engine.compiled import compiling, entries
from resample.engine.compiled.entries import Entry
from resample.files.writing import load_arrays, store_arrays
from resample.reading import limits as owners
from resample.reading.limits import NotOwnError, own_bytes
from resample.samples import finding
from resample.samples.finding import CONTENTS, expanded, kept
from tests import commands
from tests.processes import python

ROOM = "sample:room:size=48"
pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no numbers of users")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder; the data folder and the user's cache are beside it."""
    monkeypatch.setenv("HYBRID_RESAMPLE_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path


@pytest.fixture
def becomes_another(monkeypatch):
    """Become another user: all files that there are belong to a stranger."""

    def change() -> None:
        monkeypatch.setattr(owners, "ROOT", -1)
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)

    return change


def rendered(*words: str) -> object:
    line = ["render", ROOM, "--size", "16", "-o", "out.png", *words]
    return commands.ended(registry.load("apps", "warp3d"), *line)


def say(*words: str, files: list[str] | None = None) -> Path:
    """Have the cache of a sample add words to `render`, or name files; its folder."""
    made = kept(ROOM)
    contents = [files or ["room.png", "room.npy"], [[["render"], words, []]]]
    (made.folder / CONTENTS).write_text(json.dumps(contents))
    return made.folder


BEYOND_THE_LOOK = [
    ("--stats", "stats.json"),
    ("--scheduler", "tcp://127.0.0.1:9"),
    ("--threads", "1"),
    ("--limit", "text=1"),
    ("--settings-trusted", "own.toml"),
    ("--lens", "lens.yml"),
    ("--source-pose", "/etc/passwd"),
    ("-o", "other.png"),
    ("--no-such-option", "1"),
]


@pytest.mark.parametrize("words", BEYOND_THE_LOOK, ids=lambda words: words[0])
def test_a_sample_adds_nothing_but_the_look_to_a_command(words, capsys):
    say(*words)
    before = sorted(Path().iterdir())
    assert rendered() == 2
    added = f"a sample adds {'='.join(words)}, which is not about the look"
    assert capsys.readouterr().err == f"resample: error: {added}\n"
    assert sorted(Path().iterdir()) == before


@pytest.mark.parametrize("name", ["../../secret.png", "/etc/passwd", "http://x/y", "link.png"])
@pytest.mark.parametrize("is_added", [False, True])
def test_files_of_a_sample_are_in_its_folder(name, is_added, folder, capsys):
    (folder / "secret.png").write_text("mine")
    made = say("--source-pose", f"FOLDER/{name}") if is_added else say(files=[name])
    (made / "link.png").symlink_to(folder / "secret.png")
    assert rendered() == 2
    said = capsys.readouterr().err
    assert f"contents.json names {name!r}" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("text", ["", "[", "[1, 2]", "{}", "[[" * 5000, '[[], ["abc"]]', "null"])
def test_a_damaged_list_of_files_is_refused_in_a_line(text, capsys):
    (kept(ROOM).folder / CONTENTS).write_text(text)
    assert rendered() == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_cache_of_another_user_is_not_used_and_the_sample_is_made_anew(becomes_another, caplog):
    say("--stats", "stats.json")
    becomes_another()
    with pytest.raises(NotOwnError):  # what is made here belongs to the same stranger
        kept(ROOM)
    told = [record.message for record in caplog.records]  # of each folder that there is
    owner = owners._name_of(os.getuid())
    assert f"belongs to {owner} and would steer your commands: it is not used" in told[0]
    assert "HYBRID_RESAMPLE_DATA may name another folder" in told[0]


@pytest.mark.parametrize("mode", [0o777, 0o722, 0o702])
def test_a_cache_that_others_may_write_is_not_used(mode, folder, caplog):
    made = say("--stats", "stats.json")
    made.chmod(mode)
    other = kept(ROOM)
    assert other.folder == folder / "cache" / "hybrid-resample" / "samples" / made.name
    assert [record.message.count("chmod go-w") for record in caplog.records] == [1]
    assert not any("--stats" in word for word in expanded(["render", ROOM]))


def test_a_list_of_files_that_others_may_write_is_not_used(folder):
    made = say("--stats", "stats.json")
    (made / CONTENTS).chmod(0o666)
    assert kept(ROOM).folder.parent == folder / "cache" / "hybrid-resample" / "samples"


def test_samples_are_kept_in_a_folder_that_people_share(folder):
    """Each user has files of his own there, which others can neither replace nor write."""
    shared = folder / "data" / "samples"
    shared.mkdir(parents=True)
    shared.chmod(0o1777)
    made = kept(ROOM).folder
    assert made.parent == shared
    assert stat.S_IMODE(made.stat().st_mode) == 0o700


def test_a_folder_that_may_only_be_read_gives_its_samples_and_takes_none(folder, monkeypatch):
    made = kept(ROOM)
    make = finding.tempfile.mkdtemp

    def refuse(**options):
        if "data" in Path(options["dir"]).parts:
            raise PermissionError("read-only")
        return make(**options)

    monkeypatch.setattr(finding.tempfile, "mkdtemp", refuse)
    assert kept(ROOM) == made
    assert kept("sample:bricks:size=64").folder.is_relative_to(folder / "cache")


def test_files_of_users_own_groups_are_their_own(tmp_path, monkeypatch):
    path = tmp_path / "file"
    path.write_text("mine")
    path.chmod(0o664)

    class Group:
        gr_name, gr_mem = owners._name_of(os.geteuid()), []

    monkeypatch.setattr(owners.grp, "getgrgid", lambda _: Group)
    assert own_bytes(path) == b"mine"
    Group.gr_mem = ["another"]
    with pytest.raises(NotOwnError, match="others may write"):
        own_bytes(path)


def test_links_and_large_files_are_not_read(tmp_path, monkeypatch):
    path = tmp_path / "file"
    path.write_text("mine")
    (tmp_path / "link").symlink_to(path)
    with pytest.raises(OSError, match="link"):
        own_bytes(tmp_path / "link")
    monkeypatch.setenv("RESAMPLE_LIMIT", "tree=3")
    with pytest.raises(ValueError, match="over the limit"):
        own_bytes(path, "tree")


@pytest.mark.parametrize("of", ["folder", "file"])
def test_kernels_that_others_may_write_are_neither_loaded_nor_kept(of, tmp_path, caplog):
    caplog.set_level("INFO", "resample")
    path, entry = tmp_path / "kernels" / "a.kernel", Entry("a", "q", [], 1.0, b"a pickle")
    entries.write(path, entry)
    assert entries.read(path) == entry
    (path if of == "file" else path.parent).chmod(0o777)
    assert entries.read(path) is None
    assert path.exists()
    (told,) = [record.message for record in caplog.records]
    assert "would steer your commands, and others may write to it (chmod go-w)" in told
    assert "set NUMBA_CACHE_DIR" in told
    entries.write(path.with_name("b.kernel"), entry)
    assert path.with_name("b.kernel").exists() == (of == "file")


def test_kernels_of_another_user_are_not_loaded(tmp_path, becomes_another):
    path = tmp_path / "kernels" / "a.kernel"
    entries.write(path, Entry("a", "q", [], 1.0, b"a pickle"))
    becomes_another()
    assert entries.read(path) is None


def test_facts_that_others_may_write_are_found_anew(tmp_path, caplog):
    path, values = tmp_path / "facts" / "a.npz", {"value": np.arange(3)}
    assert store_arrays(path, values, 1 << 20)
    assert not stat.S_IMODE(path.stat().st_mode) & 0o022
    assert load_arrays(path, "value") is not None
    path.parent.chmod(0o777)
    assert load_arrays(path, "value") is None
    assert "HYBRID_RESAMPLE_CACHE may name another folder" in caplog.text
    assert not store_arrays(path, values, 1 << 20)
    assert load_arrays(path, "value", is_beside=True) is not None  # as trusted as the data


def test_a_file_of_numbas_in_the_working_folder_does_not_say_where_kernels_are(monkeypatch):
    """It may have been unpacked with the data, kernels that are pickles beside it."""
    Path(".numba_config.yaml").write_text("cache_dir: planted\n")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    asked = "from resample.engine.compiled import compiling\nprint(compiling.folder())"
    assert python(asked).strip() == str(compiling.folder())
    assert "planted" not in str(compiling.folder())
