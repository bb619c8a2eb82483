"""Bad arguments of the main public functions: one line that says what to give instead."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resample
import resample_chunks
import resample_gradients as differentiable
import resample_particles
import resample_points as points
import resample_sky
import resample_texture as texture
import resample_volume as volume
import resample_warp3d as warp3d
from resample import Camera, Resampler, Scatter
from resample.view.widgets import write_levels

RNG = np.random.default_rng(1)
PICTURE = RNG.random((20, 40, 3)).astype(np.float32)
CHANNELS_FIRST = np.moveaxis(PICTURE, -1, 0)
GRAY, DEPTH, CUBE = PICTURE[..., 0], np.full((20, 40), 2.0), RNG.random((6, 7, 8), np.float32)
EYE = Camera.from_fov(60, 20, 40)
ONE = np.eye(3)
NONE = np.empty((0, 3), np.float32)
CLOUD = points.Cloud(RNG.random((9, 3)), NONE, NONE, np.ones(9, np.float32))
EMPTY = points.Cloud(NONE, NONE, NONE, NONE[:, 0])
GAUSSIANS = points.Gaussians(
    *(np.ones((1, n), np.float32) for n in (3, 3, 4)),
    np.ones(1, np.float32), np.ones((1, 3), np.float32),
)  # fmt: skip
PARTICLES = resample_particles.Particles(RNG.random((9, 3)), 1.0, 0.5)
BALL = resample.particles([[0, 0, 5]], (1, 0, 0), 0.9, 1)
SHAPE, SIZE = (8, 10), (10, 8)


class Tensor:
    """A tensor of PyTorch that is not made an array: it has a gradient, or is on a device."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        raise self.error


GRADIENT = Tensor(RuntimeError("Can't call numpy() on Tensor that requires grad."))
ON_DEVICE = Tensor(TypeError("can't convert cuda:0 device type tensor to numpy. Use Tensor.cpu()"))

# Functions by what they take; each is called with bad values of it.
PICTURES: dict[str, Callable[[Any], Any]] = {
    "warp": lambda given: texture.warp(given, ONE, SHAPE),
    "resize": lambda given: texture.resize(given, SHAPE),
    "rotate": lambda given: texture.rotate(given, 30),
    "scale": lambda given: texture.scale(given, 0.5),
    "PictureScene": lambda given: texture.PictureScene(given).render(ONE),
    "color": lambda given: warp3d.warp(given, DEPTH, EYE, EYE),
    "DepthScene": lambda given: warp3d.DepthScene(given, DEPTH, EYE),
    "disparity's color": lambda given: warp3d.warp_disparity(given, DEPTH),
    "panorama": lambda given: warp3d.panorama(given, DEPTH),
}
DEPTHS: dict[str, Callable[[Any], Any]] = {
    "depth": lambda given: warp3d.warp(PICTURE, given, EYE, EYE),
    "disparity": lambda given: warp3d.warp_disparity(PICTURE, given),
    "length": lambda given: warp3d.panorama(PICTURE, given),
}
VOLUMES: dict[str, Callable[[Any], Any]] = {
    "render": lambda given: volume.render(given, size=SIZE),
    "Scene": volume.Scene,
    "as_volume": volume.as_volume,
}
CLOUDS: dict[str, Callable[[Any], Any]] = {
    "render_cloud": lambda given: points.render_cloud(given, EYE, size=SIZE),
    "index_cloud": lambda given: points.index_cloud(given, EYE, size=SIZE),
    "prepare_cloud": points.prepare_cloud,
    "framed": lambda given: points.framed(given, size=SIZE),
    "CloudScene": points.CloudScene,
}
THREADED: dict[str, Callable[[Any], Any]] = {
    "warp": lambda given: texture.warp(PICTURE, ONE, SHAPE, threads=given),
    "warp_chunks": lambda given: resample_chunks.warp_chunks(PICTURE, ONE, SHAPE, threads=given),
    "coadd": lambda given: resample_sky.coadd([GRAY], [ONE], SHAPE, threads=given),
    "Plan": lambda given: texture.Plan(ONE, SHAPE, (20, 40))(PICTURE, threads=given),
    "LinearWarp": lambda given: differentiable.LinearWarp(threads=given),
    "depth": lambda given: warp3d.warp(PICTURE, DEPTH, EYE, EYE, threads=given),
    "disparity": lambda given: warp3d.warp_disparity(PICTURE, DEPTH, threads=given),
    "render_cloud": lambda given: points.render_cloud(CLOUD, EYE, size=SIZE, threads=given),
    "index_cloud": lambda given: points.index_cloud(CLOUD, EYE, size=SIZE, threads=given),
    "prepare_cloud": lambda given: points.prepare_cloud(CLOUD, threads=given),
    "CloudScene": lambda given: points.CloudScene(CLOUD, threads=given),
    "Gaussians": lambda given: points.render_gaussians(GAUSSIANS, EYE, size=SIZE, threads=given),
    "Scatter": lambda given: Scatter()([[1, 1]], [1.0], radius=1.0, shape=SHAPE, threads=given),
    "Resampler": lambda given: Resampler()(BALL, EYE, height=8, width=10, threads=given),
}
SHAPES: dict[str, Callable[[Any], Any]] = {
    "warp": lambda given: texture.warp(PICTURE, ONE, given),
    "resize": lambda given: texture.resize(PICTURE, given),
    "warp_chunks": lambda given: resample_chunks.warp_chunks(PICTURE, ONE, given),
    "Plan": lambda given: texture.Plan(ONE, given, (20, 40)),
    "coadd": lambda given: resample_sky.coadd([GRAY], [ONE], given),
    "Scatter": lambda given: Scatter()([[1, 1]], [1.0], radius=1.0, shape=given),
}
EXACT_SHAPES = {name: call for name, call in SHAPES.items() if name != "resize"}
SIZES: dict[str, Callable[[Any], Any]] = {
    "PictureScene": lambda given: texture.PictureScene(PICTURE).render(ONE, size=given),
    "depth": lambda given: warp3d.warp(PICTURE, DEPTH, EYE, EYE, size=given),
    "volume": lambda given: volume.render(CUBE, "0..2", size=given),
    "Scene": lambda given: volume.Scene(CUBE).render("0..2", size=given),
    "render_cloud": lambda given: points.render_cloud(CLOUD, EYE, size=given),
    "CloudScene": lambda given: points.CloudScene(CLOUD).render(size=given),
    "framed": lambda given: points.framed(CLOUD, size=given),
    "Gaussians": lambda given: points.render_gaussians(GAUSSIANS, EYE, size=given),
    "column_density": lambda given: resample_particles.column_density(PARTICLES, "z", size=given),
}
NUMBERS: dict[str, Callable[[Any], Any]] = {
    "degrees": lambda given: texture.rotate(PICTURE, given),
    "factor": lambda given: texture.scale(PICTURE, given),
    "quality": lambda given: texture.warp(PICTURE, ONE, SHAPE, quality=given),
    "noise": lambda given: warp3d.warp(PICTURE, DEPTH, EYE, EYE, noise=given),
    "step": lambda given: warp3d.warp(PICTURE, DEPTH, EYE, EYE, step=given),
    "fraction": lambda given: warp3d.warp_disparity(PICTURE, DEPTH, given),
    "field of view": lambda given: Camera.from_fov(given, 8, 10),
    "height": lambda given: Camera.from_fov(60, given, 10),
    "fx": lambda given: Camera.from_intrinsics(given, 1, 1, 1),
    "azimuth": lambda given: resample.Orbit(given, 20),
    "zoom": lambda given: resample.Orbit(30, 20, given),
    "threshold": lambda given: Resampler(threshold=given),
    "subpixels": lambda given: Resampler(subpixels=given),
    "ambient": lambda given: volume.Light(ambient=given),
    "shininess": lambda given: volume.Light(shininess=given),
    "mu_water": lambda given: volume.XRay(mu_water=given),
    "point_size": lambda given: points.CloudStyle(point_size=given),
    "edl": lambda given: points.CloudStyle(edl=given),
    "trained_focal": lambda given: points.GaussianStyle(trained_focal=given),
    "near": lambda given: points.GaussianStyle(near=given),
    "slice_at": lambda given: resample_particles.column_density(
        PARTICLES, "z", size=SIZE, slice_at=given
    ),
    "radius": lambda given: points.prepare_cloud(CLOUD, radius=given),
    "largest": lambda given: points.prepare_cloud(CLOUD, largest=given),
    "distance": lambda given: points.framed(CLOUD, size=SIZE, distance=given),
}
MATRICES: dict[str, Callable[[Any], Any]] = {
    "warp": lambda given: texture.warp(PICTURE, given, SHAPE),
    "warp_chunks": lambda given: resample_chunks.warp_chunks(PICTURE, given, SHAPE),
    "from_opencv": Camera.from_opencv,
    "moved": EYE.moved,
    "look_at": lambda given: resample.look_at(given, [0, 0, 0]),
}
CAMERAS: dict[str, Callable[[Any], Any]] = {
    "depth's target": lambda given: warp3d.warp(PICTURE, DEPTH, EYE, given),
    "depth's source": lambda given: warp3d.warp(PICTURE, DEPTH, given, EYE),
    "render_cloud": lambda given: points.render_cloud(CLOUD, given, size=SIZE),
    "Gaussians": lambda given: points.render_gaussians(GAUSSIANS, given, size=SIZE),
    "Resampler": lambda given: Resampler()(BALL, given, height=8, width=10),
    "volume": lambda given: volume.render(CUBE, "0..2", given, size=SIZE),
    "CloudScene": lambda given: points.CloudScene(CLOUD).render(given, size=SIZE),
}

LISTS = r"lists of different lengths are not a .*; give an? "
BAD: list[tuple[dict[str, Callable[[Any], Any]], Any, str]] = [
    (PICTURES, CHANNELS_FIRST, r"channels first.*numpy\.moveaxis\(image, 0, -1\)"),
    (PICTURES, None, r"a picture of NoneType; give an array \(H, W\)"),
    (PICTURES, {"a": 1}, r"a picture of dict; give an array \(H, W\)"),
    (PICTURES, GRADIENT, r"a picture of Tensor: .*requires grad"),
    (PICTURES, ON_DEVICE, r"a picture of Tensor: .*Use Tensor\.cpu\(\)"),
    (PICTURES, [[1, 2], [3]], LISTS),
    (PICTURES, "none.png", r"there is no such file.*none\.png"),
    (PICTURES, np.array([["a"]]), r"its values must be real"),
    (PICTURES, np.zeros((0, 0)), r"\(0, 0\)|\(0, 0, 1\)"),
    (PICTURES, np.zeros(5), r"\(5,\)"),
    (DEPTHS, None, r"a (depth|disparity) map of NoneType; give an array \(H, W\)"),
    (DEPTHS, GRADIENT, r"a (depth|disparity) map of Tensor: .*requires grad"),
    (DEPTHS, "none.png", r"there is no such file.*none\.png"),
    (DEPTHS, GRAY * 1j, r"a (depth|disparity) map of complex64; its values must be real numbers"),
    (DEPTHS, np.full((20, 40), np.nan), r"no (pixel has a depth|depth at all); check"),
    (DEPTHS, PICTURE, r"\(20, 40, 3\); give \(H, W\)|H x 2 H pixels, .*\(20, 40, 3\)"),
    (VOLUMES, None, r"a volume of NoneType; give an array \(Z, Y, X\)"),
    (VOLUMES, GRADIENT, r"a volume of Tensor: .*requires grad"),
    (VOLUMES, GRAY, r"an array \(Z, Y, X\) with voxels in it, not \(20, 40\)"),
    (VOLUMES, np.zeros((0, 0, 0)), r"\(Z, Y, X\) with voxels in it"),
    (VOLUMES, np.zeros((3, 5, 5, 5), np.uint8),
     r"channels come first.*numpy\.moveaxis\(values, 0, -1\)"),
    (VOLUMES, CUBE * 1j, r"a volume of complex64; its values must be real numbers"),
    (VOLUMES, "none.nrrd", r"none\.nrrd: there is no such file"),
    (CLOUDS, np.zeros((9, 3)), r"a cloud of ndarray; give a Cloud, .*or read_cloud\(path\)"),
    (CLOUDS, None, r"a cloud of NoneType; give a Cloud"),
    (CLOUDS, GAUSSIANS, r"a cloud of Gaussians; give a Cloud"),
    (THREADED, 0, r"threads 0; give a whole number of 1 or more"),
    (THREADED, -1, r"threads -1; give a whole number of 1 or more"),
    (THREADED, 1.5, r"threads 1\.5; give a whole number of 1 or more"),
    (THREADED, "2", r"threads '2'; give a whole number of 1 or more"),
    (SHAPES, (0, 5), r"a (target|picture) of 5 . 0 p"),
    (SHAPES, ("4", "5"), r"\('4', '5'\).*height and width.*two whole numbers of px"),
    (EXACT_SHAPES, 4, r"4.*height and width.*two whole numbers of px"),
    (SHAPES, (4.5, 5), r"\(4\.5, 5\).*two whole numbers of px"),
    (SHAPES, "4x5", r"'4x5'.*two whole numbers of px"),
    (SIZES, (0, 5), r"a (target|picture) of 0 . 5 p"),
    (SIZES, ("4", "5"), r"\('4', '5'\).*width and height.*two whole numbers of px"),
    (SIZES, 4.5, r"4.*width and height.*two whole numbers of px"),
    (SIZES, (4, 5, 3), r"\(4, 5, 3\).*two whole numbers of px"),
    (NUMBERS, "high", r"'high'(; give a number| is no number|$)"),
    (NUMBERS, [1, 2, 3], r"\[1, 2, 3\]"),
    (MATRICES, "eye", r"(matrix|intrinsics|pose|eye).*numbers"),
    (MATRICES, [[1, 2], [3]], r"(matrix|intrinsics|pose|eye).*numbers"),
    (MATRICES, np.eye(3) * 1j, r"(matrix|intrinsics|pose|eye).*numbers"),
    (CAMERAS, 5, r"(of|by) int; (give|sources of a panorama are made by)"),
    (CAMERAS, np.eye(5), r"ndarray|array"),
]  # fmt: skip
CASES = [
    pytest.param(call, given, words, id=f"{name}-{n}")
    for n, (calls, given, words) in enumerate(BAD)
    for name, call in calls.items()
]


def complaint(call: Callable[[], Any]) -> str:
    """The one line of an error that is meant for users."""
    with pytest.raises((ValueError, TypeError, LookupError, OSError)) as caught:
        call()
    assert type(caught.value) not in {KeyError, IndexError, UnicodeDecodeError}
    said = str(caught.value)
    assert "\n" not in said
    # Errors of Python and NumPy about our own code.
    assert not re.search(
        r"not supported|object is not|must be real number, |ufunc|missing \d", said
    )
    return said


@pytest.mark.some(163)
@pytest.mark.parametrize(("call", "given", "words"), CASES)
def test_a_bad_argument_is_refused_in_one_line(
    call: Callable[[Any], Any], given: Any, words: str
) -> None:
    said = complaint(lambda: call(given))
    assert re.search(words, said), said


OTHERS: dict[str, tuple[Callable[[], Any], str]] = {
    "method": (lambda: texture.warp(PICTURE, ONE, SHAPE, 3), "method 3; give a name"),
    "region": (lambda: texture.warp(PICTURE, ONE, SHAPE, roi=4), "4 is not a region: give left"),
    "look": (lambda: volume.render(CUBE, b"a", size=SIZE), "transfer b.a.; give a name"),
    "resampler": (
        lambda: volume.render(CUBE, "0..2", resampler="rays"),
        "a resampler of str; give a Resampler",
    ),
    "one value": (lambda: volume.load_transfer("1..1"), "1..1 is empty; give two values"),
    "Gaussians": (
        lambda: points.render_gaussians(CLOUD, EYE, size=SIZE),
        "Gaussians of Cloud; give Gaussians, as read_gaussians",
    ),
    "particles": (
        lambda: resample_particles.column_density(CLOUD, "z", size=SIZE),
        "particles of Cloud; give Particles",
    ),
    "cloud style": (
        lambda: points.render_cloud(CLOUD, EYE, size=SIZE, style="edl"),
        "a style of str; give a CloudStyle",
    ),
    "Gaussian style": (
        lambda: points.render_gaussians(GAUSSIANS, EYE, size=SIZE, style="bare"),
        "a style of str; give a GaussianStyle",
    ),
    "sources": (
        lambda: warp3d.render_together([], EYE, SHAPE),
        "sources of list; give the result of agreed",
    ),
    "samples": (
        lambda: Resampler()(np.zeros((5, 3)), EYE, height=8, width=10),
        "samples of ndarray; give Samples, such as particles",
    ),
    "primitive": (lambda: Resampler(primitive="pointz"), "hybrid, points, splats"),
    "background": (
        lambda: texture.resize(PICTURE, SHAPE).to_uint8(background=3),
        "background 3; give 3 of linear light, #rrggbb or a color's name",
    ),
    "path": (lambda: texture.resize(PICTURE, SHAPE).save(None), "a path of NoneType; give a text"),
    "scattered positions": (
        lambda: Scatter()("abc", [1.0], radius=1, shape=SHAPE),
        "positions .* numbers",
    ),
    "particle positions": (lambda: resample.particles("abc", (1, 0, 0), 0.9, 1), "numbers"),
    "control points": (lambda: resample_sky.control_points("a", "b", SHAPE), "numbers"),
    "viewed stack": (
        lambda: write_levels(Path("none.png"), np.zeros((5, 64, 80), np.uint8)),
        r"a picture of \(5, 64, 80\); give \(H, W\), or \(H, W, C\) of 1, 3 or 4",
    ),
    "empty cloud": (lambda: points.CloudScene(EMPTY).render(), "a cloud without points"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_an_argument_of_another_kind_is_refused_with_its_remedy(name: str) -> None:
    call, words = OTHERS[name]
    said = complaint(call)
    assert re.search(words, said), said


def test_texts_of_numbers_are_no_numbers() -> None:
    """`"30"` would be a name elsewhere."""
    said = complaint(lambda: texture.rotate(PICTURE, "30"))
    assert said == "degrees '30'; give a number"


WARNED: dict[str, tuple[Callable[[], Any], str]] = {
    "picture without values": (
        lambda: texture.warp(np.full((8, 10), np.nan), ONE, SHAPE),
        "no value of the picture is finite",
    ),
    "volume without values": (
        lambda: volume.render(np.full((5, 5, 5), np.nan), size=SIZE),
        "no value of array is finite",
    ),
    "window outside of the values": (
        lambda: volume.render(CUBE, "300..900", size=SIZE),
        r"nothing of array is visible: .* hides all of its values, 0\.\d+ to 0\.\d+",
    ),
    "scene's window outside of the values": (
        lambda: volume.Scene(CUBE).render("300..900", size=SIZE),
        r"nothing of array is visible: .* hides all of its values, 0\.\d+ to 0\.\d+",
    ),
    "constant volume": (
        lambda: volume.render(np.ones((5, 5, 5)), size=SIZE),
        "all values of array are 1",
    ),
    "cloud without places": (
        lambda: points.prepare_cloud(CLOUD._replace(position=np.full((9, 3), np.nan))),
        "none of 9 points can be drawn",
    ),
    "particles beside the slice": (
        lambda: resample_particles.column_density(PARTICLES, "z", size=SIZE, slice_at=50.0),
        "no particle reaches the slice at 50",
    ),
}


@pytest.mark.parametrize("name", WARNED)
def test_data_that_show_nothing_are_warned_of(name: str) -> None:
    call, words = WARNED[name]
    with pytest.warns(UserWarning, match=words) as caught:
        call()
    assert len(caught) == 1
    assert Path(caught[0].filename) == Path(__file__)


@pytest.mark.some(7)
@pytest.mark.parametrize(
    "call",
    [
        lambda: texture.resize(GRAY.tolist(), SHAPE),
        lambda: texture.resize(GRAY > 0.5, SHAPE),
        lambda: texture.resize(PICTURE, np.array(SHAPE)),
        lambda: texture.warp(PICTURE, ONE.tolist(), list(SHAPE), threads=np.int64(1)),
        lambda: texture.scale(PICTURE, [0.5, 0.5]),
        lambda: volume.render(CUBE.tolist(), "0..2", [30, 20], size=list(SIZE)),
        lambda: volume.render(CUBE > 0.5, "0..2", size=np.array(SIZE)),
        lambda: texture.rotate(PICTURE, np.float32(90)),
    ],
)
def test_lists_bools_and_scalars_of_numpy_are_taken(call: Callable[[], Any]) -> None:
    assert call() is not None
