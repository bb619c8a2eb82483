"""Two processes at a time on caches that are cold: both write what one alone writes."""

import os
from pathlib import Path

import pytest

from tests.faults.commands import COMMANDS, began, content, hidden, run, whole_of, write_inputs

pytestmark = [pytest.mark.sweep, pytest.mark.slow]


@pytest.mark.parametrize("target", COMMANDS)
def test_two_commands_with_a_cold_cache_write_the_same(tmp_path, tmp_path_factory, target):
    """What they measure and keep of volumes, clouds and sheets; kernels are warm."""
    whole = whole_of(lambda: tmp_path_factory.mktemp("whole"), target)
    for turn in range(5):
        cold = {"HYBRID_RESAMPLE_CACHE": str(tmp_path / f"cache-{turn}")}
        folders = [tmp_path / f"{name}-{turn}" for name in "ab"]
        for folder in folders:
            folder.mkdir()
            write_inputs(folder)
        both = [began(folder, target, env={**os.environ, **cold}) for folder in folders]
        for command, folder in zip(both, folders, strict=True):
            assert command.communicate()[1].count("Traceback") == 0
            assert command.returncode == 0
            assert content(folder / target) == whole


@pytest.mark.parametrize("target", ["volume.png", "turned.jpg", "eye.png", "cloud.png"])
def test_two_commands_with_one_target_end_with_a_whole_one(tmp_path, target):
    write_inputs(tmp_path)
    assert run(tmp_path, target).returncode == 0
    whole = content(tmp_path / target)
    for _ in range(5):
        both = [began(tmp_path, target) for _ in range(2)]
        assert [(command.communicate()[1], command.returncode)[1] for command in both] == [0, 0]
        assert content(tmp_path / target) == whole
    assert hidden(tmp_path) == []


def test_two_commands_with_no_kernels_compile_each_once(tmp_path):
    """The second waits for the first, and takes what that has compiled."""
    folders = [tmp_path / "a", tmp_path / "b"]
    cold = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "RESAMPLE_KERNELS": "off"}
    for folder in folders:
        folder.mkdir()
        write_inputs(folder)
    both = [began(folder, "cloud.png", env={**os.environ, **cold}) for folder in folders]
    assert [(command.communicate()[1], command.returncode)[1] for command in both] == [0, 0]
    made = [path.name for path in Path(tmp_path / "kernels").glob("*.kernel")]
    assert content(folders[0] / "cloud.png") == content(folders[1] / "cloud.png")
    assert run(folders[0], "cloud.png", env={**os.environ, **cold}).returncode == 0
    assert [path.name for path in Path(tmp_path / "kernels").glob("*.kernel")] == made
    assert not list(Path(tmp_path / "kernels").glob("*.new"))
