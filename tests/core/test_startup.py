"""What commands import and build before their work: all of that is time that somebody waits.

How many seconds it takes is measured by `make bench GROUPS=startup`.
"""

import subprocess
import sys
from importlib import metadata

import cv2
import numpy as np
import pytest
from cyclopts import App

from resample import registry
from resample.command.settings import Choices, options_of
from tests.commands import HEAVY, imported
from tests.processes import PATIENCE, python

BOX = "checker-box:size=16,block=4"
COMMANDS = {  # of each application one that paints
    "points": ["render", "cloud.xyz", "--size", "32", "--no-cache"],
    "texture": ["warp", "photo.png", "--matrix", "0.5,0,0,0,0.5,0"],
    "volume": ["render", BOX, "--size", "32"],
    "warp3d": ["render", "photo.png", "depth.npy", "--fov", "60", "--move", "1,0,0"],
}
UNUSED = {"cv2", "pooch", "ssl", "matplotlib", "trimesh", "PIL", "jinja2", "rich.markdown"}
UNUSED |= {
    "resample.cameras.reconstructions",
    "resample.cameras.keyframes",
    "resample.cameras.trajectories",
    "resample_zarr.metadata",
}
COUNTING = """
import cyclopts

assembled = []
assemble = cyclopts.App.assemble_argument_collection

def count(app, *args, **kwargs):
    assembled.append(app.name[0])
    return assemble(app, *args, **kwargs)

cyclopts.App.assemble_argument_collection = count
from resample_{application}.cli import app
begun = list(assembled)
try:
    app(["{command}"], exit_on_error=False, print_error=False)
except cyclopts.CycloptsError:
    pass
print("assembled", *begun, "then", *assembled)
"""


def of_all(kind: type) -> set[type]:
    """A class and all that are derived from it."""
    return {kind}.union(*map(of_all, kind.__subclasses__()))


@pytest.mark.sweep
@pytest.mark.parametrize("application", COMMANDS)
@pytest.mark.parametrize("words", [[], ["command"]], ids=["all", "one"])
def test_help_imports_neither_numpy_nor_what_finds_packages(application, words):
    command = COMMANDS[application][: len(words)]
    loaded = imported(f"resample_{application}.cli", *command, "--help")
    assert loaded & (HEAVY | {"numpy", "importlib.metadata", "email.message"}) == set()


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("application", COMMANDS)
def test_a_picture_imports_nothing_that_it_does_not_need(application, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("photo.png", np.full((16, 24), 99, np.uint8))
    np.save("depth.npy", np.full((16, 24), 2.0))
    np.savetxt("cloud.xyz", np.random.default_rng(1).random((50, 3)))
    words = [*COMMANDS[application], "-o", "out.png"]
    assert imported(f"resample_{application}.cli", *words) & UNUSED == set()
    assert (tmp_path / "out.png").exists()


@pytest.mark.sweep
@pytest.mark.parametrize("application", COMMANDS)
def test_only_the_command_that_is_asked_for_is_assembled(application):
    command = COMMANDS[application][0]
    code = COUNTING.format(application=application, command=command)
    assert set(python(code).split("assembled")[-1].split()) == {"then", command}


@pytest.mark.sweep
@pytest.mark.parametrize("application", registry.names("apps"))
def test_commands_have_settings_where_they_have_options(application):
    app = registry.load("apps", application)
    for name in app:
        command = app[name].default_command
        if name.startswith("-") or command is None:
            continue
        plain = App(name=name)
        plain.default(getattr(command, "__wrapped__", command))
        has_options = any(key != "output" for key in options_of(plain))
        assert ("settings" in options_of(app[name])) == has_options, name


def test_choices_of_which_none_is_given_are_those_that_a_check_lets_through():
    for application in COMMANDS:
        registry.load("apps", application)
    for kind in of_all(Choices) - {Choices}:
        if any(field.is_required() for field in kind.model_fields.values()):
            continue
        assert kind.usual() == kind()
        assert kind.usual().model_fields_set == set()


@pytest.mark.sweep
def test_models_are_built_when_they_are_first_given_something():
    said = python(
        "from resample_warp3d import cli\n"
        "from resample.command.settings import Choices, Written\n"
        "built = [kind.__pydantic_complete__ for kind in Choices.__subclasses__()]\n"
        "print(any(built), Written(bits='16').bits, Written.__pydantic_complete__)"
    )
    assert said.split() == ["False", "16", "True"]


@pytest.mark.sweep
def test_quadratures_are_found_when_they_are_first_used():
    python(
        "import numpy as np; np.polynomial.legendre.leggauss = None\n"
        "import resample.profiles.reconstruction, resample.profiles.interpolation"
    )


def test_packages_are_searched_once_for_all_groups(tmp_path, monkeypatch):
    search, searched = metadata.entry_points, []
    monkeypatch.setattr(metadata, "entry_points", lambda: searched.append(1) or search())
    monkeypatch.syspath_prepend(tmp_path)  # where nothing was looked for yet
    assert all(map(registry.names, registry.GROUPS))
    assert searched == [1]


def test_garbage_is_not_looked_for_in_what_imports_have_made_and_then_again():
    said = python(
        "import gc, sys\n"
        "from types import SimpleNamespace as Module\n"
        "from resample.command.stopping import start\n"
        "told = lambda: print(gc.isenabled(), gc.get_freeze_count() > 1000)\n"
        "sys.modules['told'] = Module(main=told)\n"
        "start('told')"
    )
    assert said.split() == ["True", "True"]


@pytest.mark.parametrize(("given", "found"), [(None, "1"), ("3", "3")])
def test_algebra_has_one_thread_unless_the_environment_says_more(given, found):
    said = python(
        "import os, sys; os.environ.pop('OPENBLAS_NUM_THREADS', None)\n"
        f"os.environ |= {{'OPENBLAS_NUM_THREADS': '{given}'}} if {given} else {{}}\n"
        "from types import SimpleNamespace as Module\n"
        "from resample.command.stopping import start\n"
        "sys.modules['told'] = Module(main=lambda: print(os.environ['OPENBLAS_NUM_THREADS']))\n"
        "start('told')"
    )
    assert said.split() == [found]


CYCLE = """
import resample_texture.cli as cli
from resample.command.stopping import start

def main():
    import OpenImageIO
    holder = [OpenImageIO.ROI()]
    holder.append(holder)  # freed when garbage is collected at the end, which OpenImageIO looks at

cli.main = main
start("resample_texture.cli")
"""


@pytest.mark.sweep
def test_what_a_command_leaves_in_cycles_is_freed_at_its_end():
    ended = subprocess.run(
        [sys.executable, "-c", CYCLE], capture_output=True, text=True, check=True, timeout=PATIENCE
    )
    assert "leaked" not in ended.stderr
