"""Translate arguments that follow other libraries' conventions, or suggest ours.

The words come from OpenCV, scikit-image, SciPy, Pillow, Matplotlib, napari, VTK and PyVista.
"""

from collections.abc import Callable, Collection, Mapping
from functools import partial, wraps
from importlib import import_module
from os import PathLike
from typing import Any, ParamSpec, TypedDict, TypeVar

VARKEYWORDS = 8  # `inspect.CO_VARKEYWORDS`; importing it takes 10 ms
P = ParamSpec("P")
R = TypeVar("R")
C = TypeVar("C")

CommandOptions = TypedDict("CommandOptions", {  # noqa: UP013 - as a class one line each
    "fps": float, "resume": bool, "settings": str | PathLike[str],
    "settings_trusted": str | PathLike[str], "save_settings": str | PathLike[str], "memory": str,
    "limit": float, "allow_outside": bool,
}, total=False)  # fmt: skip


class FilmOptions(CommandOptions, total=False):
    """Options of all films."""

    frames: int
    path: str
    workers: int
    scheduler: str


# Other libraries' names of an argument or option -> ours with the same values: the first that a
# call has; and similar ones, for messages only.
NAMES = {
    "angle": ("degrees", "turn camera"),
    "antialias aa ssaa spp samples supersample": ("", "subpixels quality filter"),
    "azimuth elevation zoom eye view viewpoint": ("", "camera move"),
    "translation translate": ("move", ""),
    "cpos camera_position": ("camera", ""),
    "bg bgcolor background_color bg_color": ("background", ""),
    "clim vmin vmax min max levels_range": ("", "window range"),
    "cmap colormap palette lut color_map": ("colormap transfer", ""),
    "c color rgb colors scalars values": ("colors", "colormap transfer"),
    "image img picture rgb": ("color picture image", ""),
    "crop_box region bbox rect": ("", "roi crop"),
    "depth_factor depth_unit depth_units": ("", "depth_scale"),
    "field_of_view hfov vfov fovy": ("fov", "target_fov"),
    "fov": ("", "target_fov"),
    "framerate frame_rate rate r": ("fps", ""),
    "n_frames nframes frame_count num_frames": ("frames", ""),
    "length duration": ("", "frames"),
    "interp interpolate sampling_method": ("interpolation", "kernel method"),
    "sampling": ("spacing", "interpolation kernel method"),
    "order flags resample interpolation": ("interpolation", "kernel method"),
    "intrinsic k camera_matrix cameramatrix mtx intrinsics": ("matrix source intrinsics", ""),
    "focal_length": ("", "intrinsics"),
    "dist distcoeffs dist_coeffs": ("distortion", ""),
    "newcameramatrix new_camera_matrix": ("new_matrix", ""),
    "pose": ("target", ""),
    "extrinsic extrinsics viewmat w2c": ("world_to_camera target pose", ""),
    "isovalue iso_value iso_threshold isosurface level": ("iso", ""),
    "mode blending rendering": ("projection layout", "method"),
    "algorithm renderer": ("method", "projection"),
    "mode bordermode border_mode padding_mode boundary": ("edge", ""),  # by names, not numbers
    "bordervalue border_value cval fill_value fillcolor fill_color": ("fill", ""),
    "out output_file outfile outpath out_file dest destination save write o": ("output", ""),
    "output_shape out_shape dsize": ("shape", ""),  # of dsize width and height
    "size": ("shape", "factor"),  # width and height
    "fraction percent ratio rescale_factor scale_factor": ("", "factor size"),
    "factor": ("", "size"),
    "scale": ("", "factor size"),
    "resolution imsize window_size figsize": ("size", "factor"),
    "res dim dimension dimensions dims geometry pixels px": ("", "size factor"),
    "s pointsize splat_size point_radius": ("point_size", ""),
    "radius": ("", "point_size"),
    "points position positions means xyz": ("xyz position scene", "camera move"),
    "quats quaternions": ("rotation", ""),
    "scales": ("scale", ""),
    "opacities": ("opacity", ""),
    "normals": ("normal", ""),
    "projection_from source_projection input_projection": ("", "from source_projection"),
    "projection_to target_projection output_projection": ("", "to target_projection"),
    "quality": ("", "file_quality subpixels"),
    "rotation rotate rot": ("", "degrees turn camera"),
    "shade": ("shading", "light"),
    "lighting lights": ("", "shading light"),
    "num_threads n_threads nthreads": ("threads", "workers"),
    "jobs n_jobs cpus cores j": ("", "threads workers"),
    "tf transfer_function preset transfer": ("transfer", "colormap"),
    "voxel_size voxelsize pixdim": ("spacing", ""),
    "width height w h": ("", "width size factor"),
}
TURNED = "dsize size"  # arguments with two numbers in the opposite order
TOGETHER = (  # our options, and one argument of others for both
    ("size", "width height"),
    ("camera", "azimuth elevation zoom"),
    ("camera", "azimuth elevation"),
    ("camera", "eye lookat up"),
    ("camera", "eye look_at up"),
    ("camera", "intrinsic extrinsic"),
    ("camera", "k extrinsic"),
    ("intrinsics", "fx fy cx cy"),
    ("pose", "r t"),
)
USUAL = {  # others' arguments, and the values that name our only behavior
    "anti_aliasing antialias expand reshape resize preserve_range": (True,),
    "render_points_as_spheres opencv align_centers": (True,),
    "align_corners multichannel": (False,),
    "channel_axis": (-1, 2),
}
WHOLE = ("expand", "reshape", "resize")  # of rotations: False keeps the size of the picture
INVERSE = 16  # `cv2.WARP_INVERSE_MAP`, in `flags`
# Numbers of OpenCV (`flags`, `interpolation`) and of SciPy and scikit-image (`order`).
NUMBERED = {
    "flags interpolation": ("nearest", "bilinear", "cubic", "area-spline", "lanczos"),
    "order": ("nearest", "bilinear", "", "spline"),
    "bordermode": ("transparent", "clamp", "mirror", "wrap", "reflect-101"),
}
# What others call an argument -> what to do instead; before a colon, what such a call has.
REMEDIES = {
    "flags order resample resampling": "interpolation='nearest', 'bilinear' or 'cubic' is how a "
    "picture grows; where it shrinks, it is averaged",
    "mode bordermode border_mode padding_mode boundary": "edge='clamp', 'wrap', 'mirror' or "
    "'transparent' is what lies beyond a picture",
    "dsize size": "shape=(height, width) is the size, in px",
    "shape: scale fx fy": "resample_texture.scale(image, factor) scales; a share is "
    "resize(image, 0.5)",
    "anti_aliasing antialias": "results are always antialiased; leave it out",
    "expand reshape resize": "without a shape the result holds all of the picture; "
    "shape=image.shape[:2] keeps its size",
    "channel_axis multichannel": "channels come last: np.moveaxis(image, 0, -1)",
    "preserve_range": "values keep their range; leave it out",
    "align_corners": "pixels are areas, so corners are not aligned; leave it out",
    "gamma": "transfer='LOW,black,0 HIGH,white,0.5' has the opacity of each value",
    "isomin isomax surface_count": "iso= is one surface; surface=['0.3,red', '0.6,white'] adds "
    "others",
    "alpha": "transfer='gray:opacity=0.2' sets it for volumes; points are opaque",
    "position: radius": "radius= is in scene units, (N,)",
    "point_size: radius": "point_size= is a width in px",
    "point_size: r t": "camera=Camera(matrix, world_to_camera) is a camera of OpenCV's axes",
    "depth: znear zfar": "near= and far= are the ends of relative depth; other depth is not cut",
    "move: rotation rotate rot": "turn=(yaw, pitch, roll) turns the view, degrees",
    "output: divergence convergence": "stereo(picture, depth, divergence=...) makes both eyes",
    "degrees: center": "a rotation about another point is a matrix for warp(image, matrix)",
    "map_x map_y map1 map2": "give both maps as one: warp(image, (map_x, map_y))",
    "matrix: depth": "resample_warp3d.warp(color, depth, source, target) takes depth and cameras",
    "colors: clim vmin vmax": "clip the numbers: colors=np.clip(numbers, low, high)",
    "vmin vmax": "window='low..high' is the range of values",
    "layout: baseline ipd eye_distance": "divergence= is the shift between the eyes, in % of the "
    "width",
    "opacity": "transfer='gray:opacity=0.2' says how opaque voxels are, opacity_unit= per length",
    "transfer: color colors": "transfer='40,red,0 90,white,0.5' has the colors of values",
    "columns: c colors rgb": "color= is linear light; render(xyz, colors=...) takes levels",
    "harmonics: colors rgb sh": "color= is (colors - 0.5) / 0.28209479, harmonics= the rest",
    "world_to_camera: fx fy cx cy width height": "Camera.from_intrinsics(fx, fy, cx, cy) or "
    "Camera.from_fov(degrees, height, width) makes a camera",
    "world_to_camera: fov fovy hfov vfov": "Camera.from_fov(degrees, height, width) makes a camera",
    "nearness: depth z": "nearness= is 1 / depth",
    "width height": "size=(width, height) is in px",
    "azimuth elevation zoom": "camera=(azimuth, elevation, zoom), angles in degrees",
    "projection orthographic parallel_projection": "fov=0 is a parallel projection",
}
# What other programs call a choice -> what it is here: the first that an option has.
CHOICES = {
    "mip max maximum-intensity": "maximum",
    "minip min minimum-intensity": "minimum",
    "avg mean aip": "average",
    "attenuated-mip attenuated_mip": "attenuated",
    "sum": "additive",
    "dvr volume translucent": "composite",
    "surface isosurface iso": "first-hit",
    "reflect reflect101 reflect-101 symmetric": "mirror",
    "replicate nearest edge border": "clamp",
    "repeat grid-wrap circular": "wrap",
    "constant zeros black": "transparent",
    "sbs full-sbs lr sidebyside full-side-by-side": "side-by-side",
    "half-sbs hsbs sbs-half half-lr": "half-side-by-side",
    "tb tab ou over-under full-tb top-and-bottom": "top-bottom",
    "half-tb htb half-tab htab hou half-ou half-over-under": "half-top-bottom",
    "cross crosseye crosseyed": "cross-eyed",
    "red-cyan redcyan": "anaglyph",
    "dubois": "anaglyph-dubois",
    "half-color": "anaglyph-half-color",
    "interlaced interleaved row-interlaced": "rows",
    "meters metric distance depth": "z",
    "fill crop": "cover",
    "fit letterbox": "contain pad",
    "linear bilinear": "bilinear linear",
    "bicubic": "cubic",
    "lanczos4 lanczos3": "lanczos",
    "area": "area-spline",
    "iso isometric": "corner",
    "xy": "top",
    "xz": "front",
    "yz": "right",
}
# What others call a part of a result -> what to take instead.
RESULTS = {
    "image array data pixels numpy": "np.asarray(result) has the levels that people see, rgba of a "
    "frame its light",
    "to_pil pil to_pillow": "to_image() makes a Pillow image",
    "imshow plot display": "show() opens it; notebooks show returned results",
    "write imwrite export": "save(path) writes it",
    "alpha mask": "coverage says how much of each pixel is covered",
}
# What others call a function or method -> what it is here: the first that there is.
ALIASES = {
    "load read imread load_volume": "open",
    "show plot imshow": "view",
    "rescale": "scale",
    "add_volume add_points add_mesh draw_geometries isosurface novel_view": "render",
    "turntable orbit spin": "animate",
    "reproject forward_warp": "warp",
    "warp_affine": "warpAffine",
    "warp_perspective": "warpPerspective",
    "read_point_cloud load_point_cloud load_ply": "read_cloud",
    "pointcloud point_cloud": "Cloud",
}
# Other libraries' functions that imply options -> our function, and these options.
PRESETS: dict[str, tuple[str, dict[str, Any]]] = {
    "anaglyph": ("stereo", {"layout": "anaglyph"}),
    "mip maximum_projection": ("render", {"projection": "maximum"}),
    "pyrdown pyramid_reduce": ("resize", {"shape": 0.5}),
    "pyrup pyramid_expand": ("scale", {"factor": 2}),
    "getperspectivetransform": ("control_points", {"shape": (1, 1), "kind": "projective"}),
    "getaffinetransform": ("control_points", {"shape": (1, 1), "kind": "affine"}),
}
METHODS = "render animate view"  # functions of a package that are methods of its data, too
# What others call a function or method -> what to do instead.
FUNCTIONS = {
    "open load read imread": "resample_volume.open and resample_points.open read files; calls take "
    "paths, too",
    "mip": 'render(volume, projection="maximum") shows the greatest values',
    "plot show imshow display": "view(...) shows it, render(...).save(path) writes a picture",
    "shape dtype ndim": "its parts have those: values.shape of a volume, position.shape of a cloud",
    "points xyz": "position has them",
    "colors": "color has them, in linear light",
    "data": "values has them",
    "render": "the application's render(...) draws it: resample.render(scene)",
    "rotate": "resample_texture.rotate(image, degrees) rotates",
    "flip fliplr flipud": "image[:, ::-1] flips left and right, image[::-1] up and down",
    "crop": "image[top:bottom, left:right] crops; warp and resize take roi= and box=",
    "slice slices": "volume.values[k] is a slice; plane='z=80' shows one in a scene",
    "rasterization rasterize splat": "render_gaussians(gaussians, camera) draws 3D Gaussians",
    "point_cloud pointcloud unproject backproject create_from_rgbd_image": "the command "
    "resample-warp3d render --export points.ply --export-as points writes the points of a depth",
    "scatter scatter3d": "render(np.column_stack([x, y, z]), colors=numbers) draws them",
    "rgbdimage rgbd": "DepthImage(color, 1 / depth); render, warp and stereo take both as they are",
    "get_perspective_transform estimate_transform findhomography": "resample_sky"
    '.control_points(source, target, shape, "projective") makes the matrix for warp',
    "getrotationmatrix2d": "rotate(image, degrees) rotates",
    "downscale_local_mean": "resize(image, 0.5) halves it",
    "warp_polar": "warpPolar(image, dsize, center, radius, flags) as in OpenCV",
    "swirl piecewise_affine": "warp(image, (map_x, map_y), shape) "
    "takes the places (H, W) in the source",
    "equirectangular_to_perspective equirect_to_perspective e2p e2c py360convert": "project(image, "
    '"equirectangular", "perspective:fov=90", (height, width), turn=(yaw, pitch, 0)) does that',
    "warp_perspective warp_affine affine remap": "warp(image, matrix or maps, "
    "shape) does that; resample_dropins.opencv (hybrid-resample-dropins) has OpenCV's names",
    "thumbnail": "resize(image, 64) makes the longer side 64 px",
    "rectify": "resample_sky.control_points(...) makes the matrix for warp; the command is "
    "resample-texture rectify",
}


def answer(word: str, known: Collection[str], remedies: Mapping[str, str]) -> str:
    """Return a suggestion for an unknown name, as the end of a sentence."""
    for key, text in remedies.items():
        has, _, words = key.rpartition(": ")
        if word.lower() in words.split() and (not has or has in known):
            return f": {text}"
    from difflib import get_close_matches

    known = [name for name in known if not name.startswith("_")]
    close = get_close_matches(word, known, 1)
    return f", did you mean {close[0]!r}?" if close else f"; known: {', '.join(known)}"


def choice_meant(given: str, choices: Collection[Any]) -> str:
    """Translate another library's name of a choice; unknown names are returned unchanged."""
    word = given.lower().replace("_", "-")
    meant = [ours.split() for theirs, ours in CHOICES.items() if word in theirs.split()]
    return next((one for every in meant for one in every if one in choices), given)


def ours_of(name: str, known: Collection[str], *, alike: bool = False) -> str:
    """Return the known option that a name means; empty if it means none.

    `alike`: options that are only like it count, too.

    Examples
    --------
    >>> from resample.calling import ours_of
    >>> ours_of("bg", ["box", "background"]), ours_of("azimuth", ["camera"], alike=True)
    ('background', 'camera')
    """
    word = name.lower().replace("-", "_")
    if word in known:
        return word
    rows = [ours for theirs, ours in NAMES.items() if word in theirs.split()]
    means = [same for same, _ in rows] + [near for _, near in rows if alike]
    return next((one for row in means for one in row.split() if one in known), "")


def _value_of(name: str, value: Any, known: Collection[str]) -> Any:
    """Return a value in our form: sizes are swapped, mode numbers become names."""
    word = name.lower()
    if name not in known and word in TURNED.split() and hasattr(value, "__len__"):
        return tuple(value)[::-1]
    if isinstance(value, tuple) and len({*value}) == 1 and ours_of(name, known) == "fill":
        return value[0]  # gray of all channels
    if isinstance(value, int) and not isinstance(value, bool):
        modes = next((row for words, row in NUMBERED.items() if word in words.split()), ())
        return (modes[value] or value) if 0 <= value < len(modes) else value
    return value


def _joined(given: dict[str, Any], known: set[str]) -> None:
    """Merge other libraries' arguments that are one argument here."""
    for ours, text in TOGETHER:
        spelled, words = {name.lower(): name for name in given}, text.split()
        if ours not in known or known >= {*words} or not spelled.keys() >= {*words}:
            continue
        parts = [given[spelled[word]] for word in words]
        if words[-1] == "up" and isinstance(parts[-1], str):
            continue  # an axis, which is a separate option
        for word in words:
            del given[spelled[word]]
        if ours == "pose":
            given[ours] = [[*row, float(part)] for row, part in zip(*parts, strict=True)]
        else:
            given[ours] = tuple(parts)
    if "fit" in known and given.get("fx", "") == given.get("fy"):  # of `resize`
        given["scale"] = given.pop("fx")
        del given["fy"]
    if "sh" in given and "harmonics" in known:  # (N, K, 3) of gsplat
        import numpy as np

        whole = np.asarray(given.pop("sh"), np.float32)
        given["color"], rest = whole[:, 0], whole[:, 1:]
        step = float(np.abs(rest).max(initial=0) / 32767) or 1.0
        given |= {"harmonics": np.round(rest / step).astype(np.int16), "harmonic_step": step}
    flags = given.get("flags")
    if isinstance(flags, int) and flags & INVERSE and "inverse" in known:
        given |= {"flags": flags & 7, "inverse": True}


def understood(call: str, given: dict[str, Any], known: Collection[str]) -> dict[str, Any]:
    """Return options under our names.

    Raises
    ------
    TypeError
        A name is of no option, or two names mean the same; it says what to give instead.

    Examples
    --------
    >>> from resample.calling import understood
    >>> understood("render", {"cmap": "bone", "iso": 3}, ("transfer", "iso"))
    {'transfer': 'bone', 'iso': 3}
    >>> understood("warp", {"fil": 0}, ["fill", "threads"])
    Traceback (most recent call last):
    ...
    TypeError: warp has no option 'fil', did you mean 'fill'?
    """
    found: dict[str, Any] = {}
    for name, given_value in given.items():
        usual = next((row for words, row in USUAL.items() if name.lower() in words.split()), ())
        if name not in known and type(given_value) in (bool, int) and given_value in usual:
            continue  # it asks for our only behavior
        value, ours = _value_of(name, given_value, known), ours_of(name, known)
        if (
            name == "scale" and "fit" in known and name not in known
        ):  # `resize` also takes a factor as shape
            value, ours = float(value), "shape"
        is_number = ours in ("edge", "interpolation") and ours != name and isinstance(value, int)
        if not ours or is_number:
            raise TypeError(f"{call} has no option {name!r}{answer(name, known, REMEDIES)}")
        if ours in found or (ours != name and ours in given):
            raise TypeError(f"{call} got {ours!r} twice, also as {name!r}")
        found[ours] = value
    return found


def takes(
    options: type | None = None, *, instead: str = ""
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a function to translate other libraries' keywords, or suggest ours.

    `options`: the `TypedDict` of further keywords. `instead`: what to call if arguments are missing
    or too many.
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        code: Any = function.__code__
        count = code.co_argcount + code.co_kwonlyargcount
        named = [one for one in code.co_varnames[:count] if one not in ("self", "cls", "_cls")]
        known = {*named, *(() if options is None else options.__annotations__)}
        is_open = bool(code.co_flags & VARKEYWORDS) and options is None
        name = function.__qualname__.removesuffix(".__init__").removesuffix(".__new__")
        usual: Any = function.__defaults__ or ()
        needed = named[: len(named) - code.co_kwonlyargcount - len(usual)]

        def called(*args: P.args, **given: P.kwargs) -> R:
            try:
                return function(*args, **given)
            except TypeError as error:
                if error.__traceback__ is None or error.__traceback__.tb_next is not None:
                    raise  # from within the function
                text = str(error).removeprefix(f"{function.__qualname__}() ")
                hint = instead or f"it is called as {name}({', '.join(needed)})"
                raise TypeError(f"{name} {text}; {hint}") from None

        @wraps(function)
        def call(*args: P.args, **given: P.kwargs) -> R:
            if given.keys() <= known:
                return called(*args, **given)
            _joined(given, known)
            if args and args[-1] is None and len(args) > 1:  # resize(image, None, fx=0.5, fy=0.5)
                args = args[:-1]  # type: ignore[assignment]
            for word in {*WHOLE} & given.keys() - known:
                if given[word] is False and hasattr(args[0], "shape"):
                    del given[word]
                    given["shape"] = args[0].shape[:2]
            if given.keys() <= known:
                return called(*args, **given)
            strange = {} if not is_open else {
                name: value for name, value in given.items() if ours_of(name, known) not in known
            }  # fmt: skip
            rest = {name: value for name, value in given.items() if name not in strange}
            made: Any = understood(name, rest, sorted(known))
            return called(*args, **(made | strange))

        return call

    return decorated


def alias_of(name: str, known: Collection[str]) -> str:
    """Return the known function that a name means; empty if it means none."""
    means = (ours for words, ours in ALIASES.items() if name.lower() in words.split())
    return name if name in known else next((one for one in means if one in known), "")


def no_attribute(given: Any, name: str, remedies: Mapping[str, str]) -> AttributeError:
    """Suggest our names for other libraries' attributes; for `__getattr__`."""
    hint = "" if name.startswith("_") else answer(name, dir(given), remedies)
    return AttributeError(f"{type(given).__name__!r} object has no attribute {name!r}{hint}")


def constructed(
    instead: str = "", check: Callable[..., None] | None = None
) -> Callable[[type[C]], type[C]]:
    """Decorate a dataclass or `NamedTuple` so that its constructor translates like `takes`.

    Its package's functions in `METHODS` can be called as methods. `check`: is given the
    positional arguments, and raises errors about them.
    """

    def attribute(data: Any, name: str) -> Any:
        call = alias_of(name, METHODS.split())
        package = import_module(type(data).__module__.partition(".")[0])
        if call and hasattr(package, call):
            return partial(getattr(package, call), data)
        raise no_attribute(data, name, FUNCTIONS)

    def decorated(kind: type[C]) -> type[C]:
        setattr(kind, "__getattr__", attribute)  # noqa: B010 - mypy knows no such method
        own = "__new__" if issubclass(kind, tuple) else "__init__"
        make = takes(instead=instead)(getattr(kind, own))

        @wraps(make)
        def checked(*args: Any, **given: Any) -> Any:
            if check is not None:
                check(args, given)
            return make(*args, **given)

        setattr(kind, own, make if check is None else checked)
        return kind

    return decorated
