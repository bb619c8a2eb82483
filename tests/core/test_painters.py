"""Primitives of plugins are painted as those of the core, and comparisons are plugins."""

from importlib.metadata import EntryPoint, EntryPoints

import pytest

from resample import Primitive, Resampler, registry
from resample.painting.choices import Footprint, Technique, footprints_of
from resample.painting.splats import SplatPainter
from tests.samples import CAMERAS, SIDE, cloud

PICTURE = {"camera": CAMERAS["narrow"], "height": SIDE, "width": SIDE}


def balls() -> Technique:
    """Exact splats alone."""
    return Technique(0.0, (Footprint.EXACT,))


def own_painter() -> Technique:
    """Splats by a painter that a plugin names."""
    return Technique(
        0.6, painter=lambda choice: SplatPainter(choice.reconstruction, None, 2, "depth", 0.0, 0.0)
    )


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        EntryPoint(name, f"{__name__}:{name}", "resample.primitives")
        for name in ("balls", "own_painter")
    ]
    entry_points = registry.entry_points
    monkeypatch.setattr(
        registry,
        "entry_points",
        lambda *, group: EntryPoints((*points, *entry_points(group=group))).select(group=group),
    )
    monkeypatch.setattr(EntryPoint, "load", lambda self: globals()[self.name])


@pytest.mark.parametrize(("name", "same"), [("balls", "splats"), ("own_painter", "hybrid")])
def test_a_primitive_of_a_plugin_is_a_method_by_its_name(name, same, rng):
    samples, subpixels = cloud(rng), 2
    painted = Resampler(method=name, subpixels=subpixels)(samples, **PICTURE)
    assert painted.rgba.any()
    expected = Resampler(method=same, subpixels=subpixels)(samples, **PICTURE)
    assert painted.rgba.tobytes() == expected.rgba.tobytes()


def test_a_primitive_of_a_plugin_takes_the_footprints_that_it_names():
    with pytest.raises(
        ValueError, match="primitive balls goes with the footprint exact, not affine"
    ):
        Resampler(method="balls", footprint=Footprint.AFFINE)


def test_an_unknown_method_lists_those_of_plugins_too():
    known = "hybrid, points, splats, paper, inflate, ewa, balls, own_painter"
    with pytest.raises(ValueError, match=f"method 'ball'; known: {known}"):
        Resampler(method="ball")


def test_primitives_for_comparison_are_plugins(monkeypatch):
    monkeypatch.undo()
    own = {Primitive.HYBRID, Primitive.POINTS, Primitive.SPLATS, Primitive.PAPER}
    assert set(registry.names("primitives")) == set(Primitive) - own
    assert all(footprints_of(name) for name in Primitive)
