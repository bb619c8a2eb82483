"""Omnidirectional stereo pairs against rays from each column's own eye."""

import numpy as np

from resample.measuring.quality import psnr
from resample_warp3d.views.panoramas import SEAMLESS, panorama
from resample_warp3d.views.together import render_together
from resample_warp3d.wide import StereoPanorama
from tests.warp3d.test_panoramas import EYE, THINGS, traced

OFFSET, ROWS = 0.06, 96
MERGING = np.radians([60, 75])  # latitudes between which the eyes join


def rays_of_eyes(right, samples):
    """Eyes and rays of a stereo panorama, (ROWS, 2 ROWS, 3), as Peleg, Ben-Ezra and Pritch 2001."""
    for v in (np.arange(samples) + 0.5) / samples:
        for u in (np.arange(samples) + 0.5) / samples:
            y, x = np.mgrid[:ROWS, : 2 * ROWS]
            east = (x + u) * np.pi / ROWS - np.pi
            north = np.pi / 2 - (y + v) * np.pi / ROWS
            ray = [np.cos(north) * np.sin(east), -np.sin(north), np.cos(north) * np.cos(east)]
            share = np.clip((abs(north) - MERGING[0]) / np.ptp(MERGING), 0, 1)
            out = right * np.cos(share * np.pi / 2)
            eye = [out * np.cos(east), np.zeros_like(east), -out * np.sin(east)]
            yield EYE + np.stack(eye, -1), np.stack(ray, -1)


def traced_pair(right):
    """Color and length of the true panorama of an eye."""
    total = 0.0
    for eyes, rays in rays_of_eyes(right, 2):
        rows = [
            [
                thing.hit(e, r[None])[0]
                for e, r in zip(eyes.reshape(-1, 3), rays.reshape(-1, 3), strict=True)
            ]
            for thing in THINGS
        ]
        distance = np.array(rows).reshape(len(THINGS), ROWS, 2 * ROWS)
        length, first = distance.min(axis=0), distance.argmin(axis=0)
        point = eyes + length[..., None] * rays
        shown = np.array([thing.color(point) for thing in THINGS])
        total = total + np.take_along_axis(shown, first[None, ..., None], 0)[0]
    return total / 4, length


def main():
    pose = np.eye(4)
    pose[:3, 3] = -EYE
    sources = panorama(*traced(), pose, noise=0.0, refine="none")
    for right in (-OFFSET, OFFSET):
        made = render_together(
            sources, StereoPanorama(pose, right), (ROWS, 2 * ROWS), joining=SEAMLESS
        ).warped
        truth, length = traced_pair(right)
        mask = made.coverage > 0.97
        print(
            right,
            mask.mean(),
            psnr(made.image, truth.astype(np.float32), mask=mask),
            (np.abs(np.log(made.depth / length))[mask] < 0.02).mean(),
        )
        plain = traced()[0].reshape(ROWS, 2, 2 * ROWS, 2, 3).mean(axis=(1, 3))
        print("unmoved", psnr(plain, truth.astype(np.float32), mask=mask))
        err = np.abs(made.image - truth).max(-1)
        print(err.mean(axis=1).round(3)[::6])


if __name__ == "__main__":
    main()
