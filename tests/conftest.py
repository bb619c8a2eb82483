"""What all tests share: where the real data lies, and a generator of random numbers."""

import os
from pathlib import Path

import numpy as np
import pytest

DATA = Path(os.environ.get("RESAMPLE_TEST_DATA", Path(__file__).parents[1] / "../shared/data"))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def volumes() -> Path:
    """The folder of real volumes; tests that want it are skipped where it is absent."""
    folder = (DATA / "volumes").resolve()
    if not folder.is_dir():
        pytest.skip("the real volumes are not on this machine (set RESAMPLE_TEST_DATA)")
    return folder
