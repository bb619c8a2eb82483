"""Volumes in all modes against their analytic fields, beside VTK.

Blur counts as an error here: `analytic` integrates the formula itself. VTK's CPU ray caster has
composites, maxima and minima. VTK's surfaces are triangles from flying edges, which no CPU mapper
of its own draws without a display: these are timed, and measured by the distance of their corners
from the surface.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.analytic import (
    FIELDS,
    ISO,
    SHOTS,
    TRANSFER,
    Formula,
    Shot,
    Truth,
    camera_of,
    sampled,
    truth_of,
)
from benchmarks.contest import AbsentError, Options
from benchmarks.measure import take_turns
from benchmarks.tables import Row, Section
from resample.colors import to_srgb
from resample.painting.choices import Projection
from resample.profiles.orders import ImageSheets, Rays
from resample.resampler import Resampler
from resample.types import Doubles, Floats
from resample_volume.baselines.peers import Peer, VtkRenderer
from resample_volume.classification.transfer import from_points
from resample_volume.media.appearance import BY_DEFAULT, Appearance, Classification
from resample_volume.rendering import Subject
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light

QUICK, QUICK_SHOTS = ("rings 2.0",), (Shot(1.0, 48, 2),)
FULL_LIT = ("rings 1.2", "rings 2.0")  # lit references that are worth their minutes
STRETCHED = 5.0  # thickness of slices, voxels
LAMP = Light()
OF_VALUES = (Projection.MAXIMUM, Projection.MINIMUM, Projection.AVERAGE, Projection.ADDITIVE)
OF_VTK = (Projection.MAXIMUM, Projection.MINIMUM)
TOP = 255.0  # of values
GRAY = from_points(
    [(TOP * n / 64, (float(to_srgb(np.array(n / 64))),) * 3, 1.0) for n in range(65)]
)  # emit the value over `TOP`

Draw = Callable[[], Floats]


def sections(options: Options) -> Iterator[Section]:
    """A table for each field and shape of voxels."""
    from importlib.util import find_spec

    if find_spec("vtkmodules") is None:
        raise AbsentError("VTK is not installed; make .venv/.dev installs it")
    for name in QUICK if options.quick else FIELDS:
        for stretch in (1.0, STRETCHED):
            yield _section(name, stretch, options)


def _section(name: str, stretch: float, options: Options) -> Section:
    volume, formula = sampled(FIELDS[name], stretch), FIELDS[name]
    text = (
        f"{'×'.join(map(str, volume.values.shape[::-1]))} voxels of 8 bits against the formula. "
        "dB of linear light or of values over 255, CPU ms of all threads; the truth has up to 400 "
        "rays per pixel in steps of ⅛ voxel."
    )
    rows: list[Row] = []
    half = 0.5 * volume.spacing * volume.values.shape[::-1]
    for shot in QUICK_SHOTS if options.quick else SHOTS:
        is_lit = stretch == 1.0 and name in FULL_LIT and not options.quick
        truth = truth_of(formula, half, shot, LAMP, is_lit=is_lit)
        rows += _composites(volume, shot, truth, options)
        rows += _projections(volume, shot, truth, options)
    rows += [_triangles(volume, formula)]
    return Section(f"Fields: {name}, slices {stretch:g} thick", text, rows)


def _ours(
    volume: Volume, shot: Shot, appearance: Appearance, paint: Resampler, *, is_value: bool = False
) -> Draw:
    """Functions that draw a volume, after preparation."""
    camera, subject = camera_of(shot), Subject.of(volume, appearance, paint)
    clip, size = subject.clip, shot.size

    def draw() -> Floats:
        frame = paint(subject.samples_for(camera), camera, height=size, width=size, clip=clip)
        if not is_value:
            return frame.rgba
        if frame.value is None:
            raise ValueError(f"{paint.projection} measures no values")
        present = frame.coverage if paint.projection is not Projection.ADDITIVE else 1.0
        return np.asarray(np.nan_to_num(frame.value) * present / np.float32(TOP))

    return draw


def _vtk(volume: Volume, shot: Shot, look: Peer) -> dict[str, Draw]:
    """VTK at one ray per pixel and at 64."""
    transfer = TRANSFER if look.projection is Projection.COMPOSITE else GRAY
    found: dict[str, Draw] = {}
    for side in (1, 8):
        peer = VtkRenderer(
            volume, transfer, height=shot.size, width=shot.size, look=replace(look, rays=side)
        )
        draw = partial(peer.render, camera_of(shot))
        if look.projection is not Projection.COMPOSITE:
            draw = partial(_first_channel, draw)
        found[f"VTK {side * side}"] = draw
    return found


def _first_channel(draw: Draw) -> Floats:
    return draw()[..., 0]


def _scaled(draw: Draw, most: float) -> Floats:
    return draw() / np.float32(most)


def _row(mode: str, shot: Shot, draws: dict[str, Draw], truth: Floats, options: Options) -> Row:
    """Decibels and CPU time of each renderer."""
    times = take_turns(draws, options.rounds, clock=time.process_time)
    row: Row = {"px per voxel": shot.per_voxel, "mode": mode}
    for name, draw in draws.items():
        picture = draw()[..., :3] if truth.ndim == 3 else draw()
        goal = truth[..., :3] if truth.ndim == 3 else truth
        error = float(np.mean((picture.astype(np.float64) - goal) ** 2))
        row[f"{name} dB"] = round(-10 * np.log10(max(error, 1e-12)), 1)
        row[f"{name} ms"] = round(1000 * float(np.median(times[name])), 1)
    return row


def _composites(volume: Volume, shot: Shot, truth: Truth, options: Options) -> Iterator[Row]:
    goals: dict[str, tuple[Light | None, Floats]] = {"composite": (None, truth.unlit)}
    if truth.lit is not None:
        goals["composite, lit"] = (LAMP, truth.lit)
    for mode, (light, goal) in goals.items():
        post = Appearance(TRANSFER, light, classification=Classification.POST)
        draws = {
            "default": _ours(volume, shot, post, BY_DEFAULT),
            "rays": _ours(volume, shot, post, Resampler(order=Rays())),
            "splats": _ours(volume, shot, Appearance(TRANSFER, light), Resampler()),
            "slabs": _ours(volume, shot, post, Resampler(order=ImageSheets(0.5))),
            **_vtk(volume, shot, Peer(light=light)),
        }
        yield _row(mode, shot, draws, goal, options)


def _projections(volume: Volume, shot: Shot, truth: Truth, options: Options) -> Iterator[Row]:
    for projection in OF_VALUES:
        paint = Resampler(order=Rays(), projection=projection)
        look = Appearance(GRAY, None)
        draws = {"rays": _ours(volume, shot, look, paint, is_value=True)}
        if projection in OF_VTK:
            draws |= _vtk(volume, shot, Peer(projection=projection))
        goal = getattr(truth, projection.value) / np.float32(TOP)
        if projection is Projection.ADDITIVE:
            goal, draws = goal / goal.max(), {"rays": partial(_scaled, draws["rays"], goal.max())}
        yield _row(projection.value, shot, draws, goal, options)
    paint = Resampler(order=Rays(), projection=Projection.FIRST_HIT, iso=ISO)
    look = Appearance(TRANSFER, LAMP)
    draws = {"rays": _ours(volume, shot, look, paint)}
    yield _row("first-hit", shot, draws, truth.surface, options)


def _triangles(volume: Volume, formula: Formula) -> Row:
    """Flying edges: time, and distance of corners from the surface."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    from resample_volume.baselines.peers import image_of

    edges: Any = vtkFlyingEdges3D()
    edges.SetInputData(image_of(volume))
    edges.SetValue(0, ISO)
    times = take_turns({"edges": lambda: _extracted(edges)}, 3, clock=time.process_time)
    corner = vtk_to_numpy(edges.GetOutput().GetPoints().GetData()).astype(np.float64)
    away = _distances(corner, formula)
    note = f"flying edges: {len(corner)} corners, {np.sqrt(np.mean(away**2)):.3f} voxels off (rms)"
    return {"px per voxel": "", "mode": note, "VTK 1 ms": round(1000 * min(times["edges"]), 1)}


def _extracted(edges: Any) -> None:
    edges.Modified()
    edges.Update()


def _distances(corner: Doubles, formula: Formula) -> Doubles:
    """Approximate distance of positions (N, 3) from the surface, voxels: one Newton step."""
    ways = 1e-3 * np.eye(3)
    slope = [(formula(*(corner + d).T) - formula(*(corner - d).T)) / 2e-3 for d in ways]
    steep = np.linalg.norm(slope, axis=0)
    return np.asarray((formula(*corner.T) - ISO) / np.maximum(steep, 1.0))
