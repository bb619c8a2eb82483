"""Plugins by name: built-in and other packages' parts are entry points alike.

Every replaceable part is an entry point in a group `resample.<group>`. A package adds a plugin with
one line of its pyproject.toml; nothing is imported before it is used:

    [project.entry-points."resample.filters"]
    hann = "my_package:Hann"

If two packages define the same name, neither wins: both are listed as `distribution/name` and must
be named so. The bare name is refused with an error that names both.
"""

import difflib
import inspect
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from enum import StrEnum
from functools import cache, lru_cache, wraps
from itertools import chain
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from resample.calling import choice_meant
from resample.messages import shortly

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint, EntryPoints

GROUPS = (
    "apps",
    "clouds",
    "commands",
    "filters",
    "gaussians",
    "interpolations",
    "methods",
    "orders",
    "pages",
    "peers",
    "primitives",
    "projections",
    "readers",
    "reconstructions",
    "samples",
    "stores",
    "views",
    "warps",
)

OURS = {f"resample.{group}" for group in GROUPS}

# Parts in further packages of this project: package, group, names.
ELSEWHERE = {
    "hybrid-resample-cells": {"readers": "vtm vts vtu"},
    "hybrid-resample-comparisons": {
        "commands": "points.compare texture.compare volume.compare warp3d.compare",
        "methods": "area bilinear cubic lanczos4 oiio opencv-supersample",
        "orders": "axis-sheets image-sheets",
        "peers": "VTK",
        "primitives": "ewa inflate",
        "warps": "ldi mcmillan mcmillan-zbuffer mesh opencv subsample",
    },
    "hybrid-resample-formats": {"readers": "bioio cube fits hdf5 imaris mrc netcdf neuro vdb"},
    "hybrid-resample-labels": {"methods": "majority"},
    "hybrid-resample-meshes": {"commands": "texture.mesh", "pages": "texture.mesh"},
    "hybrid-resample-figures": {"commands": "texture.figures volume.figures warp3d.figures"},
    "hybrid-resample-particles": {"commands": "points.density", "pages": "points.density"},
    "hybrid-resample-zarr": {"commands": "volume.convert", "readers": "zarr", "stores": "zarr"},
}

REQUIRED = inspect.Parameter.empty  # marks a parameter without a default


def names(group: str) -> list[str]:
    """Sorted names of a group's plugins.

    `group`: one of `GROUPS`. Returns names accepted by `load` and `build`; `distribution/name`
    where two packages use one name. Raises LookupError: the group does not exist.
    """
    return sorted(_entries(group))


def missing(group: str, name: str) -> str:
    """Name of this project's package with a missing part; empty if unknown."""
    for package, parts in ELSEWHERE.items():
        if name in parts.get(group, "").split() and name not in _entries(group):
            kind = "method" if group in ("primitives", "warps") else _singular(group)
            return f"{kind} '{name}' is in {package}, which is not installed: pip install {package}"
    return ""


def distribution(group: str, name: str) -> str:
    """Name of the package that provides a plugin."""
    return _distribution(_entry(group, name))


def load(group: str, name: str) -> Any:
    """Import one plugin and no other.

    `group`, `name`: as listed by `names`. Returns the object of the entry point: in most groups a
    class that takes the user's choices. Raises LookupError: the name is unknown or
    claimed by two packages, or the plugin cannot be imported.
    """
    entry = _entry(group, name)
    try:
        return entry.load()
    except Exception as error:  # third-party modules may raise anything
        reason = f"{type(error).__name__}: {_one_line(error)}"
        owner = _distribution(entry)
        raise LookupError(
            f"{_singular(group)} {name!r} of {owner} cannot be imported: {reason}"
        ) from error


def build(group: str, spec: str) -> Any:
    """Create a plugin object from a specification.

    `group`: one of `GROUPS`. `spec`: `name` or `name:parameter=value,parameter=value`. Values are
    integers, numbers, `true`, `false` or text; a parameter with text as default takes its value
    literally. Returns the plugin called with the parameters: `gaussian:sigma=0.6` gives
    `Gaussian(sigma=0.6)`. Raises LookupError: as in `load`. Raises ValueError: a parameter is
    unknown, malformed, missing or rejected by the plugin.
    """
    name, colon, text = spec.partition(":")
    plugin = load(group, name)
    known = parameters(plugin)
    try:
        chosen = _parse(text, known) if colon else {}
        missing = [
            key for key, default in known.items() if default is REQUIRED and key not in chosen
        ]
        if missing:
            raise ValueError(f"needs {', '.join(missing)}")
    except ValueError as error:
        raise ValueError(f"{spec}: {error}; {name} takes {described(plugin)}") from None
    try:
        return plugin(**chosen)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{spec}: {_one_line(error)}") from error


def check(group: str, specs: Iterable[str]) -> None:
    """Reject plugins that `build` would reject, before any work is done.

    `group`, `specs`: as in `build`. Raises LookupError, ValueError: as in `build`.
    """
    for spec in specs:
        build(group, spec)


def parameters(plugin: Any) -> dict[str, Any]:
    """Parameters of a plugin with their defaults; `REQUIRED` without one."""
    return dict(_parameters(plugin))


@cache
def _parameters(plugin: Any) -> dict[str, Any]:
    open_ended = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    signature = inspect.signature(plugin)
    return {n: p.default for n, p in signature.parameters.items() if p.kind not in open_ended}


def described(plugin: Any) -> str:
    """Parameters of a plugin in one line: `sigma=0.5, radius=None`."""
    return ", ".join(map(_default, parameters(plugin).items())) or "no parameters"


def _default(parameter: tuple[str, Any]) -> str:
    name, default = parameter
    if default is REQUIRED:
        return name
    return f"{name}={default:.4g}" if isinstance(default, float) else f"{name}={default}"


def entry_points(*, group: str) -> "EntryPoints":
    """Entry points of a group; `importlib.metadata`, imported here, takes 20 ms."""
    return _installed(tuple(sys.path)).select(group=group)


@cache
def _installed(path: tuple[str, ...]) -> "EntryPoints":  # noqa: ARG001 - part of the cache's key
    """Entry points of all groups, cached (5 ms) while `sys.path` stays the same."""
    from importlib import metadata

    every: Any = metadata.entry_points()
    if isinstance(every, dict):  # Python 3.11: by group
        every = chain.from_iterable(dict.values(every))
    return metadata.EntryPoints(each for each in every if each.group in OURS)


def _entries(group: str) -> "dict[str, EntryPoint]":
    """Entry points by public name; a name that two packages use is qualified."""
    if group not in GROUPS:
        raise LookupError(f"there are no {group!r}; plugins come as {', '.join(GROUPS)}")
    return _named(group, tuple(sys.path), entry_points)


@cache
def _named(
    group: str,
    path: tuple[str, ...],  # noqa: ARG001 - part of the cache's key
    find: "Callable[..., EntryPoints]",
) -> "dict[str, EntryPoint]":
    """Entry points of a group by public name, cached while `sys.path` stays the same."""
    found = find(group=f"resample.{group}")
    uses = Counter(entry.name for entry in found)
    return {
        entry.name if uses[entry.name] == 1 else f"{_distribution(entry)}/{entry.name}": entry
        for entry in found
    }


def _entry(group: str, name: str) -> "EntryPoint":
    known = _entries(group)
    if name in known:
        return known[name]
    kind, meant = _singular(group), choice_meant(name, known)
    if meant in known:
        return known[meant]
    rivals = sorted(other for other in known if other.rpartition("/")[2] == name)
    if len(rivals) > 1:
        owners = " and ".join(rival.rpartition("/")[0] for rival in rivals)
        raise LookupError(f"{kind} {name!r} comes from {owners}; say {' or '.join(rivals)}")
    if absence := missing(group, name):
        raise LookupError(absence)
    close = difflib.get_close_matches(name, known, n=1)
    hint = f", did you mean {close[0]!r}?" if close else ";"
    listed = ", ".join(sorted(known)) or "none"
    raise LookupError(f"unknown {kind} {name!r}{hint} known {group}: {listed}")


def _distribution(entry: "EntryPoint") -> str:
    return entry.dist.name if entry.dist else "an unnamed package"


def _singular(group: str) -> str:
    return group.removesuffix("s")


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


def _parse(text: str, known: dict[str, Any]) -> dict[str, Any]:
    """Parameters written as `key=value,key=value`."""
    chosen: dict[str, Any] = {}
    for part in text.split(","):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not (key and equals and value):
            raise ValueError(f"{part!r} is not of the form parameter=value")
        if key not in known:
            raise ValueError(f"there is no parameter {key!r}")
        if key in chosen:
            raise ValueError(f"{key} is given twice")
        chosen[key] = _value(key, value, known[key])
    return chosen


def _value(key: str, text: str, default: Any) -> Any:
    """Convert a value's text to the type of the parameter's default."""
    if isinstance(default, str):
        return text
    if default is None and text.lower() == "none":
        return None
    value: int | float | bool | str = text == "true" if text in ("true", "false") else text
    for kind in (float, int):  # an int, if it is one
        with suppress(ValueError):
            value = kind(text)
    if isinstance(default, bool) and not isinstance(value, bool):
        raise ValueError(f"{key} is true or false, not {text!r}")
    if isinstance(default, int | float) and type(value) not in (int, float, type(default)):
        raise ValueError(f"{key} is a number, not {text!r}")
    return value


R = TypeVar("R")


def once(make: Callable[..., R]) -> Callable[..., R]:
    """Memoize a function of a frozen dataclass, which cannot change, and of other keys.

    Computing tables takes longer than painting a small picture. The results are read only. For
    other objects, such as those of plugins that are not hashable, it is called each time.
    """
    kept = lru_cache(maxsize=64)(make)

    @wraps(make)
    def made(choice: Any, *others: Any) -> R:
        parameters = getattr(type(choice), "__dataclass_params__", None)
        if parameters is None or not parameters.frozen:
            return make(choice, *others)
        try:
            hash(choice)
        except TypeError:  # some field is not hashable
            return make(choice, *others)
        return kept(choice, *others)

    return made


T = TypeVar("T")
E = TypeVar("E", bound=StrEnum)
N = TypeVar("N", bound=str)
# What an object of a group has; all but orders are called with distances, or places.
MEMBER = {"orders": "summing", "projections": "check"}


def plugin_of(group: str, given: Any, name: str = "") -> Any:
    """Return a plugin's object, given as such or as `build` takes it; else raise its errors.

    `name`: of the argument, for the error; "": the group's.
    """
    if isinstance(given, str):
        return build(group, given)
    if isinstance(given, type) or not hasattr(given, MEMBER.get(group, "radius")):
        known = ", ".join(names(group))
        raise ValueError(f"{name or group[:-1]} {shortly(given)}; known {group}: {known}")
    return given


class _Held(Generic[T]):
    """Field of a frozen dataclass that holds an object, and is set by what stands for one."""

    default: T

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, choices: object, owner: type | None = None) -> T:
        """Return the object; of the class, the default."""
        return self.default if choices is None else cast(T, vars(choices)[self.name])

    def _is_default(self, given: object) -> bool:
        return given is None and self.default is None


class ByName(_Held[T]):
    """Field of a frozen dataclass that holds an object, and may be set by a plugin's name.

    Examples
    --------
    >>> from resample import Resampler
    >>> Resampler(order="every-sample:thickness=2").order
    EverySample(thickness=2, key='depth')
    """

    def __init__(self, group: str, default: T) -> None:
        self.group, self.default = group, default

    def __set__(self, choices: object, given: T | str) -> None:
        found = None if self._is_default(given) else plugin_of(self.group, given, self.name)
        vars(choices)[self.name] = found


class OneOf(_Held[T], Generic[T, N]):
    """Field of a frozen dataclass that holds an enumeration's member, and may be set by its text.

    Examples
    --------
    >>> from resample import Resampler
    >>> Resampler(opacity="linear").opacity
    <Opacity.LINEAR: 'linear'>
    """

    def __init__(self, kind: type[StrEnum], default: T) -> None:
        self.kind, self.default = kind, default

    def __set__(self, choices: object, given: T | N) -> None:
        found = None if self._is_default(given) else member_of(self.kind, given, self.name)
        vars(choices)[self.name] = found


def member_of(kind: type[E], given: Any, name: str) -> E:
    """Return a member of an enumeration, given as such or as its text."""
    if not isinstance(given, str) or given not in list(kind):
        raise ValueError(f"{name} {shortly(given)}; known: {', '.join(kind)}")
    return kind(given)
