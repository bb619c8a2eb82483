import pytest

import resample_texture
from tests.processes import python

HEAVY = {"numba", "cv2", "OpenImageIO", "scipy", "trimesh", "matplotlib", "jinja2", "pydantic"}


def modules_after(code):
    return set(python(f"import sys\n{code}\nprint('imported', *sys.modules)").split())


def test_importing_the_package_imports_no_heavy_library():
    assert modules_after("import resample_texture") & HEAVY == set()


@pytest.mark.sweep
def test_making_geometries_and_methods_imports_no_heavy_library():
    code = (
        "import resample_texture\n"
        "for name in resample_texture.__all__:\n"
        "    globals()[name] = getattr(resample_texture, name)\n"
        "Homography([[2, 0, 0], [0, 2, 0], [0, 0, 1]]), BackwardMap([[1.0]], [[1.0]])\n"
        "Hybrid(), Paper(), Points(), Splats(), Supersample(), Edge.WRAP, warp"
    )
    assert modules_after(code) & HEAVY == set()


@pytest.mark.sweep
def test_a_shift_by_whole_pixels_imports_no_heavy_library():
    code = (
        "import numpy, resample_texture\n"
        "resample_texture.warp(numpy.ones((4, 4)), [[1, 0, 1], [0, 1, 2]], (4, 4))"
    )
    assert modules_after(code) & HEAVY == set()


def test_every_public_name_is_there():
    for name in resample_texture.__all__:
        assert getattr(resample_texture, name).__name__ == name


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'wrap'"):
        resample_texture.wrap  # noqa: B018 - reading it is the test
