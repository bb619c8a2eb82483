"""A box of samples on a sheared lattice, and cameras that see it as splats."""

import numpy as np

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.types import Samples

SIZE = {"height": 44, "width": 57}
POSE = look_at((8, -30, 12), (0, 0, 0))
CLOSE = Camera.from_intrinsics(90.0, 80.0, 26.0, 21.0, POSE)
INSIDE = Camera.from_intrinsics(25.0, 25.0, 26.0, 21.0, look_at((2, -1, 1), (0, 0, 0)))
CAMERAS = {
    "close": CLOSE,
    "far": Camera.from_intrinsics(90.0, 90.0, 26.0, 21.0, look_at((20, -150, 60), (0, 0, 0))),
    "inside": INSIDE,
    "near plane": Camera.from_intrinsics(90.0, 90.0, 26.0, 21.0, POSE, 28.0),
    "parallel": Orthographic(1.9, 1.7, 26.0, 21.0, look_at((30, 20, -30), (0, 0, 0)), -60.0),
}
PLANE = [[0.3, 1.0, 0.2, 2.0]]
LATTICE = np.array([[1.0, 0.1, 0.0], [0.0, 1.2, 0.0], [0.0, 0.2, -0.9]])


def box(rng, extinction=0.4, side=9):
    """Samples of any color, z slowest."""
    index = np.indices((side,) * 3).reshape(3, -1).T[:, ::-1] - (side - 1) / 2
    return Samples(
        (index @ LATTICE.T).astype(np.float32),
        rng.uniform(0, 1, index.shape).astype(np.float32),
        (extinction * rng.uniform(0, 2, len(index))).astype(np.float32),
        LATTICE,
    )
