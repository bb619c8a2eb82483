"""The tables of notes/quality.md on orders and rivals of volume rendering.

.venv/bin/python -m tests.benchmarks.volume_table [antialiasing flicker wall opacity mass popping
perspective bleeding slabs orders]

Engine and Aneurism are those of `shared/data/volumes`; VTK is the extra `peers`. What is absent is
left out, and the table says so. Times are medians of runs that take turns.
"""

import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.poses import orbit
from resample.measuring.quality import largest
from resample.painting.choices import Primitive, Projection, footprints_of
from resample.profiles.orders import EverySample, ImageSheets
from resample.profiles.reconstruction import GaussianKernel
from resample.resampler import Resampler
from resample.types import Field, Samples
from resample_volume.baselines.painting import AxisSheets
from resample_volume.baselines.raycasting import Casting, cast_rays
from resample_volume.classification.presets import load_transfer
from resample_volume.files.generated import vessel_tree
from tests.benchmarks import volume_scenes as scenes
from tests.benchmarks.volume_scenes import FORMS, RAYS, SPLATS, TRUTH, Flicker, Scene, Shot
from tests.naive import all_line_integrals, composite, in_camera

BLOCKS = (8, 4, 2, 1)  # px, of the checker box
VTK_RAYS = (1, 4, 8)  # per side of a pixel
FRAMES, FEW_FRAMES = 64, 16
MANY = ("none", "hybrid", "splats, 8 × 8 rays")  # forms that all frames are painted in
FULL = ("hybrid", "paper")  # forms to which hidden voxels make a difference
ORDERS = {
    "every-sample": EverySample(),
    "every-sample, distance": EverySample(key="distance"),
    "axis-sheets": AxisSheets(),
    "image-sheets": ImageSheets(),
    "image-sheets, 0.5": ImageSheets(0.5),
}
THICKNESSES = (4.0, 2.0, 1.0, 0.5, 0.25, 0.125)  # voxels
FINE = Casting(rays=1, step=1 / 32)

Column = dict[str, str]


def _print(name: str, columns: Mapping[str, Column]) -> None:
    """Markdown table of columns; a row is what they have in common."""
    rows = list(dict.fromkeys(row for column in columns.values() for row in column))
    lines = [[name, *columns], ["---"] * (len(columns) + 1)]
    lines += [[row, *(column.get(row, "") for column in columns.values())] for row in rows]
    sys.stdout.write("\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines))
    sys.stdout.flush()


def _say(text: str) -> None:
    sys.stdout.write(f"\n{text}\n")


def _quality(scene: Scene, shot: Shot) -> Column:
    """PSNR and time of our forms against ours at 16 × 16 rays, of VTK against its own."""
    samples = scene.samples(shot)
    actions = {name: partial(shot.by, form, samples) for name, form in FORMS.items()}
    truth = shot.by(TRUTH, samples)
    quality = {name: scenes.object_psnr(action(), truth) for name, action in actions.items()}
    if scenes.has_vtk():
        converged = scene.vtk(shot, RAYS).render(shot.camera)
        for rays in VTK_RAYS:
            name, window = f"VTK, {scenes.rays_of(rays)}", scene.vtk(shot, rays)
            actions[name] = partial(window.render, shot.camera)
            quality[name] = scenes.object_psnr(actions[name](), converged)
    times = scenes.medians(actions)
    return {name: f"{quality[name]:.1f}, {times[name]:.0f}" for name in actions}


def antialiasing() -> None:
    """Object PSNR, dB, and ms."""
    columns = {}
    for opacity in (1.0, 0.9):
        for block in BLOCKS:
            name = f"checker {block} px" + (f", {opacity:g}" if opacity < 1 else "")
            columns[name] = _quality(scenes.checker(opacity=opacity), scenes.distant(block / 10))
    for volume, distance, side in (
        ("engine", 1900, 130),
        ("aneurism", 1910, 130),
        ("aneurism", 5026, 60),
    ):
        scene = scenes.real(volume)
        if scene is None:
            _say(f"{volume} left out: it is not in {scenes.DATA}")
            continue
        columns[f"{volume} {side} px"] = _quality(scene, scenes.afar(distance, side))
    _print("dB, ms", columns)


def _sequences() -> dict[str, tuple[int, Callable[[int], Shot]]]:
    """Block size and the shot of every frame."""
    shifts = {
        f"{block} px, shift": (
            block,
            lambda frame, scale=block / 10: scenes.distant(scale, shift=frame / 16),
        )
        for block in BLOCKS
    }
    return shifts | {
        "4 px, turn": (4, lambda frame: scenes.distant(0.4, turn=0.05 * frame)),
        "2 px, dolly": (2, lambda frame: scenes.distant(0.2, dolly=1.001**frame)),
    }


def flicker() -> None:
    """Temporal rms of the error, levels of 255, and share of jumping pixels, %."""
    scene, columns = scenes.checker(), {}
    for name, (_, shot_of) in _sequences().items():
        shots = [shot_of(frame) for frame in range(FRAMES)]
        whole = scene.samples(shots[0])
        near = scenes.crust(whole)
        ours = scenes.Sequence.of(shots, lambda shot, s=near: shot.by(TRUTH, s))
        columns[name] = {}
        for form_name, form in FORMS.items():
            samples = whole if form_name in FULL else near
            seen = ours if form_name in MANY else ours.first(FEW_FRAMES)
            found = scenes.flicker(seen, lambda shot, f=form, s=samples: shot.by(f, s))
            row = form_name if form_name in MANY else f"{form_name}, {FEW_FRAMES} frames"
            columns[name][row] = _flicker(found)
        if scenes.has_vtk():
            columns[name] |= _vtk_flicker(scene, shots[:FEW_FRAMES])
    _print("levels, % jumps", columns)


def _vtk_flicker(scene: Scene, shots: list[Shot]) -> Column:
    window = scene.vtk(shots[0], RAYS)
    theirs = scenes.Sequence.of(shots, lambda shot: window.render(shot.camera))
    column = {}
    for rays in VTK_RAYS:
        coarse = scene.vtk(shots[0], rays)
        found = scenes.flicker(theirs, lambda shot, w=coarse: w.render(shot.camera))
        column[f"VTK, {scenes.rays_of(rays)}, {FEW_FRAMES} frames"] = _flicker(found)
    return column


def _flicker(found: Flicker) -> str:
    return f"{found.rms:.2f}, {100 * found.jumps:.2f}"


def wall() -> None:
    """Standard deviation of an evenly colored wall, levels of 255."""
    columns = {}
    for kind in ("thin", "thick", "gentle", "steep"):
        for oblique in (False, True):
            shot, scene = scenes.wall_shot(oblique), scenes.wall(kind)
            column = {
                name: shot.by(Resampler(order=order), scene.samples(shot))
                for name, order in ORDERS.items()
            }
            for thickness in (1.0, 0.5, 0.25):
                form = Resampler(order=ImageSheets(thickness))
                column[f"Field, {thickness:g}"] = shot.by(form, scene.field(form))
            if scenes.has_vtk():
                for step in (1.0, 0.5):
                    picture = scene.vtk(shot, 1, step).render(shot.camera)
                    column[f"VTK, step {step:g}"] = picture
            name = f"{kind}{', oblique' if oblique else ''}"
            columns[name] = {row: f"{scenes.unevenness(each):.2f}" for row, each in column.items()}
    _print("levels", columns)


def opacity() -> None:
    """Total opacity at every zoom over that at the largest, minus 1; and of a finer sampling."""
    tree = Scene(scenes.centered(vessel_tree(64))[0], load_transfer("vessels"))
    zooms = (4.0, 2.0, 1.5, 1.0, 0.7, 0.4, 0.2, 0.1)
    columns = {}
    for name in ("none", "hybrid", "splats, 8 × 8 rays", "paper"):
        totals = [
            scenes.total_opacity(FORMS[name], tree.samples(shot), shot)
            for shot in (scenes.across(zoom, 60) for zoom in zooms)
        ]
        columns[name] = {
            f"{zoom:g}": f"{total / totals[0] - 1:+.1e}"
            for zoom, total in zip(zooms, totals, strict=True)
        }
    _print("px per voxel", columns)
    columns = {}
    for name in ("every-sample", "image-sheets"):
        form = Resampler(order=ORDERS[name])
        columns[name] = {f"{radius}": f"{_finer(radius, form):+.1e}" for radius in (12, 24, 36)}
    _print("radius of a ball, voxels", columns)


def _finer(radius: float, form: Resampler) -> float:
    """Total opacity of a field sampled twice as finely over that of spacing 1, minus 1."""
    shot = scenes.across(1.5, 2 * radius)
    coarse, fine = (
        scenes.total_opacity(form, scenes.ball(radius, spacing).samples(shot), shot)
        for spacing in (1.0, 0.5)
    )
    return fine / coarse - 1


def mass() -> None:
    """Sum of an X-ray's values over the volume's mass, minus 1."""
    volumes = {
        "checker-box 40³": scenes.checker(40, 4),
        "vessel-tree 64³": Scene(scenes.centered(vessel_tree(64))[0], load_transfer("vessels")),
        "engine": scenes.real("engine"),
    }
    form = Resampler(order=ImageSheets(), projection=Projection.ADDITIVE)
    columns = {}
    for name, scene in volumes.items():
        if scene is None:
            _say(f"{name} left out: it is not in {scenes.DATA}")
            continue
        values = scene.volume.values
        zooms = (0.2, 0.6, 1.5) if name == "engine" else (0.1, 0.3, 0.8, 1.5, 4.0)
        extent, total = np.linalg.norm(values.shape) / 2, values.sum(dtype=np.float64)
        field = scene.field(form)
        columns[name] = {
            f"{zoom:g}": f"{_mass(form, field, scenes.across(zoom, extent)) / total - 1:+.1e}"
            for zoom in zooms
        }
    _print("px per voxel", columns)


def _mass(form: Resampler, field: Field, shot: Shot) -> float:
    value = form(field, shot.camera, height=shot.height, width=shot.width).value
    return float(np.nansum(value, dtype=np.float64)) / shot.camera.view().focal[0] ** 2


def popping() -> None:
    """Largest second difference, rms over all pixels, levels of 255, over the median."""
    azimuths = np.arange(40, 50.01, 0.1)
    tree = Scene(scenes.centered(vessel_tree(48))[0], load_transfer("vessels"))
    volumes = {f"checker 32³, {a:g}": scenes.checker(32, 4, a) for a in (1.0, 0.9, 0.3)}
    columns = {}
    for name, scene in (volumes | {"vessel-tree 48³": tree}).items():
        found = {
            order_name: scenes.turned(scene, Resampler(order=order), azimuths)
            for order_name, order in ORDERS.items()
        }
        worst = found["axis-sheets"].max()
        columns[name] = {
            order_name: f"{255 * each.max():.3f}, {255 * np.median(each):.3f}, "
            f"{worst / each.max():.0f}"
            for order_name, each in found.items()
        }
    _print("largest, median, times below axis-sheets", columns)


def perspective() -> None:
    """PSNR of footprints, dB, where single voxels are, by their angle off the view axis."""
    side = 240
    camera = Camera.from_fov(100, height=side, width=side)
    shot = Shot(camera, side, side)
    columns = {}
    for angle in (0, 15, 30, 45):
        samples = scenes.off_axis(angle)
        integrals = all_line_integrals(samples, camera, GaussianKernel(), height=side, width=side)
        depth = in_camera(camera, samples.position)[:, 2]
        truth = composite(1 - np.exp(-1.5 * integrals), samples.color, depth)
        columns[f"{angle}°"] = _footprints(shot, samples, truth)
    box = scenes.checker(40, 4, 0.3).samples(shot)
    wide = Shot(
        Camera.from_fov(90, height=200, width=200, world_to_camera=orbit((0, 0, 0), 45, 20, 15)),
        200,
        200,
    )
    columns["checker 40³ close"] = _footprints(wide, box, wide.by(TRUTH, box), rays=16)
    _print("footprint", columns)


def _footprints(shot: Shot, samples: Samples, truth: np.ndarray, rays: int = 1) -> Column:
    column = {}
    for footprint in footprints_of(Primitive.SPLATS):
        form = replace(SPLATS, footprint=footprint, subpixels=rays)
        column[footprint.value] = f"{scenes.object_psnr(shot.by(form, samples), truth):.1f}"
    return column


def _cast(scene: Samples | Field, shot: Shot, look: Casting = FINE) -> np.ndarray:
    return cast_rays(scene, shot.camera, height=shot.height, width=shot.width, look=look).rgba


def bleeding() -> None:
    """PSNR, dB, and largest difference in levels against rays through the same field."""
    columns = {}
    for alpha in (1.0, 0.5, 0.1):
        scene = scenes.two_colors(alpha)
        shot = scenes.near(scene)
        samples = scene.samples(shot)
        truth = _cast(samples, shot)
        sheets = {f"image-sheets, {t:g}": ImageSheets(t) for t in (1.0, 0.5, 0.25, 0.125)}
        orders = {"every-sample": EverySample(), "axis-sheets": AxisSheets()} | sheets
        column = {}
        for name, order in orders.items():
            column[name] = _difference(shot.by(replace(SPLATS, order=order), samples), truth)
        classified = None
        for thickness in (1.0, 0.5, 0.25, 0.125):
            form = replace(SPLATS, order=ImageSheets(thickness))
            field = scene.field(form)
            classified = _cast(field, shot) if classified is None else classified
            column[f"Field, {thickness:g}"] = _difference(shot.by(form, field), classified)
        columns[f"opacity {alpha:g}"] = column
    _print("dB, levels", columns)


def _difference(picture: np.ndarray, truth: np.ndarray) -> str:
    return f"{scenes.object_psnr(picture, truth):.1f}, {255 * largest(picture, truth):.1f}"


def slabs() -> None:
    """PSNR, dB, largest difference in levels, and ms of slabs of a thickness in voxels."""
    tree = Scene(scenes.centered(vessel_tree(48))[0], load_transfer("vessels"))
    columns = {}
    for name, scene in {
        "checker 40³, 0.1": scenes.checker(40, 4, 0.1),
        "vessel-tree 48³": tree,
    }.items():
        shot = scenes.near(scene)
        forms = {f"{t:g}": replace(SPLATS, order=ImageSheets(t)) for t in THICKNESSES}
        thickest = next(iter(forms.values()))
        for kind, what in {"colors": scene.samples(shot), "Field": scene.field(thickest)}.items():
            truth = _cast(what, shot)
            actions = {row: partial(shot.by, form, what) for row, form in forms.items()}
            if kind == "colors":
                actions["every-sample"] = partial(shot.by, SPLATS, what)
            apart = {row: _difference(action(), truth) for row, action in actions.items()}
            times = scenes.medians(actions, rounds=3)
            columns[f"{name}, {kind}"] = {row: f"{apart[row]}, {times[row]:.0f}" for row in actions}
    _print("dB, levels, ms", columns)


def orders() -> None:
    """Ms of every order on the Engine, 400 × 400 px."""
    scene = scenes.real("engine")
    if scene is None:
        _say(f"orders left out: the Engine is not in {scenes.DATA}")
        return
    columns = {}
    for view, distance in (("close", 520), ("distant", 1900)):
        shot = scenes.afar(distance, 400)
        samples = scene.samples(shot)
        actions = {
            name: partial(shot.by, Resampler(order=order), samples)
            for name, order in ORDERS.items()
        }
        field_form = Resampler(order=ImageSheets())
        actions["Field"] = partial(shot.by, field_form, scene.field(field_form))
        if scenes.has_vtk():
            actions["VTK"] = partial(scene.vtk(shot, 1).render, shot.camera)
        for action in actions.values():
            action()
        times = scenes.medians(actions, rounds=3)
        columns[view] = {name: f"{duration:.0f}" for name, duration in times.items()}
    _print("ms", columns)


TABLES: dict[str, Callable[[], None]] = {
    table.__name__: table
    for table in (
        antialiasing,
        flicker,
        wall,
        opacity,
        mass,
        popping,
        perspective,
        bleeding,
        slabs,
        orders,
    )
}

if __name__ == "__main__":
    for chosen in sys.argv[1:] or TABLES:
        start = time.perf_counter()
        TABLES[chosen]()
        _say(f"{chosen}: {time.perf_counter() - start:.0f} s")
