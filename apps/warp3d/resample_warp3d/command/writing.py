"""Write the results of a warp: picture, holes, coverage, depth, meshes and point clouds."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera
from resample.cameras.pixels import directions, pixel_centers
from resample.cameras.poses import camera_to_world
from resample.colors import as_levels, from_srgb, over, straight, to_srgb
from resample.console import say
from resample.files.conversion import light_of
from resample.files.formats import WriteOptions, check_output, coverage_picture
from resample.files.pictures import Kind, Picture
from resample.files.saving import write_picture
from resample.files.writing import replacing, save_array
from resample.types import Doubles, Floats
from resample_warp3d.command.choices import DepthWarping, Extras
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.types import DOWN, RIGHT, Hole, Source, Warped

if TYPE_CHECKING:
    import trimesh

DEPTHS = (".exr", ".npy", ".png")
MILLIMETERS = 1000.0  # per unit of a PNG's depth, by default
HOLE_COLORS = {
    Hole.NONE: (0, 0, 0),
    Hole.DISOCCLUDED: (255, 0, 255),
    Hole.OUTSIDE: (128, 128, 128),
    Hole.NO_DEPTH: (0, 64, 255),
    Hole.CRACK: (255, 220, 0),
}
SUFFIXES = (".ply", ".glb")
OPENGL_AXES = np.diag([1.0, -1.0, -1.0])  # y up, the camera at the identity looking along −z
Shape = Literal["mesh", "points"]
Levels = NDArray[np.uint8]
Indices = NDArray[np.int64]


def made_of(warped: Warped, kind: Kind, choice: DepthWarping, show: str = "picture") -> Picture:
    """Return the picture to write: the warped one, labels, holes, or false colors."""
    if choice.unmixed:  # a label image with its stored numbers; 0 where nothing is
        share, zeros = warped.coverage[..., None], np.zeros_like(warped.image)
        return Picture(np.divide(warped.image, share, out=zeros, where=share > 0), kind)
    if show == "picture":
        return warped_picture(warped, kind, filled=choice.fill)
    if show != "holes":
        return _colored(from_srgb(np.asarray(warped.to_uint8(show) / 255.0, np.float32)))
    holes = np.array([HOLE_COLORS[hole] for hole in Hole], np.float32)[warped.holes] / 255.0
    seen = over(light_of(warped), (0.0, 0.0, 0.0))
    return _colored(np.where(warped.holes[..., None] > 0, from_srgb(holes), seen))


def _colored(light: Floats) -> Picture:
    """Return an 8-bit picture of opaque linear light (H, W, 3)."""
    return Picture(np.asarray(light, np.float32), Kind(("R", "G", "B"), 8, is_encoded=True))


def warped_picture(warped: Warped, kind: Kind, *, filled: bool) -> Picture:
    """Return a picture with its coverage as opacity, unless it has alpha or is `filled`."""
    image = np.asarray(warped.image, np.float32)
    if kind.has_alpha or filled:
        return Picture(image, kind)
    coverage = np.clip(warped.coverage, 0.0, 1.0)[..., None]
    image = np.concatenate([image, coverage], axis=2, dtype=np.float32)
    return Picture(image, kind._replace(channels=(*kind.channels, "A")))


def check_extras(extras: Extras, eye: SourceCamera | None = None) -> None:
    """Refuse unknown suffixes, and cameras whose pictures cannot be exported."""
    if extras.holes is not None:
        check_holes(extras.holes)
    if extras.coverage is not None:
        check_output(extras.coverage, WriteOptions(is_light=False))
    if extras.depth_output is not None:
        check_depth(extras.depth_output)
    if extras.export is not None:
        check_export(extras.export)
        if eye is not None:
            eye.check_pinhole("--export")


def write_extras(extras: Extras, warped: Warped, scale: float | None) -> None:
    """Write holes, coverage and depth if requested."""
    if extras.holes is not None:
        write_holes(extras.holes, warped.holes)
    if extras.coverage is not None:
        write_picture(
            extras.coverage, coverage_picture(warped.coverage), WriteOptions(is_light=False)
        )
    if extras.depth_output is not None:
        path, scale = extras.depth_output, MILLIMETERS if scale is None else scale
        lost = write_depth(path, warped.depth, scale)
        if lost:
            say(f"{path}: {lost} pixels are farther than {65535 / scale:g} and dropped; use .exr")


def check_holes(path: Path) -> None:
    """Refuse a target that `write_holes` would refuse, before any work is done."""
    if path.suffix.lower() != ".png":
        raise ValueError(f"{path}: holes are written as .png")


def write_holes(path: Path, holes: NDArray[np.uint8]) -> None:
    """Write the causes of holes as a palette PNG with the numbers of `Hole`."""
    from PIL import Image

    check_holes(path)
    height, width = holes.shape
    picture = Image.frombytes("P", (width, height), np.ascontiguousarray(holes, np.uint8).tobytes())
    picture.putpalette([level for hole in Hole for level in HOLE_COLORS[hole]])
    with replacing(path) as temporary:
        picture.save(temporary, transparency=int(Hole.NONE))


def check_depth(path: Path) -> None:
    """Refuse a target that `write_depth` would refuse, before any work is done."""
    if path.suffix.lower() not in DEPTHS:
        *most, last = DEPTHS
        raise ValueError(f"{path}: depth is written as {', '.join(most)} or {last}")


def write_depth(path: Path, depth: Floats, scale: float = MILLIMETERS) -> int:
    """Write depth (H, W), scene units; return the number of pixels that 16 bits cannot hold.

    `.exr` (channel Z) and `.npy` are inf where nothing is; `.png` has `scale` values per unit and
    is 0 there.
    """
    check_depth(path)
    suffix, lost = path.suffix.lower(), 0
    if suffix == ".npy":
        with replacing(path) as temporary:
            save_array(temporary, np.asarray(depth, np.float32))
    elif suffix == ".exr":
        plane = np.asarray(depth, np.float32)[..., None]
        write_picture(path, Picture(plane, Kind(("Z",), 32, is_encoded=False)), WriteOptions())
    else:
        levels = np.floor(np.where(np.isfinite(depth), depth, 0.0) * float(scale) + 0.5)
        lost = int((levels > 65535).sum())
        share = np.where(levels > 65535, 0.0, levels) / 65535.0
        plane = np.asarray(share, np.float32)[..., None]
        write_picture(
            path,
            Picture(plane, Kind(("Y",), 16, is_encoded=False)),
            WriteOptions(16, is_light=False),
        )
    return lost


def check_export(path: Path) -> None:
    """Refuse a target that `write_geometry` would refuse, before any work is done."""
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path}: meshes and points are written as {' or '.join(SUFFIXES)}")


def write_geometry(path: Path, source: Source, camera: Camera, shape: Shape = "mesh") -> None:
    """Write a prepared depth image as colored triangles or points, in world axes.

    `.ply` has sRGB values; `.glb` has y and z flipped, so that up is up, and a mesh with the
    picture as its texture, or points in linear light, as glTF requires.
    """
    check_export(path)
    suffix = path.suffix.lower()
    is_gltf = suffix == ".glb"
    geometry: Any = (
        cloud(source, camera) if shape == "points" else mesh(source, camera, textured=is_gltf)
    )
    if is_gltf:  # its axes and colors
        import trimesh

        geometry.vertices = geometry.vertices @ OPENGL_AXES
        if shape == "points":
            color = geometry.colors.astype(np.float32) / 255.0
            color[:, :3] = from_srgb(color[:, :3])
            geometry.colors = as_levels(color)
        geometry = trimesh.Scene([geometry])
    with replacing(path) as temporary:
        temporary.write_bytes(geometry.export(file_type=suffix[1:]))


def mesh(source: Source, camera: Camera, *, textured: bool = False) -> "trimesh.Trimesh":
    """Triangles between linked samples, front sides to the camera, in sRGB or textured."""
    import trimesh

    triangle = triangles(source)
    if not triangle.size:
        raise ValueError("no three neighbours lie on one surface, so there is no mesh to write")
    if camera.matrix[0, 0] * camera.matrix[1, 1] < 0:  # the picture is mirrored
        triangle = triangle[:, ::-1]
    kept, corner = np.unique(triangle, return_inverse=True)
    color = levels(source)
    made = trimesh.Trimesh(
        vertices=positions(source, camera).reshape(-1, 3)[kept],
        faces=corner.reshape(-1, 3),
        vertex_colors=None if textured else color.reshape(-1, 4)[kept],
        process=False,
    )
    if textured:  # with coordinates at each kept sample's pixel center
        from PIL import Image
        from trimesh.visual import TextureVisuals
        from trimesh.visual.material import PBRMaterial

        height, width = color.shape[:2]
        across, up = (kept % width + 0.5) / width, 1.0 - (kept // width + 0.5) / height
        picture = Image.fromarray(color if (color[..., 3] < 255).any() else color[..., :3])
        material = PBRMaterial(
            baseColorTexture=picture, metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True
        )
        made.visual = TextureVisuals(uv=np.stack([across, up], axis=1), material=material)
    return made


def cloud(source: Source, camera: Camera) -> "trimesh.PointCloud":
    """Return all samples with a depth, in sRGB colors."""
    import trimesh

    is_known = source.nearness > 0
    return trimesh.PointCloud(positions(source, camera)[is_known], levels(source)[is_known])


def positions(source: Source, camera: Camera) -> Doubles:
    """Return all samples' world positions, (H, W, 3) scene units; not finite without depth."""
    place = source.place if source.place.size else pixel_centers(source.nearness.shape)
    ray = directions(camera, place)
    ray = np.concatenate([ray, np.ones((*ray.shape[:2], 1))], axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        point = ray / source.nearness[..., None].astype(np.float64)
    back = camera_to_world(camera.world_to_camera)
    with np.errstate(invalid="ignore"):
        return np.asarray(point @ back[:3, :3].T + back[:3, 3], np.float64)


def triangles(source: Source) -> Indices:
    """Return triangles (N, 3) of sample indices, counterclockwise for the camera.

    Four samples that are linked all around make two, split along the diagonal with the smaller
    change of nearness; where two links meet in a corner and others are missing, they make one.
    """
    height, width = source.nearness.shape
    number = np.arange(height * width).reshape(height, width)
    corners = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    right, down = (source.links & RIGHT) > 0, (source.links & DOWN) > 0
    sides = down[:-1, :-1], right[1:, :-1], down[:-1, 1:], right[:-1, :-1]  # after each corner
    is_whole = np.logical_and.reduce(sides)
    nearness = source.nearness
    falling = np.abs(nearness[:-1, :-1] - nearness[1:, 1:])
    rising = np.abs(nearness[1:, :-1] - nearness[:-1, 1:])
    is_falling = falling <= rising
    found = [
        _picked(corners, (0, 1, 2), is_whole & is_falling),
        _picked(corners, (0, 2, 3), is_whole & is_falling),
        _picked(corners, (0, 1, 3), is_whole & ~is_falling),
        _picked(corners, (1, 2, 3), is_whole & ~is_falling),
    ]
    is_open = ~is_whole
    for n in range(4):
        meets = is_open & sides[n] & sides[n - 1]
        found.append(_picked(corners, (n - 1, n, (n + 1) % 4), meets))
        is_open = is_open & ~meets
    return np.concatenate(found)


def levels(source: Source) -> Levels:
    """Return colors (H, W, 4) as 8-bit sRGB with straight alpha."""
    channels = source.color.shape[2]
    if channels not in (1, 2, 3, 4):
        raise ValueError(f"a picture of {channels} channels; gray and RGB ones can be exported")
    color = source.color[..., [0, 0, 0]] if channels < 3 else source.color[..., :3]
    alpha = source.color[..., -1:] if channels in (2, 4) else np.ones_like(color[..., :1])
    rgba = np.clip(straight(np.concatenate([color, alpha], axis=2)), 0.0, 1.0)
    rgba[..., :3] = to_srgb(rgba[..., :3])
    return as_levels(rgba)


def _picked(
    corners: tuple[Indices, ...], chosen: tuple[int, int, int], where: NDArray[np.bool_]
) -> Indices:
    return np.stack([corners[n][where] for n in chosen], axis=1)
