"""Point clouds of known surfaces, drawn by `resample-points render`, against the surfaces.

Surfaces: a ball on a checkered floor (closed form) and the bunny (own rasterizer of its triangles)
with colors by formula, sampled at random as scanners do, and a street by a scanner of 64 rings.
Truth: means of light over pixels. Peers: squares of 1 to 13 px with a depth buffer, as most viewers
draw points, and VTK's points and spheres where it is installed; the best counts, as if the user
had found it.
"""

from collections.abc import Iterator
from itertools import chain, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh

from benchmarks.scores.cloud_truth import (
    BALL,
    CARS,
    FLOOR,
    FOCAL,
    GROUND,
    RADIUS,
    SIZE,
    SKY,
    WALLS,
    ball_and_floor,
    depths,
    painted,
    rays_of,
    read_triangles,
    sampled_mesh,
    sampled_scene,
    street,
    truth,
)
from benchmarks.scores.judging import AbsentError, Booleans, Call, Finding, Floats, Judge, db
from benchmarks.scores.pictures import View, look_at, read_png, write_camera

POINTS = 120_000
SQUARES = (1, 2, 3, 5, 9, 13)  # px
DISTANCES = {"near": 6.0, "mid": 1.5, "far": 0.3}  # px between points
STRAYS = 0.01  # share of the points
COLORS = np.array(  # of a street's things
    [[0, 0, 0], [0.42, 0.42, 0.42], [0.78, 0.24, 0.2], [0.66, 0.6, 0.48], [0.24, 0.6, 0.28]]
)


class Surface(NamedTuple):
    """A surface and its samples."""

    name: str
    points: Floats
    floor: Booleans | None  # which points are the floor's
    spacing: float
    mesh: Floats | None  # triangles; None for the ball and its floor
    cell: float  # of the checkerboard
    at: Floats  # what the camera looks at
    ahead: Floats
    up: tuple[float, float, float]


def write_cloud(path: Path, points: Floats, levels: Floats) -> None:
    """Write a binary PLY with colors of 8 bits."""
    table = np.zeros(len(points), [("p", "<f4", 3), ("c", "u1", 3)])
    table["p"], table["c"] = points, np.rint(255 * levels)
    names = ("float x", "float y", "float z", "uchar red", "uchar green", "uchar blue")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property {name}\n" for name in names) + "end_header\n"
    path.write_bytes(head.encode() + table.tobytes())


def squares(points: Floats, levels: Floats, view: View) -> Iterator[tuple[str, Floats, Floats]]:
    """Names, levels and coverage of pictures by squares with a depth buffer."""
    camera = (points - view.eye) @ view.turn.T
    camera, levels = camera[camera[:, 2] > 0.01], levels[camera[:, 2] > 0.01]
    order = np.argsort(-camera[:, 2])
    x, y, z = camera[order].T
    left = np.floor(view.focal * x / z + view.center[0]).astype(int)
    top = np.floor(view.focal * y / z + view.center[1]).astype(int)
    for side in SQUARES:
        nearest = np.full((SIZE[1], SIZE[0]), -1)
        reach = range(-(side // 2), side - side // 2)
        for row, column in ((top + dy, left + dx) for dy in reach for dx in reach):
            inside = (column >= 0) & (column < SIZE[0]) & (row >= 0) & (row < SIZE[1])
            np.maximum.at(nearest, (row[inside], column[inside]), np.flatnonzero(inside))
        picture = np.zeros((SIZE[1], SIZE[0], 3))
        picture[nearest >= 0] = levels[order][nearest[nearest >= 0]]
        yield f"squares of {side} px", picture, (nearest >= 0).astype(float)


def vtk_points(points: Floats, levels: Floats, view: View) -> Iterator[tuple[str, Floats, Floats]]:
    """As `squares`, of VTK's points and spheres with eight samples per pixel; none without VTK."""
    try:
        import vtkmodules.all as vtk
        from vtkmodules.util import numpy_support as arrays
    except ImportError:
        return
    data, places, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    places.SetData(arrays.numpy_to_vtk(points.astype(np.float32), deep=True))
    each = np.column_stack([np.ones(len(points), np.int64), np.arange(len(points))])
    cells.SetCells(len(points), arrays.numpy_to_vtkIdTypeArray(each.ravel(), deep=True))
    data.SetPoints(places)
    data.SetVerts(cells)
    colors = np.rint(255 * levels).astype(np.uint8)
    data.GetPointData().SetScalars(arrays.numpy_to_vtk(colors, deep=True))
    mapper, actor, scene = vtk.vtkPolyDataMapper(), vtk.vtkActor(), vtk.vtkRenderer()
    mapper.SetInputData(data)
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.LightingOff()
    scene.AddActor(actor)
    camera = scene.GetActiveCamera()
    camera.SetPosition(*view.eye)
    camera.SetFocalPoint(*(view.eye + view.turn[2]))
    camera.SetViewUp(*(-view.turn[1]))
    camera.SetViewAngle(2 * np.degrees(np.arctan(SIZE[1] / 2 / view.focal)))
    scene.ResetCameraClippingRange()
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.SetAlphaBitPlanes(1)
    window.SetSize(*SIZE)
    window.AddRenderer(scene)
    for name, side in product(("points", "spheres"), SQUARES):
        look.SetRenderPointsAsSpheres(name == "spheres")
        look.SetPointSize(side)
        yield f"VTK's {name} of {side} px", *_taken(window)
    window.Finalize()


def _taken(window: Any) -> tuple[Floats, Floats]:
    """Levels, and coverage, of what a window of VTK's shows."""
    import vtkmodules.all as vtk
    from vtkmodules.util.numpy_support import vtk_to_numpy

    window.Render()
    taken = vtk.vtkWindowToImageFilter()
    taken.SetInput(window)
    taken.SetInputBufferTypeToRGBA()
    taken.ReadFrontBufferOff()
    taken.Update()
    values = vtk_to_numpy(taken.GetOutput().GetPointData().GetScalars())
    rgba = values.reshape(SIZE[1], SIZE[0], 4)[::-1] / 255
    return rgba[..., :3], rgba[..., 3]


def drawn(judge: Judge, view: View, size: tuple[int, int]) -> tuple[Floats, Floats, Call]:
    """Levels and coverage by the command."""
    write_camera(judge.folder / "camera.json", view, size)
    view_words = ("--camera", "camera.json", "--size", f"{size[0]}x{size[1]}")
    call = judge.call("points", "render", "cloud.ply", *view_words, "-o", "out.png")
    if np.isnan(call.cpu):
        empty = np.full((size[1], size[0]), np.nan)
        return empty[..., None].repeat(3, 2), empty, call
    return *read_png(judge.folder / "out.png"), call


def surfaces(judge: Judge) -> None:
    """Sampled surfaces at three distances, and with stray points."""
    rng = np.random.default_rng(11)
    points, floor, spacing = sampled_scene(POINTS, rng)
    target, ahead = np.array([0, 0, 0.9]), np.array([-0.62, 0.74, -0.35])
    ball = Surface(
        *("ball and floor", points, floor, spacing, None, 0.45, target, ahead), up=(0, 0, 1)
    )
    found = [ball]
    if not judge.quick:
        try:
            mesh = read_triangles(judge.file("meshes/bunny/bunny.ply"))
            points, spacing = sampled_mesh(mesh, POINTS, rng)
            ahead = np.array([0.3, -0.35, -0.9])
            rest = ("bunny", points, None, spacing, mesh, 0.25, np.zeros(3), ahead)
            found.append(Surface(*rest, up=(0, 1, 0)))
        except AbsentError as error:
            judge.skip(str(error))
    for surface in found:
        levels = np.rint(255 * painted(surface.points, surface.cell, surface.floor)) / 255
        for distance in DISTANCES:
            _score_distance(judge, surface, levels, distance, rng)


def _score_distance(
    judge: Judge, surface: Surface, levels: Floats, distance: str, rng: np.random.Generator
) -> None:
    points, px = surface.points, DISTANCES[distance]
    ahead = surface.ahead / np.linalg.norm(surface.ahead)
    target = surface.at
    if distance == "near":
        aside = np.linalg.norm(points - surface.at, axis=1)
        target = points[np.argmin(points @ ahead + 0.3 * aside)]
    eye = target - ahead * FOCAL * surface.spacing / px
    view = View(look_at(eye, target, surface.up), eye, FOCAL, (SIZE[0] / 2, SIZE[1] / 2))
    rays = 12 if distance == "far" else 6
    true, share = truth(view, surface.cell, rays, surface.mesh)
    inside, outside = share > 0.999, share < 0.001
    for strays in (0, STRAYS) if distance == "mid" else (0,):
        extra = (round(strays * len(points)), 3)
        added = rng.uniform(points.min(0) - 0.5, points.max(0) + 0.5, extra)
        every = np.r_[points, added]
        colors = np.r_[levels, np.tile([0.9, 0.1, 0.1], (len(added), 1))]
        write_cloud(judge.folder / "cloud.ply", every, colors)
        rgb, alpha, call = drawn(judge, view, SIZE)
        peers, covered = dict[str, float](), dict[str, Floats]()
        theirs = chain(squares(every, colors, view), vtk_points(every, colors, view))
        for name, picture, coverage in theirs:
            peers[name] = db(picture * coverage[..., None], true, inside)
            covered[name] = coverage
        case = f"{surface.name}, {distance} ({px:g} px apart)"
        case_of = case + (", 1 % strays" if strays else "")
        score = db(rgb * alpha[..., None], true, inside)
        judge.add(case_of, score, peers, calls=[call], cpu=call.cpu)
        if strays:
            continue
        best = covered[max(peers, key=peers.__getitem__)]
        holes, missed = (100 * (1 - each[inside].mean()) for each in (alpha, best))
        same = "the same rival"
        judge.add(f"{case}: holes", holes, {same: missed}, calls=[call], unit="%", sign=-1)
        if outside.sum() > 500:
            rim, beside = (100 * each[outside].mean() for each in (alpha, best))
            case = f"{case}: beyond the rim"
            judge.add(case, rim, {same: beside}, calls=[call], unit="%", sign=-1)


def lidar(judge: Judge) -> None:
    """A scan by 64 rings, seen from the scanner.

    All that a ring could reach is known to be surface.
    """
    angles = np.radians(np.linspace(-24.5, 2.5, 64)), np.radians(np.arange(0, 360, 0.2))
    rise, turn = np.meshgrid(*angles, indexing="ij")
    flat = np.cos(rise)
    ways = np.stack([flat * np.cos(turn), flat * np.sin(turn), np.sin(rise)], -1).reshape(-1, 3)
    distance, kind = street(ways, np.random.default_rng(21))
    hit = kind != SKY
    measured = distance[hit] + np.random.default_rng(5).normal(0, 0.015, hit.sum())
    write_cloud(judge.folder / "cloud.ply", ways[hit] * measured[:, None], COLORS[kind[hit]])

    size, focal = (800, 400), 500.0
    axes = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0.0]])
    view = View(axes, np.zeros(3), focal, (size[0] / 2, size[1] / 2))
    rgb, alpha, call = drawn(judge, view, size)
    row, column = np.mgrid[: size[1], : size[0]] + 0.5
    right, below = (column - view.center[0]) / focal, (row - view.center[1]) / focal
    seen = np.stack([np.ones_like(right), -right, -below], -1).reshape(-1, 3)
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    far, what = street(seen, np.random.default_rng(21))
    shape = (size[1], size[0])
    far, what = far.reshape(shape), what.reshape(shape)
    degrees = np.degrees(np.arcsin(seen[:, 2])).reshape(shape)
    scanned = (degrees > -24) & (degrees < 2.2) & (far < 60)
    correct = (np.abs(rgb - COLORS[what]).max(-1) < 0.1) & (alpha > 0.9)
    parts = {
        "ground": what == GROUND,
        "ground within 15 m": (what == GROUND) & (far < 15),
        "walls": what == WALLS,
        "cars": what == CARS,
    }
    for name, where in parts.items():
        share = 100 * correct[scanned & where].mean()
        case = f"64 rings, {name}: covered in the right color"
        judge.add(case, share, {"asked": 100.0}, calls=[call], unit="%", cpu=call.cpu)
    share = 100 * alpha[what == SKY].mean()
    judge.add("64 rings, sky: covered", share, {"asked": 0.0}, calls=[call], unit="%", sign=-1)


PARTS = (surfaces, lidar)


def closed_forms() -> Iterator[Finding]:
    """Radii of samples, and distances in the street."""
    points, floor, _ = sampled_scene(20_000, np.random.default_rng(1))
    off = float(np.abs(np.linalg.norm(points[~floor] - BALL, axis=1) - RADIUS).max())
    yield Finding(f"sampled ball: radii within {off:.1e}", off < 1e-9)
    ways = np.array([[0, 0, -1.0], [0, 1.0, 0], [0, 0, 1.0]])
    found = street(ways, np.random.default_rng(21))[0].tolist()
    yield Finding(f"street below, aside and above: {found} m", found == [1.7, 10.0, 70.0])


def check(judge: Judge) -> Iterator[Finding]:  # noqa: ARG001  as other groups' checks
    """The rasterizer of triangles against the closed form of a ball, and rays doubled."""
    yield from closed_forms()
    ball = np.asarray(trimesh.creation.icosphere(6, radius=RADIUS).triangles) + BALL
    corners = [[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]]
    eye = np.array([2.2, -2.6, 2.2])
    view = View(look_at(eye, (0, 0, 0.9), (0, 0, 1)), eye, 300.0, (SIZE[0] / 2, SIZE[1] / 2))
    depth = depths(np.r_[ball, np.array(corners) * FLOOR], view, 1)
    ways = rays_of(view, 1).reshape(-1, 3)
    exact = ball_and_floor(eye, ways)[0].reshape(depth.shape)
    both = np.isfinite(exact) & np.isfinite(depth)
    others = int((np.isfinite(exact) != np.isfinite(depth)).sum())
    off = float(np.quantile(np.abs(exact[both] - depth[both]), 0.999))
    text = f"rasterizer and closed form: {others} px of another kind, 99.9 % within {off:.1e}"
    yield Finding(text, others < 20 and off < 1e-2)
    score = db(truth(view, 0.45, 6)[0], truth(view, 0.45, 12)[0])
    yield Finding(f"6 rays to 12: {score:.1f} dB", score > 35)
