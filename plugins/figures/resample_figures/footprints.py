"""Figures 3 and 4: the ellipse of a splat, and errors of footprint models."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from resample.cameras.models import Camera
from resample.hybrid.correction import true_distance
from resample.painting.choices import Footprint, Primitive, footprints_of
from resample.profiles.reconstruction import GaussianKernel, footprint_table
from resample.resampler import Resampler
from resample.types import Doubles, Record, Samples
from resample_figures.volumes import Row, VolumeFolder, drawing, save, write_numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAME = "figure-3-4"
KERNEL = GaussianKernel()
DISTANCE = 10.0  # distance from the eye to the sphere's center, scene units
FOCAL, FRAME = 1000.0, 8000  # px; the axis meets the corner, where float32 has most digits
SIDE = 28  # px, of the pictures of one splat
TILT, CONE = 40.0, 16.0  # degrees, of the drawn sphere
AZIMUTH = 25.0  # degrees around the axis, where errors are measured

COLORS = {
    "affine": "tab:orange",
    "ellipse, index i": "tab:gray",
    "corrected as printed": "tab:red",
    "corrected": "tab:blue",
    "projected": "tab:cyan",
    "disc": "tab:purple",
    "exact": "tab:green",
}


@dataclass(frozen=True)
class ErrorGrid:
    """Directions at which errors are measured, degrees."""

    cones: Sequence[float] = (0.2, 0.5, 1, 2, 5, 10, 15, 20, 30)  # on the axis
    angles: Sequence[float] = (0, 5, 10, 15, 20, 30, 40, 45, 50, 60)  # off the axis
    cones_off: Sequence[float] = (1, 5)  # at each of the angles
    rays: int = 200  # distances from the center; 180 rays at each


QUICK = ErrorGrid((1, 15), (0, 30), (5,), 40)


class KernelBall(NamedTuple):
    """A kernel's sphere as seen from the eye."""

    angle: float  # degrees off the camera's axis
    cone: float  # degrees, half of its angular diameter
    azimuth: float = AZIMUTH  # degrees, around the axis

    @property
    def center(self) -> Doubles:
        """(3,) in camera axes, rounded as samples are."""
        tilt, around = np.radians([self.angle, self.azimuth])
        toward = [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)]
        return np.array(DISTANCE * np.array(toward), np.float32).astype(np.float64)

    @property
    def radius(self) -> float:
        """Radius in scene units."""
        return float(np.linalg.norm(self.center) * np.sin(np.radians(self.cone)))

    def samples(self) -> Samples:
        """One sample with this sphere around it."""
        spacing = self.radius / KERNEL.radius
        position = np.array([self.center], np.float32)
        extinction = np.array([1 / spacing], np.float32)
        return Samples(position, np.ones((1, 3), np.float32), extinction, spacing * np.eye(3))


def make(folder: Path, shelf: VolumeFolder, *, quick: bool = False) -> str:
    """Write the figure and return its summary."""
    del shelf  # only one sphere is shown
    rows = error_rows(QUICK if quick else ErrorGrid())
    sphere = KernelBall(TILT, CONE, 0.0)
    center, half_axes = ellipse_of(record_of(sphere, Footprint.CORRECTED))
    touched = tangent_rays(sphere)
    off = float(np.abs(index_of(record_of(sphere, Footprint.CORRECTED), touched) - 1).max())
    facts = {
        "figure": "3 and 4",
        "index_error": "largest error of a ray's distance from the center, in radii",
        "footprint_error": "largest error of the line integral, in shares of its peak",
        "picture_error": f"the same of the pixels that the resampler draws ({SIDE} x {SIDE})",
        "sphere": {"angle_deg": TILT, "cone_deg": CONE, "distance": DISTANCE},
        "ellipse": {
            "midpoint": center.tolist(),
            "projected_center": (sphere.center[:2] / sphere.center[2]).tolist(),
            "half_axes": np.linalg.norm(half_axes, axis=0).tolist(),
            "largest_error_at_tangent_rays": off,
        },
    }
    _draw(folder / f"{NAME}.png", rows)
    write_numbers(folder, NAME, rows, facts)
    return f"figures 3 and 4: the ellipse meets the rays that touch the sphere within {off:.1e}"


# The resampler's footprints.


def record_of(sphere: KernelBall, model: Footprint) -> Record:
    """Return the resampler's record of a sphere."""
    camera, samples = Camera.from_intrinsics(FOCAL, FOCAL, 0.0, 0.0), sphere.samples()
    records = _splatting(model).footprints(samples, camera, height=FRAME, width=FRAME)
    record: Record = records[0]
    return record


def index_of(record: Record, ray: Doubles) -> Doubles:
    """Return the root of a record's quadratic form at rays (..., 2) in the plane at depth 1."""
    dx = FOCAL * ray[..., 0] - float(record["x"])
    dy = FOCAL * ray[..., 1] - float(record["y"])
    a, b, c = (float(record[name]) for name in "abc")
    return np.asarray(np.sqrt(np.maximum(0.0, a * dx * dx + 2 * b * dx * dy + c * dy * dy)))


def ellipse_of(record: Record) -> tuple[Doubles, Doubles]:
    """Return where a record's form is 1, in units of the image plane at depth 1.

    The center (2,), and half axes as columns (2, 2), the longer one first.
    """
    a, b, c = (float(record[name]) for name in "abc")
    squared, axes = np.linalg.eigh(np.array([[a, b], [b, c]]))
    center = np.array([record["x"], record["y"]], np.float64)
    return center / FOCAL, axes / np.sqrt(squared) / FOCAL


# Rays at known distances.


def rays_at(sphere: KernelBall, distance: Doubles, count: int = 180) -> Doubles:
    """Return rays (D, count, 2) that pass the center at distances (D,) in radii, at depth 1."""
    center = sphere.center
    far = float(np.linalg.norm(center))
    forward = center / far
    aside = np.cross(forward, [0.3, 0.9, -0.2])
    aside /= np.linalg.norm(aside)
    up = np.cross(forward, aside)
    around = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    sine = (distance * sphere.radius / far)[:, None, None]
    circle = np.cos(around) * aside + np.sin(around) * up
    ray = np.sqrt(1 - sine**2) * forward + sine * circle
    return np.asarray(ray[..., :2] / ray[..., 2:])


def tangent_rays(sphere: KernelBall) -> Doubles:
    """Return rays (180, 2) tangent to a sphere, at depth 1."""
    return np.asarray(rays_at(sphere, np.array([1.0]))[0])


def distance_of(sphere: KernelBall, ray: Doubles) -> Doubles:
    """Return the distance in radii at which rays (..., 2) pass the center."""
    whole = np.concatenate([ray, np.ones_like(ray[..., :1])], axis=-1)
    across = np.linalg.norm(np.cross(sphere.center, whole), axis=-1)
    return np.asarray(across / np.linalg.norm(whole, axis=-1) / sphere.radius)


# The models' distances.


def printed_distance(index: Doubles, cone: Doubles) -> Doubles:
    """Return the index correction as the paper prints it (section 4.2), with tan α for sin α."""
    return np.asarray(np.sin(np.arctan(index * np.tan(cone))) / np.tan(cone))


def disc_distance(sphere: KernelBall, ray: Doubles) -> Doubles:
    """Return where rays meet the disc that faces the eye (Mueller and Yagel, 1996)."""
    sine = distance_of(sphere, ray) * sphere.radius / float(np.linalg.norm(sphere.center))
    far = float(np.linalg.norm(sphere.center))
    return np.asarray(np.tan(np.arcsin(sine)) * far / sphere.radius)


def exact_distance(sphere: KernelBall, ray: Doubles) -> Doubles:
    """Return the distance of rays by the resampler's record of exact footprint."""
    from resample.engine.shaped.records import (
        D_X,
        D_XX,
        D_XY,
        D_Y,
        D_YY,
        N_XX,
        N_XY,
        N_YY,
        WHOLE,
        ShapedArrays,
        ShapedOptions,
        X,
        Y,
        project_shapes,
    )

    samples, camera = sphere.samples(), Camera.from_intrinsics(FOCAL, FOCAL, 0.0, 0.0)
    one, radius = np.ones(1, np.float32), np.full((1, 3), sphere.radius, np.float32)
    turn = np.array([[1, 0, 0, 0]], np.float32)
    shapes = ShapedArrays(samples.position, radius, turn, one, samples.color)
    options = ShapedOptions(FRAME, FRAME, False, False, False, 0.0, FOCAL, False, 0.0, 0.0)
    record = np.empty((1, WHOLE), np.float32)
    project_shapes(shapes, camera.view(), options, record)
    r = record[0].astype(np.float64)
    dx, dy = FOCAL * ray[..., 0] - r[X], FOCAL * ray[..., 1] - r[Y]
    above = r[N_XX] * dx * dx + r[N_XY] * dx * dy + r[N_YY] * dy * dy
    below = 1 + dx * (r[D_X] + dx * r[D_XX] + dy * r[D_XY]) + dy * (r[D_Y] + dy * r[D_YY])
    return np.asarray(np.sqrt(above / below))


def model_distances(sphere: KernelBall, ray: Doubles) -> dict[str, Doubles]:
    """Return the models' distances of rays (..., 2) in radii, by name."""
    cone = np.array(np.radians(sphere.cone))
    ellipse = index_of(record_of(sphere, Footprint.CORRECTED), ray)
    projected = index_of(record_of(sphere, Footprint.PROJECTED), ray)
    return {
        "affine": index_of(record_of(sphere, Footprint.AFFINE), ray),
        "ellipse, index i": ellipse,
        "corrected as printed": printed_distance(ellipse, cone),
        "corrected": true_distance(ellipse, cone),
        "projected": true_distance(projected, cone),
        "disc": disc_distance(sphere, ray),
        "exact": exact_distance(sphere, ray),
    }


def error_rows(choices: ErrorGrid) -> list[Row]:
    """Return a row for each sphere and model."""
    on = [(0.0, cone) for cone in choices.cones]
    off = [(angle, cone) for cone in choices.cones_off for angle in choices.angles]
    distance = np.linspace(0, 1, choices.rays)
    rows: list[Row] = []
    for angle, cone in dict.fromkeys([*on, *off]):
        rows += _errors(KernelBall(float(angle), float(cone)), distance)
    return rows


def _errors(sphere: KernelBall, distance: Doubles) -> list[Row]:
    models = model_distances(sphere, rays_at(sphere, distance))
    truth = line_integral(distance)[:, None]
    pictures = picture_errors(sphere)
    return [
        {
            "angle_deg": sphere.angle,
            "cone_deg": sphere.cone,
            "model": name,
            "index_error": float(np.abs(found - distance[:, None]).max()),
            "footprint_error": float(np.abs(line_integral(found) - truth).max() / truth[0, 0]),
            "picture_error": pictures.get(name),
        }
        for name, found in models.items()
    ]


def line_integral(distance: Doubles) -> Doubles:
    """Return the kernel's line integral by distance in radii; 0 beyond the outline."""
    squared, values = _table()
    return np.asarray(np.interp(distance**2, squared, values, right=0.0))


@cache
def _table() -> tuple[Doubles, Doubles]:
    values = footprint_table(KERNEL).values.astype(np.float64)
    return np.linspace(0, 1, values.size), values


def picture_errors(sphere: KernelBall) -> dict[str, float]:
    """Return the largest error of any drawn pixel, as a fraction of the peak, by model."""
    low, high = np.tan(np.radians([sphere.angle - sphere.cone, sphere.angle + sphere.cone]))
    focal = (SIDE - 6) / (high - low)
    around = np.radians(sphere.azimuth)
    middle = focal * (low + high) / 2 * np.array([np.cos(around), np.sin(around)])
    principal = SIDE / 2 - middle + [0.3, 0.1]  # not in the middle of a pixel
    camera = Camera.from_intrinsics(focal, focal, *principal)
    column, row = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
    ray = (np.stack([column, row], axis=-1) - principal) / focal
    truth = line_integral(distance_of(sphere, ray)) / KERNEL.radius**2  # of one voxel's length
    return {
        str(model): float(np.abs(_drawn(sphere, camera, model) - truth).max() / truth.max())
        for model in footprints_of(Primitive.SPLATS)
        if str(model) in COLORS
    }


def _drawn(sphere: KernelBall, camera: Camera, model: Footprint) -> Doubles:
    """Return the optical depth (SIDE, SIDE) that the resampler gives one splat."""
    frame = _splatting(model)(sphere.samples(), camera, height=SIDE, width=SIDE)
    return np.asarray(-np.log1p(-frame.rgba[..., 3].astype(np.float64)))


@cache
def _splatting(model: Footprint) -> Resampler:
    return Resampler(primitive=Primitive.SPLATS, footprint=model, reconstruction=KERNEL)


# Drawing.


def _draw(path: Path, rows: Sequence[Row]) -> None:
    figure = drawing(15, 9)
    side, plane, circle, curves, over_cone, over_angle = figure.subplots(2, 3).ravel()
    _draw_side(side)
    _draw_plane(plane)
    _draw_index(circle)
    _draw_formula(curves)
    on_axis = [row for row in rows if row["angle_deg"] == 0]
    _draw_errors(over_cone, on_axis, "cone_deg", "half cone angle α, degrees; on the axis")
    over_cone.set_xscale("log")
    cone = max(float(str(row["cone_deg"])) for row in rows if row["angle_deg"] != 0)
    off_axis = [row for row in rows if row["cone_deg"] == cone]
    _draw_errors(over_angle, off_axis, "angle_deg", f"degrees off the axis; α = {cone:g} degrees")
    save(figure, path)


def _draw_side(axes: "Axes") -> None:
    """Draw Figure 3 in the plane of P and Q."""
    from matplotlib.patches import Circle

    sphere = KernelBall(TILT, CONE, 0.0)
    center, radius = sphere.center[[0, 2]], sphere.radius
    midpoint, half_axes = ellipse_of(record_of(sphere, Footprint.CORRECTED))
    plane = 3.5
    axes.add_patch(Circle((center[0], center[1]), radius, fill=False, color="black"))
    axes.annotate("", (0, 8.5), (0, 0), arrowprops={"arrowstyle": "->"})
    axes.text(-0.5, 8.3, "P")
    axes.plot([0, center[0]], [0, center[1]], color="tab:gray")
    axes.text(0.82 * center[0] + 0.15, 0.82 * center[1] - 0.25, "Q", color="tab:gray")
    for sign, letter in ((-1, "A"), (1, "B")):
        turn = np.radians(TILT + sign * CONE)
        touch = DISTANCE * np.cos(np.radians(CONE)) * np.array([np.sin(turn), np.cos(turn)])
        axes.plot([0, touch[0]], [0, touch[1]], color="tab:blue")
        axes.plot(*touch, ".", color="tab:blue")
        axes.text(touch[0] - 0.1, touch[1] + 0.2, letter, color="tab:blue")
        foot = plane * np.tan(turn)
        axes.text(foot + (-0.5 if sign < 0 else 0.1), plane + 0.15, f"{letter}'", color="tab:blue")
    axes.plot([-1, 9], [plane, plane], color="black", linewidth=1)
    axes.text(6.6, plane + 0.15, "image plane", fontsize=8)
    ends = plane * (midpoint[0] + np.array([-1, 1]) * np.abs(half_axes[0]).max())
    axes.plot(ends, [plane, plane], color="tab:blue", linewidth=4, alpha=0.5)
    axes.plot(plane * midpoint[0], plane, "o", color="tab:blue", label="midpoint of A'B'")
    axes.plot(plane * center[0] / center[1], plane, "x", color="tab:red", label="C', projected")
    axes.plot(0, 0, "o", color="black")
    axes.set_title("Figure 3. Side view: the cone that touches the sphere", fontsize=10)
    axes.legend(fontsize=8, loc="lower right")
    axes.set_aspect("equal")
    axes.set_axis_off()


def _draw_plane(axes: "Axes") -> None:
    """Draw Figure 3 on the image plane."""
    sphere = KernelBall(TILT, CONE, 0.0)
    around = np.linspace(0, 2 * np.pi, 200)
    circle = np.array([np.cos(around), np.sin(around)])
    for model, style in ((Footprint.CORRECTED, "-"), (Footprint.AFFINE, "--")):
        center, half_axes = ellipse_of(record_of(sphere, model))
        rim = center[:, None] + half_axes @ circle
        axes.plot(*rim, style, color=COLORS[str(model)], label=f"rim, {model}")
    axes.plot(*tangent_rays(sphere)[::6].T, ".", color="black", label="rays that touch")
    center, half_axes = ellipse_of(record_of(sphere, Footprint.CORRECTED))
    for name, axis in zip(("R1", "R2"), half_axes.T, strict=True):
        end = center + axis * (1 if axis.sum() > 0 else -1)
        start, middle = center, (center + end) / 2
        axes.annotate("", end, (start[0], start[1]), arrowprops={"arrowstyle": "->"})
        axes.text(middle[0] + 0.01, middle[1] + 0.015, name)
    axes.plot(*center, "o", color="tab:blue", label="midpoint")
    axes.plot(sphere.center[0] / sphere.center[2], 0, "x", color="tab:red", label="C'")
    axes.set_title(
        f"Figure 3. Image plane: {TILT:g} degrees off the axis, α = {CONE:g} degrees", fontsize=10
    )
    axes.set_xlabel("px / focal length")
    axes.set_aspect("equal")
    axes.set_ylim(-0.75, 0.5)
    axes.legend(fontsize=8, loc="lower center", ncols=2)


def _draw_index(axes: "Axes") -> None:
    """Draw Figure 4: where i and d are measured."""
    from matplotlib.patches import Circle

    cone, index = np.radians(30.0), 0.55
    here, angle = np.array(index), np.array(cone)
    far, rim = 1 / np.sin(cone), np.cos(cone)
    chord = np.sin(cone)  # the circle BB' lies this much nearer to the eye than the center O
    beta = np.arctan(index * np.tan(cone))
    foot = far * np.cos(beta) * np.array([np.cos(beta), np.sin(beta)]) - [far, 0.0]
    point = {
        "E": (-far, 0.0),
        "O": (0.0, 0.0),
        "A": (-chord, 0.0),
        "B": (-chord, rim),
        "B'": (-chord, -rim),
        "C": (-chord, index * rim),
        "D": (float(foot[0]), float(foot[1])),
    }
    axes.add_patch(Circle((0, 0), 1, fill=False, color="black"))
    for start, end, color in (
        ("E", "B", "tab:gray"),
        ("E", "B'", "tab:gray"),
        ("E", "O", "tab:gray"),
        ("B", "B'", "tab:gray"),
        ("E", "D", "tab:blue"),
        ("A", "C", "tab:red"),
        ("O", "D", "tab:green"),
    ):
        axes.plot(*zip(point[start], point[end], strict=True), color=color)
    for letter, place in point.items():
        axes.plot(*place, ".", color="black")
        axes.annotate(letter, place, xytext=(4, 4), textcoords="offset points")
    axes.set_title(
        "Figure 4. Index i = AC / AB (red), distance d = OD / r (green)\n"
        f"i = {index:g}, α = 30 degrees: d = {float(true_distance(here, angle)):.4f}, "
        f"as printed {float(printed_distance(here, angle)):.4f}",
        fontsize=10,
    )
    axes.set_aspect("equal")
    axes.set_axis_off()


def _draw_formula(axes: "Axes") -> None:
    """Plot distance over index."""
    index = np.linspace(0, 1, 101)
    cone = np.array(np.radians(30.0))
    forms: Mapping[str, Callable[[], Doubles]] = {
        "ellipse, index i": lambda: index,
        "corrected as printed": lambda: printed_distance(index, cone),
        "corrected": lambda: true_distance(index, cone),
    }
    label = {
        "ellipse, index i": "no correction",
        "corrected as printed": "sin(atan(i tan α)) / tan α, as printed",
        "corrected": "sin(atan(i tan α)) / sin α, used here",
    }
    for name, form in forms.items():
        axes.plot(index, form() - index, color=COLORS[name], label=label[name])
    axes.set_xlabel("index i")
    axes.set_ylabel("correction d - i, radii")
    axes.set_title("Figure 4. α = 30 degrees: d is 1 at the rim only with sin α", fontsize=10)
    axes.legend(fontsize=8)


def _draw_errors(axes: "Axes", rows: Sequence[Row], key: str, label: str) -> None:
    for name, color in COLORS.items():
        mine = [row for row in rows if row["model"] == name]
        place = [float(str(row[key])) for row in mine]
        error = [max(1e-8, float(str(row["footprint_error"]))) for row in mine]
        axes.plot(place, error, ".-", color=color, label=name)
    axes.set_yscale("log")
    axes.set_ylim(top=100)
    axes.set_xlabel(label)
    axes.set_ylabel("largest error / peak")
    axes.grid(visible=True, alpha=0.3)
    axes.set_title("Error of the footprint", fontsize=10)
    axes.legend(fontsize=7, loc="upper left")
