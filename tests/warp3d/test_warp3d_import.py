from pathlib import Path

import pytest

import resample_warp3d
from tests.processes import python

HEAVY = {"numba", "cv2", "OpenImageIO", "scipy", "trimesh", "matplotlib", "PIL", "av"}


def modules_after(code: str) -> set[str]:
    return set(python(f"import sys\n{code}\nprint('imported', *sys.modules)").split())


def plain_modules() -> list[str]:
    """All modules of the package but kernels, which are numba's."""
    folder = Path(resample_warp3d.__path__[0])
    names = (path.stem for path in folder.glob("*.py"))
    return sorted(f"resample_warp3d.{name}" for name in names if name != "__init__")


def test_importing_the_package_imports_no_heavy_library():
    assert modules_after("import resample_warp3d") & HEAVY == set()


@pytest.mark.sweep
@pytest.mark.parametrize(
    "words",
    [
        ["render", "--help"],
        *(
            pytest.param(words, marks=pytest.mark.sweep)
            for words in (["--help"], ["--version"], ["animate", "--help"])
        ),
    ],
)
def test_help_imports_nothing_heavy(words):
    imported = modules_after(
        "import resample_warp3d.cli, resample.command.session\n"
        f"try: resample.command.session.run(resample_warp3d.cli.app, {words})\n"
        "except SystemExit: pass"
    )
    assert imported & HEAVY == set()


@pytest.mark.sweep
def test_files_of_depth_are_imported_without_heavy_libraries():
    assert modules_after("import resample_warp3d.depth.files") & HEAVY == set()


@pytest.mark.sweep
def test_every_module_is_imported_without_heavy_libraries():
    assert modules_after(f"import {', '.join(plain_modules())}") & HEAVY == set()
