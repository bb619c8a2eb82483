"""Examples in docstrings do what they say."""

import doctest
import importlib
from pathlib import Path
from types import ModuleType

import pytest

import resample
import resample_chunks
import resample_comparisons
import resample_gradients
import resample_meshes
import resample_particles
import resample_points
import resample_sky
import resample_texture
import resample_volume
import resample_warp3d

PACKAGES = (
    *(resample, resample_chunks, resample_particles, resample_points, resample_sky),
    *(resample_texture, resample_volume, resample_warp3d),
)
FURTHER = (resample_comparisons, resample_gradients, resample_meshes)  # whose names have homes


def modules() -> list[str]:
    """Modules whose docstrings hold examples."""
    found = []
    for package in (*PACKAGES, *FURTHER):
        home = Path(package.__path__[0])
        for source in sorted(home.rglob("*.py")):
            if ">>> " in source.read_text(encoding="utf-8"):
                parts = source.relative_to(home.parent).with_suffix("").parts
                found.append(".".join(parts).removesuffix(".__init__"))
    return found


@pytest.mark.some(43)
@pytest.mark.parametrize("name", modules())
def test_examples_are_true(name: str) -> None:
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried
    assert not failed


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: str(package.__name__))
def test_every_public_name_has_an_example(package: ModuleType) -> None:
    named = {name: getattr(package, name) for name in dir(package) if not name.startswith("_")}
    documented = {name: of for name, of in named.items() if isinstance(of, type) or callable(of)}
    assert documented
    assert [name for name, of in documented.items() if ">>> " not in (of.__doc__ or "")] == []
