"""An outside package with one class and one entry-point line is found by everything."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import PATIENCE

PYPROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "outside-filters"
version = "1.0"

[project.entry-points."resample.filters"]
hann = "outside_filters:Hann"
broken = "outside_filters:Missing"
"""

MODULE = '''
import numpy as np

class Hann:
    """A raised cosine."""
    def __init__(self, width=2.0):
        if not width > 0:
            raise ValueError(f"width is a positive number of pixels, not {width}")
        self.radius = width / 2
    def __call__(self, distance):
        return 0.5 + 0.5 * np.cos(np.pi * distance / self.radius)
'''

has_application = importlib.util.find_spec("resample_volume.cli") is not None


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """Folder into which the package was built and installed, without a package index."""
    source = tmp_path_factory.mktemp("source")
    target = tmp_path_factory.mktemp("site")
    (source / "pyproject.toml").write_text(PYPROJECT)
    (source / "outside_filters.py").write_text(MODULE)
    uv = Path(sys.executable).parent / "uv"
    if uv.exists() and importlib.util.find_spec("hatchling"):
        command = [uv, "pip", "install", "-q", "--offline", "--no-deps", "--no-build-isolation"]
        command += ["--python", sys.executable, "--target", target, source]
        subprocess.run(command, check=True, timeout=PATIENCE)
    else:
        pytest.skip("needs uv and hatchling, as `make test` installs them")
    return target


def command(installed: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )


def resample(installed: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return command(installed, "-c", "from resample.cli import main; main()", *words)


@pytest.mark.slow
def test_it_is_listed_with_its_distribution_and_parameters(installed):
    listed = resample(installed, "plugins", "filters")
    assert "  hann  (outside-filters)\n      A raised cosine.\n      width=2\n" in listed.stdout
    assert "  box  (hybrid-resample)\n" in listed.stdout


@pytest.mark.slow
def test_its_broken_plugin_is_listed_with_the_reason(installed):
    listed = resample(installed, "plugins", "filters")
    assert "filter 'broken' of outside-filters cannot be imported: AttributeError" in listed.stdout
    assert listed.returncode == 0


@pytest.mark.slow
def test_it_passes_the_check_for_authors(installed):
    code = (
        "from resample import registry, testing\n"
        "testing.check_filter(registry.build('filters', 'hann:width=3'))"
    )
    checked = command(installed, "-c", code)
    assert checked.stderr == ""
    assert checked.returncode == 0


def render(installed: Path, pixel_filter: str, picture: Path) -> subprocess.CompletedProcess[str]:
    code = "from resample_volume.cli import main; main()"
    words = ["render", "checker-box:size=16", "--filter", pixel_filter, "--size", "32"]
    return command(installed, "-c", code, *words, "-o", str(picture))


@pytest.mark.slow
@pytest.mark.skipif(not has_application, reason="the volume application is not installed")
def test_it_renders(installed, tmp_path):
    rendered = render(installed, "hann:width=2", tmp_path / "x.png")
    assert rendered.stderr == ""
    assert rendered.returncode == 0
    assert (tmp_path / "x.png").stat().st_size > 100


@pytest.mark.slow
@pytest.mark.skipif(not has_application, reason="the volume application is not installed")
def test_its_own_check_reaches_the_user_in_one_line(installed, tmp_path):
    rendered = render(installed, "hann:width=-2", tmp_path / "x.png")
    assert rendered.returncode == 2
    assert rendered.stderr == (
        "resample: error: hann:width=-2: width is a positive number of pixels, not -2\n"
    )
