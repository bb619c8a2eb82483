"""Deep pictures: slabs that are put over each other are the flat picture."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from resample.cameras.viewpoints import Orbit
from resample.files.images import read_channels
from resample.files.saving import DepthSlab, write_deep
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume.appearance import Appearance, Classification
from resample_volume.cli import app
from resample_volume.meshes import scene_mesh
from resample_volume.rendering import Subject, boxed, check_slabs, depths, slabs
from resample_volume.voxels.shading import Light
from tests.commands import refused
from tests.deep import read_deep
from tests.volume.test_ray_truth import BLOBS, LOOK

SIZE = (40, 48)


def over(layers):
    """Layers from the nearest on, put over each other."""
    total = np.zeros((*layers[0].shape[:2], 4))
    for layer in layers:
        total += (1 - total[..., 3:]) * layer
    return total


def pieces(appearance, resampler, viewpoint, count):
    subject = Subject.of(BLOBS, appearance, resampler)
    camera = subject.camera(viewpoint, *SIZE)
    seen = subject.samples_for(camera)

    def paint(eye):
        return resampler(seen, eye, height=SIZE[0], width=SIZE[1], clip=subject.clip)

    planes = depths(camera, boxed([(BLOBS, subject.appearance)], subject), count)
    return paint(camera), list(slabs(paint, camera, planes))


POST = {"classification": Classification.POST}
WALL = scene_mesh(
    np.array([[0.0, 0, 5], [11, 0, 5], [11, 12, 4], [0, 12, 4]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
    (0.8, 0.1, 0.1),
)


@pytest.mark.sweep
@pytest.mark.parametrize("fov", [30.0, 0.0])
@pytest.mark.parametrize(
    ("choices", "order"),
    [
        pytest.param({}, None, id="splats"),
        pytest.param(POST | {"meshes": (WALL,)}, Rays(), id="mesh"),
        *(
            pytest.param(*each, id=name, marks=pytest.mark.sweep)
            for name, *each in [
                ("unlit splats", {"light": None}, None),
                ("unlit rays", POST | {"light": None}, Rays()),
                ("rays", POST | {"light": Light((1, -1, 2))}, Rays()),
                ("clipped", POST | {"clip": ("1/0/0",)}, Rays()),
            ]
        ),
    ],
)
def test_slabs_over_each_other_are_the_flat_picture(choices, order, fov, record):
    resampler = Resampler(subpixels=4) if order is None else Resampler(order=order, subpixels=4)
    flat, layers = pieces(Appearance(LOOK, **choices), resampler, Orbit(30, 20, 1.0, fov), 16)
    found = over([slab.rgba for slab in layers])
    error = np.abs(found - flat.rgba)
    steep = np.abs(np.stack(np.gradient(flat.rgba, axis=(0, 1)))).max(axis=(0, 3))
    smooth = gaussian_filter(steep, 1.0) < 0.01
    assert smooth.sum() > 100
    record.error("largest where it is smooth", error[smooth].max())
    record.error("largest", error.max())
    assert sum(slab.rgba[..., 3].max() > 0.01 for slab in layers) > 5


@pytest.mark.sweep
def test_a_camera_inside_sees_slabs_from_its_near_plane_on(record):
    flat, layers = pieces(
        Appearance(LOOK, **POST), Resampler(order=Rays(), subpixels=4), Orbit(30, 20, 8), 12
    )
    record.error("largest", np.abs(over([slab.rgba for slab in layers]) - flat.rgba).max())


def test_samples_are_where_slabs_are_and_empty_ones_are_not_kept(tmp_path):
    rng = np.random.default_rng(5)
    layers = []
    for n in range(4):
        rgba = rng.uniform(0, 1, (3, 5, 4)).astype(np.float32)
        rgba[rng.uniform(size=(3, 5)) < 0.5] = 0
        layers.append(DepthSlab(float(n), n + 1.0, rgba))
    write_deep(tmp_path / "deep.exr", layers)
    read = read_deep(tmp_path / "deep.exr")
    for row in range(3):
        for column in range(5):
            kept = [(*slab.rgba[row, column], slab.near, slab.far) for slab in layers]
            kept = [sample for sample in kept if any(sample[:4])]
            np.testing.assert_array_equal(read[row][column], np.reshape(kept, (-1, 6)))


def test_the_command_writes_a_deep_picture_of_its_flat_one(tmp_path):
    words = ["render", "checker-box:size=24,block=6", "--size", "24", "--method", "splats"]
    words += ["--subpixels", "4"]
    app([*words, "-o", str(tmp_path / "flat.exr")], result_action="return_value")
    app([*words, "-o", str(tmp_path / "deep.exr"), "--deep", "8"], result_action="return_value")
    flat, read = read_channels(tmp_path / "flat.exr"), read_deep(tmp_path / "deep.exr")
    flat = np.dstack([flat[name] for name in "RGBA"])
    most = 0
    for row, pixels in enumerate(read):
        for column, samples in enumerate(pixels):
            total = np.zeros(4)
            for sample in samples:
                total += (1 - total[3]) * sample[:4]
            assert (np.diff(samples[:, 4]) > 0).all()
            np.testing.assert_allclose(total, flat[row, column], atol=0.02)
            most = max(most, len(samples))
    assert 2 < most <= 8


@pytest.mark.some(4)
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["-o", "a.png", "--deep", "4"], "a.png: deep pictures are written as .exr"),
        (["-o", "a.exr", "--deep", "0"], "greater than or equal to 1"),
        (["-o", "a.exr", "--deep", "4", "--projection", "maximum"], "composited samples"),
        (["-o", "a.exr", "--deep", "4", "--box"], "deep pictures hold only slabs"),
        (["-o", "a.gif"], "pictures are written as .png, .exr, .jpg"),
        (["-o", "a.jpg", "--bits", "16"], ".jpg has 8 bits per channel, not 16"),
        (["-o", "a.jpg", "--background", "none"], "JPEG has no transparency"),
        (["-o", "a.png", "--bits", "32"], "PNG has 8 or 16 bits per channel, not 32"),
    ],
)
def test_what_cannot_be_written_is_one_line(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert said in refused(app, capsys, "render", "checker-box", *words)


def test_slabs_are_of_a_sane_number():
    with pytest.raises(ValueError, match="give 1 to 1024"):
        check_slabs(2000, Resampler())
    with pytest.raises(ValueError, match="composited samples"):
        check_slabs(4, Resampler(order=Rays(), projection=Projection.MAXIMUM))


@pytest.mark.sweep
@pytest.mark.parametrize(("name", "bits", "slack"), [
    ("a.jpg", 8, 0.06), ("a.tif", 8, 0.01), ("a.tif", 16, 1e-4), ("a.tiff", 32, 1e-6),
])  # fmt: skip
def test_pictures_of_other_formats_are_those_of_exr(name, bits, slack, tmp_path):
    words = ["render", "checker-box:size=24,block=6", "--size", "32", "--background", "white"]
    app([*words, "-o", str(tmp_path / name), "--bits", str(bits)], result_action="return_value")
    app([*words, "-o", str(tmp_path / "flat.exr")], result_action="return_value")
    flat = read_channels(tmp_path / "flat.exr")
    whole = np.dstack([flat[c] + 1 - flat["A"] for c in "RGB"])
    from resample.files.images import read_image

    found = read_image(tmp_path / name)
    assert found.shape == (32, 32, 3)
    assert np.sqrt(np.mean((found - np.clip(whole, 0, 1 if bits < 32 else 9)) ** 2)) < slack
