"""Truth 7: a picture does not depend on the number of threads, nor on compilation."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.command.stopping import at_most
from resample.engine.jit import IS_PLAIN
from resample.files.images import read_image
from resample.painting.choices import Primitive, footprints_of
from resample.types import Samples
from tests.bits import assert_same
from tests.samples import painter


def scene(count=400):
    """Samples from close by to far away: splats and points in one picture."""
    rng = np.random.default_rng(7)
    near = rng.uniform((-4, -1, -4), (4, 3, 4), (count // 2, 3))
    far = rng.uniform((-300, 700, -300), (300, 800, 300), (count // 2, 3))
    return Samples(
        np.concatenate([near, far]).astype(np.float32),
        rng.uniform(0, 1, (count, 3)).astype(np.float32),
        rng.uniform(0, 0.3, count).astype(np.float32),
        0.6 * np.eye(3),
    )


CAMERA = Camera.from_intrinsics(30.0, 30.0, 24.0, 20.0, look_at((0, -6, 1), (0, 0, 0)))


def draw(**choices):
    threads = choices.pop("threads")
    return painter(**choices)(scene(), CAMERA, height=40, width=48, threads=threads)


@pytest.mark.some(7)
@pytest.mark.parametrize(
    ("primitive", "model"), [(form, model) for form in Primitive for model in footprints_of(form)]
)
def test_one_thread_and_two_give_the_same_bits(primitive, model):
    alone = draw(primitive=primitive, footprint=model, threads=1)
    together = draw(primitive=primitive, footprint=model, threads=2)
    assert_same(alone, together)


@pytest.mark.parametrize("threads", [1, 1000])
def test_any_number_of_threads_will_do(threads):
    assert draw(threads=threads).rgba.tobytes() == draw(threads=None).rgba.tobytes()


PLAIN = """
import sys
import numpy as np
from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.painting.choices import Primitive
from resample.painting.choices import footprints_of
from resample.resampler import Resampler
from resample.types import Samples

rng = np.random.default_rng(7)
samples = Samples(
    rng.uniform((-2, -1, -2), (2, 30, 2), (12, 3)).astype(np.float32),
    rng.uniform(0, 1, (12, 3)).astype(np.float32),
    rng.uniform(0, 2, 12).astype(np.float32),
    0.6 * np.eye(3),
)
camera = Camera.from_intrinsics(9.0, 9.0, 5.0, 4.5, look_at((0, -2, 1), (0, 0, 0)))
arrays = {}
for primitive in Primitive:
    for model in footprints_of(primitive):
        subpixels = None if primitive is Primitive.PAPER else 2  # which has none
        resample = Resampler(primitive=primitive, footprint=model, subpixels=subpixels)
        frame = resample(samples, camera, height=9, width=10)
        for name in ("rgba", "depth", "first_depth", "coverage"):
            arrays[f"{primitive}-{model}-{name}"] = getattr(frame, name)
np.savez(sys.argv[1], **arrays)
"""


def run(target, **environment):
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", PLAIN, str(target)],
        env={**os.environ, **environment},
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return np.load(target)


def drawn(target):
    """As `run`, in this process where kernels are compiled here."""
    if IS_PLAIN:
        return run(target, NUMBA_DISABLE_JIT="0")
    exec(PLAIN.replace("sys.argv[1]", repr(str(target))), {})
    return np.load(target)


MANY = {  # words of a command, which ends with its picture
    "texture": ["warp", "sample:bricks", "--matrix", "0.7,0.2,10,-0.2,0.7,90", "--size", "300"],
    "warp3d": ["render", "sample:room", "--move", "0.1,0,0"],
    "volume": ["render", "checker-box:size=48", "--size", "200"],
}


@pytest.mark.sweep
@pytest.mark.parametrize("application", MANY)
def test_64_threads_give_the_bits_of_one(application, tmp_path):
    for threads in ("64", "1"):
        picture = str(tmp_path / f"{threads}.exr")
        words = [f"resample_{application}", *MANY[application], "--threads", threads, "-o", picture]
        environment = {**os.environ, "NUMBA_NUM_THREADS": "64"}
        subprocess.run([sys.executable, "-m", *words], env=environment, check=True)
    many, one = (read_image(tmp_path / f"{threads}.exr") for threads in ("64", "1"))
    np.testing.assert_array_equal(many, one)


MORE = pytest.mark.sweep
ALONE = """
import os
import sys

from resample_volume.cli import app

words = ["render", "checker-box:size=8", "--size", "16", "-o", sys.argv[1]]
app([*words, "--threads", "1"], result_action="return_value")
print(len(os.listdir("/proc/self/task")))
"""


@pytest.mark.sweep
@pytest.mark.skipif(sys.platform != "linux", reason="threads are counted in /proc")
@pytest.mark.parametrize(("suffix", "most"), [pytest.param(".png", 2, marks=MORE), (".exr", 3)])
def test_libraries_make_no_more_threads_than_the_command_may_have(suffix, most, tmp_path):
    words = [sys.executable, "-c", ALONE, str(tmp_path / f"box{suffix}")]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    # The main thread waits, for the one that paints and the one that packs.
    assert int(done.stdout) <= most


def test_what_the_environment_allows_is_not_raised(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with at_most(2):
        assert os.environ["OMP_NUM_THREADS"] == "1"
        assert int(os.environ["OPENBLAS_NUM_THREADS"]) <= 2
    assert "OPENBLAS_NUM_THREADS" not in os.environ


@pytest.mark.sweep
@pytest.mark.slow
def test_kernels_give_the_same_picture_as_plain_python(tmp_path):
    compiled = drawn(tmp_path / "compiled.npz")
    plain = run(tmp_path / "plain.npz", NUMBA_DISABLE_JIT="1")
    assert compiled["hybrid-exact-rgba"].max() > 0.1
    for name in compiled:
        # Compiled, float32 sums may be contracted; plain, NumPy rounds each step.
        np.testing.assert_allclose(plain[name], compiled[name], atol=1e-5, rtol=1e-5, err_msg=name)
