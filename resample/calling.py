"""Calls as users of other libraries write them: their words are understood, or answered.

The words are those of OpenCV, scikit-image, SciPy, Pillow, Matplotlib, napari, VTK and PyVista.
"""

from collections.abc import Callable, Collection, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar

VARKEYWORDS = 8  # `inspect.CO_VARKEYWORDS`, whose import takes 10 ms
P = ParamSpec("P")
R = TypeVar("R")

# What others call an argument -> what it is here, with the same values.
ARGUMENTS = {
    "cmap colormap lut": ("transfer", "colormap"),
    "voxel_size voxelsize sampling pixdim": ("spacing",),
    "bg bgcolor background_color": ("background",),
    "blending rendering": ("projection",),
    "isovalue level": ("iso",),
    "shade": ("shading",),
    "angle": ("degrees",),
    "output_shape out_shape": ("shape",),
    "resolution imsize window_size": ("size",),
    "c color rgb": ("colors",),
    "num_threads n_threads": ("threads",),
    "n_frames nframes": ("frames",),
    "points position positions": ("xyz",),
    "mode bordermode border_mode padding_mode boundary": ("edge",),  # by names, not by numbers
    "dsize size": ("shape",),  # width and height there
}
TURNED = "dsize size"  # arguments whose two numbers are the other way round here
PAIRS = {"size": ("width", "height"), "camera": ("azimuth", "elevation")}  # ours, of two of theirs
USUAL = "anti_aliasing antialias expand"  # arguments that here are always true
# What others call an argument -> what to do instead.
REMEDIES = {
    "flags order resample interpolation resampling": "it averages where a picture shrinks and "
    "interpolates where it grows; where there are interpolation= and filter=, they take others",
    "mode bordermode border_mode padding_mode boundary": "edge= says what lies beyond a picture",
    "bordervalue border_value cval": "fill= is the value where nothing is known",
    "dsize size": "shape=(height, width) is the size, in px",
    "scale fx fy": "resample_texture.scale(image, factor) scales; a share is resize(image, 0.5)",
    "anti_aliasing antialias": "results are always antialiased; leave it out",
    "expand": "without a shape the result holds all of the picture; leave it out",
    "vmin vmax": "window='low..high' is the range of values",
    "opacity": "transfer='gray:opacity=0.2' says how opaque voxels are, opacity_unit= per length",
    "width height": "size=(width, height) is in px",
    "azimuth elevation zoom": "camera=(azimuth, elevation, zoom), angles in degrees",
    "projection orthographic parallel_projection": "fov=0 is a parallel projection",
    "fov": "Camera.from_fov(degrees, height, width) makes a camera",
}
# What other programs call a choice -> what it is here: the first that an option has.
CHOICES = {
    "mip max maximum-intensity": "maximum",
    "minip min minimum-intensity": "minimum",
    "avg mean aip": "average",
    "attenuated-mip attenuated_mip": "attenuated",
    "sum": "additive",
    "dvr volume translucent": "composite",
    "surface isosurface": "first-hit",
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
    "meters metric distance": "z",
    "fill crop": "cover",
    "fit letterbox": "contain pad",
}
# What others call a part of a result -> what to take instead.
RESULTS = {
    "image array data pixels numpy": "np.asarray(result) has the levels that people see, rgba of a "
    "frame its light",
    "to_pil pil to_pillow": "to_image() makes a Pillow image",
    "show imshow plot display": "to_image().show() opens it; notebooks show what is returned",
    "write imwrite export": "save(path) writes it",
    "alpha mask": "coverage says how much of each pixel is covered",
}
# What others call a function -> what to do instead.
FUNCTIONS = {
    "load read imread": "open(path) opens a file; calls take paths, too",
    "open": "calls take paths and arrays as they are",
    "mip": 'render(volume, projection="maximum") shows the greatest values',
    "plot show imshow": "render(...).save(path) writes a picture; notebooks show what is returned",
    "warp_perspective warp_affine affine remap affine_transform": "warp(image, matrix or maps, "
    "shape) does that; resample_texture.like.opencv has OpenCV's names",
    "thumbnail": "resize(image, 64) makes the longer side 64 px",
    "rectify": "control_points(...) makes the matrix for warp; the command is resample-texture "
    "rectify",
    "map_coordinates": "warp(image, (map_x, map_y), shape) does that",
}


def answer(word: str, known: Collection[str], remedies: Mapping[str, str]) -> str:
    """Return what to write instead of a name that is not known, as the end of a sentence."""
    low = word.lower()
    remedy = next((text for words, text in remedies.items() if low in words.split()), "")
    if remedy:
        return f": {remedy}"
    from difflib import get_close_matches

    known = [name for name in known if not name.startswith("_")]
    close = get_close_matches(word, known, 1)
    hint = f", did you mean {close[0]!r}?" if close else ";"
    return f"{hint} known: {', '.join(known)}"


def choice_meant(given: str, choices: Collection[Any]) -> str:
    """Return the choice that another library's name means here; without one the name itself."""
    word = given.lower().replace("_", "-")
    meant = [ours.split() for theirs, ours in CHOICES.items() if word in theirs.split()]
    return next((one for every in meant for one in every if one in choices), given)


def ours_of(name: str, known: Collection[str]) -> str:
    """Return the option that a name means, of those known; empty if it means none."""
    if (own := name.replace("-", "_")) in known:
        return own
    alike = [every for words, every in ARGUMENTS.items() if name.lower() in words.split()]
    return next((one for every in alike for one in every if one in known), "")


def understood(call: str, given: dict[str, Any], known: Collection[str]) -> dict[str, Any]:
    """Return options under the names that they have here.

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
    TypeError: warp has no option 'fil', did you mean 'fill'? known: fill, threads
    """
    found: dict[str, Any] = {}
    for name, value in given.items():
        if value is True and name.lower() in USUAL.split() and name not in known:
            continue
        ours = ours_of(name, known)
        if name not in known and name.lower() in TURNED.split() and hasattr(value, "__len__"):
            value = tuple(value)[::-1]  # noqa: PLW2901
        if not ours or (ours == "edge" != name and not isinstance(value, str)):
            raise TypeError(f"{call} has no option {name!r}{answer(name, known, REMEDIES)}")
        if ours in found or (ours != name and ours in given):
            raise TypeError(f"{call} got {ours!r} twice, also as {name!r}")
        found[ours] = value
    return found


def takes(options: type | None = None) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a function so that keywords are understood, or refused with an answer.

    `options`: the `TypedDict` of further keywords.
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        code: Any = function.__code__
        named = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        known = {*named, *(() if options is None else options.__annotations__)}
        is_open = bool(code.co_flags & VARKEYWORDS) and options is None

        @wraps(function)
        def call(*args: P.args, **given: P.kwargs) -> R:
            for ours, both in PAIRS.items():
                if ours in known and not known & set(both) and given.keys() >= set(both):
                    given[ours] = tuple(given.pop(one) for one in both)
            if given.keys() <= known:
                return function(*args, **given)
            strange = {} if not is_open else {
                name: value for name, value in given.items() if ours_of(name, known) not in known
            }  # fmt: skip
            rest = {name: value for name, value in given.items() if name not in strange}
            made: Any = understood(function.__name__, rest, sorted(known))
            return function(*args, **made, **strange)  # type: ignore[arg-type]

        return call

    return decorated
