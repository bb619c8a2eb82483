"""Names of the release before work and say what they are called now."""

import sys
from importlib import import_module
from types import ModuleType, SimpleNamespace
from typing import NamedTuple

import pytest

from resample.lazy import attributes, moved, old_members, renamed


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    made = ModuleType("made_here")
    made.Budget = SimpleNamespace(memory=1)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "made_here", made)
    return made


def test_an_old_name_of_a_module_warns_and_gives_what_has_the_new_one(module: ModuleType) -> None:
    get = renamed("made_here", {"Spent": "Budget"})

    with pytest.warns(DeprecationWarning, match=r"made_here\.Spent is now made_here\.Budget"):
        found = get("Spent")

    assert found is module.Budget


@pytest.mark.usefixtures("module")
def test_a_name_that_never_was_is_refused_as_by_any_module() -> None:
    get = renamed("made_here", {"Spent": "Budget"})

    with pytest.raises(AttributeError, match="module 'made_here' has no attribute 'Other'"):
        get("Other")


def test_an_old_public_name_warns_and_gives_what_has_the_new_one() -> None:
    get = attributes("resample", {"Frame": "types"}, {"Picture": "Frame"})

    with pytest.warns(DeprecationWarning, match=r"resample\.Picture is now resample\.Frame"):
        found = get("Picture")

    assert found is get("Frame")


@old_members(former="amount")
class Counted(NamedTuple):
    amount: int


def test_an_old_member_warns_and_gives_the_value_of_the_new_one() -> None:
    with pytest.warns(DeprecationWarning, match=r"Counted\.former is now Counted\.amount"):
        found = Counted(3).former  # type: ignore[attr-defined]

    assert found == 3


def test_a_moved_folder_is_imported_by_its_old_name_as_the_same_modules(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path])
    moved("resample", {"finding_profiles": "profiles"})
    new = import_module("resample.profiles.filters")
    spec = new.__spec__

    with pytest.warns(DeprecationWarning, match=r"finding_profiles is now resample\.profiles"):
        old = import_module("resample.finding_profiles.filters")

    assert old is new
    assert new.__spec__ is spec
    for name in [name for name in sys.modules if name.startswith("resample.finding_profiles")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr("resample.finding_profiles")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("resample.console.messages", "resample.console"),
        ("resample_texture.geometry.corners", "resample_texture.geometry.matrices"),
        ("resample_texture.geometry.lenses", "resample_texture.geometry.cameras"),
        ("resample_texture.geometry.planes", "resample_texture.geometry.cameras"),
    ],
)
def test_a_module_that_was_joined_to_another_is_imported_by_its_old_name(
    old: str, new: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, old, raising=False)

    with pytest.warns(DeprecationWarning, match=rf"{old} is now {new}"):
        found = import_module(old)

    assert found is import_module(new)
    monkeypatch.delitem(sys.modules, old)
