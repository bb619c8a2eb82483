"""What imports of the package bring along."""

import pytest

import resample_points
from tests.commands import HEAVY
from tests.processes import python


def modules_after(code: str) -> set[str]:
    return set(python(f"import sys\n{code}\nprint('imported', *sys.modules)").split())


def test_importing_the_package_imports_no_heavy_library():
    assert modules_after("import resample_points") & HEAVY == set()


@pytest.mark.sweep
def test_clouds_are_drawn_by_names_of_the_package():
    names = {"Cloud", "CloudStyle", "framed", "prepare_cloud", "read_cloud", "render_cloud"}
    assert names <= set(resample_points.__all__)
    code = "import resample_points; resample_points.render_cloud, resample_points.read_cloud"
    assert modules_after(code) & {"scipy", "cv2", "matplotlib", "PIL", "av"} == set()
