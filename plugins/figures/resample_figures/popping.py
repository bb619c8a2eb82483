"""Figure 7: popping of the checker box rotated across 45 degrees, for each compositing order."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from resample import registry
from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit, Sphere
from resample.colors import from_srgb
from resample.files.saving import write_png
from resample.measuring.compare import contact_sheet, shown
from resample.painting.choices import Primitive
from resample.resampler import Resampler
from resample.types import Doubles, Floats
from resample_figures.volumes import Row, VolumeFolder, drawing, save, write_numbers
from resample_volume.appearance import Appearance
from resample_volume.files.source import generate
from resample_volume.rendering import lit_samples, visible_voxels
from resample_volume.voxels.framing import centered, sphere_around
from resample_volume.voxels.shading import Light
from resample_volume.voxels.visible import Voxels

NAME = "figure-7"
ORDERS = {
    "axis-sheets": "axis-sheets",
    "every-sample": "every-sample",
    "every-sample by distance": "every-sample:key=distance",
    "image-sheets": "image-sheets",
}
LEVELS = 255.0
GAIN = 16  # of the difference pictures
LIGHT = Light((0.0, -1.0, 0.6))  # fixed, so that only the view changes
MEASURE = (
    "second difference of three successive frames, in displayed gray levels of 255; rms over "
    "pixels and channels, and the largest pixel"
)


@dataclass(frozen=True)
class CheckerRotation:
    """A rotation: the volume and the angular step."""

    volume: str = "checker-box:size=40,block=8"
    transfer: str = "checker:opacity=0.3"  # translucent, so that orders matter
    side: int = 96  # px, of the frames
    large: int = 400  # px, of the two views
    first: float = 40.0  # degrees of azimuth
    last: float = 50.0
    step: float = 0.1
    before: float = 44.9  # the two views
    after: float = 45.1
    elevation: float = 8.0  # degrees
    zoom: float = 0.95


QUICK = CheckerRotation("checker-box:size=12,block=3", side=24, large=48, step=0.5)


class TurnedVolume(NamedTuple):
    """Voxels that a camera orbits."""

    voxels: Voxels
    sphere: Sphere
    choices: CheckerRotation

    def camera(self, azimuth: float, side: int) -> AnyCamera:
        """Return the camera for a square picture."""
        chosen = self.choices
        return Orbit(azimuth, chosen.elevation, chosen.zoom).around(self.sphere, side, side)

    def picture(self, resample: Resampler, azimuth: float, side: int) -> Floats:
        """Return the picture in premultiplied linear RGBA."""
        camera = self.camera(azimuth, side)
        samples = lit_samples(self.voxels, LIGHT, camera)
        return resample(samples, camera, height=side, width=side).rgba


class JumpCurve(NamedTuple):
    """Size of the picture's jumps at each angle of a rotation."""

    azimuth: Doubles  # (K,) degrees, of the middle one of three frames
    rms: Doubles  # (K,) gray levels
    largest: Doubles  # (K,) gray levels


def make(folder: Path, shelf: VolumeFolder, *, quick: bool = False) -> str:
    """Write the figure; returns the remarks about it."""
    del shelf  # the box is generated
    choices = QUICK if quick else CheckerRotation()
    scene = scene_of(choices)
    orders = {
        name: Resampler(order=registry.build("orders", spec), primitive=_form(name))
        for name, spec in ORDERS.items()
    }
    _write_views(folder, scene, orders)
    curves = {name: popping(scene, resample) for name, resample in orders.items()}
    summary = summarised(curves)
    _draw(folder / f"{NAME}-popping.png", curves)
    rows: list[Row] = [
        {"order": name, "azimuth_deg": float(a), "rms": float(r), "largest": float(m)}
        for name, curve in curves.items()
        for a, r, m in zip(*curve, strict=True)
    ]
    facts = {
        "figure": "7",
        "volume": choices.volume,
        "transfer": choices.transfer,
        "step_deg": choices.step,
        "side_px": choices.side,
        "measure": MEASURE,
        "orders": summary,
    }
    write_numbers(folder, NAME, rows, facts)
    lines = [
        f"  {name}: {numbers['largest_rms']:.3f} levels at {numbers['at_deg']:.1f} degrees, "
        f"axis-sheets jump {numbers['below_axis_sheets']:.1f} times as far"
        for name, numbers in summary.items()
    ]
    return "\n".join(["figure 7: largest second difference of a rotation", *lines])


def _form(order: str) -> Primitive:
    """Primitive of a row: the paper's where every sample is composited."""
    return Primitive.PAPER if order.startswith("every-sample") else Primitive.HYBRID


def scene_of(choices: CheckerRotation) -> TurnedVolume:
    """Return the box with its looks."""
    volume, _ = centered(generate(choices.volume))
    look = Appearance(choices.transfer, LIGHT)
    voxels = visible_voxels(volume, look)
    return TurnedVolume(voxels, sphere_around(voxels, volume), choices)


def popping(scene: TurnedVolume, resample: Resampler) -> JumpCurve:
    """Compute second differences along a rotation, as `MEASURE` says."""
    chosen = scene.choices
    count = round((chosen.last - chosen.first) / chosen.step)
    azimuth = np.linspace(chosen.first, chosen.first + count * chosen.step, count + 1)
    frames: deque[Floats] = deque(maxlen=3)
    rms, largest = [], []
    for angle in azimuth:
        frames.append(_screen(scene.picture(resample, float(angle), chosen.side)))
        if len(frames) == 3:
            jump = frames[0] - 2 * frames[1] + frames[2]
            rms.append(float(np.sqrt(np.mean(np.square(jump, dtype=np.float64)))))
            largest.append(float(np.abs(jump).max()))
    return JumpCurve(azimuth[1:-1], np.array(rms), np.array(largest))


def summarised(curves: Mapping[str, JumpCurve]) -> dict[str, dict[str, float]]:
    """Return each order's largest jump and its angle, and the ratio to that of axis-sheets."""
    reference = float(curves["axis-sheets"].rms.max())
    return {
        name: {
            "largest_rms": float(curve.rms.max()),
            "at_deg": float(curve.azimuth[np.argmax(curve.rms)]),
            "median_rms": float(np.median(curve.rms)),
            "largest_of_a_pixel": float(curve.largest.max()),
            "below_axis_sheets": reference / max(float(curve.rms.max()), 1e-9),
        }
        for name, curve in curves.items()
    }


def _screen(rgba: Floats) -> Floats:
    """Return displayed gray levels, not rounded."""
    return np.asarray(LEVELS * shown(rgba), np.float32)


def _write_views(folder: Path, scene: TurnedVolume, orders: Mapping[str, Resampler]) -> None:
    """Write both views of each order, 1 : 1, and a sheet with their differences."""
    chosen = scene.choices
    cells: dict[str, Floats] = {}
    for name, resample in orders.items():
        pair = []
        for letter, azimuth in (("a", chosen.before), ("b", chosen.after)):
            picture = scene.picture(resample, azimuth, chosen.large)
            write_png(
                folder / f"{NAME}{letter}-{name.replace(' ', '-')}.png",
                picture,
                background=(0.0, 0.0, 0.0),
            )
            cells[f"{name}, {azimuth:g} degrees"] = picture[..., :3]
            pair.append(shown(picture))
        difference = np.clip(GAIN * np.abs(pair[1] - pair[0]), 0, 1)
        cells[f"{name}, difference x {GAIN}"] = from_srgb(difference)
    contact_sheet(cells, folder / f"{NAME}.png", columns=3)


def _draw(path: Path, curves: Mapping[str, JumpCurve]) -> None:
    figure = drawing(8, 4.5)
    axes = figure.subplots()
    for name, curve in curves.items():
        axes.plot(curve.azimuth, np.maximum(curve.rms, 1e-4), label=name)
    axes.set_yscale("log")
    axes.set_xlabel("azimuth, degrees")
    axes.set_ylabel("rms of second differences, gray levels")
    axes.set_title("Figure 7. Popping in a rotation across 45 degrees", fontsize=10)
    axes.grid(visible=True, alpha=0.3)
    axes.legend()
    save(figure, path)
