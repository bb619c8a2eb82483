"""
3D Gaussians, near and far
==========================

A trained scene is a set of Gaussians with an opacity and a color each. Seen from farther away than
in training, usual renderers widen each by a part of a pixel and sample once per pixel, and the
picture aliases. Here it is the mean of the near one: left ours, right the usual way, both four
times as far away and enlarged four times.

The same from the command line, with a scene of yours:

.. code-block:: console

    $ resample-points render scene.ply --trained-focal cameras.json -o scene.png
"""

import numpy as np

from resample_points import (
    Camera,
    Gaussians,
    GaussianStyle,
    gaussian_camera,
    render_gaussians,
)

# Flat Gaussians on a ring, in stripes: what training would leave of it.
rng = np.random.default_rng(3)
turn, round_ = rng.uniform(0, 2 * np.pi, (2, 40_000))
away = 2.2 + np.cos(round_)
place = np.stack([away * np.cos(turn), away * np.sin(turn), np.sin(round_)], axis=1)
normal = np.stack([np.cos(round_) * np.cos(turn), np.cos(round_) * np.sin(turn), np.sin(round_)], 1)
half = normal + np.array([0.0, 0.0, 1.0])  # halfway to z: quaternions turn by twice that
half /= np.linalg.norm(half, axis=1, keepdims=True) + 1e-9
rotation = np.stack([half[:, 2], -half[:, 1], half[:, 0], 0 * turn], axis=1)
stripes = np.where(np.sin(24 * turn + 9 * round_) > 0, 1.0, 0.0)[:, None]
color = stripes * [0.85, 0.2, 0.1] + (1 - stripes) * [0.95, 0.9, 0.7]
scene = Gaussians(
    place.astype(np.float32),
    np.tile(np.float32([0.03, 0.03, 0.003]), (len(place), 1)),
    rotation.astype(np.float32),
    np.full(len(place), 0.9, np.float32),
    ((color - 0.5) / 0.28209479).astype(np.float32),
)

size = (480, 360)
near = gaussian_camera(scene, size=size, azimuth=30, elevation=35, up="z")
render_gaussians(scene, near, size=size, background=(1, 1, 1)).save("near.png")

# %%
# Four times as far away: the focal length of the near picture says how wide training saw Gaussians.
far = Camera(np.diag([0.25, 0.25, 1.0]) @ near.matrix, near.world_to_camera)
ours, usual = (
    render_gaussians(scene, far, size=(120, 90), background=(1, 1, 1), style=style)
    for style in (GaussianStyle(trained_focal=near.fx), GaussianStyle("affine", subpixels=1))
)
beside = np.concatenate([ours.rgba, usual.rgba], axis=1).repeat(4, axis=0).repeat(4, axis=1)
ours._replace(rgba=beside).save("far.png")
