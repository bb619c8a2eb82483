"""Lazy import of public names, so that importing a package is fast."""

import os
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from types import ModuleType
from typing import Any, TypeVar

T = TypeVar("T")

NAMESAKE = (
    "the distributions `resample` and `hybrid-resample` are installed in one environment and both "
    "import as `resample`: pip uninstall resample, then pip install --force-reinstall --no-deps "
    "hybrid-resample, or give each its own environment"
)


def warn_of_namesake(folder: str) -> None:
    """Warn if another project's package of the same name was installed over this one."""
    if os.path.exists(os.path.join(folder, "jackknife.py")):  # one of its modules; takes 5 µs
        import warnings

        warnings.warn(NAMESAKE, RuntimeWarning, stacklevel=3)


def installed_version() -> str:
    """Version of the distribution; `importlib.metadata`, imported here, takes 30 ms."""
    from importlib.metadata import version

    return version("hybrid-resample")


def attributes(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """`__getattr__` of a package; `homes` maps each public name to its module.

    A module is named within the package, or in full if in the core; after a colon, the object's own
    name in it, nothing for the module itself. `__version__` is included.
    """

    def get(name: str) -> Any:
        if name == "__version__":
            return installed_version()
        if name not in homes and not name.startswith("_"):
            from resample.calling import PRESETS, alias_of

            if alias := alias_of(name, homes):
                return get(alias)
            for words, (ours, choices) in PRESETS.items():
                if name.lower() in words.split() and ours in homes:
                    return partial(get(ours), **choices)
        if name not in homes:
            raise AttributeError(
                f"module {package!r} has no attribute {name!r}{_hint(name, homes)}"
            )
        home, colon, other = homes[name].partition(":")
        whole = home if home.startswith("resample.") else f"{package}.{home}"
        module = import_module(whole)
        return module if colon and not other else getattr(module, other or name)

    return get


def _hint(name: str, homes: Mapping[str, str]) -> str:
    """Suggestion for a name that users guess; nothing for names that Python looks up."""
    if name.startswith("_"):
        return ""
    from resample.calling import FUNCTIONS, answer

    return answer(name, list(homes), FUNCTIONS)


def moved(home: str, package: str) -> Callable[[str], Any]:
    """`__getattr__` of a module with names that moved to another package of this project.

    `home`: the module that has them.
    """

    def get(name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(f"names are in {home} now")
        return getattr(elsewhere(home, package), name)

    return get


def elsewhere(home: str, package: str) -> ModuleType:
    """Import a module of another package of this project; the error names the package."""
    try:
        return import_module(home)
    except ModuleNotFoundError as error:
        if error.name != home.partition(".")[0]:
            raise
        raise ModuleNotFoundError(
            f"{home} is in {package}, which is not installed: pip install {package}"
        ) from None


def listing(homes: Mapping[str, str]) -> Callable[[], list[str]]:
    """`__dir__` of a package: its public names."""
    return lambda: sorted([*homes, "__version__"])
