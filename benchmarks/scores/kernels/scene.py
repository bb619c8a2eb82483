"""Rays into a scene of spheres and rectangles with textures.

A ray is an origin and a way whose z in its camera is 1, so its length is a depth. Cameras look
along z, with x to the right and y down; pixel (0, 0) has its center at (0, 0).
"""

import math
from typing import TypeAlias

import numpy as np
from numba import prange
from numpy.typing import NDArray

from benchmarks.scores.kernels.compiling import kernel, parallel_kernel

Floats: TypeAlias = NDArray[np.float64]
Triple: TypeAlias = tuple[float, float, float]

# Columns of a shape's row; a rectangle is perpendicular to an axis.
SPHERE, RECTANGLE = 0.0, 1.0  # in column 0
X, Y, Z, RADIUS = 1, 2, 3, 4  # of a sphere
AXIS, PLACE, LOW_1, HIGH_1, LOW_2, HIGH_2 = 1, 2, 3, 4, 5, 6  # of a rectangle
TEXTURE, SCALE = 8, 9
PHOTO, CHECKER, NOISE, STRIPES = range(4)
FAR = 1e30


@kernel
def lattice(column: int, row: int, seed: int) -> float:
    """A number in 0..1 by chance."""
    mixed = (column * 374761393 + row * 668265263 + seed * 1442695041) & 0xFFFFFFFF
    mixed = ((mixed ^ (mixed >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((mixed ^ (mixed >> 16)) & 0xFFFF) / 65535.0


@kernel
def noise(x: float, y: float, seed: int) -> float:
    """Smooth noise in 0..1."""
    column, row = math.floor(x), math.floor(y)
    p, q = x - column, y - row
    p, q = p * p * (3 - 2 * p), q * q * (3 - 2 * q)
    above = lattice(column, row, seed) * (1 - p) + lattice(column + 1, row, seed) * p
    below = lattice(column, row + 1, seed) * (1 - p) + lattice(column + 1, row + 1, seed) * p
    return above * (1 - q) + below * q


@kernel
def photo(texture: Floats, u: float, v: float) -> Triple:
    """Bilinear color of a mirrored picture at texels u and v."""
    height, width, _ = texture.shape
    u, v = u % (2 * (width - 1)), v % (2 * (height - 1))
    u = 2 * (width - 1) - u if u > width - 1 else u
    v = 2 * (height - 1) - v if v > height - 1 else v
    column, row = min(int(u), width - 2), min(int(v), height - 2)
    p, q = u - column, v - row
    red = green = blue = 0.0
    for k in range(4):
        weight = (p if k % 2 else 1 - p) * (q if k // 2 else 1 - q)
        red += weight * texture[row + k // 2, column + k % 2, 0]
        green += weight * texture[row + k // 2, column + k % 2, 1]
        blue += weight * texture[row + k // 2, column + k % 2, 2]
    return red, green, blue


@kernel
def hit(shapes: Floats, origin: Triple, way: Triple) -> tuple[float, int]:
    """Length to the nearest shape and its row; -1 for none."""
    nearest, which = FAR, -1
    for n in range(shapes.shape[0]):
        shape = shapes[n]
        if shape[0] == SPHERE:
            x, y, z = origin[0] - shape[X], origin[1] - shape[Y], origin[2] - shape[Z]
            a = way[0] * way[0] + way[1] * way[1] + way[2] * way[2]
            b = x * way[0] + y * way[1] + z * way[2]
            inside = b * b - a * (x * x + y * y + z * z - shape[RADIUS] * shape[RADIUS])
            if inside > 0:
                length = (-b - math.sqrt(inside)) / a
                if 1e-6 < length < nearest:
                    nearest, which = length, n
            continue
        axis = int(shape[AXIS])
        first, second = (1 if axis == 0 else 0), (1 if axis == 2 else 2)
        if way[axis] != 0.0:
            length = (shape[PLACE] - origin[axis]) / way[axis]
            if 1e-6 < length < nearest:
                p, q = origin[first] + length * way[first], origin[second] + length * way[second]
                if shape[LOW_1] <= p <= shape[HIGH_1] and shape[LOW_2] <= q <= shape[HIGH_2]:
                    nearest, which = length, n
    return nearest, which


@kernel
def shade(shapes: Floats, texture: Floats, which: int, x: float, y: float, z: float) -> Triple:
    """Color of a shape at a place on it."""
    shape = shapes[which]
    light = 1.0
    if shape[0] == SPHERE:
        radius = shape[RADIUS]
        nx, ny, nz = (x - shape[X]) / radius, (y - shape[Y]) / radius, (z - shape[Z]) / radius
        u, v = math.atan2(nx, -nz) * radius, math.asin(max(-1.0, min(1.0, ny))) * radius
        light = 0.65 + 0.35 * (-0.4 * nx - 0.7 * ny - 0.59 * nz)
    elif shape[AXIS] == 0:
        u, v, light = z, y, 0.8
    elif shape[AXIS] == 1:
        u, v, light = x, z, 0.9
    else:
        u, v = x, y
    kind, u, v = int(shape[TEXTURE]), u * shape[SCALE], v * shape[SCALE]
    red, green, blue = 0.0, 0.0, 0.0
    if kind == PHOTO:
        red, green, blue = photo(texture, u, v)
    elif kind == CHECKER:
        odd = (math.floor(u) + math.floor(v)) & 1
        red, green, blue = 0.12 + 0.76 * odd, 0.15 + 0.66 * odd, 0.22 + 0.5 * odd
    elif kind == NOISE:
        n = 0.5 * noise(u, v, 1) + 0.3 * noise(u * 2.03, v * 2.03, 2)
        n += 0.2 * noise(u * 4.1, v * 4.1, 3)
        red, green, blue = 0.15 + 0.8 * n, 0.1 + 0.7 * n * n, 0.35 * (1 - n) + 0.1
    else:
        odd = math.floor(u + 0.35 * v) & 1
        red, green, blue = 0.2 + 0.65 * odd, 0.3, 0.75 - 0.5 * odd
    return red * light, green * light, blue * light


@kernel
def way_of(inverse: Floats, turn: Floats, x: float, y: float) -> Triple:
    """The way of a ray through a place on screen, in the world."""
    right, down = inverse[0, 0] * x + inverse[0, 2], inverse[1, 1] * y + inverse[1, 2]
    return (
        turn[0, 0] * right + turn[1, 0] * down + turn[2, 0],
        turn[0, 1] * right + turn[1, 1] * down + turn[2, 1],
        turn[0, 2] * right + turn[1, 2] * down + turn[2, 2],
    )


@parallel_kernel
def render(
    shapes: Floats,
    texture: Floats,
    inverse: Floats,  # of the camera's matrix
    turn: Floats,  # world to camera
    eye: Floats,
    rays: int,  # along a side of a pixel
    color: Floats,  # (H, W, 3) means over pixels
    depth: Floats,  # (H, W) at pixel centers; 0 for nothing
) -> None:
    """Draw the scene."""
    for row in prange(depth.shape[0]):
        origin = (eye[0], eye[1], eye[2])
        for column in range(depth.shape[1]):
            way = way_of(inverse, turn, column, row)
            length, which = hit(shapes, origin, way)
            depth[row, column] = length if which >= 0 else 0.0
            red = green = blue = 0.0
            for ray in range(rays * rays):
                x = column + (ray % rays + 0.5) / rays - 0.5
                y = row + (ray // rays + 0.5) / rays - 0.5
                way = way_of(inverse, turn, x, y)
                length, which = hit(shapes, origin, way)
                if which >= 0:
                    place_x, place_y = eye[0] + length * way[0], eye[1] + length * way[1]
                    place_z = eye[2] + length * way[2]
                    shaded = shade(shapes, texture, which, place_x, place_y, place_z)
                    red, green, blue = red + shaded[0], green + shaded[1], blue + shaded[2]
            color[row, column, 0] = red / (rays * rays)
            color[row, column, 1] = green / (rays * rays)
            color[row, column, 2] = blue / (rays * rays)


@parallel_kernel
def visible_share(
    shapes: Floats,
    inverse: Floats,  # of the new camera's matrix
    turn: Floats,
    eye: Floats,
    source: Floats,  # the source camera's matrix
    source_turn: Floats,
    source_eye: Floats,
    source_height: int,
    source_width: int,
    rays: int,
    share: Floats,  # (H, W)
) -> None:
    """Find the share of each pixel's area that the source sees."""
    for row in prange(share.shape[0]):
        origin = (eye[0], eye[1], eye[2])
        seen_from = (source_eye[0], source_eye[1], source_eye[2])
        for column in range(share.shape[1]):
            count = 0
            for ray in range(rays * rays):
                x = column + (ray % rays + 0.5) / rays - 0.5
                y = row + (ray // rays + 0.5) / rays - 0.5
                way = way_of(inverse, turn, x, y)
                length, which = hit(shapes, origin, way)
                if which < 0:
                    continue
                dx = eye[0] + length * way[0] - source_eye[0]
                dy = eye[1] + length * way[1] - source_eye[1]
                dz = eye[2] + length * way[2] - source_eye[2]
                a = source_turn[0, 0] * dx + source_turn[0, 1] * dy + source_turn[0, 2] * dz
                b = source_turn[1, 0] * dx + source_turn[1, 1] * dy + source_turn[1, 2] * dz
                c = source_turn[2, 0] * dx + source_turn[2, 1] * dy + source_turn[2, 2] * dz
                if c <= 0:
                    continue
                u, v = source[0, 0] * a / c + source[0, 2], source[1, 1] * b / c + source[1, 2]
                inside = -0.5 <= u <= source_width - 0.5 and -0.5 <= v <= source_height - 0.5
                if inside:
                    length, nearest = hit(shapes, seen_from, (dx, dy, dz))
                    if nearest == which and length > 1 - 1e-4:
                        count += 1
            share[row, column] = count / (rays * rays)
