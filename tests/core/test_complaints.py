"""Mistakes on command lines: one line that says what to do."""

from pathlib import Path

import numpy as np
import pytest

from resample import registry
from resample.calling import NAMES
from resample.cli import app as core
from resample.command import usage_errors
from resample.command.usage_errors import meant, with_own_pip
from tests.commands import ended, refused

APPS = {"resample": core} | {name: registry.load("apps", name) for name in registry.names("apps")}


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.png", "a.ply"):
        Path(name).write_bytes(b"")


def said(capsys, application, *words):
    return refused(APPS[application], capsys, *words).removeprefix("resample: error: ").rstrip()


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("words", "option"),
    [
        ("volume render checker-box -o a.png --colormap hot", "--transfer"),
        ("volume render checker-box -o a.png --cmap=hot", "--transfer"),
        ("points render a.ply -o a.png --cmap hot", "--colormap"),
        ("points render a.ply -o a.png --transfer hot", "--colormap"),
        ("volume render checker-box -o a.png --bg white", "--background"),
        ("volume render checker-box -o a.png --width 300", "--size"),
        ("volume render checker-box -o a.png --res 300", "--size"),
        ("texture scale a.png b.png --factor 2 --width 300", "--factor"),
        ("volume render checker-box -o a.png --field-of-view 30", "--fov"),
        ("volume render checker-box -o a.png --jobs 3", "--threads"),
        ("volume render checker-box --out a.png", "--output"),
        ("points animate a.ply -o a.gif --framerate 30", "--fps"),
        ("points render a.ply -o a.png --point-radius 3", "--point-size"),
        ("texture warp a.png -o b.jpg --matrix 1,0,0,0,1,0 --filequality 3", "--file-quality"),
        ("volume render checker-box -o a.png --voxel-size 1", "--spacing"),
        ("warp3d render a.png b.png -o c.png --camera-matrix 1,1,1,1", "--intrinsics"),
    ],
)
def test_an_option_of_other_programs_is_taken_for_ours(words, option, capsys):
    assert said(capsys, *words.split()).endswith(f". Did you mean {option}?")


@pytest.mark.sweep
def test_an_option_that_is_like_none_names_the_help(capsys):
    line = said(capsys, *["volume", "render", "checker-box", "-o", "a.png", "--fps", "3"])
    assert line == "Unknown option: --fps. resample-volume render --help lists all."


@pytest.mark.parametrize("command", ["points density", "texture mesh"])
def test_a_command_of_another_package_is_named_as_users_write_it(command, capsys):
    line = said(capsys, *command.split(), "sample:knot")
    assert line.startswith(f"resample-{command} needs --output (-o): ")


@pytest.mark.sweep
def test_every_synonym_leads_to_an_option_of_some_command():
    options = {
        name.removeprefix("--")
        for app in APPS.values()
        for command in app
        if not command.startswith("-")
        for argument in app[command].assemble_argument_collection()
        for name in argument.names
    }
    known = {name.replace("-", "_") for name in options}
    alike = {one for _, names in NAMES.values() for one in names.split()}
    assert alike <= known
    arguments = {
        "matrix",
        "source",
        "target",
        "world_to_camera",
        "xyz",
        "scene",
        "position",
        "distortion",
    }
    arguments |= {"new_matrix", "rotation", "scale", "opacity", "normal", "shape", "colors"}
    same = {one for names, _ in NAMES.values() for one in names.split()}
    assert same <= known | arguments


def test_settings_files_have_the_same_synonyms(tmp_path, capsys):
    (tmp_path / "look.toml").write_text('cmap = "hot"\n')
    words = "volume render checker-box -o a.png --settings look.toml"
    assert said(capsys, *words.split()).endswith(
        "there is no option 'cmap'; did you mean transfer?"
    )


def test_the_first_option_that_a_command_has_is_meant():
    assert meant("cmap", ["transfer", "colormap"]) == "colormap"
    assert meant("cmap", ["transfer", "size"]) == "transfer"
    assert meant("cmap", ["size"]) is None


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            "volume render checker-box",
            "resample-volume render needs --output (-o): .png, .jpg, .tif, or .exr with linear "
            "RGBA, depth (Z) and coverage; resample-volume render -h shows examples",
        ),
        ("volume render checker-box a.png", "needs --output; did you mean -o a.png?"),
        ("volume render checker-box -o", "-o needs a value: .png, .jpg, .tif, or .exr with"),
        ("volume render", "resample-volume render needs VOLUME; resample-volume render -h shows"),
        ("texture rotate a.png b.png", "resample-texture rotate needs --degrees: Counterclockwise"),
        ("volume render a.png -o b.png --camera", "--camera needs a value: Viewpoint: azimuth,"),
        ("volume render a b -o c.png", "'b': resample-volume render takes VOLUME; options begin"),
    ],
)
def test_what_is_missing_or_too_much_is_named_with_what_to_do(words, line, capsys):
    assert line in said(capsys, *words.split())


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "words",
    [
        "volume render enigne.nhdr -o a.png",
        "volume info enigne.nhdr",
        "points render enigne.nhdr -o a.png",
        "texture mesh enigne.nhdr -o a.png",
        "texture warp enigne.nhdr --matrix 1,0,0,0,1,0 -o a.png",
        "warp3d render enigne.nhdr b.png --fov 60 --move 1,0,0 -o a.png",
        "resample compare enigne.nhdr -R enigne.nhdr",
        "resample view enigne.nhdr",
    ],
)
def test_a_missing_file_is_complained_of_with_near_names(words, tmp_path, capsys):
    (tmp_path / "engine.nhdr").write_text("")
    assert said(capsys, *words.split()).endswith("there is no such file; did you mean engine.nhdr?")


def test_a_missing_folder_of_a_missing_file_is_named(capsys):
    line = said(capsys, "volume", "render", "scans/a.nrrd", "-o", "a.png")
    assert line == "scans/a.nrrd: there is no such file; there is no folder scans either"


@pytest.mark.sweep
def test_a_folder_where_a_file_is_wanted_names_files_in_it(tmp_path, capsys):
    (tmp_path / "scans").mkdir()
    line = said(capsys, "points", "render", "scans", "-o", "a.png")
    assert line == "scans: is a folder; give a file in it (it holds none)"
    (tmp_path / "scans" / "a.ply").write_text("")
    line = said(capsys, "points", "render", "scans", "-o", "a.png")
    assert line == "scans: is a folder; give a file in it, such as scans/a.ply"


@pytest.mark.some(2)
@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            "volume render mixed -o a.png",
            "mixed holds files of .dcm and .png; give one of them, or a folder with files of one "
            "kind",
        ),
        (
            "volume render empty -o a.png",
            "empty holds no slices; give a folder of .dcm, .tif, .png or .jpg files, or a file",
        ),
        (
            "volume render checker-box --mesh mixed -o a.png",
            "mixed: is a folder; give a file in it, such as mixed/a.dcm",
        ),
        (
            "texture warp empty --matrix 1,0,0,0,1,0 -o out",
            "empty: no pictures found; give files, a folder that holds some, or a quoted pattern "
            "such as 'photos/*.jpg'",
        ),
    ],
)
def test_folders_that_hold_too_much_or_too_little_say_what_to_give(words, line, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    (tmp_path / "mixed").mkdir()
    for name in ("a.dcm", "a.png"):
        (tmp_path / "mixed" / name).write_text("")
    assert said(capsys, *words.split()) == line


@pytest.mark.parametrize("name", ["notes.docx", "folder"])
def test_what_no_application_shows_is_refused_with_what_they_show(name, tmp_path, capsys):
    (tmp_path / "notes.docx").write_text("")
    (tmp_path / "folder").mkdir()
    line = said(capsys, "resample", "view", name)
    assert line == (
        f"{name}: no application shows this; give a picture, a mesh, a volume, a point cloud, or a "
        "picture and its depth"
    )


def test_names_of_files_keep_one_line(tmp_path, capsys):
    (tmp_path / "engine\n.nhdr").write_text("")
    assert ended(APPS["volume"], "render", "engin.nhdr", "-o", "a.png") == 2
    assert capsys.readouterr().err.endswith("did you mean engine\\n.nhdr?\n")


@pytest.mark.parametrize(
    ("pip", "python", "told"),
    [
        ("a/bin/pip", "a/bin/python", "pip install x"),
        ("other/bin/pip", "a/bin/python", "a/bin/python -m pip install x"),
        (None, "a/bin/python", "a/bin/python -m pip install x"),
        ("other/bin/pip", "/b/bin/python", "/b/bin/python -m pip install x"),
    ],
)
def test_what_is_to_be_installed_is_so_for_the_python_that_runs(
    pip, python, told, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.executable", str(tmp_path / python))
    monkeypatch.setattr(usage_errors, "which", lambda _: pip and str(tmp_path / pip))
    assert with_own_pip("vtk is missing; pip install x") == f"vtk is missing; {told}"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("volume render none.nrrd --bogus 3 -o a.png", "none.nrrd: there is no such file"),
        ("texture warp none.png -o a.png", "none.png: there is no such file"),
        ("volume render checker-box --camera none.json:3 -o a.png", "none.json: there is no such"),
        ("volume render checker-box --camera 30 20 -o a.png", "joined by commas: 30,20"),
        ("warp3d render given.npy a.png --fov 60 --move 0.1,0,0 -o b.png", "a.png given.npy"),
        ("warp3d stereo given.npy a.png -o b.png", "give the picture first, then its depth"),
        ("volume given.npy", "given.npy is a file; give a command before it, such as"),
        ("resample given.npy", "given.npy is a file; give a command before it, such as"),
    ],
)
def test_files_come_first(words, line, capsys, tmp_path):
    (tmp_path / "given.npy").write_bytes(b"")
    assert line in said(capsys, *words.split())


def test_an_option_that_is_a_command_is_answered_with_the_command(capsys):
    line = said(capsys, *["texture", "resize", "a.png", "b.png", "--scale", "0.5"])
    assert line.endswith("Did you mean --size? There is a command resample-texture scale, too.")


MISTAKES = {
    "texture resize ct.nrrd --size 20 -o a.png": "resample-volume reads such files",
    "texture resize photo.txt --size 20 -o a.png": "no format of pictures",
    "texture resize photo.jpg 200x100 -o a.png": "200x100 is taken for a file",
    "texture warp photo.jpg --matrix none.txt -o a.png": "there is no such file",
    "volume render scan.ply -o a.png": "resample-points reads such files",
    "volume render engine.nhdr --window 400 -o a.png": "a center and a width, 40,400",
    "volume render engine.nhdr --transfer bones -o a.png": "did you mean 'bone'?",
    "volume render ct.nrrd --opacity 0.5 -o a.png": "gray:opacity=0.2",
    "points render ct.nrrd -o a.png": "resample-volume reads such files",
    "points render xyz.npy -o a.png": "numpy.savetxt",
    "warp3d render photo.jpg depht.png --fovv 60 -o a.png": "did you mean depth.png",
    "warp3d render photo.jpg left.png --fov 60 --move 1,0,0 -o a.png": "the picture first",
    "warp3d render photo.jpg depth.png --depth-scale 1000 --fov 60 --pose H.txt -o a.png": "3 x 3",
}


@pytest.mark.parametrize(("words", "line"), MISTAKES.items())
def test_mistakes_have_remedies(words, line, capsys, tmp_path, monkeypatch):
    from tests import printed

    monkeypatch.chdir(tmp_path)
    for name in (
        "photo.jpg",
        "depth.png",
        "scan.ply",
        "ct.nrrd",
        "H.txt",
        "engine.nhdr",
        "left.png",
    ):
        printed.make(name)
    (tmp_path / "photo.txt").write_text("a text\n")
    np.save("xyz.npy", np.zeros((9, 3)))
    assert line in said(capsys, *words.split())


def test_results_that_show_nothing_are_told(capsys, tmp_path, monkeypatch):
    from tests import printed

    monkeypatch.chdir(tmp_path)
    for name in ("photo.jpg", "depth.png", "scan.ply"):
        printed.make(name)
    np.save("flat.npy", np.zeros((8, 8, 8), np.float32))
    for words, line in {
        "volume render flat.npy --size 16 -o a.png": "all values of flat are 0",
        "volume render checker-box --transfer 5..9 --size 16 -o a.png": "its values go from",
        "points render scan.ply --range 5000..9000 --color-by x --size 16 -o a.png": "no value;",
        "warp3d stereo photo.jpg depth.png --fraction 0 -o a.png": "both pictures are the same",
        "points render scan.ply --colormap hot --size 16 -o a.png": "choose one by --color-by",
        "texture rectify photo.jpg --corners 0,0;1,0;1,1;0,1 -o a.png": "not shares",
        "volume render checker-box --fov 1.04 --size 16 -o a.png": "if radians are meant",
    }.items():
        application, *rest = words.split()
        assert ended(APPS[application], *rest) == 0
        assert line in capsys.readouterr().err, words


def test_a_command_of_an_application_is_found(capsys):
    line = said(capsys, "resample", "resize", "a.png")
    assert line == '"resize" is a command of resample-texture'
