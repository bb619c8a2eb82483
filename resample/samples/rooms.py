"""A furnished room as a picture with exact depth, from any viewpoint."""

import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.samples import DefaultOptions, SampleFiles
from resample.samples.pictures import grain, rough
from resample.types import Doubles, Floats

FOV = 60.0  # degrees along the shorter side
RAYS = 3  # per side of a pixel
ASIDE = (0.35, -0.05, 0.1)  # default position of the new viewpoint
EYED = ("render", "animate", "view", "stereo", "compare", "figures")  # commands with a camera
EYES = ("--source-pose", "--intrinsics", "--fov", "--lens", "--source-projection")
BALLS = (  # center, radius, color
    ((-0.85, 0.62, 3.1), 0.48, (0.72, 0.10, 0.07)),
    ((0.62, 0.78, 2.35), 0.32, (0.05, 0.32, 0.55)),
    ((1.15, 0.55, 3.75), 0.55, (0.80, 0.55, 0.10)),
    ((-0.12, 0.92, 2.15), 0.18, (0.18, 0.50, 0.16)),
)
BOX_LOW, BOX_HIGH = np.array([-0.35, 0.1, 3.5]), np.array([0.45, 1.1, 4.3])
LOW, HIGH = np.array([-2.2, -1.3, -1.0]), np.array([2.2, 1.1, 5.6])  # corners of the room
LAMP = np.array([-0.7, -1.15, 1.6])


class DepthPicture(NamedTuple):
    """A picture with its depth, from a pinhole camera with square pixels."""

    color: NDArray[np.uint8]  # (H, W, 3) sRGB
    depth: Floats  # (H, W) z in scene units
    fov: float  # degrees along the shorter side
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the camera: right, down, forward

    def stored(self, folder: Path, name: str) -> SampleFiles:
        from resample.samples.writing import write_npy, write_png

        write_png(folder / f"{name}.png", self.color)
        write_npy(folder / f"{name}.npy", self.depth)
        # Camera in the form of NeRF's transforms.json.
        height, width = self.depth.shape
        focal = min(height, width) / 2 / math.tan(math.radians(self.fov / 2))
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = self.place
        facts = {"w": width, "h": height, "fl_x": focal, "fl_y": focal}
        facts |= {"cx": width / 2, "cy": height / 2}
        (folder / f"{name}.json").write_text(
            json.dumps(
                ({**facts, "frames": [{"file_path": "", "transform_matrix": pose.tolist()}]}),
                indent=1,
            ),
            "utf-8",
        )
        eye = DefaultOptions(EYED, ["--source-pose", f"FOLDER/{name}.json"], (*EYES, "--settings"))
        aim = ("--pose", "--move", "--turn", "--target", "--truth", "--scene", "--settings")
        move = ["--move", ",".join(f"{step:g}" for step in ASIDE)]
        x, y, z = (at + step for at, step in zip(self.place, ASIDE, strict=True))
        truth = f"sample:{name}:size={len(self.depth)},x={x:g},y={y:g},z={z:g}"
        options = [
            eye,
            DefaultOptions(["render", "compare"], move, aim),
            DefaultOptions(["compare"], ["--truth", truth], aim),
            DefaultOptions(["stereo"], ["--depth-kind", "z"], ("--depth-kind", "--settings")),
        ]
        return SampleFiles([f"{name}.png", f"{name}.npy"], options)


def room(size: int = 320, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> DepthPicture:
    """Ray trace balls and a box in a room with a tiled floor.

    Parameters
    ----------
    size
        Height in px; pictures are 4 : 3.
    x, y, z
        Position of the camera: right, down and forward, scene units. It looks along z.
    """
    if not 16 <= size <= 2048:
        raise ValueError(f"room: size is 16 to 2048 px, not {size}")
    eye = np.array([x, y, z])
    if not ((eye > LOW + 0.1) & (eye < (2.1, 1.0, 1.7))).all():
        raise ValueError(f"room: {x:g}, {y:g}, {z:g} is not a position in front of the objects")
    shape = size, size * 4 // 3
    depth = _traced(eye, shape)[1].astype(np.float32)
    # Picture from a position, (H, W, 3) sRGB.
    from resample.colors import to_srgb

    light = np.zeros((*shape, 3), np.float32)
    for n in range(RAYS * RAYS):
        at = (n % RAYS + 0.5) / RAYS, (n // RAYS + 0.5) / RAYS
        light += _traced(eye.astype(np.float32), shape, at)[0] / RAYS**2
    levels = to_srgb(np.clip(light, 0, 1)) + 0.006 * grain(*shape, 3)[..., None]
    return DepthPicture(
        np.asarray(np.clip(255 * levels, 0, 255).astype(np.uint8)), depth, FOV, (x, y, z)
    )


def _traced(
    eye: Doubles, shape: tuple[int, int], at: tuple[float, float] = (0.5, 0.5)
) -> tuple[Doubles, Doubles]:
    """Light and z-depth of a ray through one position in every pixel, in float64."""
    height, width = shape
    focal = min(shape) / 2 / math.tan(math.radians(FOV / 2))
    y, x = np.mgrid[:height, :width].astype(eye.dtype)
    along = (x + at[0] - width / 2) / focal, (y + at[1] - height / 2) / focal
    ray = np.stack([*along, np.ones_like(x)], axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.where(ray > 0, (HIGH - eye) / ray, (LOW - eye) / ray).astype(eye.dtype)
    depth, axis = walls.min(axis=2), walls.argmin(axis=2)  # and what each wall is across
    normal = -np.sign(ray) * (np.arange(3) == axis[..., None])
    paint = np.empty_like(ray)
    _paint_walls(eye + ray * depth[..., None], axis, paint)
    # Add the box where it is nearest.
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (BOX_LOW - eye) / ray, (BOX_HIGH - eye) / ray
    enter, leave = np.minimum(one, other), np.maximum(one, other)
    near = enter.max(axis=2)
    hit = (near < leave.min(axis=2)) & (near > 0) & (near < depth)
    side, away = enter.argmax(axis=2)[hit], near[hit]
    fine = np.floor((eye + ray[hit] * away[:, None]) * 10 + 1e-3).sum(axis=1) % 2
    depth[hit], normal[hit] = away, -np.sign(ray[hit]) * (np.arange(3) == side[:, None])
    paint[hit] = np.array([0.60, 0.30, 0.14]) * (0.55 + 0.45 * fine)[:, None]
    # Add the balls.
    for place, radius, levels in BALLS:
        center, color = np.array(place, eye.dtype), np.array(levels, eye.dtype)
        offset = eye - center
        a, b = (ray * ray).sum(axis=2), (ray * offset).sum(axis=2)
        root = b * b - a * (offset @ offset - radius * radius)
        near = (-b - np.sqrt(np.maximum(root, 0))) / a
        hit = (root > 0) & (near > 0) & (near < depth)
        out = (eye + ray[hit] * near[hit][:, None] - center) / radius
        depth[hit], normal[hit] = near[hit], out
        bands = np.sin(14 * np.arctan2(out[:, 1], np.hypot(out[:, 0], out[:, 2])))
        paint[hit] = np.where((bands > 0.55)[:, None], 0.82 - 0.4 * color, color)
    return _lit(eye + ray * depth[..., None], normal, paint), depth


def _paint_walls(place: Doubles, axis: NDArray[np.intp], paint: Doubles) -> None:
    """Color the room's sides."""
    floor = (axis == 1) & (place[..., 1] > 0)
    paint[axis == 1] = 0.75
    x, _, z = place[floor].T
    tile = 0.34 + 0.66 * ((np.floor(x * 4) + np.floor(z * 4)) % 2)
    veins = 0.75 + 0.4 * rough(x * 6, z * 6, 3, 5)
    paint[floor] = np.array([0.62, 0.56, 0.47]) * (tile * veins)[:, None]
    wall = axis != 1
    x, y, z = place[wall].T
    behind = axis[wall] == 2
    stripe = 0.86 + 0.14 * (np.floor(np.where(behind, x, z) * 7) % 2)
    color = np.array([0.50, 0.58, 0.55]) * stripe[:, None]
    color[y > 0.93] = 0.66, 0.62, 0.55  # skirting
    across, down = np.abs(x + 0.9), np.abs(y + 0.35)
    framed = behind & (across < 0.78) & (down < 0.56)
    inside = framed & (across < 0.7) & (down < 0.48)
    rings = 0.5 + 0.5 * np.cos(60 * ((x + 0.9) ** 2 + (y + 0.35) ** 2)[inside])
    color[framed] = 0.16, 0.09, 0.05
    color[inside] = rings[:, None] * np.array([0.85, 0.72, 0.38]) + np.array([0.05, 0.08, 0.16])
    paint[wall] = color


def _lit(place: Doubles, normal: Doubles, paint: Doubles) -> Doubles:
    """Shade by a lamp under the ceiling, with shadows of the balls, and ambient light."""
    way = LAMP - place
    length = np.linalg.norm(way, axis=2)
    way = way / length[..., None]
    facing = np.clip((normal * way).sum(axis=2), 0, 1)
    for center, radius, _ in BALLS:
        offset = place - np.array(center)
        b = (way * offset).sum(axis=2)
        gap = np.sqrt(np.maximum((offset * offset).sum(axis=2) - b * b, 0))
        behind = (b < -1e-6) & (-b < length)
        shade = np.clip((gap / radius - 0.9) / 0.2, 0, 1)
        own = (offset * offset).sum(axis=2) < radius * radius * 1.001
        facing = facing * np.where(behind & ~own, shade, 1)
    return np.asarray(paint * (0.22 + 2.6 * facing / (1 + 0.55 * length * length))[..., None])
