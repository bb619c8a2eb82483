"""Another project's package that imports as `resample`: named in one line, whoever comes first."""

import subprocess
import sys
import warnings

import pytest

from resample.lazy import warn_of_namesake


def test_a_namesake_in_the_same_folder_is_named_with_what_to_do(tmp_path):
    (tmp_path / "jackknife.py").write_text("")
    with pytest.warns(RuntimeWarning, match="pip uninstall resample"):
        warn_of_namesake(str(tmp_path))


def test_nothing_is_said_where_there_is_no_namesake(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_namesake(str(tmp_path))


@pytest.mark.some(3)
@pytest.mark.parametrize("name", ["points", "texture", "volume", "warp3d"])
def test_an_application_beside_a_namesake_alone_says_what_to_do(tmp_path, name):
    (tmp_path / "resample").mkdir()
    (tmp_path / "resample" / "__init__.py").write_text("")
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import resample_{name}"
    failed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    last = failed.stderr.splitlines()[-1]
    assert last.startswith("ImportError: `resample` is here another project's package")
    assert "pip uninstall resample" in last
