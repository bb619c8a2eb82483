"""Public names of the packages: listed, imported when used, documented."""

import importlib
import inspect
from importlib.metadata import version

import pytest

PACKAGES = [
    "resample",
    "resample_chunks",
    "resample_particles",
    "resample_points",
    "resample_sky",
    "resample_texture",
    "resample_volume",
    "resample_warp3d",
]


@pytest.mark.parametrize("name", PACKAGES)
def test_packages_list_what_is_public_and_their_version(name: str) -> None:
    package = importlib.import_module(name)
    assert dir(package) == sorted([*package.__all__, "__version__"])
    assert package.__version__ == version("hybrid-resample")


@pytest.mark.parametrize("name", PACKAGES)
def test_public_names_are_documented(name: str) -> None:
    package = importlib.import_module(name)
    for public in package.__all__:
        found = getattr(package, public)
        if inspect.isclass(found) or inspect.isfunction(found):
            assert inspect.getdoc(found), public
