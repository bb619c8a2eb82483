"""3D Gaussians, drawn by `resample-points render`, against renderers written from the equations.

Near: the usual rasterizer. From afar: its native picture, averaged over blocks of display values,
in which Gaussians are trained; that is what the eye sees of a scene farther away. Rays: every
Gaussian's greatest response on each ray, all sorted along the ray. Pictures are over black.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.scores.gaussian_truth import (
    WIDENING,
    Gaussians,
    along_rays,
    rasterized,
    read_compressed,
    write_plain,
)
from benchmarks.scores.judging import Call, Finding, Floats, Judge, db
from benchmarks.scores.pictures import View, look_at, shown, write_camera

SIZE = (800, 600)
SCENES = ("guitar", "biker")
RADII = (0.02, 1e-3, 1e3)  # of a scaled scene
ASKED = {"asked": 60.0}


def view_of(gaussians: Gaussians, size: tuple[int, int]) -> View:
    """A camera that sees the middle nine tenths of the Gaussians."""
    low, high = np.quantile(gaussians.position, [0.05, 0.95], axis=0)
    middle, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    ahead = np.array([0.6, -0.3, 0.75])
    eye = middle - ahead / np.linalg.norm(ahead) * radius * 2.6
    center = (size[0] / 2, size[1] / 2)
    return View(look_at(eye, middle, (0, -1, 0)), eye, 1.1 * size[1], center)


def drawn(
    judge: Judge, path: object, view: View, size: tuple[int, int], *words: object
) -> tuple[Floats, Call]:
    """The command's picture."""
    write_camera(judge.folder / "camera.json", view, size)
    shape = f"{size[0]}x{size[1]}"
    view_words = ("--camera", "camera.json", "--size", shape)
    call = judge.call("points", "render", path, *view_words, *words, "-o", "out.png")
    if np.isnan(call.cpu):
        return np.full((size[1], size[0], 3), np.nan), call
    return shown(judge.folder / "out.png"), call


def averaged(image: Floats, factor: int) -> Floats:
    """Means of blocks of factor x factor px."""
    height, width = image.shape[0] // factor, image.shape[1] // factor
    return np.asarray(image.reshape(height, factor, width, factor, -1).mean((1, 3)))


def scene(judge: Judge, name: str) -> None:
    """A trained scene near, from afar and with its order by rays."""
    if judge.quick and name != SCENES[0]:
        return
    path = judge.file(f"splats/{name}.compressed.ply")
    gaussians = read_compressed(path)
    view = view_of(gaussians, SIZE)
    native = rasterized(gaussians, view, SIZE)
    ours, call = drawn(judge, path, view, SIZE)
    case = f"{name}, near: as the usual rasterizer"
    judge.add(case, db(ours, native), ASKED, calls=[call], cpu=call.cpu)
    for factor in (4, 8):
        small, far = (SIZE[0] // factor, SIZE[1] // factor), view.smaller(factor)
        true = averaged(native, factor)
        ours, call = drawn(judge, path, far, small)
        peers = {
            "usual rasterizer": db(rasterized(gaussians, far, small), true),
            "usual, compensated": db(rasterized(gaussians, far, small, True), true),
        }
        case = f"{name}, {factor} x out: as the native picture averaged"
        judge.add(case, db(ours, true), peers, calls=[call], cpu=call.cpu)
    half, low = (SIZE[0] // 2, SIZE[1] // 2), view.smaller(2)
    busy = np.argwhere(averaged(native, 2).mean(-1) > 0.02)
    chosen = np.random.default_rng(1).permutation(len(busy))[: 500 if judge.quick else 1500]
    pixels = busy[chosen, ::-1].copy()
    ours, call = drawn(judge, path, low, half, "--order", "rays", "--subpixels", 1)
    columns, rows = pixels.T
    true, usual = along_rays(gaussians, low, pixels), rasterized(gaussians, low, half)
    peers = {"usual rasterizer": db(usual[rows, columns], true)}
    case = f"{name}, --order rays: as a full sort of the same rays"
    judge.add(case, db(ours[rows, columns], true), peers, calls=[call], cpu=call.cpu)


def scaled_scenes(judge: Judge) -> None:
    """The same scene in other units: the picture must not change."""
    base, size = read_compressed(judge.file("splats/guitar.compressed.ply")), (400, 300)
    middle = np.median(base.position, 0)
    old = np.linalg.norm(np.subtract(*np.quantile(base.position, [0.95, 0.05], axis=0))) / 2
    pictures = {}
    for radius in (1.0, *RADII):
        position = (base.position - middle) * radius / old
        scaled = base._replace(position=position, scale=base.scale * radius / old)
        write_plain(judge.folder / "scaled.ply", scaled)
        pictures[radius], call = drawn(judge, "scaled.ply", view_of(scaled, size), size)
        if radius != 1:
            score = db(pictures[radius], pictures[1.0])
            case = f"scene of radius {radius:g}: the picture of radius 1"
            judge.add(case, score, ASKED, calls=[call])


PARTS = (*(partial(scene, name=name) for name in SCENES), scaled_scenes)


def single() -> Iterator[Finding]:
    """One Gaussian, and two, whose pictures have closed forms."""
    color = np.array([[1.0, 0.5, 0.25]])
    upright = np.array([[1.0, 0, 0, 0]])
    one = Gaussians(np.array([[0, 0, 10.0]]), np.full((1, 3), 0.2), upright, np.array([0.8]), color)
    view, size = View(np.eye(3), np.zeros(3), 300.0, (32.0, 32.0)), (64, 64)
    y, x = np.mgrid[:64, :64] + 0.5 - 32
    alpha = 0.8 * np.exp(-0.5 * (x * x + y * y) / (36 + WIDENING))
    alpha[alpha < 1 / 255] = 0
    score = db(rasterized(one, view, size), alpha[..., None] * color)
    yield Finding(f"one Gaussian: rasterizer {score:.1f} dB to the closed form", score > 100)
    pixels = np.argwhere(np.ones(size, bool))[:, ::-1].copy()
    rays = along_rays(one, view, pixels).reshape(64, 64, 3)
    width, square = 0.04 + WIDENING * (10 / 300) ** 2, (x * x + y * y) / 300**2
    exact = 0.8 * np.exp(-0.5 * 100 * square / (1 + square) / width)  # by the distance to the ray
    exact[exact < 1 / 255] = 0
    score = db(rays, exact[..., None] * color)
    yield Finding(f"one Gaussian: rays {score:.1f} dB to the closed form", score > 100)
    near = Gaussians(
        *(np.array([[0, 0, 5.0]]), np.full((1, 3), 0.1), upright, np.array([0.5])),
        np.array([[0, 0, 1.0]]),
    )
    two = Gaussians(*(np.concatenate(pair) for pair in zip(one, near, strict=True)))
    middle = rasterized(two, view._replace(center=(32.5, 32.5)), size)[32, 32]
    holds = bool(np.allclose(middle, [0.4, 0.2, 0.6]))
    yield Finding(f"two, the nearer one last: {middle} in the middle, 0.4 0.2 0.6 expected", holds)


def check(judge: Judge) -> Iterator[Finding]:
    """Closed forms, and quaternions of length 1."""
    yield from single()
    found = read_compressed(judge.file("splats/guitar.compressed.ply"))
    off = float(np.abs(np.linalg.norm(found.quaternion, axis=1) - 1).max())
    text = f"guitar: {len(found.position)} Gaussians, quaternions of length 1 within {off:.1e}"
    yield Finding(text, off < 1e-6)
