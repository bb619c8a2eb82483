"""Tiles stop when they are opaque: what lies behind is neither painted nor missed."""

import numpy as np
import pytest

from resample.cameras import Pinhole
from resample.resampler import Primitive, Resampler
from resample.types import Frame, Samples

WALL_DEPTH, BEHIND = 200.0, 100_000


def wall() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, colors and extinctions of an opaque wall, wider than the picture."""
    y, x, z = np.indices((80, 80, 4)).reshape(3, -1)
    position = np.stack([x - 39.5, y - 39.5, z + WALL_DEPTH], axis=1)
    return position, np.full((x.size, 3), [0.8, 0.5, 0.2]), np.full(x.size, 5.0)


def picture(primitive: Primitive, scale: float, behind: int, rng: np.random.Generator) -> Frame:
    """The wall at `scale` px per voxel, before as many bright samples as asked for."""
    position, color, extinction = wall()
    side = int(40 * scale)
    camera = Pinhole(WALL_DEPTH * scale, WALL_DEPTH * scale, side / 2, side / 2)
    crowd = rng.uniform([-15, -15, WALL_DEPTH + 20], [15, 15, WALL_DEPTH + 80], (behind, 3))
    samples = Samples(
        np.concatenate([position, crowd]),
        np.concatenate([color, np.ones((behind, 3))]),
        np.concatenate([extinction, np.full(behind, 1.0)]),
        np.eye(3),
    )
    return Resampler(primitive=primitive)(samples, camera, height=side, width=side)


@pytest.fixture(
    params=[(Primitive.POINTS, 0.5), (Primitive.SPLATS, 2.0), (Primitive.HYBRID, 0.5)],
    ids=lambda case: str(case[0]),
)
def frames(request, rng) -> tuple[Frame, Frame]:
    """The wall alone, and the wall before the crowd."""
    return picture(*request.param, 0, rng), picture(*request.param, BEHIND, rng)


def test_samples_behind_an_opaque_wall_are_hidden(frames):
    alone, crowded = frames
    assert crowded.statistics.hidden - alone.statistics.hidden > 0.99 * BEHIND


def test_hidden_samples_leave_no_trace_in_the_picture(frames):
    alone, crowded = frames
    np.testing.assert_allclose(crowded.rgba, alone.rgba, rtol=0, atol=1e-4)
    np.testing.assert_allclose(crowded.first_depth, alone.first_depth, rtol=0, atol=1e-3)


def test_an_opaque_wall_is_opaque(frames):
    assert frames[0].rgba[..., 3].min() > 0.999
