"""Settings out of files from anywhere: they say how pictures look, and nothing else."""

import re
import socket
import threading
import tomllib
from functools import partial
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest
from cyclopts import App
from PIL import Image, PngImagePlugin

from resample import registry
from resample.cameras.files import viewpoint
from resample.cameras.viewpoints import NAMED, Orbit
from resample.cli import app
from resample.command import flags as abouts
from resample.command.flags import Inline, OptionTopic, about, marks_of, with_intrinsics
from resample.command.settings import OWN, Choices, options_of, read_settings
from resample.files.metadata.tags import KEY, settings_in
from resample_comparisons.texture import scenes
from resample_points.command import rendering as cloud_films
from resample_texture.command.choices import MATRIX
from resample_texture.geometry.matrices import parse_matrix
from resample_volume.classification.presets import is_file
from resample_volume.command import animation as volume_films
from resample_volume.command.choices import TRANSFER
from resample_warp3d.command import animation as depth_films
from tests import commands

BOX = "checker-box:size=8,block=4"
RENDER = ["volume", "render", BOX, "--size", "16", "-o", "box.png"]
ended, refused = partial(commands.ended, app), partial(commands.refused, app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def listener():
    """A server on this machine that counts who connects: its address, and the count."""
    server, met = socket.create_server(("127.0.0.1", 0)), []

    def listen():
        while True:
            try:
                met.append(server.accept()[0].close())
            except OSError:
                return

    threading.Thread(target=listen, daemon=True).start()
    yield f"127.0.0.1:{server.getsockname()[1]}", met
    server.close()


def picture_of(text: str, name: str = "foreign.png") -> str:
    """A picture that holds settings."""
    texts = PngImagePlugin.PngInfo()
    texts.add_text(KEY, text)
    Image.new("RGB", (2, 2)).save(name, pnginfo=texts)
    return name


def all_commands() -> list[tuple[str, App]]:
    """Names of all commands of applications that take settings, and they."""
    found = []
    for application in registry.names("apps"):
        home = import_module(f"resample_{application}.cli").app
        found += [
            (f"resample-{application} {name}", home[name])
            for name in home
            if not name.startswith("-") and "settings" in options_of(home[name])
        ]
    return found


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["png", "toml"])
@pytest.mark.parametrize(
    "attack",
    [
        'scheduler = "tcp://ADDRESS"',
        'also = ["http://ADDRESS/a.zarr"]',
        'labels = "http://ADDRESS/a.zarr"',
        'transfer = "http://ADDRESS/a.toml"',
        'camera = "http://ADDRESS/a.toml"',
        'channels = "red,http://ADDRESS/a.json"',
    ],
)
def test_a_file_with_settings_makes_nobody_connect(attack, kind, listener, capsys):
    address, met = listener
    text = f"specular = 0.5\n{attack.replace('ADDRESS', address)}\n"
    Path("foreign.toml").write_text(text)
    given = picture_of(text) if kind == "png" else "foreign.toml"
    assert ended(*RENDER, "--settings", given) == 0
    option = attack.partition(" ")[0]
    assert f"{given}: {option} left out, as settings only set a picture's look" in (
        capsys.readouterr().err
    )
    assert met == []
    assert tomllib.loads(settings_in(Path("box.png"))) == {
        "command": "resample-volume render",
        "specular": 0.5,
        "size": "16",
    }


@pytest.mark.sweep
def test_a_picture_with_settings_makes_nothing_be_written(capsys):
    Path("precious.txt").write_text("mine")
    cv2.imwrite("color.png", np.zeros((8, 8, 3), np.uint8))
    np.save("depth.npy", np.ones((8, 8)))
    written = ["stats", "export", "coverage", "depth-output", "holes", "output"]
    text = "".join(f'{option} = "precious.txt"\n' for option in written)
    foreign = picture_of(text)
    made = ["warp3d", "render", "color.png", "depth.npy", "--fov", "60", "--move", "0,0,0"]
    assert ended(*made, "--settings", foreign, "-o", "moved.png") == 0
    assert Path("precious.txt").read_text() == "mine"
    assert f"{', '.join(written)} left out" in capsys.readouterr().err
    before = sorted(Path().iterdir())
    assert ended(*made, "--settings", foreign) == 2  # what is written has to be said
    assert sorted(Path().iterdir()) == before


@pytest.mark.sweep
def test_a_file_takes_no_memory_or_processes_and_raises_no_limits(capsys):
    text = 'memory = "1KiB"\nworkers = 64\nthreads = 999\nlimit = "text=1"\nallow-outside = true\n'
    assert ended(*RENDER, "--settings", picture_of(text)) == 0
    said = capsys.readouterr().err
    assert "memory, workers, threads, limit, allow-outside left out" in said
    assert said.count("\n") == 1


@pytest.mark.some(1)
@pytest.mark.parametrize(("name", "command"), all_commands())
def test_of_all_options_files_say_the_look_alone(name, command):
    options, marks = options_of(command), marks_of(command.default_command)
    assert None not in marks.values(), "each option says what it is about"
    assert marks.keys() >= options.keys()
    beyond = [
        key
        for key, mark in marks.items()
        if mark is not OptionTopic.APPEARANCE and not isinstance(mark, Inline) and key not in OWN
    ]
    files = [key for key, mark in marks.items() if isinstance(mark, Inline)]
    text = "".join(f'{key} = "http://x/y.toml"\n' for key in (*beyond, *files))
    Path("foreign.toml").write_text(text)
    known = {key: option for key, option in options.items() if key not in OWN}
    assert read_settings(Path("foreign.toml"), name, known, marks) == {}


@pytest.mark.sweep
def test_every_model_says_what_its_options_are_about():
    all_commands()
    models, left = [], [Choices]
    while left:
        models += left[-1].__subclasses__()
        left += left.pop().__subclasses__()
    for model in models:
        if model.__module__.startswith("resample"):
            assert isinstance(model.about, OptionTopic), model


def test_values_that_say_the_look_are_never_taken_for_files():
    """Also where there is a file of that name: no reader is shown it."""
    for text in (*NAMED, "30", "1,0,0,0,1,0,0,0,1", "5,5,2,2", "bone"):
        Path(text).write_text("1 2 3")
    assert all(isinstance(viewpoint(text), Orbit) for text in NAMED)
    assert parse_matrix("1,0,0,0,1,0,0,0,1").tolist() == np.eye(3).tolist()
    assert with_intrinsics("intrinsics", "5,5,2,2", "corner").camera.matrix[0, 0] == 5
    assert not is_file("bone")


@pytest.mark.parametrize(
    ("mark", "looks", "files"),
    [
        (
            abouts.ANGLES,
            [*NAMED, "30/20", "-30/20/1.5", "1e1/.5/1./0.1/-0.2", "30,20\n", "30/20/0"],
            ["a.toml", "/etc/passwd", "images.txt:3", "30", "../30", "poses", "", "front\n"],
        ),
        (
            abouts.LENS,
            ["1,0,0", "k=0.1,0.2", "1 2\n3", "m.txt"],
            ["a.json", "A.YML", "1,2,m.xml", "1\n.toml", "k=1/a.yaml"],
        ),
        (
            MATRIX,
            ["1,0,0", "[[1, 0], [0, 1]]", "1 2\n3", "-1e-3;2", "nan"],
            ["m.txt", "1..2", "/1", "1/2", "k=1", "1,2,m.npy", "1\0"],
        ),
        (
            TRANSFER,
            ["auto", "bone:opacity=0.2+skin", "300..900", "40/red/0,90/#fff/0.5", "red,none"],
            [
                "a.json",
                "A.TOML",
                "bone+a.json",
                "red,../a.toml",
                "a.json+\nb",
                "\n/a.json",
                "a.toml ",
            ],
        ),
        (Inline(("orbit", "still")), ["orbit", "still"], ["orbits", "a.toml", "", "still\n"]),
    ],
)
def test_forms_of_values_tell_looks_from_files(mark, looks, files):
    assert [about(mark, text) for text in looks] == [OptionTopic.APPEARANCE] * len(looks)
    assert [about(mark, text) for text in files] == [OptionTopic.SOURCE] * len(files)


@pytest.mark.sweep
def test_a_long_value_is_told_from_a_file_at_once():
    for mark in (abouts.ANGLES, abouts.LENS, MATRIX, TRANSFER):
        assert about(mark, "1" * 10**6 + "/x.json") is OptionTopic.SOURCE


def test_words_of_paths_are_those_that_there_are():
    known = {
        ("texture", "compare", "scene"): (*scenes.NAMES, "1,0,0,0,1,0"),
        ("volume", "animate", "path"): volume_films.PATHS,
        ("warp3d", "animate", "path"): depth_films.PATHS,
        ("points", "animate", "path"): cloud_films.PATHS,
    }
    for (application, command, option), names in known.items():
        home = import_module(f"resample_{application}.cli").app
        mark = marks_of(home[command].default_command)[option]
        assert [about(mark, name) for name in names] == [OptionTopic.APPEARANCE] * len(names)
        assert about(mark, "poses.toml") is OptionTopic.SOURCE


def test_what_is_read_is_not_kept_which_is_said(capsys):
    Path("view.toml").write_text("azimuth = 40\n")
    words = ["--camera", "view.toml", "--ambient", "0.5", "--threads", "1"]
    assert ended(*RENDER, *words, "--save-settings", "kept.toml") == 0
    kept = {"command": "resample-volume render", "ambient": 0.5, "size": "16"}
    assert tomllib.loads(Path("kept.toml").read_text()) == kept
    assert tomllib.loads(settings_in(Path("box.png"))) == kept
    assert "kept.toml: camera not saved, as settings do not name inputs" in (
        capsys.readouterr().err
    )


@pytest.mark.sweep
def test_options_of_another_name_than_their_fields_are_kept():
    np.savetxt("cloud.xyz", np.random.default_rng(1).random((50, 3)))
    made = ["points", "render", "cloud.xyz", "--size", "16", "-o", "cloud.png", "--no-cache"]
    words = ["--color-by", "z", "--range", "0,1", "--save-settings", "kept.toml"]
    assert ended(*made, *words) == 0
    assert tomllib.loads(Path("kept.toml").read_text())["range"] == "0,1"
    assert ended(*made, "--settings", "kept.toml") == 0


def test_a_file_of_ones_own_may_say_more_where_it_is_trusted(capsys):
    Path("own.toml").write_text(
        'output = "own.png"\nstats = "own.json"\nthreads = 1\nspecular = 0.5\nlimit = "text=1"\n'
    )
    made = ["volume", "render", BOX, "--size", "16", "--settings-trusted", "own.toml"]
    assert ended(*made) == 0
    assert re.match(r"resample: own\.toml: limit left out", capsys.readouterr().err)
    assert Path("own.png").exists()
    assert Path("own.json").exists()


def test_pictures_are_not_trusted_and_one_file_is_read(capsys):
    foreign = picture_of('stats = "stats.json"\n')
    said = refused(capsys, *RENDER, "--settings-trusted", foreign)
    assert "foreign.png is a picture; trust a .toml that you wrote yourself" in said
    both = ["--settings-trusted", "a.toml", "--settings", "b.toml"]
    assert "give one of --settings and --settings-trusted" in refused(capsys, *RENDER, *both)


@pytest.mark.sweep
def test_unknown_options_are_still_refused(capsys):
    said = refused(capsys, *RENDER, "--settings", picture_of('shceduler = "tcp://x"\n'))
    assert "there is no option 'shceduler'; did you mean scheduler?" in said
