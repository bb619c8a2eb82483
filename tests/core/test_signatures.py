"""Signatures of the public functions: what editors complete, and type checkers find."""

import importlib
import inspect
import tomllib
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resample
import resample_chunks
import resample_particles
import resample_points
import resample_sky
import resample_texture
import resample_volume
import resample_warp3d
from resample_dropins import ndimage, scikit

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

# Texts that may be anything: names of plugins with options, files, expressions. Others are Literal.
OPEN_TEXTS = {
    "method", "filter", "pixel_filter", "interpolation", "primitive",  # plugins, with options
    "path", "file", "name", "spec", "cloud", "given", "volume", "reader",  # files, sources
    "output", "more",
    "camera", "view", "source", "target",  # viewpoints and projections
    "appearance", "look", "transfer", "framing", "colors", "crop", "clip", "slab", "where", "text",
    "only", "columns", "quantity", "quantities", "units", "length", "part", "scale", "kind",
    "note", "space", "up", "painters", "background", "memory", "choices", "settings",
    "colormap",  # of matplotlib
}  # fmt: skip


def public() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Public functions, classes and their methods."""
    for package in map(importlib.import_module, PACKAGES):
        for name in package.__all__:
            found = getattr(package, name)
            if inspect.isfunction(found) or inspect.isclass(found):
                yield f"{package.__name__}.{name}", found
            for method in vars(found) if inspect.isclass(found) else ():
                if not method.startswith("_") or method == "__call__":
                    member = getattr(found, method)
                    if inspect.isfunction(member) or inspect.ismethod(member):
                        yield f"{package.__name__}.{name}.{method}", member


def parameters(found: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    try:
        return dict(inspect.signature(found).parameters)
    except ValueError:  # a class that is built in, as exceptions are
        return {}


def names_in(annotation: Any) -> set[str]:
    """Values of all literals in a type."""
    if typing.get_origin(annotation) is typing.Literal:
        return set(map(str, typing.get_args(annotation)))
    return set().union(*map(names_in, typing.get_args(annotation)))


def annotation_of(function: Callable[..., Any], parameter: str) -> Any:
    """Type of a parameter, or of an option in the group that a function takes."""
    given = parameters(function)
    if parameter in given:
        return given[parameter].annotation
    (group,) = typing.get_args(list(given.values())[-1].annotation)
    return typing.get_type_hints(group)[parameter]


def takes_any_text(annotation: Any) -> bool:
    parts = typing.get_args(annotation)
    return annotation is str or (
        bytes not in parts and any(map(takes_any_text, parts))
    )  # of arrays


def test_texts_with_few_values_are_literals() -> None:
    found = {
        f"{name}({parameter})"
        for name, function in public()
        for parameter, given in parameters(function).items()
        if parameter not in OPEN_TEXTS and takes_any_text(given.annotation)
    }
    assert not found


PICTURE, CUBE, EYE = np.ones((4, 5)), np.ones((4, 5, 6)), resample.Camera.from_fov(60, 4, 5)
PLACE = np.zeros((1, 3))
SHAPE = 4, 5
CHOICES: list[tuple[Callable[..., Any], str, Callable[[Any], Any]]] = [
    (resample_texture.warp, name, call)
    for name, call in {
        "edge": lambda given: resample_texture.warp(PICTURE, np.eye(3), SHAPE, edge=given),
        "convention": lambda given: resample_texture.warp(
            PICTURE, np.eye(3), SHAPE, convention=given
        ),
        "alpha": lambda given: resample_texture.warp(PICTURE, np.eye(3), SHAPE, alpha=given),
    }.items()
] + [
    (resample_texture.resize, "edge",
     lambda given: resample_texture.resize(PICTURE, SHAPE, edge=given)),
    (resample_sky.coadd, "interpolation",
     lambda given: resample_sky.coadd([PICTURE], [np.eye(3)], SHAPE, interpolation=given)),
    (resample_texture.Hybrid, "magnified", lambda given: resample_texture.Hybrid(magnified=given)),
    (resample_texture.Hybrid, "average", lambda given: resample_texture.Hybrid(average=given)),
    (scikit.resize, "mode", lambda given: scikit.resize(PICTURE, SHAPE, mode=given)),
    (ndimage.zoom, "mode", lambda given: ndimage.zoom(PICTURE, 1, mode=given)),
    (resample_warp3d.warp, "refine",
     lambda given: resample_warp3d.warp(PICTURE, PICTURE, EYE, EYE, refine=given)),
    (resample_warp3d.warp, "fill",
     lambda given: resample_warp3d.warp(PICTURE, PICTURE, EYE, EYE, fill=given)),
    (resample_warp3d.Joining, "blend", lambda given: resample_warp3d.Joining(blend=given)),
    (resample_warp3d.Joining, "colors", lambda given: resample_warp3d.Joining(colors=given)),
    (resample_warp3d.Joining, "depths", lambda given: resample_warp3d.Joining(depths=given)),
    (resample_warp3d.Joining, "votes", lambda given: resample_warp3d.Joining(votes=given)),
    (resample_warp3d.Joining, "poses", lambda given: resample_warp3d.Joining(poses=given)),
    (resample_points.GaussianStyle, "appearance", resample_points.GaussianStyle),
    (resample_points.GaussianStyle, "order",
     lambda given: resample_points.GaussianStyle(order=given)),
    (resample_points.CloudStyle, "light", lambda given: resample_points.CloudStyle(light=given)),
    (resample_particles.column_density, "kernel", lambda given: resample_particles.column_density(
        resample_particles.Particles(PLACE, 1.0, 1.0), "z", size=SHAPE, kernel=given)),
    (resample_particles.column_density, "view", lambda given: resample_particles.column_density(
        resample_particles.Particles(PLACE, 1.0, 1.0), given, size=SHAPE)),
    (resample_volume.Appearance, "gradient",
     lambda given: resample_volume.render(CUBE, resample_volume.Appearance(gradient=given))),
    (resample_volume.Scene.render, "quality",
     lambda given: resample_volume.Scene(CUBE).render("0..1", size=(4, 4), quality=given)),
    (resample_volume.Scene.placed_view, "quality",
     lambda given: resample_volume.Scene(CUBE).placed_view("0..1", quality=given)),
    (resample_volume.Scene.render, "fit",
     lambda given: resample_volume.Scene(CUBE).render("0..1", size=(4, 4), fit=given)),
    (resample.Scatter, "method", resample.Scatter),
    (resample.Orbit, "up", lambda given: resample.Orbit(30, 20, up=given)),
    (resample.orbit, "up", lambda given: resample.orbit([0, 0, 0], 1, 30, 20, up=given)),
    (resample.Camera.from_opencv, "model",
     lambda given: resample.Camera.from_opencv(np.eye(3), model=given)),
    (resample.Camera.from_intrinsics, "convention",
     lambda given: resample.Camera.from_intrinsics(1, 1, 0, 0, convention=given)),
    (resample_points.framed, "up", lambda given: resample_points.framed(
        resample_points.Cloud(*[np.eye(3, dtype=np.float32)] * 3, None), size=SHAPE, up=given)),
]  # fmt: skip


@pytest.mark.parametrize(
    ("function", "parameter", "call"),
    CHOICES,
    ids=[f"{function.__qualname__}-{parameter}" for function, parameter, _ in CHOICES],
)
def test_names_in_signatures_are_those_that_errors_list(
    function: Callable[..., Any], parameter: str, call: Callable[[Any], Any]
) -> None:
    known = names_in(annotation_of(function, parameter))
    assert known
    with pytest.raises((ValueError, LookupError)) as caught:
        call("reflekt")
    said = str(caught.value)
    assert "reflekt" in said
    assert "\n" not in said
    assert [name for name in known if name not in said] == []


def test_mypy_looks_for_wrong_calls() -> None:
    """In `make lint`, where a wrong call that it does not find is an unused `type: ignore`."""
    root = Path(__file__).parents[2]
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
    assert settings["strict"]
    assert settings["modules"] == ["tests.wrong_calls"]
    calls = (root / "tests" / "wrong_calls.py").read_text(encoding="utf-8")
    assert calls.count("# type: ignore[") > 30


GROUPED: dict[str, Callable[..., Any]] = {
    "warp": lambda **given: resample_texture.warp(PICTURE, np.eye(3), SHAPE, **given),
    "resize": lambda **given: resample_texture.resize(PICTURE, SHAPE, **given),
    "rotate": lambda **given: resample_texture.rotate(PICTURE, 30, **given),
    "scale": lambda **given: resample_texture.scale(PICTURE, 2, **given),
    "project": lambda **given: resample_texture.project(
        np.zeros((64, 128, 3), np.uint8), "equirectangular", "perspective", SHAPE, **given
    ),
    "warp_chunks": lambda **given: resample_chunks.warp_chunks(PICTURE, np.eye(3), SHAPE, **given),
    "render": lambda **given: resample_texture.PictureScene(PICTURE).render(np.eye(3), **given),
    "preview": lambda **given: resample_texture.PictureScene(PICTURE).render(
        np.eye(3), quality="preview", **given
    ),
    "depth": lambda **given: resample_warp3d.warp(PICTURE, PICTURE, EYE, EYE, **given),
    "from_intrinsics": lambda **given: resample.Camera.from_intrinsics(1, 1, 0, 0, **given),
}


@pytest.mark.parametrize("name", GROUPED)
def test_unknown_options_of_groups_are_refused(name: str) -> None:
    with pytest.raises(TypeError, match=r"no option 'nonsense'(; known: \w+, |, did)") as caught:
        GROUPED[name](nonsense=3)
    assert "\n" not in str(caught.value)


def test_options_with_a_typing_error_have_a_suggestion() -> None:
    with pytest.raises(TypeError, match="no option 'intrepolation', did you mean 'interpolation'"):
        resample_texture.warp(PICTURE, np.eye(3), SHAPE, intrepolation="lanczos")  # type: ignore[call-arg]


@pytest.mark.parametrize("name", GROUPED)
def test_groups_name_the_options_that_docstrings_describe(name: str) -> None:
    function = {
        "render": resample_texture.PictureScene.render,
        "preview": resample_texture.PictureScene.render,
        "depth": resample_warp3d.warp,
        "from_intrinsics": resample.Camera.from_intrinsics,
    }.get(name) or getattr(resample_texture, name)
    (group,) = (
        typing.get_args(given.annotation)[0]
        for given in parameters(function).values()
        if given.kind is inspect.Parameter.VAR_KEYWORD
    )
    told = inspect.getdoc(function) or ""
    if "As `resize` takes them" in told:
        told += inspect.getdoc(resample_texture.resize) or ""
    assert not [one for one in group.__annotations__ if one not in told]
