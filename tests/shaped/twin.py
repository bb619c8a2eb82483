"""Gaussians by brute force: every ray against every Gaussian, in float64."""

import numpy as np


def rotations(quaternion):
    """Matrices (N, 3, 3) of quaternions w, x, y, z of any length."""
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def rays_of(camera, size, fine=1):
    """Origins and directions (H fine, W fine, 3) in camera axes, of depth 1 per unit."""
    view = camera.view()
    y, x = (np.mgrid[: size[0] * fine, : size[1] * fine] + 0.5) / fine
    flat = np.stack(
        [(x - view.principal[0]) / view.focal[0], (y - view.principal[1]) / view.focal[1]]
    )
    one = np.ones_like(x)
    if view.perspective:
        return np.zeros((*x.shape, 3)), np.stack([*flat, one], axis=2)
    return np.stack([*flat, 0 * one], axis=2), np.stack([0 * one, 0 * one, one], axis=2)


def responses(gaussians, camera, size, fine=1):
    """Squared distances and depths (N, H, W) where rays are nearest to the centers."""
    position, scale, rotation = (np.asarray(array, float) for array in gaussians[:3])
    view = camera.view()
    center = position @ view.rotation.T + view.translation
    axes = view.rotation @ rotations(rotation)
    origin, direction = rays_of(camera, size, fine)
    squares, depths = [], []
    for n in range(len(center)):
        to_unit = axes[n].T / scale[n][:, None]
        o, d = (origin - center[n]) @ to_unit.T, direction @ to_unit.T
        t = -(o * d).sum(axis=2) / (d * d).sum(axis=2)
        squares.append((np.square(o + t[..., None] * d)).sum(axis=2))
        depths.append(t)
    return np.array(squares), np.array(depths), center


def painted(gaussians, camera, size, order="depth", near=0.0, fine=1):
    """RGBA (H, W, 4), premultiplied: opacities o exp(-i² / 2), front to back in an order."""
    square, depth, center = responses(gaussians, camera, size, fine)
    opacity, color = (np.asarray(array, float) for array in gaussians[3:5])
    alpha = np.minimum(opacity[:, None, None] * np.exp(-0.5 * square), 0.99)
    alpha[(alpha < 1 / 255) | (depth <= near)] = 0.0
    if order == "rays":
        turn = np.argsort(depth, axis=0, kind="stable")
    else:
        key = center[:, 2] if order == "depth" else np.linalg.norm(center, axis=1)
        turn = np.broadcast_to(np.argsort(key)[:, None, None], alpha.shape)
    rgba, share = np.zeros((*alpha.shape[1:], 4)), np.ones(alpha.shape[1:])
    for layer in turn:
        here = np.take_along_axis(alpha, layer[None], 0)[0]
        rgba[..., :3] += (share * here)[..., None] * color[layer]
        rgba[..., 3] += share * here
        share *= 1 - here
    rows, columns = rgba.shape[0] // fine, rgba.shape[1] // fine
    return rgba.reshape(rows, fine, columns, fine, 4).mean(axis=(1, 3))


def as_trained(gaussians, camera, size, dilation=0.3):
    """What training sees (Kerbl et al. 2023): linear projection, wider by px², by depth."""
    position, scale, rotation, opacity, color = (np.asarray(a, float) for a in gaussians[:5])
    view = camera.view()
    center = position @ view.rotation.T + view.translation
    axes = view.rotation @ rotations(rotation) * scale[:, None, :]
    y, x = np.mgrid[: size[0], : size[1]] + 0.5
    rgba, share = np.zeros((*size, 4)), np.ones(size)
    limit = 0.65 * np.array([size[1] / view.focal[0], size[0] / view.focal[1]])
    for n in np.argsort(center[:, 2]):
        place = center[n]
        if place[2] <= view.near:
            continue
        slope = np.clip(place[:2] / place[2], -limit, limit)
        (fx, fy), z = view.focal, place[2]
        jacobian = np.array([[fx / z, 0, -fx * slope[0] / z], [0, fy / z, -fy * slope[1] / z]])
        spread = jacobian @ axes[n] @ axes[n].T @ jacobian.T + dilation * np.eye(2)
        dx = x - (fx * place[0] / z + view.principal[0])
        dy = y - (fy * place[1] / z + view.principal[1])
        form = np.linalg.inv(spread)
        square = form[0, 0] * dx * dx + 2 * form[0, 1] * dx * dy + form[1, 1] * dy * dy
        alpha = np.minimum(opacity[n] * np.exp(-0.5 * square), 0.99)
        alpha[alpha < 1 / 255] = 0
        rgba[..., :3] += (share * alpha)[..., None] * color[n]
        rgba[..., 3] += share * alpha
        share *= 1 - alpha
    return rgba


def psnr(one, two):
    """Peak signal-to-noise ratio, dB, of values up to 1."""
    return -10 * np.log10(max(np.mean(np.square(np.asarray(one, float) - two)), 1e-20))
