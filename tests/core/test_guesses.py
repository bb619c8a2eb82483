"""Calls that users guess: most run, and all others are answered with what to write instead."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

import resample
import resample_points
import resample_texture
import resample_volume
import resample_warp3d

RANDOM = np.random.default_rng(0)
IMAGE = RANDOM.integers(0, 256, (48, 64, 3), np.uint8)
PLANE = np.array([[1, 0.1, 3], [0.05, 1, 2], [0, 0.0005, 1]])
LENS = np.array([[60, 0, 32], [0, 60, 24], [0, 0, 1.0]])
POSE = np.array([[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
MAPS = tuple(np.meshgrid(np.arange(32, dtype=np.float32), np.arange(24, dtype=np.float32)))
CUBE = RANDOM.integers(0, 256, (16, 18, 20), np.uint8)
XYZ, RGB = RANDOM.normal(size=(300, 3)), RANDOM.integers(0, 256, (300, 3), np.uint8)
CORNERS = [(0, 0), (64, 0), (64, 48), (0, 48)]
DEPTH = (2 + RANDOM.random((48, 64))).astype(np.float32)
NAMES = {
    **{name: value for name, value in globals().items() if name.isupper()},
    "np": np,
    "resample": resample,
    "points": resample_points,
    "texture": resample_texture,
    "volume": resample_volume,
    "warp3d": resample_warp3d,
}
RUNNING = """
texture.warp(IMAGE, PLANE)
texture.warp(IMAGE, PLANE, (48, 64))
texture.warp(IMAGE, PLANE, output_shape=(48, 64))
texture.warp(IMAGE, PLANE, edge="reflect")
texture.warp(IMAGE, PLANE, dsize=(64, 48))
texture.warp(IMAGE, PLANE, mode="constant")
texture.warp(IMAGE, PLANE, borderMode="reflect")
texture.resize(IMAGE, (24, 32), anti_aliasing=True)
texture.resize(IMAGE, size=(32, 24))
texture.rotate(IMAGE, 30, expand=True)
volume.render(CUBE, iso=128)
volume.render(CUBE, volume.Appearance("bone", classification="pre"), background="white")
volume.render(CUBE, width=64, height=48)
volume.render(CUBE, azimuth=30, elevation=20)
points.render(XYZ, azimuth=30, elevation=20)
texture.warp("a.png", PLANE)
texture.warp(IMAGE, MAPS)
texture.warp(IMAGE, PLANE[:2])
texture.warp(IMAGE, PLANE).save("b.png")
np.asarray(texture.warp(IMAGE, PLANE))
texture.resize(IMAGE, (32, 24))
texture.resize(IMAGE, 0.5)
texture.resize(IMAGE, width=32)
texture.rotate(IMAGE, angle=30)
texture.scale(IMAGE, 2)
texture.undistort(IMAGE, LENS, np.array([-0.1, 0.01, 0, 0, 0]))
volume.render(CUBE)
volume.render("a.npy")
volume.render(CUBE, transfer="bone")
volume.render(CUBE, cmap="viridis")
volume.render(CUBE, colormap="viridis")
volume.render(CUBE, projection="maximum")
volume.render(CUBE, projection="mip")
volume.render(CUBE, blending="mip")
volume.render(CUBE, projection="first-hit", isovalue=128)
volume.render(CUBE, spacing=(1, 1, 2.5))
volume.render(CUBE, voxel_size=(1, 1, 2.5))
volume.render(CUBE, window=(125, 150))
volume.render(CUBE, clim=(50, 200))
volume.render(CUBE, background="white")
volume.render(CUBE, size=64)
volume.render(CUBE, camera=(30, 20))
volume.render(CUBE, camera="front", fov=0)
volume.render(CUBE, method="paper")
volume.render(CUBE, shade=False)
volume.render(CUBE, scale_bar=True, color_bar=True, size=(200, 200))
volume.render([(CUBE, "bone"), (CUBE, "hot")], background="black")
volume.render(volume.Volume(CUBE))
volume.render(volume.Volume(CUBE, spacing=(1, 1, 2)))
volume.render(CUBE).to_image()
volume.open("a.npy")
volume.animate(CUBE, "a.webp", frames=2, size=32)
points.render("a.ply")
points.render(XYZ)
points.render(XYZ, colors=RGB)
points.render(XYZ, c=XYZ[:, 2], cmap="magma")
points.render(XYZ, point_size=3, background="white")
points.render(points.Cloud(XYZ), fov=0)
points.open("a.ply")
points.animate(XYZ, "b.webp", n_frames=2, size="32x24")
warp3d.warp(IMAGE, DEPTH, LENS, POSE)
warp3d.warp("a.png", "depth.npy", LENS, POSE)
warp3d.stereo(IMAGE, DEPTH)
warp3d.stereo(IMAGE, DEPTH, layout="anaglyph")
warp3d.stereo("a.png", "depth.npy", layout="sbs")
warp3d.animate(IMAGE, DEPTH, "c.webp", frames=2, fov=60)
texture.resize(IMAGE, fx=0.5, fy=0.5)
texture.resize(IMAGE, (24, 32), order=1)
texture.resize(IMAGE, scale=0.5, interpolation="bicubic")
texture.rescale(IMAGE, 0.5)
texture.rotate(IMAGE, 30, reshape=False)
texture.warp(IMAGE, PLANE, flags=1, borderMode="reflect", borderValue=0)
texture.remap(IMAGE, *MAPS, interpolation=1)
texture.undistort(IMAGE, cameraMatrix=LENS, distCoeffs=np.zeros(5))
volume.render(CUBE, "mip")
volume.render(CUBE, mode="mip", vmin=10, vmax=200)
volume.render(CUBE, cpos="xy", parallel_projection=True)
volume.render(CUBE, camera=[(60, 0, 0), (0, 0, 0), (0, 0, 1)])
volume.load("a.npy")
volume.Volume(CUBE).render(size=64)
points.render(XYZ, RGB, s=2)
points.render(points=XYZ, color="red")
points.render(XYZ, scalars=XYZ[:, 2], cmap="plasma", clim=(0, 1))
points.Cloud(points=XYZ).render(size=64)
points.read("a.ply")
points.animate(XYZ, "d.webp", frames=2, size=(32, 24))
warp3d.warp(IMAGE, DEPTH, intrinsics=LENS, pose=POSE)
warp3d.DepthImage(IMAGE, 1 / DEPTH)
warp3d.stereo(IMAGE, DEPTH, mode="sbs")
resample.open("a.ply")
resample.open("a.png")
resample.stereo(IMAGE, DEPTH)
resample.render("a.npy")
resample.render("a.ply")
resample.render(CUBE)
resample.render(XYZ)
resample.warp(IMAGE, PLANE)
resample.warp(IMAGE, DEPTH, resample.Camera(LENS), resample.Camera(LENS, POSE))
resample.resize(IMAGE, (32, 24))
texture.warp(IMAGE, PLANE, flags=18)
texture.warp(IMAGE, PLANE, borderMode=2, borderValue=(255, 255, 255))
texture.warp(IMAGE, PLANE, output_shape=(9, 9), order=3, mode="reflect", preserve_range=True)
texture.resize(IMAGE, None, fx=0.5, fy=0.5, interpolation=3)
texture.rescale(IMAGE, 0.5, channel_axis=-1)
texture.rotate(IMAGE, 30, expand=True, fillcolor="white")
texture.warp(IMAGE, texture.getPerspectiveTransform(CORNERS, CORNERS))
texture.pyrDown(IMAGE)
texture.zoom(IMAGE[..., 0], 2, order=3)
texture.map_coordinates(IMAGE[..., 0], np.stack(MAPS[::-1]), order=3, mode="nearest")
volume.render(CUBE, cmap="viridis", opacity="sigmoid", clim=[0, 200], size=32)
volume.render(CUBE, cmap="gray", opacity=[0, 0.1, 0.5], size=32)
volume.render(CUBE, rendering="iso", iso_threshold=128, size=32)
volume.render(CUBE, colormap="magma", scale=(2, 1, 1), size=32)
volume.render(CUBE, azimuth=30, elevation=20, zoom=1.5, size=32)
volume.mip(CUBE, axis=0, size=32)
volume.isosurface(CUBE, 128, size=32)
volume.plot(CUBE, cmap="hot")
volume.add_volume(CUBE, cmap="gray", opacity="linear", size=32)
volume.turntable(CUBE, frames=2, size=(16, 16))
points.render(XYZ, scalars=XYZ[:, 2], point_size=5, render_points_as_spheres=True)
points.render(XYZ, values=XYZ[:, 2], colormap="plasma", vmin=-1, vmax=1)
points.render(XYZ, eye=(0, 0, -5), lookat=(0, 0, 0), up=(0, 1, 0))
points.render(XYZ, extrinsic=POSE, intrinsic=LENS, width=64, height=48)
points.render(np.hstack([XYZ, RGB / 255]))
points.render(XYZ, normals=XYZ)
points.draw_geometries([points.Cloud(XYZ), points.Cloud(XYZ + 1)])
points.PointCloud(points=XYZ, colors=RGB)
points.Cloud(xyz=XYZ, colors=RGB)
points.Gaussians(XYZ, np.exp(XYZ), np.ones((300, 4)), np.ones(300), sh=np.ones((300, 4, 3)))
warp3d.render(IMAGE, DEPTH, fov=60, move=(0.1, 0, 0))
warp3d.render(IMAGE, DEPTH, LENS, POSE)
warp3d.render(IMAGE, DEPTH, fx=60, fy=60, cx=32, cy=24, translation=(0.1, 0, 0))
warp3d.render(color=IMAGE, depth=DEPTH, K=LENS, R=np.eye(3), t=(0.1, 0, 0))
warp3d.novel_view(IMAGE, DEPTH, POSE, fov=60)
warp3d.reproject(IMAGE, DEPTH, LENS, POSE)
warp3d.stereo(IMAGE, disparity=DEPTH)
warp3d.stereo(IMAGE, DEPTH, mode="sbs", divergence=2, convergence=50)
warp3d.anaglyph(IMAGE, DEPTH)
warp3d.animate(IMAGE, DEPTH, fov=60, path="dolly", frames=2)
""".strip().splitlines()
ANSWERED = {
    "texture.warp(IMAGE, PLANE, resample=3)": "interpolation=",
    "texture.warp(IMAGE, PLANE, fil=0)": "did you mean 'fill'",
    "texture.resize(IMAGE, fx=0.5, fy=0.25)": r"scale\(image, factor\)",
    "texture.rotate(IMAGE, 30, center=(3, 4))": "matrix for warp",
    "texture.flip(IMAGE)": "::-1",
    "texture.crop(IMAGE, (0, 0, 9, 9))": "roi=",
    "texture.affine(IMAGE, PLANE)": "resample_dropins.opencv",
    "texture.thumbnail(IMAGE, 16)": "resize",
    "texture.load('a.png')": "take paths",
    "texture.warp_polar(IMAGE, radius=20)": "warpPolar",
    "texture.equirectangular_to_perspective(IMAGE, fov=90)": r"project\(image",
    "volume.render(CUBE, gamma=0.8)": "transfer=",
    "volume.render(CUBE, isomin=3, isomax=9)": "surface=",
    "points.render(XYZ, alpha=0.5)": "opaque",
    "points.render(XYZ, R=np.eye(3), T=(0, 0, 5))": r"camera=Camera\(matrix",
    "points.render(XYZ, radius=0.01)": "point_size=",
    "points.scatter(XYZ[:, 0], XYZ[:, 1], XYZ[:, 2])": "column_stack",
    "points.Cloud(XYZ, RGB)": "colors=",
    "warp3d.render(IMAGE, DEPTH, rotation=(0, 10, 0))": "turn=",
    "warp3d.render(IMAGE, DEPTH, znear=0.1)": "near=",
    "warp3d.stereo(IMAGE, DEPTH, baseline=0.065)": "eye-distance",
    "warp3d.unproject(DEPTH, LENS)": "--export",
    "warp3d.RGBDImage(IMAGE, DEPTH)": "1 / depth",
    "volume.render(CUBE, color='red')": "colors of values",
    "volume.slice(CUBE)": r"values\[k\]",
    "volume.open('a.npy').shape": "values.shape",
    "warp3d.prepare(IMAGE, DEPTH)": "DepthImage",
    "warp3d.DepthImage(IMAGE, depth=DEPTH)": "1 / depth",
    "warp3d.Camera(fov=60)": "Camera.from_fov",
    "warp3d.Camera(fx=60, fy=60, cx=32, cy=24)": "Camera.from_intrinsics",
    "warp3d.merge([(IMAGE, DEPTH)])": "results of warp",
    "points.rasterization(XYZ)": "render_gaussians",
    "resample.rotate(IMAGE, 10)": "resample_texture.rotate",
    "resample.warp(IMAGE, depth=DEPTH)": "resample_warp3d.warp",
    "volume.render(CUBE, width=64)": r"size=\(width, height\)",
    "volume.render(CUBE, azimuth=30)": r"camera=\(azimuth",
    "volume.render(CUBE, vmin=3)": "window=",
    "volume.render(CUBE, transfre='bone')": "did you mean 'transfer'",
    "volume.render(CUBE, cmap='bone', transfer='hot')": "twice",
    "volume.render([CUBE, CUBE])": "list of pairs",
    "volume.render(CUBE, volume.Appearance('bone'), window=(1, 2))": "leave window out",
    "volume.render(CUBE, resampler=resample.Resampler(), iso=3)": "leave iso, projection out",
    "volume.render(CUBE).image": "np.asarray",
    "volume.render(CUBE).to_pil()": "to_image",
    "points.render(XYZ, RGB, colors=RGB)": "after the scene",
    "points.render(XYZ, projection='orthographic')": "fov=0",
    "warp3d.warp(IMAGE, DEPTH, LENS, LENS, POSE)": "give",
    "resample.render('a.png')": "resample.warp",
    "resample.render(IMAGE)": "resample.warp",
    "resample.render(None)": "give a file",
}


@pytest.fixture
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Image.fromarray(IMAGE).save("a.png")
    np.save("a.npy", CUBE)
    np.save("depth.npy", DEPTH)
    trimesh.PointCloud(XYZ, RGB).export("a.ply")


def run(call: str) -> Any:
    return eval(call, NAMES)


@pytest.mark.usefixtures("_files")
@pytest.mark.parametrize("call", RUNNING)
def test_it_runs(call: str) -> None:
    run(call)


@pytest.mark.usefixtures("_files")
@pytest.mark.parametrize(("call", "answer"), ANSWERED.items())
def test_it_is_answered(call: str, answer: str) -> None:
    with pytest.raises((TypeError, ValueError, AttributeError), match=answer) as caught:
        run(call)
    assert "\n" not in str(caught.value)


def test_sizes_of_others_are_width_and_height() -> None:
    assert resample_texture.warp(IMAGE, PLANE, dsize=(64, 20)).image.shape == (20, 64, 3)
    assert resample_texture.resize(IMAGE, size=(64, 20)).image.shape == (20, 64, 3)


def test_options_of_calls_make_the_picture_of_the_command(tmp_path: Path) -> None:
    from resample_volume.cli import app

    words = ["render", "sample:vessel-tree", "--size", "64x48", "--transfer", "bone", "--box"]
    words += ["--camera", "40,30,1", "--fov", "20", "-o", str(tmp_path / "a.png")]
    app(words, result_action="return_value")
    frame = resample_volume.render(
        "sample:vessel-tree", size=(64, 48), transfer="bone", box=True, camera=(40, 30), fov=20
    )
    with Image.open(tmp_path / "a.png") as written:
        np.testing.assert_array_equal(frame.to_uint8(background="black"), np.asarray(written))


def test_editors_know_all_options_of_a_picture() -> None:
    from resample.command.settings import FrameFormat, PictureFormat, Resampling, option_of
    from resample_points.calls import RenderOptions as OfPoints
    from resample_points.command.choices import CloudOptions, CloudStart
    from resample_points.command.gaussians import GaussianOptions
    from resample_volume.calls import RenderOptions as OfVolumes
    from resample_volume.command.choices import AppearanceChoices, PictureExtras, ReadOptions

    def options(*models: Any) -> set[str]:
        named = {option_of(model, field) for model in models for field in model.model_fields}
        return {name.replace("-", "_") for name in named}

    of_volumes = options(AppearanceChoices, Resampling, PictureExtras, ReadOptions, PictureFormat)
    assert set(OfVolumes.__annotations__) ^ of_volumes == {"camera", "size", "bits", "deep", "clim"}
    of_points = options(CloudOptions, GaussianOptions, CloudStart, FrameFormat)
    apart = "clim camera steady size bits also level no_cache eyes deep color_by color_bar range "
    apart += "threads filter colormap"
    assert set(OfPoints.__annotations__) ^ of_points == set(apart.split())


def test_films_without_a_file_are_returned() -> None:
    made = resample_volume.animate(CUBE, frames=2, size=(20, 16))
    assert made is not None
    assert made.shape == (2, 16, 20, 3)


def test_a_projection_along_an_axis_is_that_of_the_array() -> None:
    seen = resample_volume.render(CUBE, "gray", axis=0, projection="maximum", spacing=(1, 1, 1))
    bottom = resample_volume.render(CUBE, "gray", "bottom", projection="maximum", fov=0)
    np.testing.assert_array_equal(seen.rgba, bottom.rgba)


def test_options_of_depth_images_are_those_of_the_commands() -> None:
    from typing import get_type_hints

    from resample import registry
    from resample.command.flags import marks_of
    from resample_points import calls as of_points
    from resample_volume import calls as of_volumes
    from resample_warp3d import calls

    apart = {
        ("warp3d", "stereo"): (calls.StereoOptions, "output batch recursive skip-errors from"),
        ("warp3d", "animate"): (calls.AnimateOptions, "output"),
        ("volume", "animate"): (of_volumes.AnimateOptions, "output size camera"),
        ("points", "animate"): (of_points.AnimateOptions, "output"),
    }
    more = {"disparity", "clim", "zoom-in"}  # and those of snapshots
    more |= {name.replace("_", "-") for name in get_type_hints(of_points.DensityOptions)}
    for (application, command), (options, left_out) in apart.items():
        function = registry.load("apps", application)[command].default_command
        known = {name.replace("_", "-") for name in get_type_hints(options)}
        assert known - more == set(marks_of(function)) - {*left_out.split()} - more, application


def test_colors_that_are_given_for_normals_are_told() -> None:
    light = resample_points.Cloud(XYZ, colors=np.full((300, 3), 188, np.uint8)).color
    assert float(light.mean()) == pytest.approx(0.5, abs=0.005)
    even = np.tile([0, 0, 1.0], (300, 1))
    assert len(resample_points.Cloud(XYZ, even).normal) == 300
    with pytest.raises(TypeError, match="colors="):
        resample_points.Cloud(XYZ, RGB / 255)


def test_what_is_assumed_of_a_camera_is_told() -> None:
    with pytest.warns(UserWarning, match="assumed a field of view of 60 degrees"):
        resample_warp3d.animate(IMAGE, DEPTH, path="dolly", frames=2)
    with pytest.warns(UserWarning, match="the view is the picture's own"):
        resample_warp3d.render(IMAGE, DEPTH, LENS)
