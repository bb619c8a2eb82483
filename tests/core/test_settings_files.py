import json
import tomllib
from functools import partial
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO
import pytest

from resample import registry
from resample.cli import app
from resample.command.applications import command_now
from resample.command.flags import OptionTopic, marks_of
from resample.command.settings import as_toml, options_of, read_settings
from resample.files.images import read_channels
from resample.files.metadata.tags import settings_in, state, stating
from tests import commands

BOX = "checker-box:size=16,block=4"
RENDER = ["volume", "render", BOX, "--size", "32"]
LOOK = ["--camera=-40/10/1.5", "--no-shading", "--clip", "1/0/-1", "--clip=-1/0/0/2", "--bits", 16]
EYE = ["--intrinsics", "20,20,16,12", "--depth-scale", "1000"]
MOVED = ["--move=-0.2,0,0", "--method", "mcmillan-zbuffer", "--holes", "holes.png"]
CHANGED = ["--matrix=0.5,0.1,3,0,0.5,0", "--edge", "mirror", "--no-linear", "--bits", "16"]
FILMED = ["--frames", "2", "--size", "24", "--background", "white"]
KEPT = {  # inputs, and what is kept
    "volume render": ([BOX], ["--size", "32", *LOOK]),
    "volume animate": ([BOX], [*FILMED, "--fps", "12.5"]),
    "texture warp": (["color.png"], CHANGED),
    "texture resize": (["color.png"], ["--size", "50%"]),
    "texture animate": (["color.png"], [*FILMED, "--path", "turn"]),
    "warp3d render": (["color.png", "depth.png"], [*EYE, *MOVED]),
    "warp3d animate": (["color.png", "depth.png"], [*EYE, "--frames", "2", "--path", "orbit"]),
}
ended, refused = partial(commands.ended, app), partial(commands.refused, app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, rng):
    """The working folder, with color.png and depth.png in it."""
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("color.png", rng.integers(0, 256, (24, 32, 3), np.uint8))
    cv2.imwrite("depth.png", np.full((24, 32), 2000, np.uint16))


def holding(text: str) -> list[str]:
    """Words that give a settings file of this text."""
    Path("view.toml").write_text(text)
    return ["--settings", "view.toml"]


@pytest.mark.some(2)
@pytest.mark.parametrize("command", KEPT)
def test_a_picture_of_kept_settings_has_the_same_bits(command):
    inputs, words = KEPT[command]
    suffix = "gif" if "animate" in command else "png"
    made = [*command.split(), *inputs]
    first, again = (["-o", f"{name}.{suffix}"] for name in ("first", "again"))
    assert ended(*made, *words, *first, "--save-settings", "view.toml") == 0
    Path("holes.png").unlink(missing_ok=True)
    assert ended(*made, "--settings", "view.toml", *again) == 0
    assert Path(first[1]).read_bytes() == Path(again[1]).read_bytes()
    assert not Path("holes.png").exists()  # what else was written is not kept


@pytest.mark.sweep
@pytest.mark.parametrize("suffix", ["png", "exr"])
@pytest.mark.parametrize("command", ["volume render", "texture warp", "warp3d render"])
def test_pictures_hold_the_settings_they_were_made_with(command, suffix):
    inputs, words = KEPT[command]
    made = [*command.split(), *inputs]
    words = [word for word in words if suffix == "png" or word not in ("--bits", "16", 16)]
    assert ended(*made, *words, "-o", f"first.{suffix}", "--save-settings", "view.toml") == 0
    kept = tomllib.loads(settings_in(Path(f"first.{suffix}")))
    assert kept == tomllib.loads(Path("view.toml").read_text())
    assert ended(*made, "--settings", f"first.{suffix}", "-o", f"again.{suffix}") == 0
    first, again = (read_channels(f"{name}.{suffix}") for name in ("first", "again"))
    assert first.keys() == again.keys()
    for name in first:  # not byte by byte, as EXR tells when it was written
        np.testing.assert_array_equal(first[name], again[name])


def test_settings_in_pictures_are_of_any_letters():
    spec = OpenImageIO.ImageSpec(2, 2, 3, "uint8")
    with stating(as_toml("command", {"a": "façade 😀"})):
        state(spec, Path("box.png"))
    target = OpenImageIO.ImageOutput.create("box.png")
    target.open("box.png", spec)
    target.write_image(np.zeros((2, 2, 3), np.uint8))
    target.close()
    assert tomllib.loads(settings_in(Path("box.png")))["a"] == "façade 😀"


@pytest.mark.sweep
def test_other_pictures_hold_no_settings(capsys):
    told = refused(capsys, *RENDER, "--settings", "color.png", "-o", "box.png")
    assert told.strip().endswith(
        "give a PNG or EXR that these commands have written, or a .toml file"
    )
    Path("cut.exr").write_bytes(b"no picture")
    assert "cut.exr is not a picture" in refused(
        capsys, *RENDER, "--settings", "cut.exr", "-o", "box.png"
    )
    assert "no such file" in refused(capsys, *RENDER, "--settings", "none.png", "-o", "box.png")


@pytest.mark.sweep
def test_what_differs_from_the_defaults_is_kept():
    words = [*LOOK, "--ambient", "0.3", "--depth-cue", "0.5", "--stats", "stats.json"]
    assert ended(*RENDER, *words, "-o", "box.png", "--save-settings", "view.toml") == 0
    assert tomllib.loads(Path("view.toml").read_text()) == {
        "command": "resample-volume render",
        "camera": "-40/10/1.5",
        "shading": False,
        "clip": ["1/0/-1", "-1/0/0/2"],
        "depth-cue": 0.5,
        "size": "32",
        "bits": 16,
    }


@pytest.mark.sweep
def test_the_command_line_goes_before_the_file():
    given = holding('size = "24"\nbits = 16\nclip = ["1/0/0"]\n')
    made = ["volume", "render", BOX, *given, "--size", "16", "--clip", "0/0/1"]
    assert ended(*made, "-o", "box.png", "--save-settings", "both.toml") == 0
    kept = {"command": "resample-volume render", "size": "16", "bits": 16, "clip": ["0/0/1"]}
    assert tomllib.loads(Path("both.toml").read_text()) == kept
    assert cv2.imread("box.png", cv2.IMREAD_UNCHANGED).shape == (16, 16, 3)


@pytest.mark.some(5)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('camra = "1/2/3"', "there is no option 'camra'; did you mean camera?"),
        ("volume = 1", "there is no option 'volume'; --help lists what there is"),
        ('settings = "view.toml"', "there is no option 'settings'"),
        ("camera = 30", "camera: Input should be a valid string"),
        ('shading = "yes"', "shading: Input should be a valid boolean"),
        ('specular = "1"', "specular: Input should be a valid number"),
        ("specular = -1", "specular: Input should be greater than or equal to 0"),
        ("specular = 2020-01-01", "specular: no option takes a date"),
        ("bits = 12", "bits: Input should be 8, 16 or 32"),
        ("clip = [1]", "clip: "),
        ("[camera]\nazimuth = 3", "camera: Input should be a valid string"),
        ('command = "resample-volume animate"', "these are settings of 'resample-volume animate'"),
        ("command = 3", "these are settings of 3; give some of 'resample-volume render'"),
        ("size = 3 = 4", "line 1"),
        (f"size = {'[' * 9999}", "view.toml: "),
        (f"size{'.a' * 2999} = 1", "view.toml: "),
    ],
)
def test_files_that_are_no_settings_of_a_command_are_refused(capsys, text, said):
    error = refused(capsys, *RENDER, *holding(text), "-o", "box.png")
    assert "view.toml: " in error
    assert said in error


@pytest.mark.sweep
def test_a_file_that_is_missing_or_no_text_is_refused(capsys):
    words = [*RENDER, "-o", "box.png", "--settings"]
    assert "none.toml: No such file" in refused(capsys, *words, "none.toml")
    Path("bytes.toml").write_bytes(b"\x89PNG\xff")
    assert "bytes.toml is not a text" in refused(capsys, *words, "bytes.toml")


@pytest.mark.sweep
def test_settings_are_kept_in_a_file_of_their_own(capsys):
    words = [*RENDER, "-o", "box.png", "--save-settings"]
    assert "box.png cannot be written twice" in refused(capsys, *words, "box.png")
    assert "none/view.toml" in refused(capsys, *words, "none/view.toml")


@pytest.mark.sweep
def test_a_run_that_fails_keeps_no_settings(capsys):
    words = ["--transfer", "none", "-o", "box.png", "--save-settings", "view.toml"]
    assert "none" in refused(capsys, *RENDER, *words)


@pytest.mark.parametrize("text", ['a "b" \\ c', "a\nb\t\x7f\x00", "é 😀", "C:\\new"])
def test_texts_are_read_as_they_were_written(text):
    assert tomllib.loads(as_toml(text, {"size": text})) == {"command": text, "size": text}


@pytest.mark.sweep
@pytest.mark.parametrize("application", registry.names("apps"))
def test_the_schema_of_every_command_knows_its_options(application, capsys):
    commands_of = import_module(f"resample_{application}.cli").app
    for name in [name for name in commands_of if not name.startswith("-")]:
        assert ended("schema", f"resample-{application}", name) == 0
        schema = commands.strict_json(capsys.readouterr().out)
        _, command = command_now(application, name)
        marks = marks_of(command.default_command)
        known = {key for key in options_of(command) if marks[key] is not OptionTopic.TRUST}
        assert set(schema["properties"]) == known | {"command"}


def test_the_schema_tells_types_limits_defaults_and_what_options_are(capsys):
    assert ended("schema", "resample-volume", "render") == 0
    option = json.loads(capsys.readouterr().out)["properties"]
    specular = {"type": "number", "minimum": 0, "default": 0.2}
    described = {"description": "Strength of specular highlights.", "about": "look"}
    assert option["specular"] == specular | described
    assert option["scheduler"]["about"] == "target"
    assert option["bits"]["enum"] == [8, 16, 32]
    assert option["command"] == {"const": "resample-volume render"}


def test_the_schema_of_an_unknown_command_lists_the_known_ones(capsys):
    error = refused(capsys, "schema", "resample-volume", "rendr")
    assert "no command 'rendr'; it has render, animate, view" in error
    assert "'volum'" in refused(capsys, "schema", "volum", "render")


def test_options_read_are_those_of_the_file():
    path = Path("view.toml")
    path.write_text('\ufeffsize = "24"\nfov = 0\n', encoding="utf-8")
    render = import_module("resample_volume.cli").app["render"]
    options, marks = options_of(render), marks_of(render.default_command)
    read = read_settings(path, "resample-volume render", options, marks)
    assert read == {"size": "24", "fov": 0}
