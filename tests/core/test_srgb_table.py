import zlib

import cv2
import numpy as np
import pytest

from resample.colors import from_srgb, to_srgb
from resample.files.formats import levels
from resample.files.images import read_image


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_every_level_of_a_file_has_the_curves_light(dtype, tmp_path):
    largest = np.iinfo(dtype).max
    levels = np.arange(largest + 1, dtype=dtype).reshape(16, -1)
    picture = np.vstack([levels] * 2)  # more values than levels
    png = cv2.imencode(".png", picture)[1].tobytes()
    mark = b"sRGB\0"  # without which levels of 16 bits are linear
    header = 33  # bytes before the first chunk after the header's
    chunk = b"\0\0\0\1" + mark + zlib.crc32(mark).to_bytes(4, "big")
    (tmp_path / "levels.png").write_bytes(png[:header] + chunk + png[header:])
    found = read_image(tmp_path / "levels.png")[..., 0]
    truth = from_srgb((picture / largest).astype(np.float32))
    np.testing.assert_allclose(found, truth, rtol=2e-6)  # float32


def test_light_becomes_the_levels_of_the_curve(rng):
    """At all bounds of levels, found by the curve, three floats to each side, and at random."""
    bound = from_srgb((np.arange(255) + 0.5) / 255).astype(np.float32).view(np.int32)
    near = (bound[:, None] + np.arange(-3, 4, dtype=np.int32)).view(np.float32).ravel()
    odd = np.float32([-0.0, -1, 1e-45, 1, 2, np.inf, -np.inf, np.nan, -np.nan])
    light = np.concatenate([near, odd, rng.random(100_000, np.float32) ** 3])
    share = to_srgb(np.clip(np.nan_to_num(light, nan=0.0), 0, 1))
    made = levels(light.reshape(1, -1, 1), "uint8", has_alpha=False, is_light=True)
    np.testing.assert_array_equal(made.ravel(), np.floor(share * 255 + 0.5))
