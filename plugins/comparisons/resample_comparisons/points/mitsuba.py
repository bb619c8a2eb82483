"""Mitsuba's ray tracer of ellipsoids (3.9 and newer), as a renderer of 3D Gaussians.

It traces rays through ellipsoids of three standard deviations in the order in which they are
entered, with the opacity at the peak along the ray, and averages rays over the pixel.

Mitsuba runs in its own process: with an LLVM that is too old for it, it aborts.
"""

import math
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from resample.cameras.models import Camera
from resample.messages import one_line
from resample.types import Floats
from resample_points.data.gaussians import Gaussians
from resample_points.data.harmonics import CONSTANT

RAYS = 16  # per pixel
VARIANT = "llvm_ad_rgb"  # the integrator runs in no scalar one
DEEPEST = 4096  # ellipsoids that a ray passes, at most
ROUND = 1e-3  # share by which focal lengths of square pixels may differ
LONGEST = 600  # seconds
SCENE, PICTURE = "scene.npz", "picture.npz"
NEEDED = "mitsuba is not installed: pip install 'mitsuba>=3.9' (it also needs an LLVM library)"


def render(
    scene: Gaussians, color: Floats, camera: Camera, shape: tuple[int, int], wider: float
) -> tuple[Floats, float]:
    """Return a picture (H, W, 3) in display values, over black, and the time it took, ms.

    Parameters
    ----------
    scene
        Gaussians.
    color
        (N, 3) display values toward the camera.
    camera
        Perspective with square pixels, without a lens.
    shape
        Height and width, px.
    wider
        Variance by which training has seen each wider, at a distance of 1.

    Raises
    ------
    ValueError
        Mitsuba is not installed or cannot run here, or the pixels are not square.
    """
    check()
    if abs(camera.fx / camera.fy - 1) > ROUND:
        raise ValueError("mitsuba has square pixels; leave other intrinsics out of the comparison")
    pose = np.eye(4)
    pose[: len(camera.world_to_camera)] = camera.world_to_camera
    depth = np.maximum(scene.position.astype(np.float64) @ pose[2, :3] + pose[2, 3], camera.near)
    scale = np.sqrt(scene.scale.astype(np.float64) ** 2 + wider * depth[:, None] ** 2)
    turned = scene.rotation[:, [1, 2, 3, 0]]  # x, y, z, w
    shapes = np.concatenate([scene.position, scale, turned], axis=1).astype(np.float32)
    with TemporaryDirectory(prefix="mitsuba-") as folder:
        np.savez(
            Path(folder) / SCENE,
            shapes=shapes,
            opacity=scene.opacity[:, None],
            levels=((color - np.float32(0.5)) / np.float32(CONSTANT)).astype(np.float32),
            pose=pose,
            matrix=camera.matrix,
            shape=shape,
        )
        words = [sys.executable, "-m", __name__, folder]
        try:
            done = subprocess.run(  # noqa: S603 - this Python and this module
                words, capture_output=True, text=True, check=False, timeout=LONGEST
            )
        except subprocess.TimeoutExpired:
            raise ValueError(f"mitsuba took longer than {LONGEST} s; take a smaller size") from None
        if done.returncode:
            said = (done.stderr.strip() or "no message").splitlines()
            told = next((line for line in said if "ERROR" in line), said[-1])
            raise ValueError(f"mitsuba cannot run here: {told:.160}")
        with np.load(Path(folder) / PICTURE, allow_pickle=False) as made:
            return made["picture"], float(made["ms"])


def check() -> None:
    """Raise ValueError where Mitsuba is not installed, without importing it."""
    from importlib.util import find_spec

    if find_spec("mitsuba") is None:
        raise ValueError(NEEDED)


def _sensor(mi: Any, given: Any) -> dict[str, Any]:
    """Describe a camera, with x to the right and y down."""
    height, width = map(int, given["shape"])
    matrix = given["matrix"]
    back = np.linalg.inv(given["pose"]) @ np.diag([-1.0, -1.0, 1.0, 1.0])
    return {
        "type": "perspective",
        "fov": math.degrees(2 * math.atan(0.5 * width / matrix[0, 0])),
        "fov_axis": "x",
        "principal_point_offset_x": 0.5 - matrix[0, 2] / width,
        "principal_point_offset_y": 0.5 - matrix[1, 2] / height,
        "near_clip": 1e-2,
        "far_clip": 1e6,
        "to_world": mi.ScalarTransform4f(back),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "stratified", "sample_count": RAYS},
    }


def main(folder: Path) -> None:
    """Render the scene of a folder; runs in its own process."""
    import mitsuba as mi

    mi.set_variant(VARIANT)
    with np.load(folder / SCENE, allow_pickle=False) as given:
        scene = mi.load_dict({
            "type": "scene",
            "integrator": {
                "type": "volprim_rf_basic", "max_depth": DEEPEST, "srgb_primitives": False
            },
            "sensor": _sensor(mi, given),
            "shape": {
                "type": "ellipsoids",
                "data": mi.TensorXf(given["shapes"]),
                "opacities": mi.TensorXf(given["opacity"]),
                "sh_coeffs": mi.TensorXf(given["levels"]),
            },
        })  # fmt: skip
    begin = perf_counter()
    picture = np.array(mi.render(scene, spp=RAYS), np.float32)[..., :3]
    np.savez(folder / PICTURE, picture=picture, ms=1000 * (perf_counter() - begin))


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]))
    except Exception as error:
        sys.exit(f"ERROR {one_line(error)}")
