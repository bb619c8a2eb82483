import cv2
import numpy as np
import pytest

from resample.colors import from_srgb
from resample.files.images import read_image


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_every_level_of_a_file_has_the_curves_light(dtype, tmp_path):
    largest = np.iinfo(dtype).max
    levels = np.arange(largest + 1, dtype=dtype).reshape(16, -1)
    picture = np.vstack([levels] * 2)  # more values than levels
    cv2.imwrite(str(tmp_path / "levels.png"), picture)
    found = read_image(tmp_path / "levels.png")[..., 0]
    truth = from_srgb((picture / largest).astype(np.float32))
    np.testing.assert_allclose(found, truth, rtol=2e-6)  # float32
