"""Compare ways to render 3D Gaussians with a picture of many rays per pixel."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from resample.cameras.models import Camera
from resample_comparisons.points import mitsuba
from resample_points.command.gaussians import focal_of

if TYPE_CHECKING:
    from resample.types import Floats
    from resample_points.command.gaussians import GaussianPictures
    from resample_points.scenes import Shape

PER, FINE = 4, 4  # pixels and sub-pixels along a pixel's side: 16 × 16 rays
RUNS = 3  # per timing
BLACK = (0.0, 0.0, 0.0)
METHODS: dict[str, dict[str, Any]] = {
    "trained": {"appearance": "trained", "order": "depth"},
    "distance": {"appearance": "trained", "order": "distance"},
    "rays": {"appearance": "trained", "order": "rays"},
    "bare": {"appearance": "bare", "order": "depth"},
    "affine": {"appearance": "affine", "order": "depth", "subpixels": 1},
}
OTHERS = ("mitsuba",)  # renderers of others, where they are installed


def methods_named(names: str) -> list[str]:
    """Split names of methods.

    Raises
    ------
    ValueError
        One is unknown.
    """
    chosen = [name.strip() for name in names.split(",")]
    for name in chosen:
        if name not in (*METHODS, *OTHERS):
            raise ValueError(f"method {name!r}; known: {', '.join((*METHODS, *OTHERS))}")
        if name in OTHERS:
            mitsuba.check()
    return chosen


def compare_methods(
    scene: "GaussianPictures", camera: Any, shape: "Shape", names: Sequence[str]
) -> "tuple[list[dict[str, object]], dict[str, Floats]]":
    """Return a row of measures and a picture for each method, and the picture of 16 × 16 rays.

    The truth orders Gaussians along each ray, as wide as training saw them at the picture's focal
    length, or at that of `--trained-focal`.

    Raises
    ------
    ValueError
        The camera is not one of perspective without a lens.
    """
    from resample.measuring.compare import milliseconds, shown
    from resample.measuring.quality import measure

    if not isinstance(camera, Camera) or camera.distortion is not None:
        raise ValueError("methods are compared in perspective; leave out the panorama or the lens")
    focal = scene.options.trained_focal or f"{camera.fx:.17g}"

    def pictured(eye: Camera, size: "Shape", **chosen: Any) -> "Floats":
        options = scene.options.model_copy(update={"trained_focal": focal, "eyes": None, **chosen})
        rgba: Floats = replace(scene, options=options).picture(eye, size, BLACK).rgba
        return rgba

    near = replace(camera, matrix=np.diag([PER, PER, 1.0]) @ camera.matrix)
    rays = {**METHODS["rays"], "subpixels": FINE}
    fine = pictured(near, (PER * shape[0], PER * shape[1]), **rays)
    # The mean of display values, as Gaussians are composited in.
    values = shown(fine).reshape(shape[0], PER, shape[1], PER, 3).mean(axis=(1, 3))
    rows: list[dict[str, object]] = []
    pictures: dict[str, Floats] = {"16 × 16 rays": linear(values)}
    for name in names:
        if name in OTHERS:
            found, spent = _by_mitsuba(scene, camera, shape, float(focal_of(focal)))
            pictures[name] = linear(found)
            rows.append({"method": name, **measure(found, values), "ms": round(spent)})
            continue
        render = partial(pictured, camera, shape, **METHODS[name])
        pictures[name], spent = render(), milliseconds(render, RUNS)
        rows.append({"method": name, **measure(shown(pictures[name]), values), "ms": spent})
    return rows, pictures


def _by_mitsuba(
    scene: "GaussianPictures", camera: Camera, shape: "Shape", focal: float
) -> "tuple[Floats, float]":
    """Return Mitsuba's picture in display values, and the time it took, ms."""
    from resample_points.data.gaussians import Gaussians
    from resample_points.painting.gaussians import DILATION, colors_of

    given = scene.gaussians
    if not isinstance(given, Gaussians):
        raise ValueError("mitsuba takes scenes that memory holds; allow more memory")
    color = colors_of(given, slice(None), camera.view())
    return mitsuba.render(given, color, camera, shape, DILATION / focal**2)


def linear(values: Any) -> "Floats":
    """Linear light of display values."""
    from resample.colors import from_srgb

    return from_srgb(np.asarray(values, np.float32))
