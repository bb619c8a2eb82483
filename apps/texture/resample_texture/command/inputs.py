"""Targets of pictures from the command line's options and files."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from resample.cameras.calibrations.lens_files import Calibration, pinhole_of, read_calibration
from resample_texture.arguments import Places, geometry_of
from resample_texture.command.choices import WarpGeometry
from resample_texture.geometry.mappings import Geometry
from resample_texture.types import Warped


@dataclass(frozen=True, eq=False)
class PictureTarget:
    """Geometry and size of a warp's target."""

    places: Geometry | Places
    shape: tuple[int, int]  # height and width, px
    draws: "Draws | None" = None  # what shows the picture, if no geometry does it

    @cached_property
    def geometry(self) -> Geometry:
        """Geometry, evaluated for the whole target."""
        return geometry_of(self.places, self.shape, "corner", inverse=False)


Draws = Callable[..., Warped]  # takes a picture and options of `warp`
Aim = Callable[[tuple[int, int]], PictureTarget]  # from a picture's height and width


def target_of(place: WarpGeometry, source_shape: tuple[int, int]) -> PictureTarget:
    """Return geometry and size for a source (height, width)."""
    name, given = place.given()
    if name == "matrix":
        from resample_texture.geometry.matrices import homography, parse_matrix

        matrix = homography(parse_matrix(given), convention=place.convention, inverse=place.inverse)
        return PictureTarget(matrix, place.shape() or source_shape)
    if name == "lens":
        return rectified(calibrated(given), place.shape() or source_shape, inverse=place.inverse)
    if place.inverse:
        raise ValueError(f"--inverse applies to a matrix or a lens, not to a {name}")
    if name == "corners":
        from resample_texture.geometry.matrices import from_corners, page_corners, parse_points

        before, arrow, after = given.partition("->")
        shift = 0.5 if place.convention == "opencv" else 0.0
        points = parse_points(before) + shift
        source = points if arrow else page_corners(source_shape)
        target = parse_points(after) + shift if arrow else points
        right, bottom = target.max(axis=0)
        bounds = max(1, math.ceil(bottom)), max(1, math.ceil(right))
        return PictureTarget(from_corners(source, target), place.shape() or bounds)
    from resample_texture.geometry.mappings import ForwardMap, places_by_map, read_map

    pairs = read_map(given)
    shape = pairs.shape[0], pairs.shape[1]
    if name == "flow":
        if shape != source_shape:
            raise ValueError(
                f"{given} is a flow of {shape[1]} x {shape[0]} pixels, the picture "
                f"has {source_shape[1]} x {source_shape[0]}"
            )
        return PictureTarget(ForwardMap.from_flow(pairs), place.shape() or source_shape)
    if place.shape() not in (None, shape):
        raise ValueError(
            f"{given} is a map of {shape[1]} x {shape[0]} pixels, and so is what it makes; "
            "leave out the size"
        )
    shift = 0.5 if place.convention == "opencv" else 0.0
    return PictureTarget(places_by_map(pairs, shift), shape)


def calibrated(
    lens: str,
    new_matrix: str | None = None,
    rotation: str | None = None,
    *,
    fisheye: bool = False,
) -> Calibration:
    """Read a lens, with the pinhole and rotation to rectify for if given."""
    from resample.cameras.models import LensModel
    from resample.cameras.poses import turned_by
    from resample.words import naming
    from resample_texture.geometry.matrices import parse_matrix

    calibration = read_calibration(lens, LensModel.FISHEYE if fisheye else None)
    if new_matrix is not None:
        with naming("--new-matrix"):
            given = _four_of(new_matrix) or parse_matrix(new_matrix)
            calibration = calibration._replace(pinhole=pinhole_of(given))
    if rotation is not None:
        with naming("--rectify"):
            calibration = calibration._replace(rotation=turned_by(parse_matrix(rotation)))
    return calibration


def rectified(calibration: Calibration, shape: tuple[int, int], *, inverse: bool) -> PictureTarget:
    """Return the target (height, width) that removes a lens's distortion, or adds it."""
    from resample_texture.geometry.cameras import places_by_lens

    camera, pinhole, rotation, _ = calibration
    places = places_by_lens(camera, ideal=pinhole, rotation=rotation, inverse=inverse)
    return PictureTarget(places, shape)


def _four_of(text: str) -> list[float] | None:
    """Read fx, fy, cx, cy; None unless there are four numbers."""
    try:
        numbers = [float(number) for number in text.replace(",", " ").split()]
    except ValueError:
        return None
    return numbers if len(numbers) == 4 else None
