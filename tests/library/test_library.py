"""The library of kernels that `make kernels` has built: the same bits, and numba is not needed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from resample.engine.compiled import library
from tests.processes import PATIENCE

ROOT = Path(__file__).parents[2]
BUILT = Path(library.__file__).with_name("_kernels.abi3.so")
IS_LEFT_ALONE = os.environ.get(library.VARIABLE) == "off"
pytestmark = pytest.mark.skipif(
    not BUILT.exists() or IS_LEFT_ALONE, reason="`make kernels` has built no library, or it is off"
)

HASHES = """
import hashlib, json, sys
import numpy as np
from tools.kernels.pictures import SCENES

def digest(picture):
    return hashlib.sha256(np.ascontiguousarray(picture).tobytes()).hexdigest()

print(json.dumps({name: digest(np.asarray(paint())) for name, paint in SCENES.items()}))
print("numba" in sys.modules, file=sys.stderr)
"""


@pytest.fixture
def without_numba(tmp_path):
    """Environment in which numba cannot be imported."""
    (tmp_path / "numba.py").write_text("raise ImportError('numba is blocked by a test')\n")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}


def ended(environment, *words):
    """A process of Python that has ended well."""
    done = subprocess.run(
        [sys.executable, *words],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done


def test_pictures_of_all_painters_have_the_bits_that_numbas_have(without_numba):
    by_library = json.loads(ended(without_numba, "-c", HASHES).stdout)
    environment = {**os.environ, "RESAMPLE_KERNELS": "off", "PYTHONPATH": str(ROOT)}
    by_numba = ended(environment, "-c", HASHES)
    assert by_numba.stderr.split()[-1] == "True"
    other = json.loads(by_numba.stdout)
    assert [name for name, digest in by_library.items() if other[name] != digest] == []


def test_every_command_of_the_docs_runs_without_numba(without_numba):
    ended(without_numba, "-m", "tools.kernels.scenes", "documented")


FILTER = """
from dataclasses import dataclass
import numpy as np
from resample import Camera, Resampler, particles

@dataclass(frozen=True)
class Quartic:
    radius: float = 1.25

    def __call__(self, distance):
        return np.maximum(0.0, 1 - (np.asarray(distance) / self.radius) ** 2) ** 2

balls = particles([[0, 0, 5], [0.3, 0.2, 5.5]], (1, 1, 1), 0.5, 1)
camera = Camera.from_fov(60, 24, 32)
frame = Resampler(pixel_filter=Quartic())(balls, camera, height=24, width=32)
print(frame.rgba.max() > 0)
"""


def test_a_filter_of_ones_own_needs_no_numba(without_numba):
    assert ended(without_numba, "-c", FILTER).stdout.split() == ["True"]


ROLE = """
import sys
from typing import NamedTuple
from resample.engine.jit import kernel
from resample.engine.lookup import unit_lookup
from tests.core.test_roles import Loud, heard
print(heard(Loud(2.0), 3.0), "numba" in sys.modules)
"""


def test_a_role_of_ones_own_is_compiled_by_numba():
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    assert ended(environment, "-c", ROLE).stdout.split() == ["60.0", "True"]
