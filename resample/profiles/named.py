"""Fields of dataclasses that take names: of plugins, or of the members of an enumeration."""

from collections.abc import Callable
from enum import StrEnum
from functools import lru_cache, wraps
from typing import Any, Generic, TypeVar, cast

from resample import registry
from resample.messages import shortly

R = TypeVar("R")


def once(make: Callable[..., R]) -> Callable[..., R]:
    """Memoize a function of a frozen dataclass, which cannot change, and of other keys.

    Computing tables takes longer than painting a small picture. The results are read only. For
    other objects, such as plugins' that are not hashable, it is called each time.
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
    """Return a plugin's object, given as such or by its name with parameters.

    Parameters
    ----------
    group
        One of `registry.GROUPS`.
    given
        An object, or an argument of `registry.build`.
    name
        Of the argument, for the error; "": the group's.

    Raises
    ------
    LookupError, ValueError
        As in `registry.build`; or the object does not belong to the group.
    """
    if isinstance(given, str):
        return registry.build(group, given)
    if isinstance(given, type) or not hasattr(given, MEMBER.get(group, "radius")):
        known = ", ".join(registry.names(group))
        raise ValueError(f"{name or group[:-1]} {shortly(given)}; known {group}: {known}")
    return given


class _Held(Generic[T]):
    """Field of a frozen dataclass that holds an object, and is set by name or object."""

    default: T

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, choices: object, owner: type | None = None) -> T:
        """Return the object, or on the class the default."""
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
    """Return a member of an enumeration, given as such or as its text.

    Raises
    ------
    ValueError
        The name is unknown.
    """
    if not isinstance(given, str) or given not in list(kind):
        raise ValueError(f"{name} {shortly(given)}; known: {', '.join(kind)}")
    return kind(given)
