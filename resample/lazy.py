"""Lazy import of public names, so that importing a package is fast."""

import os
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, TypeVar

T = TypeVar("T")

NAMESAKE = (
    "the distributions `resample` and `hybrid-resample` are installed in one environment and both "
    "import as `resample`: pip uninstall resample, then pip install --force-reinstall --no-deps "
    "hybrid-resample, or give each an environment of its own"
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


def attributes(
    package: str, homes: Mapping[str, str], former: Mapping[str, str] | None = None
) -> Callable[[str], Any]:
    """`__getattr__` of a package; `homes` maps each public name to its module.

    A module is named within the package, or in full if in the core. `__version__` is included.
    Names of the release before, in `former`, warn and give what has the new one: a name of the
    package, or of another in full (`resample_points.Cloud`).
    """

    def get(name: str) -> Any:
        if name == "__version__":
            return installed_version()
        if former is not None and name in former:
            home, dot, new = former[name].rpartition(".")
            warn_of_old_name(f"{package}.{name}", f"{home or package}.{new}")
            if dot:
                return getattr(import_module(home), new)
            name = new
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = homes[name]
        whole = home if home.startswith("resample.") else f"{package}.{home}"
        return getattr(import_module(whole), name)

    return get


def listing(homes: Mapping[str, str]) -> Callable[[], list[str]]:
    """`__dir__` of a package: its public names."""
    return lambda: sorted([*homes, "__version__"])


def warn_of_old_name(old: str, new: str) -> None:
    """Warn whoever uses a name that was another in the release before."""
    import warnings

    warnings.warn(
        f"{old} is now {new}; the old name goes with the next release",
        DeprecationWarning,
        stacklevel=3,
    )


def renamed(module: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """`__getattr__` of a module in which some public names are new: the old ones warn.

    Names that moved to another module are named in full.
    """

    def get(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home, _, new = names[name].rpartition(".")
        warn_of_old_name(f"{module}.{name}", f"{home or module}.{new}")
        return getattr(import_module(home or module), new)

    return get


def old_members(**names: str) -> Callable[[type[T]], type[T]]:
    """Decorator of a class in which some public members are new: the old ones warn."""

    def decorated(kind: type[T]) -> type[T]:
        for old, new in names.items():
            setattr(kind, old, _old_member(kind.__name__, old, new))
        return kind

    return decorated


def _old_member(kind: str, old: str, new: str) -> property:
    """A property that reads a member by its new name."""

    def get(self: Any) -> Any:
        warn_of_old_name(f"{kind}.{old}", f"{kind}.{new}")
        return getattr(self, new)

    return property(get)


def moved(package: str, folders: Mapping[str, str]) -> None:
    """Let folders of a package be imported by the names that they had, with a warning."""
    names = {f"{package}.{old}": f"{package}.{new}" for old, new in folders.items()}
    sys.meta_path.insert(0, _Moved(names))


class _Moved:
    """Finds modules by names that they had; first of all, or files would be loaded twice."""

    def __init__(self, folders: Mapping[str, str]) -> None:
        self.folders = folders

    def find_spec(self, name: str, *_: Any) -> ModuleSpec | None:
        """What loads the module that has another name now."""
        for old, new in self.folders.items():
            if name == old:
                warn_of_old_name(old, new)
            if name == old or name.startswith(f"{old}."):
                loader: Any = _NewHome(new + name[len(old) :])
                return ModuleSpec(name, loader)
        return None


class _NewHome:
    """Gives the module of a new name for an old one."""

    def __init__(self, name: str) -> None:
        self.name = name

    def create_module(self, _: ModuleSpec) -> ModuleType:
        """Import it as it is called now."""
        module = import_module(self.name)
        self.spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Leave it as it is: it was run when it was imported."""
        module.__spec__ = self.spec
