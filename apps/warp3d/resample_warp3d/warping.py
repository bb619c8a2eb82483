"""Warp depth images to other cameras."""

import warnings
from collections.abc import Callable
from functools import partial
from os import PathLike
from typing import Any, Literal, TypedDict, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike

from resample import registry
from resample.calling import takes
from resample.cameras.models import Camera, Orthographic
from resample.colors import from_srgb
from resample.files.conversion import as_picture, picture_and_encoding
from resample.messages import check_threads, number, shortly
from resample.painting.scenes.plans import pair_of, shape_of
from resample.profiles.filters import PixelFilter
from resample.types import Doubles, Floats
from resample_warp3d.depth.encodings import check_scale
from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.depth.files import confident, read_depth
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.depth.refining.conditioning import Refine
from resample_warp3d.methods.filtering import filtered
from resample_warp3d.painting import explained as wide_explained
from resample_warp3d.painting import painted
from resample_warp3d.painting import trusted as wide_trusted
from resample_warp3d.projection_models import CameraModel, Passage, Way, mapping_between, taken_by
from resample_warp3d.sheet.filling import explained, trusted
from resample_warp3d.sheet.filling import fill as fill_holes
from resample_warp3d.sheet.sheets import background, behind
from resample_warp3d.types import DepthImage, Equation, Method, Rendered, Source, Warped

Filling = Literal["picture", "layer"]
FILLINGS = get_args(Filling)
CLOSEST = 1e-30  # scene units; smaller depths are unknown
OPACITY = 3  # channel
LARGEST_PICTURE = 1 << 28  # pixels; a larger size is taken for a mistake
FEW_CHANNELS = 1, 3, 4  # rows of a picture that is taken for one with its channels first, ...
MANY = 16  # ... if it has as many columns and channels, at least


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
        (`resample.cameras.panoramic.Equirectangular`). Those targets, and targets with a lens, need
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
        Result of `equation.between` or `equation.of_rectified`; or of
        `wide.passages.mapping_between` (targets may have a lens, be panoramas or parallel),
        for the method hybrid.
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
            rendered = painted(chosen, pixel, source, equation, shape)
            holes = wide_explained(rendered, source, equation)
            sure = wide_trusted(rendered, source, equation)
        else:
            paint = chosen if pixel is None else partial(filtered, chosen, pixel)
            rendered = paint(source, equation, shape)
            holes = explained(rendered, source, equation)
            sure = trusted(rendered, source, equation)
    near = rendered.nearness
    depth = np.divide(1.0, near, out=np.full(shape, np.inf, np.float32), where=near > 0)
    return Warped(
        rendered.image, rendered.coverage, depth, holes, rendered.magnification,
        confidence_of(rendered) * sure,
    )  # fmt: skip


def is_usable(equation: Equation) -> bool:
    """Whether an equation's numbers are finite and its matrix is invertible."""
    matrix = equation.matrix
    if not (np.isfinite(matrix).all() and np.isfinite(equation.epipole).all()):
        return False
    largest = np.abs(matrix).max()
    return bool(largest > 0.0 and abs(np.linalg.det(matrix / largest)) > 1e-15)


def confidence_of(rendered: Rendered) -> Floats:
    """Return how well samples support each pixel, 0..1.

    The coverage, divided by the number of pixels that share one sample, and halved where a gap was
    filled. A surface that the source saw at a grazing angle counts as magnified, too. The trust of
    refined depth, from `filling.trusted`, is a further factor.
    """
    shared = np.maximum(rendered.magnification, np.float32(1))
    trust = np.where(rendered.bridged, np.float32(0.5), np.float32(1))
    return np.asarray(rendered.coverage * trust / shared, np.float32)
