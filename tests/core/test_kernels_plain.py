"""A few pictures so small that kernels can paint them as plain Python (NUMBA_DISABLE_JIT=1)."""

import os
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.engine import jit
from resample.painting.choices import Opacity, Primitive, footprints_of
from resample.profiles.reconstruction import GaussianKernel
from resample.types import Samples
from resample_points import Gaussians, write_gaussians
from tests import naive
from tests.commands import ended
from tests.processes import PATIENCE
from tests.samples import painter

SIDE = 8  # px
PICTURES = {
    "warp": "resample-texture warp photo.png --corners '2,3 20,4 18,18 3,15' --size 16",
    "enlarge": "resample-texture resize photo.png --size 32",
    "shrink": "resample-texture resize photo.png --size 10",
    "depth": "resample-warp3d render photo.png depth.npy --fov 60 --move 0.1,0,0 --size 16",
    "stereo": "resample-warp3d stereo photo.png depth.npy --fov 60 --eye-distance 0.1",
    "cloud": "resample-points render cloud.ply --size 16",
    "gaussians": "resample-points render gaussians.ply --size 16",
    "rays": "resample-volume render ball.npy --size 16",
    "splats": "resample-volume render ball.npy --size 16 --method splats",
}


def two(spacing=1.0):
    return Samples(
        np.array([(0.3, -0.2, 6.0), (-0.4, 0.1, 7.0)], np.float32),
        np.array([(1.0, 0.5, 0.0), (0.0, 0.5, 1.0)], np.float32),
        np.array([1.0, 2.0], np.float32),
        spacing * np.eye(3),
    )


def draw(samples, camera, **choices):
    return painter(**choices)(samples, camera, height=SIDE, width=SIDE)


@pytest.mark.parametrize(
    "camera", [Camera.from_intrinsics(8.0, 8.0, 4.1, 3.9), Orthographic(1.5, 1.5, 4.1, 3.9)]
)
def test_splats_are_the_kernels_along_the_rays(camera):
    samples = two()
    frame = draw(samples, camera, primitive=Primitive.SPLATS)
    kernel = GaussianKernel()
    integral = naive.all_line_integrals(samples, camera, kernel, height=SIDE, width=SIDE)
    alpha = 1 - np.exp(-integral * samples.extinction[:, None, None])
    truth = naive.composite(alpha, samples.color, samples.position[:, 2])
    np.testing.assert_allclose(frame.rgba, truth, atol=1e-5)  # tables of 1024 steps


@pytest.mark.parametrize("primitive", [Primitive.HYBRID, Primitive.SPLATS])
def test_samples_of_a_size_each_are_those_of_a_lattice_that_wide(primitive):
    camera, scale = Camera.from_intrinsics(8.0, 8.0, 4.1, 3.9, near=6.5), np.array([0.5, 0.5])
    samples = two()._replace(extinction=np.array([0.001, 0.002], np.float32))
    frame = draw(samples._replace(scale=scale), camera, primitive=primitive)
    other = draw(samples._replace(lattice=0.5 * samples.lattice), camera, primitive=primitive)
    np.testing.assert_allclose(frame.rgba, other.rgba, rtol=2e-3, atol=1e-8)
    assert frame.rgba.max() > 1e-4


def test_spheres_close_to_the_eye_are_the_kernels_along_the_rays():
    samples = two()._replace(position=np.array([(0.3, 0, 2.5), (0, 0.2, 3.5)], np.float32))
    camera = Camera.from_intrinsics(4.0, 4.0, 4.1, 3.9)
    frame = draw(samples, camera, primitive=Primitive.SPLATS)
    kernel = GaussianKernel()
    integral = naive.all_line_integrals(samples, camera, kernel, height=SIDE, width=SIDE)
    truth = np.exp(-(integral * samples.extinction[:, None, None]).sum(axis=0))
    np.testing.assert_allclose(1 - frame.rgba[..., 3], truth, atol=1e-4)


@pytest.mark.parametrize(
    ("primitive", "model"), [(form, model) for form in Primitive for model in footprints_of(form)]
)
@pytest.mark.parametrize("focal", [1.0, 6.0])
def test_every_choice_paints_something_sensible(primitive, model, focal):
    camera = Camera.from_intrinsics(focal, focal, 4.1, 3.9)
    frame = draw(two(), camera, primitive=primitive, footprint=model)
    assert 0 <= frame.rgba.min() <= frame.rgba.max() <= 1
    # Depths are those of the centers, or where the rays of a pixel pass nearest to them.
    fine = Camera.from_intrinsics(4 * focal, 4 * focal, 16.4, 15.6)
    nearest = np.moveaxis(naive.nearest_depths(two(), fine, height=32, width=32), 0, -1)
    nearest = nearest.reshape(SIDE, 4, SIDE, 4, 2).transpose(0, 2, 1, 3, 4).reshape(SIDE, SIDE, 32)
    is_seen = frame.rgba[..., 3] > 1e-3
    assert (frame.depth >= np.minimum(nearest.min(axis=-1), 5.99))[is_seen].all()
    assert (frame.depth <= np.maximum(nearest.max(axis=-1), 7.01))[is_seen].all()
    assert frame.statistics.points + frame.statistics.splats <= 2  # some miss all pixels


def test_the_order_of_many_samples_does_not_change_a_bit():
    """More than insertion sort takes, with ties and duplicates."""
    rng = np.random.default_rng(7)
    samples = Samples(
        rng.integers(0, 3, (60, 3)).astype(np.float32) + np.array([-1, -1, 60], np.float32),
        rng.choice([0.2, 0.7], (60, 3)).astype(np.float32),
        rng.choice([0.1, 0.2], 60).astype(np.float32),
        np.eye(3),
    )
    order = rng.permutation(60)
    shuffled = Samples(*(samples[n][order] for n in range(3)), lattice=samples.lattice)
    camera = Camera.from_intrinsics(30.0, 30.0, 4.1, 3.9)
    first, again = (draw(one, camera, subpixels=1) for one in (samples, shuffled))
    assert first.rgba.tobytes() == again.rgba.tobytes()


@pytest.mark.sweep
def test_linear_opacity_is_linear_in_the_line_integral():
    sample = Samples(*(column[:1] for column in two()[:3]), lattice=np.eye(3))
    camera = Camera.from_intrinsics(8.0, 8.0, 4.1, 3.9)
    frame = draw(sample, camera, primitive=Primitive.SPLATS, opacity=Opacity.LINEAR)
    kernel = GaussianKernel()
    integral = naive.all_line_integrals(sample, camera, kernel, height=SIDE, width=SIDE)[0]
    np.testing.assert_allclose(frame.rgba[..., 3], (1 - np.exp(-1)) * integral, atol=1e-5)


def paint(folder):
    """Paint small pictures by the commands of every application, from files in a folder."""
    os.chdir(folder)
    for name, line in PICTURES.items():
        program, *words = shlex.split(line)
        app = import_module(f"{program.replace('-', '_')}.cli").app
        assert ended(app, *words, "-o", f"{name}-{jit.IS_PLAIN}.png") == 0


@pytest.fixture
def inputs(tmp_path, monkeypatch):
    """Folder with a small picture, its depth, a cloud, Gaussians and a volume."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(7)
    cv2.imwrite("photo.png", rng.integers(0, 256, (18, 24, 3)).astype(np.uint8))
    np.save("depth.npy", np.where(np.arange(24) < 12, 2.0, 3.0) + np.zeros((18, 1)))
    head = "ply\nformat ascii 1.0\nelement vertex 40\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header"
    np.savetxt("cloud.ply", rng.random((40, 3)), header=head, comments="")
    place, turn, color = (rng.normal(size=(12, n)).astype(np.float32) for n in (3, 4, 3))
    size, opacity = np.full((12, 3), 0.3, np.float32), rng.random(12).astype(np.float32)
    none = np.zeros((12, 0, 3), np.int16)
    write_gaussians("gaussians.ply", Gaussians(place, size, turn, opacity, color, none, 1e-3))
    z, y, x = np.mgrid[-1:1:8j, -1:1:8j, -1:1:8j]
    np.save("ball.npy", (120 * np.clip(1.2 - np.sqrt(x * x + y * y + z * z), 0, 1)).astype("u1"))
    return tmp_path


@pytest.mark.skipif(not jit.IS_PLAIN, reason="pictures of plain Python are those of machine code")
def test_pictures_of_every_application_are_those_of_machine_code(inputs):
    code = f"from tests.core.test_kernels_plain import paint; paint({str(inputs)!r})"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0"}
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", code]
    subprocess.run(command, cwd=root, env=environment, check=True, timeout=PATIENCE)
    paint(inputs)
    for name in PICTURES:
        plain, compiled = (cv2.imread(f"{name}-{which}.png", -1) for which in (True, False))
        assert compiled.max() > 99, name
        assert np.abs(plain.astype(int) - compiled).max() <= 1, name  # level: both are rounded
