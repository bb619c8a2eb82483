"""The library of kernels and its wheel's tag on each platform."""

import importlib.util
import platform
import sys
import sysconfig
from pathlib import Path

import pytest

from tools.kernels import platforms

ROOT = Path(__file__).parents[2]


@pytest.fixture
def on(monkeypatch):
    """Play another platform."""

    def play(system, machine, tag="linux-x86_64"):
        monkeypatch.setattr(sys, "platform", system)
        monkeypatch.setattr(platform, "machine", lambda: machine)
        monkeypatch.setattr(sysconfig, "get_platform", lambda: tag)
        monkeypatch.delenv("CC", raising=False)

    return play


@pytest.fixture(scope="module")
def hook():
    pytest.importorskip("hatchling")
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("system", "machine", "cpu", "is_wide", "file"),
    [
        ("linux", "x86_64", "x86-64-v3", True, "_kernels.abi3.so"),
        ("linux", "aarch64", "generic", False, "_kernels.abi3.so"),
        ("darwin", "arm64", "apple-m1", False, "_kernels.abi3.so"),
        ("win32", "AMD64", "x86-64-v3", True, "_kernels.pyd"),
    ],
)
def test_each_platform_has_a_level_and_a_file(on, hook, system, machine, cpu, is_wide, file):
    on(system, machine)
    assert platforms.level().cpu == cpu
    assert (platforms.wide_level() is not None) == is_wide
    assert platforms.file_name() == file
    assert file in hook.NAMES


def test_no_library_is_built_for_other_platforms(on):
    for other in (("linux", "riscv64"), ("darwin", "x86_64")):  # numba has left Intel's Macs
        on(*other)
        assert platforms.level() is None
        assert platforms.wide_level() is None


def test_links_as_each_system_does(on):
    on("linux", "aarch64")
    assert platforms.compiler() == ["cc"]
    assert {"-shared", "-fPIC", "-Wl,--wrap=exp"} <= set(platforms.options())
    on("darwin", "arm64")
    assert {"-bundle", "dynamic_lookup"} <= set(platforms.options())
    assert not any("wrap" in option for option in platforms.options())
    on("win32", "AMD64")
    assert platforms.compiler() == ["clang"]
    assert platforms.options()[-1] == "-lpython3"


@pytest.mark.parametrize(
    ("system", "machine", "given", "tag"),
    [
        ("linux", "x86_64", "linux-x86_64", "manylinux_2_17_x86_64"),
        ("linux", "aarch64", "linux-aarch64", "manylinux_2_29_aarch64"),
        ("darwin", "arm64", "macosx-11.0-arm64", "macosx_11_0_arm64"),
        ("win32", "AMD64", "win-amd64", "win_amd64"),
    ],
)
def test_the_tag_of_a_wheel_says_where_it_runs(on, hook, system, machine, given, tag):
    on(system, machine, given)
    asked = b"GLIBC_2.2.5 GLIBC_2.29" if machine == "aarch64" else b"GLIBC_2.2.5"
    assert hook.platform_tag(asked) == tag


def test_to_build_a_wheel_imports_no_tests():
    kernels = (ROOT / "tools" / "kernels").rglob("*.py")
    files = [*kernels, *(ROOT / "tools").glob("*.py"), ROOT / "hatch_build.py"]
    imports = (line.split() for file in files for line in file.read_text().splitlines())
    homes = {words[1].partition(".")[0] for words in imports if words[:1] in (["from"], ["import"])}
    assert "resample" in homes
    assert not homes & {"tests", "pytest", "hypothesis"}
