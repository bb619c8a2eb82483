"""Default volume rendering and VTK's ray caster against ray casting of SciPy's spline.

The reference uses only our transfer function and lamp: `scipy.ndimage` interpolates the values, and
a NumPy loop composites short steps on many rays through random pixels of the bounding rectangle of
the volume's picture. So decibels are estimates for that rectangle, with an uncertainty of 0.2 to
0.5 dB.
"""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from benchmarks.contest import AbsentError, Options
from benchmarks.measure import take_turns
from benchmarks.tables import Row, Section
from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit
from resample.painting.rays import spacing_of
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample.types import Classifier, Doubles, Floats, LatticeField
from resample_volume.baselines.peers import Peer, VtkRenderer
from resample_volume.classification.surveys import survey, without_padding
from resample_volume.files.source import open_volume
from resample_volume.media.appearance import BY_DEFAULT, Appearance, Classification, transfer_of
from resample_volume.rendering import Subject
from resample_volume.types import Volume
from resample_volume.voxels.framing import centered
from resample_volume.voxels.visible import lattice_of
from tests import ray_truth

SUFFIXES = (".nhdr", ".nrrd", ".nii.gz", ".nii", ".mha", ".mhd", ".vti", ".dcm")
ZOOMS = {"close": 4.0, "1:1": 1.0, "half": 0.5, "quarter": 0.25, "an eighth": 0.125}  # px per voxel
RAYS = {"close": 3, "1:1": 4, "half": 5, "quarter": 7, "an eighth": 12}  # per side of a pixel
SIDE, PIXELS = 400, 1200  # px; number of random pixels
TURN = (30.0, 20.0)  # degrees
STEP = 0.125  # voxels
CHUNK = 1 << 17  # steps computed together
DARK = 1e-4  # transmittance that counts as opaque
AROUND, BEYOND = 5, 0.2  # voxels, and fraction of their range: bounds of a spline around a voxel


class Seen(NamedTuple):
    """A volume and a camera."""

    volume: Volume  # centered at the scene's origin
    field: LatticeField  # source of the look and lamp of the reference
    camera: AnyCamera
    draws: dict[str, Callable[[], Floats]]


def sections(options: Options) -> Iterator[Section]:
    """A table for each volume of a folder."""
    from importlib.util import find_spec

    if find_spec("vtkmodules") is None:
        raise AbsentError("VTK is not installed; make .venv/.dev installs it")
    files = [file for file in sorted(options.volumes.glob("*")) if file.name.endswith(SUFFIXES)]
    if not files:
        raise AbsentError(f"{options.volumes} holds no volumes ({', '.join(SUFFIXES)})")
    for file in files[:1] if options.quick else files:
        volume = open_volume(file)
        volume = without_padding(volume, survey(volume))
        rows = [_row(volume, zoom, options) for zoom in ZOOMS]
        size = " × ".join(map(str, volume.values.shape[::-1]))
        text = (
            f"{size} voxels, {SIDE} × {SIDE} px, one thread. CPU ms / dB of linear light against "
            f"SciPy's spline in steps of ⅛ voxel, on {PIXELS} pixels of what is seen."
        )
        yield Section(f"Truth: {volume.name}", text, rows)


def _row(volume: Volume, zoom: str, options: Options) -> Row:
    seen = _seen(volume, ZOOMS[zoom])
    rng = np.random.default_rng(1)
    pixels = _rectangle(seen)
    count = min(PIXELS // (8 if options.quick else 1), pixels.size)
    place = rng.choice(pixels, count, replace=False)
    truth = _truth(seen, place, 2 if options.quick else RAYS[zoom])
    times = take_turns(seen.draws, min(options.rounds, 3), clock=time.process_time)
    row: Row = {"px per voxel": zoom}
    for name, draw in seen.draws.items():
        light = draw()[..., :3].reshape(-1, 3)[place].astype(np.float64)
        error = float(np.mean((np.clip(light, 0, 1) - np.clip(truth, 0, 1)) ** 2))
        decibels = -10 * np.log10(max(error, 1e-12))
        row[name] = f"{1000 * float(np.median(times[name])):.0f} / {decibels:.1f}"
    return row


def _rectangle(seen: Seen) -> NDArray[np.int64]:
    """Pixels of the bounding rectangle of what is not black."""
    light = seen.draws["default"]()[..., :3].max(axis=-1) > 0
    rows, columns = np.flatnonzero(light.any(axis=1)), np.flatnonzero(light.any(axis=0))
    row, column = np.mgrid[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return np.asarray((row * SIDE + column).reshape(-1), np.int64)


def _seen(volume: Volume, per_voxel: float) -> Seen:
    """Place a camera so that voxels have a size in px at the volume's center."""
    look = Appearance()
    subject = Subject.of(volume, look)
    camera = _camera(subject, volume, per_voxel)
    voxels = Subject.of(volume, Appearance(classification=Classification.PRE))
    scene, _ = centered(volume)
    draws = {
        "default": _drawn(subject, camera, BY_DEFAULT),
        "fast": _drawn(subject, camera, Resampler(order=Rays(quality="fast"))),
        "best": _drawn(subject, camera, Resampler(order=Rays())),
        "splats, points": _drawn(voxels, camera, Resampler()),
    }
    for rays in (1, 4):
        peer = Peer(rays=rays, light=look.light, threads=1)
        transfer = transfer_of(volume, look)
        try:
            vtk = VtkRenderer(scene, transfer, height=SIDE, width=SIDE, look=peer)
        except ValueError:  # not supported by VTK
            continue
        draws[f"VTK, {rays * rays} rays"] = partial(vtk.render, camera)
    field = subject.samples_for(camera)
    assert isinstance(field, LatticeField)
    return Seen(scene, field, camera, draws)


def _camera(subject: Subject, volume: Volume, per_voxel: float) -> AnyCamera:
    """Camera that shows the center voxel at a size in px."""
    view = subject.camera(Orbit(*TURN), SIDE, SIDE).view()
    usual = spacing_of(lattice_of(volume), subject.sphere.center, view)
    return subject.camera(Orbit(*TURN, per_voxel / usual), SIDE, SIDE)


def _drawn(subject: Subject, camera: AnyCamera, paint: Resampler) -> Callable[[], Floats]:
    samples, cuts = subject.samples_for(camera), subject.cuts(camera)

    def draw() -> Floats:
        frame = paint(samples, camera, height=SIDE, width=SIDE, threads=1, clip=cuts)
        return subject.developed(frame).rgba

    return draw


def _truth(seen: Seen, place: NDArray[np.int64], count: int) -> Doubles:
    """Light (N, 3) of pixels (N,) by count × count rays each."""
    values = ray_truth.filled(seen.volume.values)
    coefficient = ray_truth.filtered(values)
    shown = _shown(values, seen.field.classifier)
    offset = (np.arange(count) + 0.5) / count
    total = np.zeros((place.size, 3))
    row, column = np.divmod(place, SIDE)
    for down in offset:
        for right in offset:
            pixels = np.column_stack([column + right, row + down])
            total += _along(seen, coefficient, shown, pixels)
    return total / count**2


def _shown(values: NDArray[Any], look: Classifier) -> NDArray[np.bool_]:
    """Voxels (Z, Y, X) with something visible around them."""
    least, most = minimum_filter(values, AROUND), maximum_filter(values, AROUND)
    low, high = least.astype(np.float64), most.astype(np.float64)
    margin = BEYOND * (high - low)
    thick = np.concatenate([[0], np.cumsum(look.table[..., 3].max(axis=0) > 0)])
    per = (thick.size - 2) / (look.high - look.low)
    first = np.clip(np.floor((low - margin - look.low) * per), 0, thick.size - 2).astype(np.int32)
    last = np.clip(np.ceil((high + margin - look.low) * per), 0, thick.size - 2).astype(np.int32)
    return np.asarray(thick[last + 1] > thick[first])


def _along(seen: Seen, coefficient: Doubles, shown: NDArray[np.bool_], pixels: Doubles) -> Doubles:
    """Light (N, 3) along rays through screen points (N, 2), px."""
    view, lattice = seen.camera.view(), lattice_of(seen.volume)
    on_plane = np.column_stack([(pixels - view.principal) / view.focal, np.ones(len(pixels))])
    start = np.zeros_like(on_plane) if view.perspective else on_plane * [1, 1, 0]
    way = on_plane if view.perspective else np.broadcast_to([0.0, 0.0, 1.0], on_plane.shape)
    eye = (start - view.translation) @ view.rotation
    way = way @ view.rotation
    to_lattice = np.linalg.inv(lattice).T
    origin, speed = (eye - seen.volume.origin) @ to_lattice, way @ to_lattice
    size = np.array(seen.volume.values.shape[::-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([(-0.5 - origin) / speed, (size - 0.5 - origin) / speed], axis=0)
    first = np.maximum(np.nanmax(ends[0], axis=1), max(view.near, 0.0))
    last = np.nanmin(ends[1], axis=1)
    step = STEP / np.linalg.norm(speed, axis=1)
    steps = np.maximum(np.ceil((last - first) / step), 0).astype(np.int64)
    light, kept = np.zeros((len(pixels), 3)), np.ones(len(pixels))
    at, many = np.zeros(len(pixels), np.int64), max(1, CHUNK // max(1, len(pixels)))
    while (alive := np.flatnonzero((at < steps) & (kept > DARK))).size:
        number = at[alive, None] + np.arange(many)
        depth = first[alive, None] + (number + 0.5) * step[alive, None]
        index = origin[alive, None] + depth[..., None] * speed[alive, None]
        inside = number < steps[alive, None]
        nearest = np.clip(np.rint(index).astype(np.int32), 0, size - 1)
        inside &= shown[nearest[..., 2], nearest[..., 1], nearest[..., 0]]
        part = ray_truth.at(coefficient, index[inside])
        value = np.zeros(inside.shape)
        value[inside] = part
        _composite(seen, coefficient, (alive, value, index, depth, inside), step, way, light, kept)
        at[alive] += many
    return light


def _composite(
    seen: Seen,
    coefficient: Doubles,
    met: tuple[NDArray[np.int64], Doubles, Doubles, Doubles, NDArray[np.bool_]],
    step: Doubles,
    way: Doubles,
    light: Doubles,
    kept: Doubles,
) -> None:
    """Composite steps of several rays into their light and transmittance."""
    alive, value, index, depth, inside = met
    look: Classifier = seen.field.classifier
    slope = np.zeros((*value.shape, 3))
    table = look.table[..., 3].max(axis=0)
    column = np.clip((value - look.low) / (look.high - look.low), 0, 1) * (table.size - 1)
    thick = inside & (np.maximum(table[column.astype(int)], table[np.ceil(column).astype(int)]) > 0)
    bump, to_scene = 1e-3, np.linalg.inv(lattice_of(seen.volume))
    for axis in range(3):
        move = bump * np.eye(3)[axis]
        behind = ray_truth.at(coefficient, index[thick] + move)
        slope[thick, axis] = (behind - ray_truth.at(coefficient, index[thick] - move)) / (2 * bump)
    slope = slope[thick] @ to_scene
    place = seen.volume.origin + index[thick] @ lattice_of(seen.volume).T
    colors = ray_truth.looks(look, value[thick], np.linalg.norm(slope, axis=-1))
    own, high = ray_truth.shine(look, slope, place, depth[thick])
    long = (step * np.linalg.norm(way, axis=1))[alive]
    extinction, color = np.zeros(value.shape), np.zeros((*value.shape, 3))
    extinction[thick] = colors[:, 3]
    color[thick] = own[:, None] * colors[:, :3] + high[:, None]
    optical = extinction * long[:, None]
    before = kept[alive, None] * np.exp(-(np.cumsum(optical, axis=1) - optical))
    light[alive] += ((before * -np.expm1(-optical))[..., None] * color).sum(axis=1)
    kept[alive] *= np.exp(-optical.sum(axis=1))
