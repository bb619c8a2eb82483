"""Write the results of a warp: picture, holes, coverage and depth."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb, over
from resample.console import say
from resample.files.conversion import light_of
from resample.files.formats import WriteOptions, check_output, coverage_picture
from resample.files.pictures import Kind, Picture
from resample.files.saving import write_picture
from resample.files.writing import replacing, save_array
from resample.types import Floats
from resample_warp3d.command.choices import DepthWarping, Extras
from resample_warp3d.command.export import check_export
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.types import Hole, Warped

DEPTHS = (".exr", ".npy", ".png")
MILLIMETERS = 1000.0  # per unit of a PNG's depth, by default
HOLE_COLORS = {
    Hole.NONE: (0, 0, 0),
    Hole.DISOCCLUDED: (255, 0, 255),
    Hole.OUTSIDE: (128, 128, 128),
    Hole.NO_DEPTH: (0, 64, 255),
    Hole.CRACK: (255, 220, 0),
}


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
    """Return a warped picture with its coverage as opacity, unless it has alpha.

    A `filled` picture has no coverage to show.
    """
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
    """Write the causes of holes as a palette PNG with the numbers of `Hole`.

    Covered pixels are transparent; the other colors are `HOLE_COLORS`.
    """
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
