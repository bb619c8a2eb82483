"""Stacks of frames and pictures of many channels, at every entry; matrices for each frame."""

import numpy as np
import pytest

from resample.files.conversion import as_picture
from resample_chunks import warp_chunks
from resample_sky import coadd, reproject
from resample_texture import (
    PictureScene,
    Plan,
    differentiable,
    project,
    resize,
    rotate,
    scale,
    undistort,
    warp,
)
from tests import commands

SHAPE = (20, 30)
TURN = np.array([[0.8, -0.2, 10], [0.2, 0.9, 0], [0, 1e-3, 1]])
TURNS = np.stack([TURN, np.eye(3), np.diag([0.5, 0.4, 1.0]), TURN @ TURN, np.linalg.inv(TURN)])
WORLD = [[10, 0, 0], [0, -10, 0]]
CAMERA, LENS = [40, 40, 39.5, 31.5], [-0.1, 0.01, 0, 0]
FLAT = "perspective:fov=60"

ENTRIES = {
    "warp": lambda image, **more: warp(image, TURN, SHAPE, **more),
    "majority": lambda image, **more: warp(image, TURN, SHAPE, "majority", **more),
    "map": lambda image, **more: warp(image, lambda x, y: (y, x), SHAPE, **more),
    "resize": lambda image, **more: resize(image, 40, **more),
    "box": lambda image, **more: resize(image, 20, box=(4, 8, 44, 38), **more),
    "scale": lambda image, **more: scale(image, 0.5, **more),
    "rotate": lambda image, **more: rotate(image, 30, **more),
    "undistort": lambda image, **more: undistort(image, CAMERA, LENS, **more),
    "project": lambda image, **more: project(image, FLAT, "fisheye:fov=90", SHAPE, **more),
    "reproject": lambda image, **more: reproject(image, WORLD, WORLD, SHAPE, **more),
    "Plan": Plan(TURN, SHAPE, (64, 80)),
}
ALONE = {
    "PictureScene": lambda image, **more: PictureScene(image, **more).render(TURN),
    "coadd": lambda image, **more: coadd([image], [TURN], SHAPE, **more),
    "LinearWarp": lambda image, **more: differentiable.LinearWarp()(
        image, differentiable.MapPlaces(*np.full((2, 9, 9), 4.0)), **more
    ),
    "warp_chunks": lambda image, **more: np.asarray(
        warp_chunks(image, TURN, SHAPE, out=np.empty((*SHAPE, *image.shape[2:])), **more)
    ),
}


@pytest.fixture
def frames():
    return np.random.default_rng(7).random((5, 64, 80))


@pytest.mark.parametrize("name", ENTRIES)
def test_frames_are_warped_one_by_one(name, frames):
    call = ENTRIES[name]
    made, each = call(frames, axis=0), [call(frame) for frame in frames]
    np.testing.assert_array_equal(made.image, np.stack([one.image for one in each]))
    np.testing.assert_array_equal(made.coverage, np.stack([one.coverage for one in each]))
    assert type(made) is type(each[0])


@pytest.mark.parametrize("name", ENTRIES)
def test_frames_of_colors_are_warped_one_by_one(name, frames):
    call, colors = ENTRIES[name], np.stack([frames, frames[::-1], 1 - frames], axis=-1)
    each = [call(frame).image for frame in colors]
    np.testing.assert_array_equal(call(colors).image, np.stack(each))


@pytest.mark.parametrize("name", ENTRIES | ALONE)
@pytest.mark.parametrize("shape", [(5, 64, 80), (64, 64, 64), (3, 40, 50), (500, 64, 80)])
def test_a_stack_of_which_nothing_is_said_is_refused(name, shape):
    with pytest.raises(ValueError, match=r"give axis=-1 if so, axis=0 if it is a stack") as caught:
        (ENTRIES | ALONE)[name](np.zeros(shape))
    said = str(caught.value)
    rows, columns, channels = shape
    assert f"{rows} rows of {columns} pixels with {channels} channels each" in said
    assert "\n" not in said


@pytest.mark.parametrize("name", ENTRIES)
@pytest.mark.parametrize("shape", [(5, 3, 40, 50), (2, 7, 64, 80)])
def test_many_channels_of_frames_are_refused(name, shape):
    with pytest.raises(ValueError, match=r"give axis=0 if so, .*numpy\.moveaxis\(image, 1, -1\)"):
        ENTRIES[name](np.zeros(shape))


@pytest.mark.parametrize("name", ENTRIES | ALONE)
def test_many_channels_are_channels_if_that_is_said(name):
    call, image = (ENTRIES | ALONE)[name], np.random.default_rng(7).random((64, 80, 20))
    made, gray = np.asarray(call(image, axis=-1)), np.asarray(call(image[..., 3]))
    np.testing.assert_allclose(made[..., 3], gray, atol=2e-6)  # other sums of float32
    np.testing.assert_array_equal(made, np.asarray(call(image, axis=2)))


@pytest.mark.parametrize("name", ALONE)
def test_stacks_are_refused_where_one_picture_is_taken(name, frames):
    with pytest.raises(ValueError, match=r"stack|frames"):
        ALONE[name](frames, axis=0)


@pytest.mark.parametrize(
    ("shape", "axis", "words"),
    [
        ((8, 9), 0, "leave that out"),
        ((8, 9), -1, "leave that out"),
        ((2, 8, 9, 3), -1, "leave that out"),
        ((5, 8, 9), 1, "axis 1; give 0 for frames, or -1 for channels"),
        ((5, 8, 9), "frames", "axis 'frames'; give 0"),
        ((5, 8, 9), True, "axis True; give 0"),
    ],
)
def test_an_axis_is_that_of_frames_or_channels(shape, axis, words):
    with pytest.raises(ValueError, match=words):
        warp(np.zeros(shape), TURN, SHAPE, axis=axis)


def test_files_say_themselves_what_their_channels_are(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    commands.store("bands.tif", np.random.default_rng(7).random((16, 24, 18), np.float32))
    image = as_picture("bands.tif")
    assert image.shape == (16, 24, 18)
    np.testing.assert_array_equal(
        resize("bands.tif", (8, 12)).image, resize(image, (8, 12), axis=-1).image
    )


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize("colors", [(), (3,)])
def test_each_frame_has_its_matrix(count, colors):
    frames = np.random.default_rng(7).random((count, 64, 80, *colors))
    matrices = TURNS[:count]
    made = warp(frames, matrices, SHAPE)
    each = [warp(*pair, SHAPE) for pair in zip(frames, matrices, strict=True)]
    np.testing.assert_array_equal(made.image, np.stack([one.image for one in each]))
    np.testing.assert_array_equal(made.coverage, np.stack([one.coverage for one in each]))


@pytest.mark.parametrize("shape", [(64, 80), (64, 80, 3), (5, 80, 3)])
@pytest.mark.parametrize("is_affine", [False, True])
def test_a_picture_with_many_matrices_becomes_a_stack(shape, is_affine):
    picture = np.random.default_rng(7).integers(0, 256, shape).astype(np.uint8)
    matrices = [one[:2] if is_affine else one for one in TURNS]
    options = {"convention": "opencv", "inverse": True, "roi": (3, 2, 20, 11)}
    made = warp(picture, matrices, SHAPE, **options)
    each = [warp(picture, matrix, SHAPE, **options).image for matrix in matrices]
    np.testing.assert_array_equal(made.image, np.stack(each))


def test_masks_and_outputs_are_those_of_the_stack(frames):
    hidden = np.ma.MaskedArray(frames, frames > 0.9)
    out = np.ma.zeros((5, *SHAPE))
    made = warp(hidden, TURNS, SHAPE, out=out)
    each = [warp(*pair, SHAPE).image for pair in zip(hidden, TURNS, strict=True)]
    assert made.image is out
    np.testing.assert_array_equal(np.ma.getmaskarray(out), [one.mask for one in each])
    np.testing.assert_array_equal(out.filled(0), [one.filled(0) for one in each])


@pytest.mark.parametrize(
    ("shape", "axis", "words"),
    [
        ((4, 64, 80), None, r"\(4, 64, 80\), with 5 matrices, would be 4 rows"),
        ((5, 12, 14), None, r"with 5 matrices, would be 5 rows .* axis=0 if it is a stack"),
        ((4, 64, 80), 0, "5 matrices for 4 frames; give one, or one for each"),
        ((4, 64, 80, 3), None, "5 matrices for 4 frames"),
        ((5, 3, 40, 50), None, r"numpy\.moveaxis\(image, 1, -1\)"),
    ],
)
def test_matrices_that_do_not_fit_are_refused(shape, axis, words):
    with pytest.raises(ValueError, match=words):
        warp(np.zeros(shape), TURNS, SHAPE, axis=axis)


@pytest.mark.parametrize("form", [(0, 3, 3), (5, 4, 4), (5, 3, 3, 1)])
def test_what_is_no_stack_of_matrices_is_refused(form):
    with pytest.raises(ValueError, match="a matrix holds numbers of the shape"):
        warp(np.zeros((64, 80)), np.zeros(form), SHAPE)


def test_a_plan_has_one_matrix():
    with pytest.raises(ValueError, match="a matrix holds numbers of the shape"):
        Plan(TURNS, SHAPE, (64, 80))
