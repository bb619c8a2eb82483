"""Small textured meshes, cameras on them, and the obvious slow way to see a square."""

import math

import numpy as np

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.cameras.viewpoints import Orbit
from resample.profiles.interpolation import InterpolatingCatmullRom
from resample_meshes.rendering import Mesh, MeshStyle, ball_around, render_mesh

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
FALLING = np.array([[0, 1, 2], [0, 2, 3]])  # the two ways to halve it
RISING = np.array([[0, 1, 3], [1, 2, 3]])
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)


def even(*color):
    return np.full((4, 4, 3), color, np.float32)


def noise(size, seed=3):
    rng = np.random.default_rng(seed)
    coarse = rng.random((size // 8, size // 8, 3))
    return np.kron(coarse, np.ones((8, 8, 1))).astype(np.float32)


def square(texture, corners=SQUARE, triangle=FALLING):
    return Mesh(corners, triangle, uv=SQUARE[:, :2], textures=(texture,))


def cube(texture):
    corner = FACES.ravel()
    triangle = (4 * np.arange(6)[:, None, None] + FALLING[None]).reshape(-1, 3)
    uv = np.tile(SQUARE[:, :2], (6, 1))
    return Mesh(CUBE[corner], triangle, uv=uv, textures=(texture,))


def finely_cut(texture, count):
    """The unit square in count × count squares."""
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(0, 1, count + 1)]))
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).reshape(-1, 1)
    corner = first + np.array([0, 1, count + 2, count + 1])
    position = np.stack([x, y, np.zeros_like(x)], axis=1)
    return Mesh(position, corner[:, FALLING].reshape(-1, 3), position[:, :2], (texture,))


def from_above(scale, size, turn=0.0):
    """Camera that looks along −z at the middle of the unit square, y upward in the picture."""
    up = (np.sin(turn), np.cos(turn), 0.0)
    pose = look_at((0.5, 0.5, 5.0), (0.5, 0.5, 0.0), up)
    return Orthographic(scale, scale, size / 2, size / 2, pose)


def oblique(distance, size):
    pose = look_at((0.5 + distance, 0.5 - distance, distance), (0.5, 0.5, 0.0))
    return Camera.from_fov(40, height=size, width=size, world_to_camera=pose)


def picture(mesh, camera, size, **style):
    return render_mesh(mesh, camera, size=(size, size), style=MeshStyle(**style))


def decibels(found, truth):
    return -10 * np.log10(np.mean((found - truth) ** 2))


def naive(texture, camera, size, rays=8, interpolation=None):
    """The unit square at z = 0, by rays through a grid in every pixel."""
    image = naive_rays(texture, camera, size, rays, interpolation or InterpolatingCatmullRom())
    return image.reshape(size, rays, size, rays, 4).mean(axis=(1, 3))


def naive_rays(texture, camera, size, rays, interpolation):
    view = camera.view()
    row, column = (np.mgrid[0 : size * rays, 0 : size * rays] + 0.5) / rays
    flat = np.stack([view.rotation[:, 0], view.rotation[:, 1], view.translation], axis=1)
    if not view.perspective:
        flat[2] = 0, 0, 1
    lens = np.array([[view.focal[0], 0, view.principal[0]], [0, view.focal[1], view.principal[1]]])
    lens = np.vstack([lens, [0, 0, 1]])
    place = np.linalg.inv(lens @ flat) @ np.stack([column.ravel(), row.ravel(), np.ones(row.size)])
    u, v = place[:2] / place[2]
    hit = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    image = np.zeros((row.size, 4))
    image[hit, :3] = interpolated(texture, u[hit], 1 - v[hit], interpolation)
    image[hit, 3] = 1
    return image.reshape(size * rays, size * rays, 4)


def at_texel(interpolation, step):
    """What a texel gets of the coefficient so many steps away: the value, or the mean over it."""
    if not getattr(interpolation, "is_mean", False):
        return weight(interpolation, np.array(step))
    return weight(interpolation, step + (np.arange(1000) + 0.5) / 1000 - 0.5).mean()


EDGES = {
    "wrap": lambda index, size: index % size,
    "clamp": lambda index, size: np.clip(index, 0, size - 1),
    "mirror": lambda index, size: np.minimum(index % (2 * size), 2 * size - 1 - index % (2 * size)),
}


def interpolated(texture, u, t, interpolation, along_u="wrap", along_t="wrap"):
    """Colors at places of a texture; one that does not repeat is its own coefficients."""
    height, width, channels = texture.shape
    coefficient = texture.astype(float)
    for axis, size in enumerate((height, width)):
        at_texels = np.zeros(size)
        reach = range(-math.ceil(interpolation.radius), math.ceil(interpolation.radius) + 1)
        for step in reach:
            at_texels[step % size] += at_texel(interpolation, float(step))
        response = np.fft.fft(at_texels / at_texels.sum())
        shape = [1, 1, 1]
        shape[axis] = size
        spectrum = np.fft.fft(coefficient, axis=axis) / response.reshape(shape)
        coefficient = np.fft.ifft(spectrum, axis=axis).real
    color, total = np.zeros((u.size, channels)), 0.0
    row_of, column_of = EDGES[along_t], EDGES[along_u]
    x, y = u * width - 0.5, t * height - 0.5
    for n in reach:
        for m in reach:
            line, place = np.floor(y).astype(int) + n, np.floor(x).astype(int) + m
            share = weight(interpolation, y - line) * weight(interpolation, x - place)
            color += share[:, None] * coefficient[row_of(line, height), column_of(place, width)]
            total = total + share[:, None]
    return color / total


def weight(interpolation, distance):
    distance = np.abs(distance)
    return np.where(distance <= interpolation.radius, interpolation(distance), 0.0)


def naive_mesh(mesh, camera, size, rays=8):
    """Any mesh with textures, by rays through a grid in every pixel that ask every triangle."""
    image = np.zeros(((size * rays) ** 2, 4))
    for hits in layers_of_rays(mesh, camera, size, rays):
        color = np.zeros_like(image)
        for n in range(len(mesh.textures)):
            hit = np.flatnonzero((hits[0] >= 0) & (mesh.texture[hits[0]] == n))
            color[hit] = covering(mesh.textures[n], mesh.covers[n], *hits[1][hit].T)
        image += (1 - image[:, 3:]) * color
    return image.reshape(size, rays, size, rays, 4).mean(axis=(1, 3))


def covering(texture, cover, u, v):
    """Premultiplied colors of a texture, and what is seen of it."""
    edges = cover.along_u, cover.along_v
    color = interpolated(texture[..., :3], u, 1 - v, InterpolatingCatmullRom(), *edges)
    alpha = np.ones((u.size, 1))
    if texture.shape[2] == 4 and cover.alpha == "mask":
        alpha = (
            interpolated(texture[..., 3:], u, 1 - v, InterpolatingCatmullRom(), *edges)
            >= cover.cutoff
        )
    elif texture.shape[2] == 4:
        alpha = np.clip(
            interpolated(texture[..., 3:], u, 1 - v, InterpolatingCatmullRom(), *edges), 0, 1
        )
        premultiplied = texture[..., :3] * texture[..., 3:]
        return np.hstack(
            [interpolated(premultiplied, u, 1 - v, InterpolatingCatmullRom(), *edges), alpha]
        )
    return np.hstack([color * alpha, alpha])


def layers_of_rays(mesh, camera, size, rays):
    """Which triangle each ray meets first, second and so on, and its texture coordinates there."""
    view, n = camera.view(), size * rays
    place = mesh.position @ view.rotation.T + view.translation
    w = place[:, 2] if view.perspective else np.ones(len(place))
    corner = np.stack(
        [place[:, k] * view.focal[k] + w * view.principal[k] for k in range(2)] + [w], axis=1
    )
    row, column = (np.mgrid[0:n, 0:n] + 0.5) / rays
    ray = np.stack([column.ravel(), row.ravel(), np.ones(n * n)])
    before = np.full(n * n, -np.inf)
    while np.isfinite(before).any() or (before < 0).all():
        nearest, shown, uv = np.full(n * n, np.inf), np.full(n * n, -1), np.zeros((n * n, 2))
        for k, triangle in enumerate(mesh.triangle):
            share = np.linalg.solve(corner[triangle].T, ray)
            depth = place[triangle, 2] @ share / share.sum(axis=0)
            hit = (share >= 0).all(axis=0) & (depth < nearest) & (depth > before + 1e-9)
            nearest[hit], shown[hit] = depth[hit], k
            uv[hit] = (share[:, hit] / share[:, hit].sum(axis=0)).T @ mesh.uv[triangle]
        yield shown, uv
        before = nearest


def areas(polygon, size):
    """Share of every pixel that a convex polygon (N, 2), px, covers; exact."""
    area = np.zeros((size, size))
    for row in range(size):
        for column in range(size):
            part = [tuple(corner) for corner in polygon]
            for axis, bound, sign in (
                (0, column, 1),
                (0, column + 1, -1),
                (1, row, 1),
                (1, row + 1, -1),
            ):
                part = list(halved(part, axis, bound, sign))
            x, y = np.array(part).T if part else np.zeros((2, 1))
            area[row, column] = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    return area


def halved(polygon, axis, bound, sign):
    """Corners of what of a convex polygon is beyond a bound, times the sign."""
    for here, there in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        at, to = sign * (here[axis] - bound), sign * (there[axis] - bound)
        if at >= 0:
            yield here
        if (at >= 0) != (to >= 0):
            yield tuple(np.add(here, at / (at - to) * np.subtract(there, here)))


def fitted_camera(mesh, azimuth=30.0, elevation=20.0, zoom=1.0, fov=30.0, up="y", size=(512, 512)):
    """A camera on a sphere around a mesh; `size`: width and height."""
    return Orbit(azimuth, elevation, zoom, fov, up).around(ball_around(mesh), *size[::-1])
