"""Warp depth images to other cameras: by an equation, or to lenses, panoramas and parallel rays."""

import math
import warnings
from collections.abc import Callable
from functools import partial
from os import PathLike
from typing import Any, Literal, TypedDict, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample import registry
from resample.calling import takes
from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import Equirectangular, check_panorama, pixel_centers, rays_at, turn
from resample.colors import from_srgb
from resample.files.conversion import as_picture, picture_and_encoding
from resample.messages import check_threads, number, pair_of, shape_of, shortly
from resample.profiles.filters import PixelFilter
from resample.types import Doubles, Floats
from resample_warp3d.depth.encodings import check_scale
from resample_warp3d.depth.equation import between, lens_places, of_rectified
from resample_warp3d.depth.files import confident, read_depth
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.depth.refining.conditioning import Refine
from resample_warp3d.methods.filtering import filtered
from resample_warp3d.methods.hybrid import Hybrid, empty
from resample_warp3d.projection_models import (
    MERGED,
    CameraModel,
    Passage,
    Shape,
    StereoPanorama,
    Way,
    mapping_between,
    on_lattice,
    poles_rows,
    taken_by,
)
from resample_warp3d.sheet.filling import explained, farthest_of_rows, trusted
from resample_warp3d.sheet.filling import fill as fill_holes
from resample_warp3d.sheet.sheets import background, behind
from resample_warp3d.types import DepthImage, Equation, Hole, Method, Rendered, Source, Warped

Filling = Literal["picture", "layer"]
FILLINGS = get_args(Filling)
CLOSEST = 1e-30  # scene units; smaller depths are unknown
OPACITY = 3  # channel
LARGEST_PICTURE = 1 << 28  # pixels; a larger size is taken for a mistake
FEW_CHANNELS = 1, 3, 4  # rows of a picture that is taken for one with its channels first, ...
MANY = 16  # ... if it has as many columns and channels, at least
MARGIN = 8  # px that the halves of a panorama overlap, on each side
LEAST_ROWS = 3  # of a panorama, beside each pole, taken from a picture of the pole
MOST_ROWS = 0.15  # of its height: most such rows
REACHES = 3  # times the extent of the cells over the pole
FINE = 4  # px of that picture per row of the panorama
SAMPLES = 8, 4  # of that picture, down and across, per pixel of the panorama

PassageMethod = Callable[[Source, Passage, Shape], Rendered]
SOLID = 0.5  # coverage from which a pixel has a depth


class DepthWarpOptions(TypedDict, total=False):
    """Options of `warp` besides those in its signature, as it describes them."""

    filter: str | PixelFilter | None
    noise: float | None  # relative standard deviation of the depth
    step: float | None  # smallest step of 1 / depth
    refine: Refine
    confidence: Any
    least_confidence: float | None
    threads: int | None


@takes(DepthWarpOptions)
def warp(
    color: Any,
    depth: Any,
    source: Camera | Orthographic | ArrayLike,
    target: CameraModel | ArrayLike,
    method: str | Method = "hybrid",
    *,
    size: tuple[int, int] | None = None,
    fill: bool | Filling = False,
    **options: Unpack[DepthWarpOptions],
) -> Warped:
    """Warp a depth image: exact at 1:1, antialiased if shrunk, without holes if enlarged.

    Parameters
    ----------
    color
        (H, W) or (H, W, C), any number of channels, linear light, premultiplied if one is opacity;
        or anything else that `resample.files.conversion.as_picture` takes. Integers are
        divided by their type's largest value; uint8 of up to 4 channels is taken for sRGB levels
        with straight opacity, as photographs are. The result is linear light.
    depth
        (H, W) z along the source's axis, scene units; 0, negative, NaN and inf are unknown. A map
        of another size that shows the same frame is scaled to the picture's size.
    source, target
        Cameras, or the source's matrix (3, 3) and the pose (3, 4) or (4, 4), from the source's
        coordinates to the target's, of the same camera moved. Either may be parallel
        (`resample.cameras.models.Orthographic`), the target also a panorama
        (`resample.cameras.pixels.Equirectangular`). Those targets, and targets with a lens, need
        the method hybrid.
    method
        Name such as `hybrid`, `paper`, `mesh:samples=4` or `mcmillan`, or an object in that role.
    size
        Width and height of the target, px. Default: the source's.
    fill
        Fill holes: True or `picture` from the background beside them in the result; `layer` first
        from a background layer of the source, the same for all targets.
    options
        Any of the options that follow; `DepthWarpOptions` has their types.

    Other Parameters
    ----------------
    filter
        Pixel filter: `area`, `gaussian:sigma=0.5`, `tent`, `mitchell`, `lanczos:a=3`... Default:
        the method's own, the mean over a pixel's square.
    noise
        Relative standard deviation of the depth. Default: estimated.
    step
        Smallest step of 1 / depth. Default: estimated.
    refine
        Repair of depth that does not fit the picture: `snap` moves edges to color edges, `sharpen`
        hardens soft edges, `complete` fills gaps, `none` does nothing, `auto` chooses.
    confidence
        (H, W) or a file, larger is surer: where it is low, depth is unknown.
    least_confidence
        Smaller confidence is low. Default: half of the largest.
    threads
        Most threads to use; the result does not depend on it.

    Returns
    -------
    Picture (height, width, C), coverage, depth (z; for a panorama the ray length), classified
    holes, magnification and confidence.

    Raises
    ------
    ValueError
        A picture, depth, size or option is invalid.
    LookupError
        The method or refinement is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, warp
    >>> depth = np.full((32, 32), 4.0)
    >>> depth[8:24, 8:24] = 1.0  # a square before a wall
    >>> camera = Camera.from_fov(60, 32, 32)
    >>> right = camera.moved(np.c_[np.eye(3), [-0.4, 0, 0]])  # world to camera
    >>> warp(np.ones((32, 32, 3)), depth, camera, right)
    Warped(32 × 32 × 3 float32, 81.6 % covered)
    >>> warp(np.ones((32, 32, 3)), depth, camera, right, fill=True)
    Warped(32 × 32 × 3 float32, 100 % covered)
    """
    nearness, light = nearness_of(depth), as_light(color)
    if options.get("confidence") is not None:
        nearness = confident(nearness, options["confidence"], options.get("least_confidence"))
    height, width = light.shape[:2]
    taken: Any = source
    if np.shape(taken) == (3, 3):
        taken = Camera(taken)
    seen_by: Any = target
    if np.shape(seen_by) in ((3, 4), (4, 4)) and isinstance(taken, Camera):
        seen_by = taken.moved(seen_by)
    image, taken = taken_by(taken, DepthImage(light, nearness))
    prepared = prepare(
        image,
        noise=options.get("noise"),
        step=options.get("step"),
        refine=options.get("refine", "auto"),
    )
    shape = (height, width) if size is None else shape_of(size)
    equation = mapping_between(taken, seen_by, shape)
    threads, pixel = options.get("threads"), options.get("filter")
    seen = partial(render, equation=equation, shape=shape, method=method, threads=threads)
    return filled(prepared, partial(seen, filter=pixel), fill)


def warp_disparity(
    color: Any,
    disparity: Any,
    fraction: float = 1.0,
    method: str | Method = "hybrid",
    *,
    filter: str | PixelFilter | None = None,  # noqa: A002
    refine: Refine = "auto",
    fill: bool | Filling = False,
    threads: int | None = None,
) -> Warped:
    """Warp one picture of a rectified pair toward the other.

    Parameters
    ----------
    color
        As `warp` takes it.
    disparity
        (H, W) px, larger is nearer; 0 and values not finite are unknown.
    fraction
        1 from the left picture to the right one, −1 from right to left, 0.5 halfway.
    method, filter, refine, fill, threads
        As `warp` takes them.

    Returns
    -------
    As `warp`; `depth` is 1 / disparity.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import warp_disparity
    >>> left = np.zeros((24, 32))
    >>> left[:, 20] = 1.0  # a line
    >>> right = warp_disparity(left, np.full((24, 32), 6.0))
    >>> np.flatnonzero(right.image[12] > 0.5).tolist()
    [14]
    """
    disparities = as_picture(disparity, "disparity map")
    nearness = two_dimensional(disparities, "disparity").astype(np.float32)
    fraction = number("fraction", fraction)
    image = DepthImage(as_light(color), nearness)
    shape = image.color.shape[0], image.color.shape[1]
    if nearness.shape != shape:
        raise ValueError(
            f"color of {shape[1]} × {shape[0]} px does not fit depth of {nearness.shape[1]} × "
            f"{nearness.shape[0]} px; disparity is in px of the picture"
        )
    prepared = prepare(image, refine=refine)
    equation = of_rectified(fraction)
    seen = partial(render, equation=equation, shape=shape, method=method, threads=threads)
    return filled(prepared, partial(seen, filter=filter), fill)


def filled(source: Source, seen: Callable[[Source], Warped], fill: bool | Filling) -> Warped:
    """Render a source and fill it as requested."""
    if fill not in (False, True, *FILLINGS):
        raise ValueError(f"unknown filling {fill!r}; known: {', '.join(FILLINGS)}, True and False")
    warped = seen(source)
    layer = background(source) if fill == "layer" else None
    if layer is not None:
        warped = behind(warped, seen(layer))
    return fill_holes(warped) if fill else warped


def nearness_of(depth: Any) -> Floats:
    """Return 1 / depth, 0 where the depth is unknown."""
    is_file = isinstance(depth, str | PathLike)
    picture = read_depth(depth) if is_file else as_picture(depth, "depth map")
    given = two_dimensional(picture, "depth")
    nearness = np.zeros(given.shape, np.float64)
    np.divide(1.0, given, out=nearness, where=np.isfinite(given) & (given > CLOSEST))
    near = nearness.astype(np.float32)
    doubt = check_scale(near) if np.asarray(picture).dtype.kind in "ui" else None
    if doubt is not None:  # millimeters, as sensors store them
        warnings.warn(f"depth in whole numbers: {doubt}, or divide it by 1000", stacklevel=3)
    return near


def two_dimensional(given: ArrayLike, name: str) -> Doubles:
    """Return numbers of the shape (H, W), checked."""
    array = np.asarray(given, np.float64)
    if array.ndim != 2 or min(array.shape) < 1:
        raise ValueError(f"{name} of shape {array.shape}; give (H, W) of at least 1 px")
    return array


def as_light(color: Any) -> Floats:
    """Convert a picture to (H, W, C) float32, linear light, premultiplied if it has an opacity.

    Integers are divided by their largest value. Of up to 4 channels, uint8 and files that say so
    are sRGB levels with straight opacity.
    """
    given, is_encoded = picture_and_encoding(color)
    form = given.shape[-3:]
    if given.ndim in (3, 4) and form[0] in FEW_CHANNELS and min(form[1:]) >= MANY:
        raise ValueError(
            f"{given.shape} looks like channels first: {form[0]} rows of {form[1]} pixels with"
            f" {form[2]} channels each; give numpy.moveaxis(image, {given.ndim - 3}, -1)"
        )
    if given.ndim == 2:
        given = given[..., None]
    if given.ndim != 3 or min(given.shape) < 1:
        raise ValueError(f"color of shape {given.shape}; give (H, W) or (H, W, C) of at least 1 px")
    if given.dtype.kind == "b":
        return np.ascontiguousarray(given, np.float32)
    if given.dtype.kind == "u":
        light = np.ascontiguousarray(given / np.float32(np.iinfo(given.dtype).max), np.float32)
        if given.shape[2] > OPACITY + 1 or not (given.dtype == np.uint8 or is_encoded):
            return light
        light[..., :OPACITY] = from_srgb(light[..., :OPACITY])
        light[..., :OPACITY] *= light[..., OPACITY:] if given.shape[2] > OPACITY else 1
        return light
    if given.dtype.kind != "f":
        raise ValueError(f"color of type {given.dtype}; give unsigned integers or floats")
    return np.ascontiguousarray(given, np.float32)


@takes(
    instead="render(prepare(DepthImage(color, 1 / depth)), equation, shape, method) draws prepared "
    "sources; warp(color, depth, source, target) takes a picture, its depth and two cameras"
)
def render(
    source: Source,
    equation: Way,
    shape: tuple[int, int],
    method: str | Method,
    threads: int | None = None,
    *,
    filter: str | PixelFilter | None = None,  # noqa: A002
) -> Warped:
    """Warp a prepared source by McMillan's equation.

    Parameters
    ----------
    source
        Result of `preparation.prepare`; one serves any number of targets.
    equation
        Result of `equation.between` or `equation.of_rectified`; or of `mapping_between`, whose
        targets may have a lens, be panoramas or parallel, for the method hybrid.
    shape
        Height and width of the target, px.
    method, threads, filter
        As `warp` takes them.

    Raises
    ------
    ValueError
        The method takes no filter, or the shape or the equation is invalid.
    LookupError
        The method or the filter is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, of_rectified, prepare, render
    >>> color, disparity = np.ones((24, 32, 3), np.float32), np.full((24, 32), 8, np.float32)
    >>> source = prepare(DepthImage(color, disparity))
    >>> for fraction in (0.25, 1.0):
    ...     print(render(source, of_rectified(fraction), (24, 32), "hybrid"))
    Warped(24 × 32 × 3 float32, 96.9 % covered)
    Warped(24 × 32 × 3 float32, 78.1 % covered)
    """
    from resample.engine import jit

    check_threads(threads)
    height, width = pair_of("shape", shape, "height and width")
    if min(height, width) < 1 or height * width > LARGEST_PICTURE:
        raise ValueError(
            f"a target of {width} × {height} px; give 1 px or more each way, together at most "
            f"{LARGEST_PICTURE} px"
        )
    if isinstance(equation, Equation) and not is_usable(equation):
        raise ValueError("the warping equation is singular or not finite; check both cameras")
    shape = height, width
    chosen = registry.build("warps", method) if isinstance(method, str) else method
    if not callable(chosen):
        given = shortly(method)
        raise ValueError(
            f"method {given}; give a name, or an object that warps; warp takes (color, depth, "
            "source, target), and a camera with a matrix and a pose is Camera(matrix, pose)"
        )
    pixel = registry.build("filters", filter) if isinstance(filter, str) else filter
    with jit.threads(threads):
        if isinstance(equation, Passage):
            rendered = painted_beyond(chosen, pixel, source, equation, shape)
            holes = holes_beyond(rendered, source, equation)
            sure = trust_beyond(rendered, source, equation)
        else:
            paint = chosen if pixel is None else partial(filtered, chosen, pixel)
            rendered = paint(source, equation, shape)
            holes = explained(rendered, source, equation)
            sure = trusted(rendered, source, equation)
    near = rendered.nearness
    depth = np.divide(1.0, near, out=np.full(shape, np.inf, np.float32), where=near > 0)
    # A surface that the source saw at a grazing angle counts as magnified, too.
    shared = np.maximum(rendered.magnification, np.float32(1))  # pixels that share one sample
    trust = np.where(rendered.bridged, np.float32(0.5), np.float32(1))
    confidence = np.asarray(rendered.coverage * trust / shared, np.float32) * sure
    return Warped(
        rendered.image, rendered.coverage, depth, holes, rendered.magnification, confidence
    )


def is_usable(equation: Equation) -> bool:
    """Whether an equation's numbers are finite and its matrix is invertible."""
    matrix = equation.matrix
    if not (np.isfinite(matrix).all() and np.isfinite(equation.epipole).all()):
        return False
    largest = np.abs(matrix).max()
    return bool(largest > 0.0 and abs(np.linalg.det(matrix / largest)) > 1e-15)


def painted_beyond(
    method: Method, pixel: PixelFilter | None, source: Source, passage: Passage, shape: Shape
) -> Rendered:
    """Paint a source for a target of any camera model."""
    if not isinstance(method, Hybrid):
        raise ValueError(
            f"{type(method).__name__} warps from pinhole to pinhole; for lenses, panoramas and"
            " parallel rays use the method hybrid"
        )
    look: PassageMethod = method if pixel is None else partial(filtered, method, pixel)
    target = passage.target
    if not isinstance(target, Equirectangular):
        return look(source, passage, shape)
    check_panorama(shape)
    # Paint the panorama in two halves, so that no cell is cut by the seam.
    height, width = shape
    first, half = width // 4, width // 2
    whole, shifted = empty(shape, source.color.shape[2]), np.eye(3)
    shifted[0, 2] = MARGIN - first
    for turned in (0, 1):
        way = Passage(passage.source, target.turned(turned * math.pi), shape)
        part = look(source, way.in_frame(shifted), (height, half + 2 * MARGIN))
        columns = (np.arange(first, first + half) + turned * half) % width
        for into, each in zip(whole, part, strict=True):
            into[:, columns] = each[:, MARGIN:-MARGIN]
    reaches = poles_rows(passage, method.sheet(source))
    most = MOST_ROWS if not isinstance(target, StereoPanorama) else 0.5 - MERGED[1] / 180.0
    for reach, is_upper in zip(reaches, (True, False), strict=True):
        wanted = max(LEAST_ROWS, REACHES * reach)
        rows = max(1, min(wanted, int(most * shape[0])))
        _cap(method, source, passage, whole, rows if is_upper else -rows)
    return whole


def holes_beyond(rendered: Rendered, source: Source, passage: Passage) -> NDArray[np.uint8]:
    """Classify each pixel, (H, W) values of `Hole`, as `sheet.filling.explained` does."""
    shape = rendered.coverage.shape[0], rendered.coverage.shape[1]
    holes = np.zeros(shape, np.uint8)
    is_empty = np.logical_not(rendered.coverage > 0)
    nearness = np.where(is_empty, np.float32(np.inf), rendered.nearness)
    sides: Floats = np.minimum(_last_known(nearness), _last_known(nearness[:, ::-1])[:, ::-1])
    near = np.where(np.isfinite(sides), sides, farthest_of_rows(rendered)[:, None])[is_empty]
    place, _ = passage.back(pixel_centers(shape)[is_empty], near.astype(np.float64))
    is_seen = np.asarray(np.isfinite(place).all(axis=1))
    place = np.where(is_seen[:, None], place, -1.0)
    if source.place.size:
        place[is_seen] = on_lattice(source.place, place[is_seen])
    height, width = source.nearness.shape
    is_inside = (place >= 0).all(axis=1) & (place[:, 0] < width) & (place[:, 1] < height)
    column, row = np.where(is_inside[:, None], place, 0.0).astype(np.int64).T
    is_known = source.nearness[row, column] > 0
    inside = np.where(is_known, Hole.DISOCCLUDED, Hole.NO_DEPTH)
    holes[is_empty] = np.where(is_inside, inside, Hole.OUTSIDE)
    holes[rendered.bridged] = Hole.CRACK
    return holes


def trust_beyond(rendered: Rendered, source: Source, passage: Passage) -> Floats:
    """Return the trust of the pixels' depth (H, W), as `sheet.holes.trust_beyond` does."""
    sure = np.ones(rendered.nearness.shape, np.float32)
    if not source.trust.size:
        return sure
    is_seen = np.asarray(rendered.nearness > 0)
    near = rendered.nearness[is_seen].astype(np.float64)
    rows, columns = rendered.nearness.shape[:2]
    place, _ = passage.back(pixel_centers((rows, columns))[is_seen], near)
    is_found = np.isfinite(place).all(axis=1)
    if source.place.size:
        place[is_found] = on_lattice(source.place, place[is_found])
    height, width = source.trust.shape
    column, row = np.floor(np.clip(place[is_found], 0, (width - 1, height - 1))).astype(int).T
    found = np.zeros(len(place), np.float32)
    found[is_found] = source.trust[row, column]
    sure[:] = 0.0
    sure[is_seen] = found
    return sure


def _last_known(nearness: Floats) -> Floats:
    """Return the last finite number to the left of each pixel; inf if there is none."""
    width = nearness.shape[1]
    at = np.where(np.isfinite(nearness), np.arange(width), 0)
    return np.take_along_axis(nearness, np.maximum.accumulate(at, axis=1), axis=1)


def _cap(method: Hybrid, source: Source, passage: Passage, whole: Rendered, rows: int) -> None:
    """Fill rows beside a pole (negative: the lower one) from a picture of the pole."""
    height, width = whole.coverage.shape
    focal = FINE * height / math.pi
    half = math.ceil(focal * math.tan((abs(rows) + 1) * math.pi / height)) + 2
    pose = turn(0.0, math.copysign(0.5 * math.pi, rows)) @ passage.target.world_to_camera
    camera = Camera.from_intrinsics(focal, focal, half, half, pose)
    side = 2 * half
    fine = method(source, Passage(passage.source, camera, (side, side)), (side, side))
    upper = np.arange(abs(rows)) if rows > 0 else height - np.arange(abs(rows), 0, -1)
    down, across = SAMPLES
    y = (upper[:, None] + (np.arange(down) + 0.5) / down).ravel()
    x = (np.arange(width)[:, None] + (np.arange(across) + 0.5) / across).ravel()
    place = np.stack(np.broadcast_arrays(x, y[:, None]), axis=2)
    ray = rays_at(place, (height, width)) @ turn(0.0, math.copysign(0.5 * math.pi, rows))[:3, :3].T
    at = focal * ray[..., :2] / ray[..., 2:] + half
    _resampled(method, fine, at, ray[..., 2], whole, upper)


def _resampled(
    method: Hybrid, fine: Rendered, at: Doubles, cosine: Doubles, whole: Rendered,
    rows: NDArray[np.int64],
) -> None:  # fmt: skip
    """Fill rows of a panorama from a pinhole's picture, sampled at `at`, px."""
    height, width = whole.coverage.shape
    shape = rows.size, SAMPLES[0], width, SAMPLES[1]
    column, row = (
        np.floor(at).astype(np.int64).reshape(*shape, 2)[..., ::1].transpose(4, 0, 1, 2, 3)
    )
    middle = np.s_[:, SAMPLES[0] // 2, :, SAMPLES[1] // 2]
    chosen = (row[middle], column[middle]) if method.labels else (row, column)

    def mean(of: Floats) -> Floats:
        there = of[chosen]
        found = there if method.labels else there.mean(axis=(1, 3), dtype=np.float64)
        return np.asarray(found, np.float32)

    whole.image[rows], whole.coverage[rows] = mean(fine.image), mean(fine.coverage)
    flat = cosine.reshape(shape)
    near = fine.nearness[row, column] * flat
    whole.nearness[rows] = np.where(whole.coverage[rows] > 0, near.max(axis=(1, 3)), 0.0)
    # Magnification in pixels of the panorama, by solid angles.
    sine = np.sqrt(np.maximum(1.0 - flat * flat, 0.0))
    pixel = (math.pi / height) ** 2 * sine * (FINE * height / math.pi) ** 2 / flat**3
    finely = fine.magnification[row, column]
    grown = (finely > 0).sum(axis=(1, 3))
    total = np.where(finely > 0, finely / pixel, 0.0).sum(axis=(1, 3))
    whole.magnification[rows] = np.where(whole.coverage[rows] > 0, total / np.maximum(grown, 1), 0)
    whole.bridged[rows] = fine.bridged[row, column].mean(axis=(1, 3)) >= 0.5


def registered(
    nearness: Floats, depth_camera: Camera, camera: Camera, shape: tuple[int, int]
) -> Floats:
    """Reproject nearness from the depth camera to another camera, (height, width).

    Parameters
    ----------
    nearness
        (h, w) of the depth camera; 0 where unknown.
    depth_camera, camera
        Cameras with poses in the same world; the second without distortion.
    shape
        Height and width of the result, px.

    Returns
    -------
    Nearness of the nearest surface that covers most of each pixel; 0 where there is none, as in the
    shadow of what hides a part from the depth camera: `refine="complete"` fills that.

    Raises
    ------
    ValueError
        None of the depth is in view.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, registered
    >>> sensor, camera = Camera.from_fov(60, 24, 32), Camera.from_fov(50, 48, 64)
    >>> beside = camera.moved(np.c_[np.eye(3), [-0.05, 0, 0]])
    >>> nearness = registered(np.full((24, 32), 0.5, np.float32), sensor, beside, (48, 64))
    >>> nearness.shape, round(nearness[24, 32].item(), 3)
    ((48, 64), 0.5)
    """
    from resample_warp3d.depth.preparation import prepare
    from resample_warp3d.methods.hybrid import Hybrid

    height, width = nearness.shape
    place = lens_places(depth_camera, (height, width))
    image = DepthImage(np.ones((height, width, 1), np.float32), nearness, place)
    source = prepare(image, refine="none")
    rendered = Hybrid()(source, between(depth_camera, camera), shape)
    seen = np.where(rendered.coverage >= SOLID, rendered.nearness, np.float32(0))
    if not seen.any():
        raise ValueError(
            "none of the depth is in the picture's view; check the depth camera's pose"
        )
    return np.asarray(seen, np.float32)
