"""3D Gaussians: fidelity, distance, order, seams and time, of the scenes of a folder.

`python -m tests.benchmarks.gaussians_table FOLDER` prints lines per scene. Pictures are 800 × 600
px over black, scores dB of display values. "Usual" is the linear projection with the dilation of
training at each picture's own pixels, as usual renderers have it, one sample per pixel; it equals
the twin in `tests/shaped/twin.py` (`tests/shaped/test_ellipsoids.py`).
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from resample.cameras.panoramic import Equirectangular
from resample.colors import to_srgb
from resample_points import GaussianStyle, gaussian_camera, read_gaussians, render_gaussians
from resample_points.files.gaussians.reading import is_gaussians

SIZE = (800, 600)
BLACK = (0.0, 0.0, 0.0)
FARTHER = (2, 4, 8)
PANORAMA = (512, 256)


def shown(gaussians, camera, size, **style):
    """Display values (H, W, 3) over black."""
    chosen = GaussianStyle(**style)
    frame = render_gaussians(gaussians, camera, size=size, style=chosen, background=BLACK)
    return np.clip(to_srgb(frame.rgba[..., :3]), 0, 1)


def decibels(one, two):
    """Peak signal-to-noise ratio of values up to 1; at most 200."""
    return -10 * np.log10(max(np.mean(np.square(one - two, dtype=np.float64)), 1e-20))


def zoomed(camera, factor):
    """The camera of a picture with `factor` times as many pixels along each axis."""
    return replace(camera, matrix=np.diag([factor, factor, 1.0]) @ camera.matrix)


def averaged(picture, count):
    """Means of blocks of pixels."""
    height, width = picture.shape[0] // count, picture.shape[1] // count
    return picture.reshape(height, count, width, count, 3).mean(axis=(1, 3))


def seconds(gaussians, camera, **style):
    """CPU seconds of a picture, the least of three."""
    spent = []
    for _ in range(3):
        start = time.process_time()
        shown(gaussians, camera, SIZE, **style)
        spent.append(time.process_time() - start)
    return min(spent)


def row(path):
    """Lines about one scene."""
    gaussians = read_gaussians(path)
    camera = gaussian_camera(
        gaussians, size=SIZE, azimuth=30, elevation=15, up=gaussians.up or "-y"
    )
    native = shown(gaussians, camera, SIZE, subpixels=1)
    usual = shown(gaussians, camera, SIZE, subpixels=1, appearance="affine")
    yield f"{path.name}: {len(gaussians.opacity):,} Gaussians, degree {degree(gaussians)}"
    yield f"  trained against the usual projection: {decibels(native, usual):.1f} dB"
    for count in FARTHER:
        size, far = (SIZE[0] // count, SIZE[1] // count), zoomed(camera, 1 / count)
        truth = averaged(native, count)
        ours = shown(gaussians, far, size, trained_focal=camera.fx)
        theirs = shown(gaussians, far, size, subpixels=1, appearance="affine")
        smooth = gaussians._replace(is_antialiased=True)
        better = shown(smooth, far, size, subpixels=1, appearance="affine")
        scores = ", ".join(f"{decibels(one, truth):.1f}" for one in (theirs, better, ours))
        yield f"  {count} times out, usual, usual antialiased, ours: {scores} dB"
    fine = {"order": "rays", "trained_focal": camera.fx}
    truth = averaged(
        shown(gaussians, zoomed(camera, 4), (4 * SIZE[0], 4 * SIZE[1]), subpixels=4, **fine), 4
    )
    scores = [
        decibels(shown(gaussians, camera, SIZE, subpixels=4, **{**fine, "order": order}), truth)
        for order in ("rays", "depth", "distance")
    ]
    yield (
        "  rays, depth, distance at 4 x 4 against 16 x 16 rays: "
        + ", ".join(f"{one:.1f}" for one in scores)
        + " dB"
    )
    eye = Equirectangular(camera.world_to_camera)
    one, two = (
        shown(gaussians, each, PANORAMA, subpixels=1) for each in (eye, eye.turned(np.pi / 4))
    )
    apart = decibels(np.roll(one, -PANORAMA[0] // 8, axis=1), two)
    yield f"  panorama turned by 45 degrees: {apart:.1f} dB"
    spent = [seconds(gaussians, camera, subpixels=n) for n in (1, 2)]
    along = seconds(gaussians, camera, subpixels=2, order="rays")
    yield f"  CPU s, 1 and 2 sub-pixels, rays at 2: {spent[0]:.2f}, {spent[1]:.2f}, {along:.2f}"


def degree(gaussians):
    return {0: 0, 3: 1, 8: 2, 15: 3}[gaussians.harmonics.shape[1]]


def main(folder):
    for path in sorted(Path(folder).rglob("*")):
        if is_gaussians(path) and (path.is_file() or path.name != path.parent.name):
            if path.suffix == ".json" or path.stat().st_size < 1000:
                continue
            for line in row(path):
                sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    main(sys.argv[1])
