"""Tiles stop when they are opaque: what lies behind is neither painted nor missed."""

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.painting.choices import Primitive
from resample.types import Frame, Samples
from tests.samples import painter

WALL_DEPTH, BEHIND = 200.0, 100_000


def wall() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, colors and extinctions of an opaque wall, wider than the picture."""
    y, x, z = np.indices((160, 160, 4)).reshape(3, -1)
    position = np.stack([x - 79.5, y - 79.5, z + WALL_DEPTH], axis=1)
    return position, np.full((x.size, 3), [0.8, 0.5, 0.2]), np.full(x.size, 5.0)


def picture(
    primitive: Primitive, scale: float, side: int, behind: int, rng: np.random.Generator
) -> Frame:
    """The wall at `scale` px per voxel, in front of as many bright samples as asked for."""
    position, color, extinction = wall()
    camera = Camera.from_intrinsics(WALL_DEPTH * scale, WALL_DEPTH * scale, side / 2, side / 2)
    reach = 0.45 * side / scale
    near, far = [-reach, -reach, WALL_DEPTH + 20], [reach, reach, WALL_DEPTH + 80]
    crowd = rng.uniform(near, far, (behind, 3))
    samples = Samples(
        np.concatenate([position, crowd]),
        np.concatenate([color, np.ones((behind, 3))]),
        np.concatenate([extinction, np.full(behind, 1.0)]),
        np.eye(3),
    )
    return painter(primitive=primitive)(samples, camera, height=side, width=side)


@pytest.fixture(
    params=[
        (primitive, scale, side)
        for primitive, scale in [("points", 0.5), ("splats", 2.0), ("hybrid", 0.5), ("hybrid", 1.2)]
        for side in (64, 40)  # px; tiles of 32 px fit, and stick out
    ],
    ids=lambda case: f"{case[0]} at {case[1]} px, {case[2]} px wide",
)
def frames(request, rng) -> tuple[Frame, Frame]:
    """The wall alone, and the wall before the crowd."""
    primitive, scale, side = request.param
    return tuple(picture(Primitive(primitive), scale, side, count, rng) for count in (0, BEHIND))


@pytest.mark.sweep
def test_samples_behind_an_opaque_wall_are_hidden(frames):
    """But for those behind what is painted last, at once with them."""
    alone, crowded = frames
    assert crowded.statistics.hidden - alone.statistics.hidden > 0.4 * BEHIND


@pytest.mark.sweep
def test_hidden_samples_leave_no_trace_in_the_picture(frames):
    """Where sub-pixels are as many: hybrid takes as many as all samples need."""
    alone, crowded = frames
    if alone.statistics.subpixels != crowded.statistics.subpixels:
        pytest.skip("the crowd is finer")
    np.testing.assert_allclose(crowded.rgba, alone.rgba, rtol=0, atol=1e-4)
    np.testing.assert_allclose(crowded.first_depth, alone.first_depth, rtol=0, atol=1e-3)


@pytest.mark.sweep
def test_an_opaque_wall_is_opaque(frames):
    assert frames[0].rgba[..., 3].min() > 0.999
