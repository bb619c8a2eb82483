"""Volumes in files, drawn by `resample-volume render`, against closed forms and own fine rays.

Looks are white and unshaded where opacity is judged, so that the alpha of an .exr is all there is
to compare: 1 - exp(-sum of extinction x length), with extinction -ln(1 - opacity) for the length of
a voxel.
Peer: VTK's fixed-point ray caster, one thread, its own step of one voxel.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import OpenImageIO

from benchmarks.scores.judging import AbsentError, Call, Finding, Floats, Judge, db
from benchmarks.scores.kernels.fine_rays import MARSCHNER_LOBB, RINGS, SIDE, sampled
from benchmarks.scores.pictures import View, look_at, read_png, write_camera
from benchmarks.scores.volume_files import Spacing, Values, read_nrrd, write_nrrd, write_ome
from benchmarks.scores.volume_truth import POINTS, Points, Vtk, ball, fine, wall_area

EVEN: Spacing = (1, 1, 1)
FORMULAS = {"rings": RINGS, "Marschner-Lobb": MARSCHNER_LOBB}
ZOOMS = ((3.0, 96, 2), (1.0, 96, 3), (0.3, 32, 10))  # px a voxel, size, rays along a pixel's side
SCANS: dict[str, Points] = {
    "engine": ((70, 0.0), (140, 0.05), (255, 0.6)),
    "cthead": ((1100, 0.0), (1300, 0.02), (2500, 0.5)),
    "stent": ((1000, 0.0), (1250, 0.02), (2500, 0.5)),
}
WALLS, APART = 8, 29  # voxels from wall to wall


def view_of(
    shape: tuple[int, ...],
    spacing: Spacing,
    per: float,
    size: int,
    azimuth: float,
    elevation: float,
    distance: float = 4.0,
) -> View:
    """A camera that shows voxels at `per` px in the middle; distance in diagonals of the volume."""
    voxels = np.array(shape[::-1])
    a, e = np.radians((azimuth, elevation))
    ahead = np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), -np.sin(e)])
    away = distance * float(np.linalg.norm(voxels * spacing))
    eye = (voxels - 1) / 2 * spacing - ahead * away
    focal = per * away / float(np.cbrt(np.prod(spacing)))
    return View(look_at(eye, eye + ahead, (0, 0, 1)), eye, focal, (size / 2, size / 2))


def drawn(
    judge: Judge, path: object, view: View, size: int, *words: object
) -> tuple[dict[str, Floats], Call]:
    """Channels of an .exr by name."""
    write_camera(judge.folder / "camera.json", view, (size, size))
    view_words = ("--camera", "camera.json", "--size", size)
    call = judge.call("volume", "render", path, *view_words, *words, "-o", "out.exr")
    if np.isnan(call.cpu):
        return dict.fromkeys(("A", "value"), np.full((size, size), np.nan)), call
    picture: Any = OpenImageIO.ImageInput.open(str(judge.folder / "out.exr"))
    channels = np.moveaxis(picture.read_image("float"), -1, 0)
    return dict(zip(picture.spec().channelnames, channels, strict=True)), call


def white(points: Points) -> tuple[str, ...]:
    """Words for a white look without light."""
    return "--no-shading", "--transfer", " ".join(f"{v:g},white,{a:g}" for v, a in points)


def peers_of(
    judge: Judge, values: Values, spacing: Spacing, points: Points, size: int
) -> dict[str, Vtk]:
    """VTK by its name, or nothing."""
    try:
        return {"VTK, one ray": Vtk(values, spacing, points, size)}
    except AbsentError as error:
        judge.skip(str(error))
    return {}


def spheres(judge: Judge) -> None:
    """Diameters of a ball of 36 mm, whose field is 0 exactly at its surface."""
    shape, spacing, size = (24, 48, 48), (1.0, 1.0, 2.0), 240
    field = ball(shape, spacing, 18.0)
    write_nrrd(judge.folder / "ball.nrrd", field, spacing)
    empty = np.full_like(field, -900)
    empty[0, 0, 0] = -899
    write_nrrd(judge.folder / "empty.nrrd", empty, spacing)
    cube = ball((48, 48, 48), EVEN, 18.0) + 2000
    write_ome(judge.folder / "two.ome.tif", np.stack([np.full_like(cube, 100), cube]), EVEN)

    view = view_of(shape, spacing, 5.0 * np.cbrt(2), size, 0, 0, 100)
    even = view_of(cube.shape, EVEN, 5.0, size, 0, 0, 100)
    look = ("--no-shading", "--transfer", "-1,white,0 1,white,1")
    shifted = ("--no-shading", "--transfer", "1999,white,0 2001,white,1")
    also = ("--also", "empty.nrrd:transfer=-1,red,0 1,red,1")
    cases: dict[str, tuple[str, View, tuple[object, ...]]] = {
        "one volume": ("ball.nrrd", view, look),
        "one of two, by --also": ("ball.nrrd", view, (*look, *also)),
        "channel of an OME-TIFF": ("two.ome.tif", even, ("--channel", 1, *shifted)),
    }
    for name, (file, camera, words) in cases.items():
        picture, call = drawn(judge, file, camera, size, *words)
        for side, axis in (("width", 1), ("height", 0)):
            off = abs(picture["A"].sum(axis).max() / 5 - 36)
            case = f"ball of 36 mm, {name}: {side} off by"
            judge.add(case, off, {"asked": 0.1}, calls=[call], unit="mm", sign=-1)

    # A ball that is sampled every 0.2 um in x and y, and every 0.5 um in z.
    small = ball((28, 56, 56), (0.2, 0.2, 0.5), 4.5, 200) + 2000
    write_ome(judge.folder / "small.ome.tif", small[None], (0.2, 0.2, 0.5))
    front = ("--camera", "front", "--fov", 0, "--size", size)
    words = ("--no-shading", "--transfer", "1990,white,0 2010,white,1")
    call = judge.call("volume", "render", "small.ome.tif", *front, *words, "-o", "out.png")
    seen = read_png(judge.folder / "out.png")[0][..., 0]
    off = abs(seen.sum(0).max() / seen.sum(1).max() - 1)
    case = "ball with sizes only in OME-TIFF: height / width off by"
    judge.add(case, off, {"asked": 0.01}, calls=[call], unit="", sign=-1)


def walls(judge: Judge) -> None:
    """Walls of one voxel, which meet the pixels at other places each: all areas are equal."""
    field = np.zeros((40, 40, APART * WALLS + 12), np.uint8)
    for n in range(WALLS):
        field[10:30, 10:30, 20 + APART * n] = 100
    write_nrrd(judge.folder / "walls.nrrd", field)
    points, size = ((50, 0.0), (51, 1.0)), 160
    for per in (0.5, 0.125) if judge.quick else (0.5, 0.25, 0.125):
        peers = peers_of(judge, field, EVEN, points, size)
        for tilt in (0, 4, 30):
            # All but parallel: at 50 diagonals the outer walls are turned by half a degree, which
            # adds 16 % to their area.
            view = view_of(field.shape, EVEN, per, size, tilt, 0, 5000)
            picture, call = drawn(judge, "walls.nrrd", view, size, *white(points))
            off = {
                name: _area_error(alpha, per, tilt, field.shape[2])
                for name, alpha in [
                    ("ours", picture["A"]),
                    *((name, peer(view)[0]) for name, peer in peers.items()),
                ]
            }
            case = f"wall of one voxel, {per:g} px a voxel, {tilt} degrees: area off by"
            judge.add(case, off.pop("ours"), off, calls=[call], unit="%", sign=-1)


def _area_error(alpha: Floats, per: float, tilt: float, length: int) -> float:
    """The worst wall's error, %."""
    size, columns, reach = alpha.shape[1], alpha.sum(0), 14 * per
    along = 20 + APART * np.arange(WALLS) - (length - 1) / 2
    left = np.arange(size)
    areas = []
    for middle in size / 2 + per * np.cos(np.radians(tilt)) * along:
        inside = np.minimum(left + 1, middle + reach) - np.maximum(left, middle - reach)
        areas.append((columns * np.maximum(inside, 0)).sum() / per**2)
    return float(100 * np.abs(np.array(areas) / wall_area(tilt) - 1).max())


def values(judge: Judge) -> None:
    """Values of projections, and labels."""
    size = 100
    cells = (np.random.default_rng(3).random((24, 24, 24)) > 0.5).astype(np.uint8) * 200
    write_nrrd(judge.folder / "cells.nrrd", cells)
    most, calls = 0.0, []
    for per in (3.0, 0.5):
        view = view_of(cells.shape, EVEN, per, size, 30, 20)
        picture, call = drawn(judge, "cells.nrrd", view, size, "--projection", "maximum")
        most = max(most, float(np.nanmax(picture["value"])))
        calls.append(call)
    case = "maximum projection: above the greatest voxel by"
    judge.add(case, max(0.0, most - 200), {"asked": 0.01}, calls=calls, unit="", sign=-1)

    water, spacing = np.full((40, 40, 40), -1000, np.int16), (1.0, 1.0, 1.5)
    water[10:30, 10:30, 10:30] = 0
    write_nrrd(judge.folder / "water.nrrd", water, spacing)
    view = view_of(water.shape, spacing, 1.5, size, 0, 0, 100)
    words = ("--projection", "xray", "--units", "hu")
    picture, call = drawn(judge, "water.nrrd", view, size, *words)
    off = 100 * abs(picture["value"][size // 2, size // 2] / 0.4 - 1)
    case = "X-ray of 20 mm of water: off by"
    judge.add(case, off, {"asked": 0.5}, calls=[call], unit="%", sign=-1)

    labels = np.zeros((40, 40, 40), np.uint8)
    labels[8:32, 8:32, 8:20], labels[8:32, 8:32, 20:32] = 1, 7
    write_nrrd(judge.folder / "labels.nrrd", labels)
    write_nrrd(judge.folder / "blocks.nrrd", (labels > 0).astype(np.uint8) * 100)
    view = view_of(labels.shape, EVEN, 3.0, 2 * size, 0, 0, 50)  # a half shows 1, the other 7
    look = (*white(((50, 0.0), (51, 1.0))), "--labels", "labels.nrrd")
    words = ("--label", "1:color=red", "--label", "7:color=blue")
    picture, call = drawn(judge, "blocks.nrrd", view, 2 * size, *look, *words)
    for name, channel in (("red", "R"), ("blue", "B")):
        share = 100 * (picture.get(channel, picture["A"]) > 0.9).sum() / 72**2
        case = f"blocks of label 1 and 7: {name} half off by"
        judge.add(case, abs(share - 50), {"asked": 3.0}, calls=[call], unit="%", sign=-1)


def formulas(judge: Judge) -> None:
    """Formulas, sampled with 64 x 64 x 64 voxels of 8 bits."""
    for name, kind in FORMULAS.items():
        exact = np.empty((SIDE, SIDE, SIDE))
        sampled(kind, exact)
        field = np.rint(np.clip(exact, 0, 255)).astype(np.uint8)
        write_nrrd(judge.folder / "formula.nrrd", field)
        for per, size, rays in ZOOMS:
            view = view_of(field.shape, EVEN, per, size, 30, 20)
            true = fine(field, EVEN, view, size, rays, POINTS, kind=kind)
            peers = peers_of(judge, field, EVEN, POINTS, size)
            scores = {peer: db(draw(view)[0], true) for peer, draw in peers.items()}
            ours, call = drawn(judge, "formula.nrrd", view, size, *white(POINTS))
            case = f"{name}, {per:g} px a voxel: as the formula"
            judge.add(case, db(ours["A"], true), scores, calls=[call], cpu=call.cpu)


def scan_times(judge: Judge, name: str) -> None:
    """CPU ms of a scan's picture beyond that of one of 8 x 8 px (start and reading).

    Sizes take turns, and the least of each counts, since other work disturbs.
    """
    path, points = judge.file(f"volumes/{name}.nhdr"), SCANS[name]
    field, spacing = read_nrrd(path)
    zooms, rounds = [3.0], 2
    if not judge.quick:  # farther away than 1 px a voxel, start is nearly all
        zooms, rounds = [4.0, 3.3, 3.0, 1.0] if name == "engine" else [3.3, 1.0], 5
    sizes: dict[float | None, int] = {None: 8} | {per: 400 if per >= 3 else 300 for per in zooms}
    views = {
        per: view_of(field.shape, spacing, per or 1.0, size, 30, 20) for per, size in sizes.items()
    }
    took: dict[float | None, list[Call]] = {per: [] for per in sizes}
    for per in (*sizes,) * rounds:
        words = (*white(points), "--threads", 1)
        took[per].append(drawn(judge, path, views[per], sizes[per], *words)[1])
    least = {per: min(calls, key=lambda call: call.cpu) for per, calls in took.items()}
    for per in zooms:
        peers = peers_of(judge, field, spacing, points, sizes[per])
        times = {
            peer: 1000 * min(draw(views[per])[1] for _ in range(rounds))
            for peer, draw in peers.items()
        }
        case = f"{name}, {per:g} px a voxel: CPU beyond start"
        ours = 1000 * (least[per].cpu - least[None].cpu)
        judge.add(case, ours, times, calls=[least[per]], unit="ms", sign=-1)


def halved_scan(judge: Judge, name: str) -> None:
    """A scan halved by means of 2 x 2 x 2 voxels, against fine rays through the whole one.

    Only a finer scan is a truth between voxels.
    """
    field, spacing = read_nrrd(judge.file(f"volumes/{name}.nhdr"))
    whole = np.ascontiguousarray(field[tuple(slice(0, n // 2 * 2) for n in field.shape)])
    z, y, x = (n // 2 for n in whole.shape)
    means = whole.reshape(z, 2, y, 2, x, 2).mean((1, 3, 5))
    half = means.round().astype(whole.dtype)
    twice = (2 * spacing[0], 2 * spacing[1], 2 * spacing[2])
    path, points = judge.folder / f"half-{name}.nrrd", SCANS[name]
    write_nrrd(path, half, twice)
    for per, size, rays in ((3.0, 240, 2), (1.0, 200, 3), (0.5, 100, 6))[: 2 if judge.quick else 3]:
        view = view_of(half.shape, twice, per, size, 30, 20)
        true = fine(whole, spacing, view, size, rays, points, step=0.25)
        peers = peers_of(judge, half, twice, points, size)
        scores = {peer: db(draw(view)[0], true) for peer, draw in peers.items()}
        ours, call = drawn(judge, path, view, size, *white(points))
        case = f"{name} halved, {per:g} px a voxel: as the whole"
        judge.add(case, db(ours["A"], true), scores, calls=[call])


SCAN_PARTS = (partial(part, name=name) for name in SCANS for part in (scan_times, halved_scan))
PARTS = (spheres, walls, values, formulas, *SCAN_PARTS)


def box() -> Finding:
    """A box, whose opacity along a ray has a closed form."""
    field = np.zeros((40, 40, 40), np.uint8)
    field[8:32, 8:32, 8:32] = 100
    view = view_of(field.shape, EVEN, 1.0, 40, 0, 0, 1000)
    found = fine(field, EVEN, view, 40, 2, ((0, 0.0), (200, 0.1)), step=0.01)[20, 20]
    ramp = np.mean(-np.log(1 - 0.05 * (np.arange(1000) + 0.5) / 1000))  # between the last voxels
    exact = 1 - np.exp(23 * np.log(0.95) - 2 * ramp)
    text = f"box of 23 voxels and two ramps: alpha {found:.5f}, closed form {exact:.5f}"
    return Finding(text, bool(abs(found - exact) < 1e-3))


def check(judge: Judge) -> Iterator[Finding]:  # noqa: ARG001  as other groups' checks
    """Own rays against a closed form and with shorter steps; wall areas against rectangles."""
    yield box()
    view, cube = view_of((SIDE,) * 3, EVEN, 1.0, 48, 30, 20), np.zeros((SIDE,) * 3)
    for name, kind in FORMULAS.items():
        long, short = (
            fine(cube, EVEN, view, 48, 2, POINTS, kind=kind, step=step) for step in (0.125, 0.03)
        )
        score = db(long, short)
        yield Finding(f"{name}, steps of 1/8 and 1/32: {score:.1f} dB", score > 50)
    for tilt in (0, 4, 30):
        turn, area = np.radians(tilt), wall_area(tilt)
        rectangle = 20 * (np.cos(turn) + 20 * np.sin(turn))
        text = f"wall at {tilt} degrees: {area:.2f} voxels, rectangle {rectangle:.2f}"
        yield Finding(text, bool(abs(area / rectangle - 1) < 0.05))
