"""Without the packages of plugins/ everything else works, and what is missing names its package."""

import subprocess
import sys
from importlib import import_module
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

import resample_gradients
from resample import registry
from resample_volume.cli import app
from tests.commands import ended, refused
from tests.processes import PATIENCE

ROOT = Path(__file__).parents[2]
# Python that hides the packages of plugins/, and runs a command line.
ALONE = """
import sys
from importlib import metadata

search = metadata.distributions
metadata.distributions = lambda **choice: (
    found for found in search(**choice) if not found.name.startswith("hybrid-resample-")
)
apart = "cells chunks comparisons dropins figures formats gradients labels meshes particles"
for name in (*apart.split(), "sky", "zarr"):
    sys.modules["resample_" + name] = None
from {module} import main
main()
"""
MISSING = [
    ("resample-texture compare sample:bricks", "command 'texture.compare'", "comparisons"),
    (
        "resample-texture resize sample:bricks a.png --size 9 --method cubic",
        "'cubic'",
        "comparisons",
    ),
    (
        "resample-texture resize sample:bricks a.png --size 9 --method majority",
        "'majority'",
        "labels",
    ),
    ("resample-volume compare checker-box", "command 'volume.compare'", "comparisons"),
    ("resample-volume figures", "command 'volume.figures'", "figures"),
    ("resample-volume render checker-box --method ewa -o a.png", "primitive 'ewa'", "comparisons"),
    ("resample-volume render checker-box --order axis-sheets -o a.png", "order", "comparisons"),
    ("resample-warp3d compare sample:room", "command 'warp3d.compare'", "comparisons"),
    ("resample-warp3d render sample:room --method mcmillan -o a.png", "method", "comparisons"),
    ("resample-texture mesh sample:knot -o a.png", "command 'texture.mesh'", "meshes"),
    ("resample-texture view sample:knot", "page 'texture.mesh'", "meshes"),
    ("resample-points density sample:halo -o a.png", "command 'points.density'", "particles"),
    ("resample-volume convert checker-box a.zarr", "command 'volume.convert'", "zarr"),
    ("resample-volume info s3://a/b.zarr", "reader 'zarr'", "zarr"),
    ("resample-texture resize sample:bricks a.zarr --size 20", "store 'zarr'", "zarr"),
    ("resample-texture resize s3://a/b.zarr a.png --size 20", "store 'zarr'", "zarr"),
    ("resample-points compare sample:knot-gaussians", "command 'points.compare'", "comparisons"),
]
WORK = [
    "resample plugins methods",
    "resample compare sample:bricks -R sample:test-card",
    "resample-points render sample:knot-points --size 32 -o a.png",
    "resample-texture resize sample:bricks a.png --size 20",
    "resample-texture --help",
    "resample-volume render checker-box:size=16,block=4 --size 32 -o a.png",
    "resample-warp3d render sample:room:size=66 --fill -o a.png",
]


def alone(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command line where no package of plugins/ is installed."""
    program, *words = line.split()
    module = "resample.cli" if program == "resample" else f"{program.replace('-', '_')}.cli"
    return subprocess.run(
        [sys.executable, "-c", ALONE.format(module=module), *words],
        cwd=folder, capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip


@pytest.mark.some(4)
@pytest.mark.parametrize(("line", "part", "package"), MISSING)
def test_what_is_missing_names_its_package_in_a_line(line, part, package, tmp_path):
    refused = alone(line, tmp_path)
    assert part in refused.stderr
    assert f"pip install hybrid-resample-{package}\n" in refused.stderr
    assert refused.stderr.startswith("resample: error: ")
    assert (refused.stderr.count("\n"), refused.stdout, refused.returncode) == (1, "", 2)
    assert not list(tmp_path.iterdir())


def test_a_mistyped_command_is_told_without_them(tmp_path):
    refused = alone("resample-volume comparee checker-box", tmp_path)
    known = 'resample: error: Unknown command "comparee". Did you mean "compare"?\n'
    assert (refused.stderr, refused.returncode) == (known, 2)


@pytest.mark.parametrize("name", ["a.h5", "a.mrc.gz"])
def test_a_file_of_another_format_names_the_package_that_reads_it(name, tmp_path):
    (tmp_path / name).write_bytes(b"something")
    refused = alone(f"resample-volume info {name}", tmp_path)
    assert "pip install hybrid-resample-formats\n" in refused.stderr
    assert (refused.stderr.count("\n"), refused.stdout, refused.returncode) == (1, "", 2)


@pytest.mark.parametrize("name", ["a.vtu", "a.vtk"])
def test_a_file_of_cells_names_the_package_that_reads_it(name, tmp_path):
    head = "# vtk DataFile Version 3.0\ncells\nASCII\nDATASET UNSTRUCTURED_GRID\n"
    (tmp_path / name).write_text(head if name == "a.vtk" else "<VTKFile/>")
    refused = alone(f"resample-volume info {name}", tmp_path)
    assert "pip install hybrid-resample-cells" in refused.stderr
    assert (refused.stderr.count("\n"), refused.stdout, refused.returncode) == (1, "", 2)


def test_a_store_names_the_package_that_reads_it(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "zarr.json").touch()
    for line in ("resample-volume info a", "resample-texture resize a b.png --size 20"):
        refused = alone(line, tmp_path)
        assert "pip install hybrid-resample-zarr" in refused.stderr
        assert (refused.stderr.count("\n"), refused.stdout, refused.returncode) == (1, "", 2)


@pytest.mark.some(2)
@pytest.mark.parametrize(
    "line", ["render a.hdf5 -o a.png", "animate a.hdf5 -o a", "info a.hdf5", "view a.hdf5"]
)
def test_a_snapshot_names_the_package_that_maps_it(line, tmp_path):
    (tmp_path / "a.hdf5").touch()
    refused = alone(f"resample-points {line}", tmp_path)
    assert "pip install hybrid-resample-particles\n" in refused.stderr
    assert (refused.stderr.count("\n"), refused.stdout, refused.returncode) == (1, "", 2)
    assert [path.name for path in tmp_path.iterdir()] == ["a.hdf5"]


@pytest.mark.parametrize(("old", "name"), [("differentiable", "LinearWarp"), ("torch", "warp")])
def test_modules_of_another_package_keep_their_old_names_and_name_it(old, name, monkeypatch):
    module = import_module(f"resample_texture.{old}")
    if old == "differentiable":
        assert module.LinearWarp is resample_gradients.LinearWarp

    def absent(_):
        raise ModuleNotFoundError("no module", name="resample_gradients")

    monkeypatch.setattr("resample.lazy.import_module", absent)
    with pytest.raises(ModuleNotFoundError) as caught:
        getattr(module, name)
    assert str(caught.value).endswith("not installed: pip install hybrid-resample-gradients")


@pytest.mark.parametrize("name", ["ndimage", "opencv", "scikit"])
def test_drop_ins_keep_their_old_names_and_these_name_their_package(name, monkeypatch):
    old, new = f"resample_texture.like.{name}", f"resample_dropins.{name}"
    assert import_module(old) is import_module(new)

    def absent(_):
        raise ModuleNotFoundError("no module", name="resample_dropins")

    monkeypatch.setattr("resample.lazy.import_module", absent)
    monkeypatch.delitem(sys.modules, old)
    with pytest.raises(ModuleNotFoundError) as caught:
        import_module(old)
    assert str(caught.value) == (
        f"{new} is in hybrid-resample-dropins, which is not installed: "
        "pip install hybrid-resample-dropins"
    )


@pytest.mark.some(3)
@pytest.mark.parametrize("line", WORK)
def test_all_else_works(line, tmp_path):
    done = alone(line, tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("application", registry.names("apps"))
def test_a_list_of_commands_says_of_an_added_one_what_it_says_itself(application):
    app = registry.load("apps", application)
    for name in registry.names("commands"):
        owner, _, command = name.partition(".")
        if owner == application:
            listed = app._get_item(command).help
            assert str(registry.load("commands", name).__doc__).startswith(listed.rstrip("."))


def thrice(word: str, *, more: int = 1) -> None:
    """Print a word three times."""
    sys.stdout.write(f"{word * 3 * more}\n")


def test_a_command_of_any_package_runs_beside_those_of_an_application(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    fake = EntryPoint("volume.thrice", "package:thrice", "resample.commands")
    monkeypatch.setattr(registry, "entry_points", EntryPoints([fake]).select)
    monkeypatch.setattr(EntryPoint, "load", lambda _: thrice)
    monkeypatch.setattr(app, "_commands", dict(app._commands))
    assert ended(app, "thrice", "no", "--more", "2", "--memory", "1GiB") == 0
    assert capsys.readouterr().out == "nononononono\n"
    assert ended(app, "thrice", "-h") == 0
    assert "Usage: resample-volume thrice" in capsys.readouterr().out
    assert 'Unknown command "twice"' in refused(app, capsys, "twice")
