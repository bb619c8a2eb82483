"""Figures 1 and 2: which voxels are points and which are splats, and in which order they come."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera
from resample.cameras.poses import orbit
from resample.hybrid.record import NOTHING, SPLAT
from resample.painting.choices import PAPER_FILTER, Primitive
from resample.painting.scenes import spacing_of
from resample.profiles.orders import EverySample, layers_of, sheets_of
from resample.resampler import Resampler
from resample.types import Doubles, Floats, Records, Samples, Sheets
from resample_figures.volumes import Row, VolumeFolder, drawing, save, write_numbers
from resample_volume.appearance import Appearance
from resample_volume.files.source import generate
from resample_volume.rendering import visible_voxels
from resample_volume.types import Volume
from resample_volume.voxels.framing import centered

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAME = "figure-1-2"
THRESHOLD = 1.0  # px, the paper's
BLUE, RED, PALE = "#1f5fa8", "#c0392b", "#9fc3ea"
AZIMUTH = 25.0  # degrees
FIELD = 62.0  # degrees of view
FINE = 160  # steps of the grid on which the boundary is found, per side


@dataclass(frozen=True)
class SceneSizes:
    """How large the scenes are."""

    few: int = 14  # voxels of the box of Figure 1, per side
    many: int = 48  # voxels of the volume of Figure 2, about, along its longest side


QUICK = SceneSizes(few=8, many=16)


class LayerCut(NamedTuple):
    """One layer of a volume's visible voxels, seen by a camera in the plane of that layer."""

    title: str
    samples: Samples
    footprints: Records  # (N,)
    spacing: Floats  # (N,) px
    place: Doubles  # (N, 2) aside and ahead of the eye, voxels
    is_splat: NDArray[np.bool_]  # (N,)
    sheets: Sheets
    rank: NDArray[np.int64]  # (N,) turn in the order of painting, from 0
    camera: Camera
    voxel: float  # scene units
    width: int  # px, of the picture


def make(folder: Path, shelf: VolumeFolder, *, quick: bool = False) -> str:
    """Write the figure; returns the remarks about it."""
    choices = QUICK if quick else SceneSizes()
    first = cut(generate(f"checker-box:size={choices.few},block=2"), "checker", "checker box")
    volume, transfer, title, note = _subject(shelf)
    second = cut(reduced(volume, choices.many), transfer, title)
    rows = [*_rows("1", first), *_rows("2", second)]
    facts: dict[str, Any] = {"figure": "1 and 2", "threshold_px": THRESHOLD, "notes": [note]}
    for number, shown in (("1", first), ("2", second)):
        facts[number] = {
            "volume": shown.title,
            "points": int((~shown.is_splat).sum()),
            "splats": int(shown.is_splat.sum()),
            "focal_px": shown.camera.fx,
            "picture_px": shown.width,
        }
    _draw(folder / f"{NAME}.png", first, second)
    write_numbers(folder, NAME, rows, facts)
    counts = ", ".join(
        f"{shown.title}: {shown.is_splat.sum()} splats and {(~shown.is_splat).sum()} points"
        for shown in (first, second)
    )
    return "\n".join(filter(None, [f"figures 1 and 2: {counts}", note]))


def cut(volume: Volume, transfer: str, title: str) -> LayerCut:
    """Middle layer of a volume, classified by the resampler with the paper's rule.

    The camera looks along the layer; its distance is such that a voxel in the middle is as large
    as a pixel, so that nearer ones are splats and farther ones points.
    """
    scene, _ = centered(volume)
    height = 0.5 * float(scene.spacing[2]) * (1 - scene.values.shape[0] % 2)
    voxels = visible_voxels(scene, Appearance(transfer, light=None))
    everything = Samples(voxels.position, voxels.color, voxels.extinction, voxels.lattice)
    in_layer = np.abs(voxels.position[:, 2] - height) < 0.25 * scene.spacing[2]
    samples = _some(everything, in_layer)
    low, high = samples.position.min(axis=0), samples.position.max(axis=0)
    voxel = float(np.cbrt(np.prod(scene.spacing)))
    reach = 0.5 * float(np.hypot(*(high - low)[:2])) + voxel
    half = np.tan(np.radians(FIELD / 2))
    distance = reach * (1.0 / half + 0.25)
    focal = distance / voxel
    width = 2 * int(np.ceil(focal * half))
    pose = orbit((low + high) / 2, distance, AZIMUTH, 0.0)
    camera = Camera.from_intrinsics(focal, focal, width / 2, width / 2, pose)
    return _classified(samples, camera, width, title)


def reduced(volume: Volume, most: int) -> Volume:
    """Every n-th voxel, so that about `most` are left along the longest side."""
    step = max(1, round(max(volume.values.shape) / most))
    return volume._replace(
        values=np.ascontiguousarray(volume.values[::step, ::step, ::step]),
        spacing=volume.spacing * step,
    )


def resampler() -> Resampler:
    """The paper's form."""
    return Resampler(primitive=Primitive.PAPER, threshold=THRESHOLD, order=EverySample())


def _subject(shelf: VolumeFolder) -> tuple[Volume, str, str, str]:
    """Volume, transfer function, title and note of Figure 2."""
    engine = shelf.subject("engine")
    if engine is not None:
        return engine.volume, "paper-engine", "Engine, every few voxels", ""
    note = "Engine is not there: Figure 2 shows the generated vessel-tree"
    return generate("vessel-tree:size=96"), "vessels", "generated vessel-tree", note


def _some(samples: Samples, kept: NDArray[np.bool_]) -> Samples:
    return Samples(
        samples.position[kept], samples.color[kept], samples.extinction[kept], samples.lattice
    )


def _classified(samples: Samples, camera: Camera, width: int, title: str) -> LayerCut:
    """Samples in front of the camera and in its picture, as the resampler sees them."""
    resample = resampler()
    records = resample.footprints(samples, camera, height=width, width=width)
    seen = records["kind"] != NOTHING
    kept = _some(samples, seen)
    footprints = np.ascontiguousarray(records[seen])
    voxel = float(np.cbrt(abs(np.linalg.det(samples.lattice))))
    view = camera.view()
    order = resample.order
    layers = layers_of(order, kept.position, view, kept.lattice)
    sheets = sheets_of(layers, order.summing, kept.position, view)
    rank = np.empty(len(footprints), np.int64)
    rank[np.argsort(sheets.key, kind="stable")] = np.arange(len(footprints))
    local = kept.position @ view.rotation.T + view.translation
    place = np.asarray(local[:, [0, 2]] / voxel, np.float64)
    is_splat, spacing = footprints["kind"] == SPLAT, spacing_of(view, kept)
    return LayerCut(
        title, kept, footprints, spacing, place, is_splat, sheets, rank, camera, voxel, width
    )


def _rows(number: str, shown: LayerCut) -> list[Row]:
    return [
        {
            "figure": number,
            "aside_voxels": float(shown.place[n, 0]),
            "ahead_voxels": float(shown.place[n, 1]),
            "spacing_px": float(shown.spacing[n]),
            "primitive": "splat" if shown.is_splat[n] else "point",
            "turn": int(shown.rank[n]),
            "layer": int(shown.sheets.sheet[n]),
        }
        for n in np.argsort(shown.rank)
    ]


def boundary(shown: LayerCut) -> tuple[Doubles, Doubles, Doubles]:
    """Spacing in px (F, F) on a grid of places aside (F,) and ahead (F,), voxels."""
    deep = shown.place[:, 1]
    ahead = np.linspace(0.6 * deep.min(), 1.1 * deep.max(), FINE)
    half = 1.02 * ahead[-1] * shown.width / (2 * shown.camera.fx)
    aside = np.linspace(-half, half, FINE)
    x, z = np.meshgrid(aside, ahead)
    local = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3) * shown.voxel
    view = shown.camera.view()
    position = ((local - view.translation) @ view.rotation).astype(np.float32)
    ones = np.ones(len(position), np.float32)
    fake = Samples(position, np.ones((len(position), 3), np.float32), ones, shown.samples.lattice)
    records = resampler().footprints(fake, shown.camera, height=shown.width, width=shown.width)
    spacing = np.where(records["kind"] != NOTHING, spacing_of(view, fake), np.nan)
    return aside, ahead, np.asarray(spacing, np.float64).reshape(x.shape)


def _draw(path: Path, first: LayerCut, second: LayerCut) -> None:
    figure = drawing(12, 6.4)
    left, right = figure.subplots(1, 2)
    _draw_primitives(left, first)
    _draw_order(right, second)
    save(figure, path)


def _draw_primitives(axes: "Axes", shown: LayerCut) -> None:
    """Figure 1."""
    from matplotlib.patches import Circle

    plane = 0.55 * float(shown.place[:, 1].min())
    _draw_view(axes, shown, plane)
    for (x, z), is_splat in zip(shown.place, shown.is_splat, strict=True):
        if is_splat:
            axes.add_patch(Circle((x, z), 0.5, facecolor=RED, alpha=0.3, edgecolor=RED))
        else:
            axes.plot(x, z, ".", color=BLUE, markersize=5)
    for letter, n in zip("abc", _examples(shown), strict=True):
        _draw_example(axes, shown, plane, int(n), letter)
    axes.set_title(
        f"Figure 1. Voxels up to {THRESHOLD:g} px apart on screen are points (blue),\nothers "
        f"splats (red); {shown.title}, one layer: {shown.is_splat.sum()} splats, "
        f"{(~shown.is_splat).sum()} points",
        fontsize=10,
    )


def _examples(shown: LayerCut) -> tuple[int, int, int]:
    """Two points and a splat that are well to be seen."""
    deep = shown.place[:, 1]
    far = np.flatnonzero(~shown.is_splat)
    near = np.flatnonzero(shown.is_splat)
    across = shown.place[:, 0] / deep
    left = far[np.argmin(across[far] - 0.015 * deep[far])]
    right = far[np.argmax(across[far] + 0.005 * deep[far])]
    return int(left), int(right), int(near[np.argmin(np.abs(across[near]) + 0.1 * deep[near])])


def _draw_example(axes: "Axes", shown: LayerCut, plane: float, n: int, letter: str) -> None:
    """A voxel's way to the image plane: a splat's cone, or a point and the filter it falls in."""
    from matplotlib.patches import Circle

    x, z = shown.place[n]
    record = shown.footprints[n]
    color = RED if shown.is_splat[n] else BLUE
    per_px = plane / shown.camera.fx
    middle = shown.camera.cx
    if shown.is_splat[n]:
        radius = resampler().reconstruction.radius
        axes.add_patch(Circle((x, z), radius, fill=False, edgecolor=color, linewidth=1.5))
        length = float(np.hypot(x, z))
        touch = np.sqrt(length**2 - radius**2)
        turn = np.arctan2(x, z) + np.array([-1, 1]) * np.arcsin(radius / length)
        for angle in turn:
            axes.plot([0, touch * np.sin(angle)], [0, touch * np.cos(angle)], color=color, lw=0.8)
        ends = plane * np.tan(turn)
    else:
        axes.plot([0, x], [0, z], color=color, linewidth=0.8)
        extent = PAPER_FILTER.radius
        ends = (float(record["x"]) - middle + np.array([-extent, extent])) * per_px
    axes.plot(ends, [plane, plane], color=color, linewidth=5, solid_capstyle="butt")
    axes.plot(x, z, "o", color=color, markersize=6)
    axes.annotate(
        letter, (x, z), xytext=(7, 5), textcoords="offset points", fontsize=13, weight="bold"
    )


def _draw_view(axes: "Axes", shown: LayerCut, plane: float) -> None:
    """Eye, frustum, image plane with its pixels, and the boundary between points and splats."""
    half = shown.width / (2 * shown.camera.fx)
    far = 1.06 * float(shown.place[:, 1].max())
    axes.fill([0, -half * far, half * far], [0, far, far], color="0.96", zorder=0)
    for sign in (-1, 1):
        axes.plot([0, sign * half * far], [0, far], color="0.6", linewidth=0.8)
    axes.plot([-half * plane, half * plane], [plane, plane], color="black", linewidth=1.2)
    edges = (np.arange(shown.width + 1) - shown.camera.cx) * plane / shown.camera.fx
    axes.vlines(edges, plane - 0.012 * far, plane + 0.012 * far, color="black", linewidth=0.5)
    axes.plot(0, 0, marker="o", color="black")
    axes.annotate("eye", (0, 0), xytext=(8, -4), textcoords="offset points")
    axes.annotate(
        f"image plane, {shown.width} px",
        (half * plane, plane),
        xytext=(8, -3),
        textcoords="offset points",
    )
    aside, ahead, spacing = boundary(shown)
    axes.contour(aside, ahead, spacing, [THRESHOLD], colors="black", linestyles="dotted")
    axes.set_aspect("equal")
    axes.set_axis_off()


def _draw_order(axes: "Axes", shown: LayerCut) -> None:
    """Figure 2."""
    plane = 0.55 * float(shown.place[:, 1].min())
    _draw_view(axes, shown, plane)
    is_splat, sheet = shown.is_splat, shown.sheets.sheet
    half = shown.width / (2 * shown.camera.fx)
    points = sheet[~is_splat]
    for layer in range(int(points.min()), int(points.max()) + 2) if points.size else ():
        axes.plot([-half * layer, half * layer], [layer, layer], color="0.85", lw=0.5, zorder=1)
    size = (2.6 * 48 / max(8.0, float(np.ptp(shown.place[:, 1])))) ** 2
    color = np.where(sheet[~is_splat] % 2 == 0, BLUE, PALE)
    axes.scatter(
        shown.place[~is_splat, 0],
        shown.place[~is_splat, 1],
        s=size,
        c=color,
        linewidths=0,
        zorder=2,
    )
    drawn = axes.scatter(
        shown.place[is_splat, 0],
        shown.place[is_splat, 1],
        s=3.5 * size,
        c=shown.rank[is_splat],
        cmap="autumn",
        edgecolors="0.3",
        linewidths=0.3,
        zorder=3,
    )
    bar = axes.figure.colorbar(drawn, ax=axes, shrink=0.5, location="right")
    bar.set_label("splats: composited one by one, turn", fontsize=8)
    axes.set_title(
        f"Figure 2. {shown.title}: splats one by one, nearest first;\npoints (blue, pale) are "
        "summed in layers one voxel deep first",
        fontsize=10,
    )
