"""
3D Gaussians: near, far, and all around
=======================================

A trained scene is a set of Gaussians with an opacity and a color each. Usual renderers project each
linearly, widen it by a part of a pixel and sample once per pixel, in the order of depth. Seen from
farther away than in training, such a picture aliases; in panoramas, which they paint as six faces
of a cube, faces do not meet. Here Gaussians are as wide as in training, so
that a far picture is close to the mean of the near one: left ours, right the usual way, both four times as far away and enlarged four times.

The same from the command line, with a scene of yours:

.. code-block:: console

    $ resample-points render scene.ply -o scene.png
    $ resample-points render scene.ply --panorama equirectangular --size 960x480 -o around.png
    $ resample-points animate scene.ply --frames 48 -o turn.webp
"""

import os
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from resample import look_at
from resample.cameras.pixels import Equirectangular
from resample_points import (
    Camera,
    Gaussians,
    GaussianStyle,
    read_gaussians,
    render_gaussians,
)


def ring():
    """Flat Gaussians on a ring, in stripes: what training would leave of it."""
    rng = np.random.default_rng(3)
    turn, round_ = rng.uniform(0, 2 * np.pi, (2, 40_000))
    away = 2.2 + np.cos(round_)
    place = np.stack([away * np.cos(turn), np.sin(round_), away * np.sin(turn)], axis=1)
    across = np.cos(round_)
    normal = np.stack([across * np.cos(turn), np.sin(round_), across * np.sin(turn)], axis=1)
    half = normal + np.array([0.0, 0.0, 1.0])  # halfway to z: quaternions turn by twice that
    half /= np.linalg.norm(half, axis=1, keepdims=True) + 1e-9
    rotation = np.stack([half[:, 2], -half[:, 1], half[:, 0], 0 * turn], axis=1)
    stripes = np.where(np.sin(24 * turn + 9 * round_) > 0, 1.0, 0.0)[:, None]
    color = stripes * [0.85, 0.2, 0.1] + (1 - stripes) * [0.95, 0.9, 0.7]
    return Gaussians(
        place.astype(np.float32),
        np.tile(np.float32([0.03, 0.03, 0.003]), (len(place), 1)),
        rotation.astype(np.float32),
        np.full(len(place), 0.9, np.float32),
        ((color - 0.5) / 0.28209479).astype(np.float32),
    )


# A trained scene, where the data of the tests are; else the ring. y points down.
trained = Path(os.environ.get("RESAMPLE_TEST_DATA", "")) / "splats" / "playbot" / "0_0"
scene, eye, target, inside = ring(), (3.5, -5.0, -6.0), (0, 0, 0), (0.2, -0.6, -0.3)
if trained.exists():
    scene, eye, target = read_gaussians(trained), (1.1, -0.75, -1.8), (0, -0.45, 0)
    inside = (0.35, -0.35, -0.35)

black, size = (0, 0, 0), (480, 360)
near = Camera.from_fov(40, 360, 480, look_at(eye, target, up=(0, -1, 0)))
render_gaussians(scene, near, size=size, background=black).save("near.png")

# %%
# Four times as far away. The smallest Gaussians tell how wide training saw them.
far = Camera(np.diag([0.25, 0.25, 1.0]) @ near.matrix, near.world_to_camera)
plain = GaussianStyle("affine", subpixels=1)
ours, usual = (
    render_gaussians(scene, far, size=(120, 90), background=black, style=style)
    for style in (None, plain)
)
beside = np.concatenate([ours.rgba, usual.rgba], axis=1).repeat(4, axis=0).repeat(4, axis=1)
ours._replace(rgba=beside).save("far-ours-and-the-usual-way.png")

# %%
# All around, from within the scene: one exact picture, then six faces of a cube painted the usual
# way. Where faces meet, edges are bent, and what is in front of what changes.
pose, height = look_at(inside, target, up=(0, -1, 0)), 360
around = render_gaussians(
    scene, Equirectangular().moved(pose), size=(2 * height, height), background=black
)
around.save("panorama.png")


def six_faces():
    """A panorama (H, 2 H, 4) made of six pictures of 90 degrees."""
    lat = (np.arange(height)[:, None] + 0.5) / height * np.pi - np.pi / 2
    lon = (np.arange(2 * height) + 0.5) / height * np.pi - np.pi
    parts = (np.cos(lat) * np.sin(lon), np.sin(lat) + 0 * lon, np.cos(lat) * np.cos(lon))
    ray, side = np.stack(parts, axis=2), height // 2
    whole = np.zeros((height, 2 * height, 4), np.float32)
    for z in np.concatenate([np.eye(3), -np.eye(3)]):
        turn = np.eye(4)
        turn[:3, :3] = look_at((0, 0, 0), z, up=(0, -1, 0) if not z[1] else (0, 0, z[1]))[:3, :3]
        camera = Camera.from_fov(90, side, side, turn @ pose)
        face = render_gaussians(
            scene, camera, size=(side, side), background=black, style=plain
        ).rgba
        x, y, away = np.moveaxis(ray @ turn[:3, :3].T, 2, 0)
        here = (away > 0) & (np.maximum(abs(x), abs(y)) <= away)
        ahead = np.where(here, away, 1)
        at = [np.float32(side / 2 * (part / ahead + 1) - 0.5) for part in (x, y)]
        flat = cv2.remap(face, *at, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
        whole[here] = flat[here]
    return whole


around._replace(rgba=six_faces()).save("panorama-the-usual-way.png")

# %%
# A film goes around, as ``resample-points animate`` does.
turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
frames = []
for angle in turn:
    x, y, z = np.subtract(eye, target)
    out = (x * np.cos(angle) - z * np.sin(angle), y, x * np.sin(angle) + z * np.cos(angle))
    moved = look_at(np.add(out, target), target, up=(0, -1, 0))
    camera = Camera.from_fov(40, 180, 240, moved)
    shown = render_gaussians(scene, camera, size=(240, 180), background=black)
    frames.append(Image.fromarray(np.asarray(shown)[..., :3]))
frames[0].save(
    "film.webp", save_all=True, append_images=frames[1:], duration=80, loop=0, quality=60
)
