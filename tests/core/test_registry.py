import inspect
import tomllib
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from types import SimpleNamespace

import pytest

from resample import registry
from resample.profiles.filters import Gaussian

ROOT = Path(__file__).parents[2]


class Options:
    """A plugin with every kind of default."""

    def __init__(self, size, *, factor=1.0, label="a", is_fast=False):
        if size == 13:
            raise ValueError("13 is\nunlucky")
        self.given = (size, factor, label, is_fast)


def entry(name: str, value: str, distribution: str) -> EntryPoint:
    point = EntryPoint(name, value, "resample.filters")
    vars(point)["dist"] = SimpleNamespace(name=distribution)
    return point


@pytest.fixture
def installed(monkeypatch):
    """Pretend that packages bring these filters; returns a function that takes the entry points."""

    def install(*points: EntryPoint) -> None:
        monkeypatch.setattr(registry, "entry_points", EntryPoints(points).select)

    return install


@pytest.fixture
def options(installed, monkeypatch):
    installed(entry("options", "resample.registry:Options", "outside"))
    monkeypatch.setattr(registry, "Options", Options, raising=False)


def test_names_are_sorted():
    names = registry.names("filters")
    assert names == sorted(names)
    assert {"box", "catmull-rom", "gaussian", "lanczos", "mitchell", "tent"} <= set(names)


def test_an_unknown_group_lists_the_groups():
    with pytest.raises(
        LookupError, match="no 'filter'; plugins come as apps, clouds, commands, filters"
    ):
        registry.names("filter")


def test_an_unknown_name_lists_the_known_ones_and_the_closest():
    with pytest.raises(
        LookupError, match=r"did you mean 'gaussian'\? known filters: area, box, cat"
    ):
        registry.load("filters", "gausian")


def test_a_part_that_another_package_of_this_project_has_names_it(installed):
    installed()
    with pytest.raises(LookupError) as caught:
        registry.load("commands", "volume.figures")
    assert str(caught.value) == (
        "command 'volume.figures' is in hybrid-resample-figures, which is not installed: "
        "pip install hybrid-resample-figures"
    )
    assert registry.missing("primitives", "ewa").startswith("method 'ewa' is in hybrid-resample-c")


def test_parts_of_the_packages_of_this_project_are_those_that_they_register():
    declared = {}
    for file in sorted(ROOT.glob("plugins/*/pyproject.toml")):
        project = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
        declared[project["name"]] = {
            group.removeprefix("resample."): " ".join(sorted(parts))
            for group, parts in project.get("entry-points", {}).items()
        }
    assert {name: parts for name, parts in declared.items() if parts} == registry.ELSEWHERE
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert extras["optional-dependencies"]["all"] == list(declared)


def test_an_unknown_name_far_from_all_has_no_suggestion():
    with pytest.raises(LookupError, match="unknown filter 'xyzzy'; known filters: area, box"):
        registry.load("filters", "xyzzy")


def test_a_specification_becomes_an_object():
    assert registry.build("filters", "gaussian:sigma=0.6,radius=2") == Gaussian(0.6, 2)


def test_a_bare_name_takes_the_defaults():
    assert registry.build("filters", "gaussian") == Gaussian()


def test_spaces_around_parameters_do_not_matter():
    assert registry.build("filters", "gaussian: sigma = 0.6 , radius=none") == Gaussian(0.6)


def test_parameters_come_with_their_defaults():
    assert registry.parameters(Gaussian) == {"sigma": 0.5, "radius": None, "lowered": False}
    assert registry.described(Gaussian) == "sigma=0.5, radius=None, lowered=False"


def test_a_parameter_without_default_is_required():
    assert registry.parameters(Options)["size"] is registry.REQUIRED is inspect.Parameter.empty


@pytest.mark.usefixtures("options")
@pytest.mark.parametrize(
    ("text", "given"),
    [
        ("size=3", (3, 1.0, "a", False)),
        ("size=-0.5,factor=2", (-0.5, 2, "a", False)),
        ("size=1e-3,is_fast=true", (0.001, 1.0, "a", True)),
        ("size=tall,label=7", ("tall", 1.0, "7", False)),
        ("size=false,label=a=b", (False, 1.0, "a=b", False)),
    ],
)
def test_values_are_read_as_numbers_truths_or_text(text, given):
    assert registry.build("filters", f"options:{text}").given == given


@pytest.mark.usefixtures("options")
@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("options", "options: needs size; options takes size, factor=1, label=a, is_fast=False"),
        ("options:width=3", "there is no parameter 'width'; options takes size"),
        ("options:size", "'size' is not of the form parameter=value"),
        ("options:", "'' is not of the form"),
        ("options:size=", "is not of the form"),
        ("options:size=1,size=2", "size is given twice"),
        ("options:size=1,factor=big", "factor is a number, not 'big'"),
        ("options:size=1,factor=true", "factor is a number"),
        ("options:size=1,is_fast=1", "is_fast is true or false, not '1'"),
        ("options:size=13", "^options:size=13: 13 is unlucky$"),
    ],
)
def test_a_bad_parameter_is_refused_with_the_specification_in_front(text, complaint):
    with pytest.raises(ValueError, match=complaint) as caught:
        registry.build("filters", text)
    assert str(caught.value).startswith(f"{text}: ")


def test_a_value_that_the_plugin_cannot_use_is_a_value_error():
    with pytest.raises(ValueError, match="gaussian:radius=wide: "):
        registry.build("filters", "gaussian:radius=wide")


@pytest.mark.parametrize("value", ["no_such_module:X", "resample.profiles.filters:NoSuchFilter"])
def test_a_plugin_that_cannot_be_imported_names_its_distribution(installed, value):
    installed(entry("hann", value, "outside"))
    with pytest.raises(
        LookupError, match="filter 'hann' of outside cannot be imported: "
    ) as caught:
        registry.load("filters", "hann")
    assert "\n" not in str(caught.value)


def test_a_broken_plugin_does_not_disturb_the_others(installed):
    installed(
        entry("hann", "no_module:X", "outside"), entry("box", "resample.profiles.filters:Box", "a")
    )
    assert registry.names("filters") == ["box", "hann"]
    assert registry.build("filters", "box").radius == 0.5


@pytest.fixture
def rivals(installed):
    installed(
        entry("box", "resample.profiles.filters:Box", "hybrid-resample"),
        entry("box", "resample.profiles.filters:Tent", "outside"),
        entry("tent", "resample.profiles.filters:Tent", "hybrid-resample"),
    )


@pytest.mark.usefixtures("rivals")
def test_a_name_that_two_packages_use_is_listed_with_the_package():
    assert registry.names("filters") == ["hybrid-resample/box", "outside/box", "tent"]


@pytest.mark.usefixtures("rivals")
def test_a_name_that_two_packages_use_is_refused_alone():
    with pytest.raises(LookupError, match="'box' comes from hybrid-resample and outside; say hyb"):
        registry.build("filters", "box:radius=1")


@pytest.mark.usefixtures("rivals")
def test_a_name_that_two_packages_use_is_found_with_its_package():
    assert type(registry.build("filters", "outside/box:radius=2")).__name__ == "Tent"
    assert registry.distribution("filters", "outside/box") == "outside"
