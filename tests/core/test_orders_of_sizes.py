"""Sizes have one order each: `shape` is height and width as in NumPy, `size` width and height."""

import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import resample
import resample_chunks
import resample_gradients as differentiable
import resample_particles
import resample_points
import resample_sky
import resample_texture
import resample_volume
import resample_warp3d
from resample_dropins import ndimage, opencv, scikit
from resample_meshes import rendering as meshes
from tests.core.test_signatures import parameters, public

PAIR = re.compile(r"(shape|size|height and width|width and height)", re.IGNORECASE)
LIKE_OTHERS = {"dsize"}  # OpenCV's name: width and height
OTHER_PAIRS = {  # of numbers that are no size of a picture
    "axes",
    "data_range", "gradient_opacity", "pan", "rows", "span", "window", "splat_color",
}  # fmt: skip
ONE_OR_TWO = {"side"}  # one number, or a height and a width


def documented() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Public functions, and those of modules that the documentation names."""
    yield from public()
    for module in (differentiable, ndimage, opencv, scikit, meshes):
        for name, found in vars(module).items():
            is_own = getattr(found, "__module__", "") == module.__name__ and name[0] != "_"
            if is_own and inspect.isfunction(found):
                yield f"{module.__name__}.{name}", found


def described(function: Callable[..., Any], parameter: str) -> str:
    """What a docstring says about a parameter; empty if it says that in other words elsewhere."""
    found = re.search(
        rf"^(?:[\w, ]*, )?{parameter}(?:, [\w, ]*)?\n((?:    .*\n?)+)",
        inspect.getdoc(function) or "",
        re.MULTILINE,
    )
    return " ".join(found[1].split()).lower() if found else ""


def test_a_pair_of_pixels_is_called_shape_or_size() -> None:
    found = [
        f"{name}({parameter})"
        for name, function in documented()
        for parameter, given in parameters(function).items()
        if "tuple[int, int]" in str(given.annotation)
        and not parameter.endswith(("shape", "size"))
        and parameter not in {*OTHER_PAIRS, *ONE_OR_TWO}
    ]
    assert not found


@pytest.mark.sweep
def test_docstrings_say_shapes_and_sizes_in_their_order() -> None:
    wrong = []
    for name, function in documented():
        for parameter in parameters(function):
            said = described(function, parameter)
            if parameter.endswith("shape") and "width and height" in said:
                wrong.append(f"{name}({parameter}): {said}")
            if parameter in {"size", "dsize"} and "height and width" in said:
                wrong.append(f"{name}({parameter}): {said}")
    assert not wrong


def test_no_function_takes_both_orders() -> None:
    both = {"shape", "size"}
    assert not [name for name, function in documented() if both <= set(parameters(function))]


def test_height_comes_before_width_where_they_are_two_arguments() -> None:
    for name, function in documented():
        given = list(parameters(function))
        if "height" in given:
            assert given.index("width") == given.index("height") + 1, name


PICTURE, CUBE = np.ones((4, 5)), np.ones((4, 5, 6), np.uint8)
EYE = resample.Camera.from_fov(60, 4, 5)
CLOUD = resample_points.Cloud(*[np.eye(3, dtype=np.float32)] * 3, np.ones(3, np.float32))
PARTICLES = resample_particles.Particles(np.eye(3), 1.0, 1.0)
GAUSSIANS = resample_points.Gaussians(
    np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), np.eye(1, 4, dtype=np.float32),
    np.ones(1, np.float32), np.ones((1, 3), np.float32),
)  # fmt: skip
BALL = resample.particles([[0, 0, 5]], (1, 0, 0), 0.9, 1)
SHAPES: dict[str, Callable[[tuple[int, int]], Any]] = {
    "warp": lambda shape: resample_texture.warp(PICTURE, np.eye(3), shape),
    "warp_chunks": lambda shape: resample_chunks.warp_chunks(PICTURE, np.eye(3), shape),
    "resize": lambda shape: resample_texture.resize(PICTURE, shape),
    "rotate": lambda shape: resample_texture.rotate(PICTURE, 30, shape),
    "coadd": lambda shape: resample_sky.coadd([PICTURE], [np.eye(3)], shape),
    "reproject": lambda shape: resample_sky.reproject(PICTURE, np.eye(2, 3), np.eye(2, 3), shape),
    "project": lambda shape: resample_texture.project(
        np.zeros((64, 128, 3), np.uint8), "equirectangular", "perspective:fov=70", shape
    ),
    "Plan": lambda shape: resample_texture.Plan(np.eye(3), shape, (4, 5))(PICTURE),
    "control_points": lambda shape: (
        resample_sky.control_points(
            np.eye(5, 2), np.eye(5, 2) + np.arange(5)[:, None] ** 2, shape, "polynomial:degree=1"
        ).x
    ),
    "like scikit": lambda shape: scikit.resize(PICTURE, shape),
    "MatrixPlaces": lambda shape: differentiable.LinearWarp()(
        PICTURE, differentiable.MatrixPlaces(np.eye(3), shape, (4, 5))
    ),
    "Scatter": lambda shape: resample.Scatter()([[1, 1]], [1.0], radius=1.0, shape=shape),
    "depth: render_together": lambda shape: (
        resample_warp3d.render_together(
            resample_warp3d.panorama(np.ones((16, 32, 3)), np.ones((16, 32))), EYE, shape
        ).warped.image
    ),
}
SIZES: dict[str, Callable[[tuple[int, int]], Any]] = {
    "PictureScene": lambda size: resample_texture.PictureScene(PICTURE).render(
        np.eye(3), size=size
    ),
    "like OpenCV": lambda size: opencv.resize(PICTURE, size),
    "depth": lambda size: resample_warp3d.warp(PICTURE, PICTURE, EYE, EYE, size=size).depth,
    "DepthScene": lambda size: (
        resample_warp3d.DepthScene(PICTURE, PICTURE, EYE).render(EYE, size=size).depth
    ),
    "volume": lambda size: resample_volume.render(CUBE, "0..2", size=size),
    "Scene": lambda size: resample_volume.Scene(CUBE).render("0..2", size=size),
    "sample_ids": lambda size: resample_volume.Scene(CUBE).sample_ids("0..2", size=size),
    "cloud": lambda size: resample_points.render_cloud(CLOUD, EYE, size=size),
    "CloudScene": lambda size: resample_points.CloudScene(CLOUD).render(size=size),
    "index_cloud": lambda size: resample_points.index_cloud(CLOUD, EYE, size=size),
    "Gaussians": lambda size: resample_points.render_gaussians(GAUSSIANS, EYE, size=size),
    "column_density": lambda size: resample_particles.column_density(PARTICLES, "z", size=size),
}


@pytest.mark.some(6)
@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_is_height_and_width(name: str) -> None:
    assert np.asarray(SHAPES[name]((6, 9))).shape[:2] == (6, 9)


@pytest.mark.parametrize("name", SIZES)
def test_a_size_is_width_and_height(name: str) -> None:
    assert np.asarray(SIZES[name]((9, 6))).shape[:2] == (6, 9)


def test_cameras_of_a_size_put_its_middle_in_the_middle() -> None:
    for camera in (
        resample_points.framed(CLOUD, size=(9, 6)),
        resample_points.gaussian_camera(GAUSSIANS, size=(9, 6)),
        resample.Camera.from_fov(60, height=6, width=9),
    ):
        assert tuple(camera.matrix[:2, 2]) == (4.5, 3.0)  # type: ignore[union-attr]
