"""Resize, scale and rotate pictures, and show them in other projections, by `warp`."""

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.calling import takes
from resample.cameras.models import Camera, LensModel
from resample.messages import number, shortly
from resample.registry import plugin_of
from resample_texture.arguments import (
    CHANNELS,
    AnySize,
    Fit,
    GivenPictures,
    check_shape,
    given_pictures,
    resized,
    stacked,
    whole_pair,
)
from resample_texture.geometry.cameras import places_by_lens
from resample_texture.geometry.mappings import BackwardMap
from resample_texture.geometry.matrices import scaled_shape, scaling, turned_shape, turning
from resample_texture.geometry.projections import PictureProjection, rotation, source_tiles
from resample_texture.texels.encoding import light_for, masked
from resample_texture.types import (
    AnyAlpha,
    AnyEdge,
    AnyLight,
    Method,
    ProjectOptions,
    ResizeOptions,
    Warped,
)
from resample_texture.warping import warp


@takes(ResizeOptions)
def resize(
    image: Any,
    shape: AnySize | None = None,
    *,
    height: int | None = None,
    width: int | None = None,
    fit: Fit | None = None,
    box: Sequence[float] | None = None,
    method: str | Method = "hybrid",
    edge: AnyEdge | None = None,
    linear_light: AnyLight | None = None,
    alpha: AnyAlpha | None = None,
    **choices: Unpack[ResizeOptions],
) -> Warped:
    """Resize a picture, as the command does; it fills the target exactly, or as `fit` says.

    Parameters
    ----------
    image
        As `warp` takes it.
    shape
        Height and width of the result, px; one whole number: its longer side; a float: a share of
        the picture's size.
    height, width
        Instead of a shape, px; one follows from the other if it is left out.
    fit
        `contain`, as large as the shape holds; `cover`, all of the shape, and the rest is cut off;
        `stretch`; `pad`, contained, and filled up around. By default `contain` for one number,
        `stretch` for two.
    box
        Left, top, right and bottom, px, of the part of the picture to take, as Pillow has them.
        Its surroundings count only where an interpolation reaches beyond.
    method
        Name, or an object with its own options, such as `Hybrid(filter="gaussian:sigma=0.5")`.
    edge
        As `warp` takes it; by default `clamp`, but `transparent` with `fit="pad"`.
    linear_light, alpha
        As `warp` takes them.
    choices
        Its other options: `filter`, `interpolation`, `quality`, `total`, `axis`, `nodata`, `fill`,
        `roi`, `threads` and `out`.

    Raises
    ------
    ValueError, LookupError
        As `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import resize
    >>> resize(np.uint8([[1, 3, 5, 7]]), (1, 2)).image.tolist()  # means of two texels each
    [[2, 6]]
    >>> resize(np.zeros((48, 64, 3), np.uint8), (30, 40))
    Warped(30 × 40 × 3 uint8, 100 % covered)
    >>> resize(np.zeros((48, 64, 3), np.uint8), 32).image.shape  # the longer side
    (24, 32, 3)
    """
    picture, light = _opened(image, linear_light, choices)
    way = resized(picture.size, shape, height=height, width=width, fit=fit, box=box)
    usual: AnyEdge = "transparent" if fit == "pad" else "clamp"
    border = usual if edge is None else edge
    return warp(picture.values, *way, method, edge=border, **light, alpha=alpha, **choices)


@takes(ResizeOptions)
def scale(
    image: Any,
    factor: float | tuple[float, float],
    *,
    method: str | Method = "hybrid",
    edge: AnyEdge = "clamp",
    linear_light: AnyLight | None = None,
    alpha: AnyAlpha | None = None,
    **choices: Unpack[ResizeOptions],
) -> Warped:
    """Scale a picture by an exact factor; its size is rounded to whole px.

    Parameters
    ----------
    image, method, edge, linear_light, alpha, choices
        As `resize` takes them.
    factor
        Above 0; one factor, or two for x and y.

    Raises
    ------
    ValueError, LookupError
        A factor is not above 0, or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import scale
    >>> scale(np.ones((15, 21)), 0.5).image.shape
    (8, 11)
    >>> scale(np.ones((15, 21)), (2, 0.5)).image.shape  # along x and y
    (8, 42)
    """
    picture, light = _opened(image, linear_light, choices)
    pair = factor if isinstance(factor, list | tuple | np.ndarray) else (factor, factor)
    if len(pair) != 2:
        raise ValueError(f"factor {shortly(factor)}; give one number, or two for x and y")
    both = number("factor", pair[0]), number("factor", pair[1])
    target = scaled_shape(picture.size, both)
    way = scaling(both), target
    return warp(picture.values, *way, method, edge=edge, **light, alpha=alpha, **choices)


@takes(ResizeOptions)
def rotate(
    image: Any,
    degrees: float,
    shape: tuple[int, int] | None = None,
    *,
    method: str | Method = "hybrid",
    edge: AnyEdge = "transparent",
    linear_light: AnyLight | None = None,
    alpha: AnyAlpha | None = None,
    **choices: Unpack[ResizeOptions],
) -> Warped:
    """Rotate a picture counterclockwise about its center; multiples of 90° copy values.

    Parameters
    ----------
    image, method, edge, linear_light, alpha, choices
        As `resize` takes them.
    degrees
        Angle; negative angles turn clockwise.
    shape
        Height and width of the result, px; the centers of picture and result coincide. By default
        the result holds the whole picture.

    Raises
    ------
    ValueError, LookupError
        The angle is not a finite number, or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import rotate
    >>> rotate(np.uint8([[1, 2], [3, 4]]), 90).image.tolist()
    [[2, 4], [1, 3]]
    >>> rotate(np.ones((30, 40)), 30)
    WarpedMeans(46 × 50 float64, 56.3 % covered)
    """
    picture, light = _opened(image, linear_light, choices)
    source, degrees = picture.size, number("degrees", degrees)
    target = (
        turned_shape(source, degrees) if shape is None else whole_pair(shape, "height", "width")
    )
    way = turning(source, degrees, target), target
    return warp(picture.values, *way, method, edge=edge, **light, alpha=alpha, **choices)


@takes(ResizeOptions)
def undistort(
    image: Any,
    matrix: ArrayLike,
    distortion: ArrayLike | None = None,
    shape: tuple[int, int] | None = None,
    *,
    new_matrix: ArrayLike | None = None,
    rotation: ArrayLike | None = None,
    fisheye: bool = False,
    inverse: bool = False,
    method: str | Method = "hybrid",
    edge: AnyEdge = "transparent",
    linear_light: AnyLight | None = None,
    alpha: AnyAlpha | None = None,
    **choices: Unpack[ResizeOptions],
) -> Warped:
    """Remove a calibrated lens's distortion from a picture and rectify it, or add it.

    Parameters
    ----------
    image, method, edge, linear_light, alpha, choices
        As `resize` takes them.
    matrix
        OpenCV's camera matrix (3, 3), or fx, fy, cx and cy, px; they count from pixel centers.
    distortion
        OpenCV's 4, 5, 8, 12 or 14 coefficients; of a fisheye k1 to k4. None: no distortion.
    shape
        Height and width of the result, px; by default the picture's.
    new_matrix
        OpenCV's newCameraMatrix (3, 3) of the result; by default `matrix`.
    rotation
        OpenCV's R (3, 3) from the camera's axes to the result's; by default none.
    fisheye
        The coefficients follow `cv2.fisheye`.
    inverse
        Add the distortion to a picture without.

    Returns
    -------
    As `warp` does; pixels are not covered where the lens shows nothing, or its polynomial folds.

    Raises
    ------
    ValueError, LookupError
        A matrix or the number of coefficients is wrong, or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import undistort
    >>> camera = [[90, 0, 63.5], [0, 90, 47.5], [0, 0, 1]]
    >>> undistort(np.full((96, 128, 3), 200, np.uint8), camera, [-0.1, 0.01, 0, 0])
    Warped(96 × 128 × 3 uint8, 100 % covered)
    """
    picture, light = _opened(image, linear_light, choices)
    lens = LensModel.FISHEYE if fisheye else LensModel.PINHOLE
    camera = Camera.from_opencv(matrix, distortion, model=lens)
    ideal = None if new_matrix is None else Camera.from_opencv(new_matrix)
    places = places_by_lens(camera, ideal=ideal, rotation=rotation, inverse=inverse)
    target = picture.size if shape is None else shape
    return warp(picture.values, places, target, method, edge=edge, **light, alpha=alpha, **choices)


def _opened(
    image: Any, linear_light: AnyLight | None, choices: ResizeOptions
) -> tuple[GivenPictures, dict[str, Any]]:
    """Return a picture or stack, and options of its light and axis for `warp`."""
    picture = given_pictures(image, choices.pop("axis", None))
    is_linear = light_for(linear_light, picture.values.dtype, picture.is_encoded)
    return picture, {"linear_light": is_linear, "axis": picture.axis}


@takes(ProjectOptions)
def project(
    image: Any,
    source: str | PictureProjection,
    target: str | PictureProjection,
    shape: tuple[int, int],
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **choices: Unpack[ProjectOptions],
) -> Warped:
    """Show a picture of one projection in another, antialiased and without seams.

    Parameters
    ----------
    image
        As `warp` takes it.
    source, target
        Projections of the picture and of the result, by name or as objects: `equirectangular`,
        `cubemap:layout=row`, `fisheye:fov=180,model=equidistant`, `stereographic:fov=240`,
        `cylindrical:fov=360` or `perspective:fov=90`.
    shape
        Height and width of the result, px.
    turn
        Degrees by which the result looks to the right, up, and turns clockwise.
    choices
        Options of `warp`: `method`, `filter`, `interpolation`, `quality`, `total`, `axis`,
        `linear_light`, `alpha`, `nodata`, `fill` and `threads`.

    Raises
    ------
    ValueError, LookupError
        A size does not fit its projection, an angle is not finite, or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import project
    >>> panorama = np.full((64, 128, 3), 200, np.uint8)
    >>> project(panorama, "equirectangular", "perspective:fov=70", (48, 64), turn=(30, 10, 0))
    Warped(48 × 64 × 3 uint8, 100 % covered)
    >>> project(panorama, "equirectangular", "fisheye:fov=220", (64, 64))
    Warped(64 × 64 × 3 uint8, 78.8 % covered)
    """
    given = given_pictures(image, choices.get("axis"))
    picture = given.values
    choices.setdefault("linear_light", light_for(None, picture.dtype, given.is_encoded))
    if given.is_stack:
        choices["axis"] = CHANNELS if picture.ndim == 4 else None
        return stacked(
            [project(one, source, target, shape, turn, **choices) for one in picture], picture
        )
    choices["axis"] = given.axis
    shape = whole_pair(shape, "height", "width")
    check_shape(shape)
    before: PictureProjection = plugin_of("projections", source)
    after: PictureProjection = plugin_of("projections", target)
    before.check((picture.shape[0], picture.shape[1]))
    after.check(shape)
    turned = rotation(turn)
    made: Warped | None = None
    for n, (left, top, width, height) in enumerate(after.tiles(shape)):
        # One pixel more on each side tells how large those at the sides are.
        y, x = np.mgrid[top - 1 : top + height + 1, left - 1 : left + width + 1] + 0.5
        place = np.stack([x, y], axis=-1)
        ray = after.rays(place, shape, n) @ turned.T
        part = _drawn(picture, before, ray, choices)
        if made is None:  # nothing yet, of the type and with the fill of the first part
            is_measured = part.image.dtype.kind in "fc" and not part.is_premultiplied
            form = (*shape, *part.image.shape[2:])
            empty: NDArray[Any] = np.full(form, np.nan if is_measured else 0, part.image.dtype)
            if isinstance(part.image, np.ma.MaskedArray):
                empty = masked(empty, np.ones(form, np.bool_), part.image.fill_value)
            made = type(part)(empty, np.zeros(shape, np.float32))
        here = np.s_[top : top + height, left : left + width]
        is_shown = after.shows(place[1:-1, 1:-1], shape)
        made.image[here][is_shown] = part.image[is_shown]
        made.coverage[here][is_shown] = part.coverage[is_shown]
    assert made is not None
    return made


def _drawn(
    picture: NDArray[Any], before: PictureProjection, ray: NDArray[Any], choices: ProjectOptions
) -> Warped:
    """Draw a picture by its directions (h, w, 3)."""
    from scipy import ndimage

    form, made = (ray.shape[0], ray.shape[1]), None
    inner, roi = np.s_[1:-1, 1:-1], (1, 1, form[1] - 2, form[0] - 2)
    # The largest angle between neighbouring directions, rad.
    unit = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    steps = [np.linalg.norm(np.diff(unit, axis=axis), axis=-1) for axis in (0, 1)]
    angle = max(float(np.nanmax(step, initial=0.0)) for step in steps)
    for image, places, shows, is_endless in source_tiles(picture, before, angle):
        is_here = shows(ray)
        around = ndimage.binary_dilation(is_here, np.ones((3, 3), np.bool_))
        place = np.where(around[..., None], places(ray), np.nan)
        lookup = BackwardMap(place[..., 0], place[..., 1])
        edge: AnyEdge = "wrap" if is_endless else "transparent"
        part = warp(image, lookup, form, edge=edge, roi=roi, **choices)
        made = part if made is None else made
        there = is_here[inner]
        made.image[there], made.coverage[there] = part.image[there], part.coverage[there]
    assert made is not None
    return made
