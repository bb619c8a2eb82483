"""The packages that the documents print are built, found and run."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.processes import PATIENCE

ROOT = Path(__file__).parents[2]
BROKEN = 'broken = "hann_filter:Missing"\n'  # one entry point more than the page has


def printed(page: str, language: str, name: str) -> str:
    """Contents of a file as a page of the documents prints them below its name."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    found = re.search(rf"`{re.escape(name)}`:\n\n```{language}\n(.*?)```", text, re.DOTALL)
    assert found, f"{page} prints no {name}"
    return found[1]


has_application = importlib.util.find_spec("resample_volume.cli") is not None


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """Folder into which the package was built and installed, without a package index."""
    target = tmp_path_factory.mktemp("site")
    source, application = (tmp_path_factory.mktemp(name) for name in ("source", "application"))
    project = printed("plugins.md", "toml", "pyproject.toml")
    (source / "pyproject.toml").write_text(project + BROKEN)
    (source / "hann_filter.py").write_text(printed("plugins.md", "python", "hann_filter.py"))
    page = "howto/application.md"
    (application / "pyproject.toml").write_text(printed(page, "toml", "pyproject.toml"))
    (application / "darkness.py").write_text(printed(page, "python", "darkness.py"))
    uv = Path(sys.executable).parent / "uv"
    if uv.exists() and importlib.util.find_spec("hatchling"):
        command = [uv, "pip", "install", "-q", "--offline", "--no-deps", "--no-build-isolation"]
        command += ["--python", sys.executable, "--target", target, source, application]
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


@pytest.mark.sweep
@pytest.mark.slow
def test_it_is_listed_with_its_distribution_and_parameters(installed):
    listed = resample(installed, "plugins", "filters")
    assert "  hann  (hann-filter)\n      A raised cosine.\n      width=2\n" in listed.stdout
    assert "  box  (hybrid-resample)\n" in listed.stdout


@pytest.mark.sweep
@pytest.mark.slow
def test_its_broken_plugin_is_listed_with_the_reason(installed):
    listed = resample(installed, "plugins", "filters")
    assert "filter 'broken' of hann-filter cannot be imported: AttributeError" in listed.stdout
    assert listed.returncode == 0


@pytest.mark.sweep
@pytest.mark.slow
def test_the_application_runs_as_a_command_and_refuses_in_one_line(installed, tmp_path):
    light = np.full((10, 10, 3), 255, np.uint8)
    light[:, :3] = 0
    cv2.imwrite(str(tmp_path / "photo.png"), light)
    counted = resample(installed, "darkness", "share", str(tmp_path / "photo.png"))
    assert counted.stdout == "30.0 % of 100 pixels are dark\n"
    refused = resample(installed, "darkness", "share", str(tmp_path / "other.png"))
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1


@pytest.mark.sweep
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


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.skipif(not has_application, reason="the volume application is not installed")
def test_it_renders(installed, tmp_path):
    rendered = render(installed, "hann:width=2", tmp_path / "x.png")
    assert rendered.stderr == ""
    assert rendered.returncode == 0
    assert (tmp_path / "x.png").stat().st_size > 100


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.skipif(not has_application, reason="the volume application is not installed")
def test_its_own_check_reaches_the_user_in_one_line(installed, tmp_path):
    rendered = render(installed, "hann:width=-2", tmp_path / "x.png")
    assert rendered.returncode == 2
    assert rendered.stderr == (
        "resample: error: hann:width=-2: width is a positive number of pixels, not -2\n"
    )
