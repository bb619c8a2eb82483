"""One parser reads the headers of PLY files, of clouds and of Gaussians alike."""

import numpy as np
import pytest

from resample_points import read_cloud, read_gaussians
from resample_points.files.ply import ply_header

BINARY = b"ply\nformat binary_little_endian 1.0\n"
LONG = 1 << 22


@pytest.mark.parametrize("read", [read_cloud, read_gaussians])
@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"plywood\nend_header\n", "does not begin with ply"),
        (BINARY + b"element vertex 1\n", "no end"),
        (BINARY + b"comment\n" * 2000 + b"end_header\n", "no end"),
        (BINARY + b"a" * LONG + b"\nend_header\n", "no end"),
        (b"ply\nelement vertex 1\nend_header\n", "the PLY format ''"),
        (b"ply\nformat middle 1.0\nelement vertex 1\nend_header\n", "'middle'"),
        (BINARY + b"element vertex -1\nend_header\n", "whole number"),
        (BINARY + b"element vertex\nend_header\n", "whole number"),
        (BINARY + b"element vertex " + b"9" * 31 + b"\nend_header\n", "whole number"),
        (BINARY + b"element vertex 1\nproperty quad x\nend_header\n", "neither a number"),
        (BINARY + b"element vertex 1\nproperty float\nend_header\n", "neither a number"),
        (BINARY + b"element vertex 1\nproperty list float int x\nend_header\n", "whole number"),
        (BINARY + b"element vertex 1\nproperty list int x\nend_header\n", "neither a number"),
        (BINARY + b"element vertex 1\n" + 2 * b"property float x\n" + b"end_header\n", "twice"),
        (BINARY + 2 * b"element vertex 1\n" + b"end_header\n", "twice"),
        (BINARY + b"element face 1\nproperty float x\nend_header\n1234", "vertex|f_dc_0"),
    ],
)
def test_a_hostile_header_is_refused_in_one_line_whoever_reads_it(
    tmp_path, read, content, expected
):
    path = tmp_path / "a.ply"
    path.write_bytes(content)
    with pytest.raises((ValueError, OSError), match=expected) as caught:
        read(path)
    message = str(caught.value)
    assert message.startswith("a.ply") or str(path) in message
    assert "\n" not in message
    assert len(message) < 300


def test_the_byte_order_may_stand_after_the_elements(tmp_path):
    path = tmp_path / "a.ply"
    lines = b"".join(b"property float %c\n" % name for name in b"xyz")
    header = b"ply\nelement vertex 2\n" + lines + b"format binary_big_endian 1.0\nend_header\n"
    place = np.arange(6.0).reshape(2, 3)
    path.write_bytes(header + place.astype(">f4").tobytes())
    assert ply_header(path).start == len(header)
    assert (read_cloud(path).position == place).all()
