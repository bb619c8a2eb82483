"""Public names that are imported when they are first used, so that importing a package is quick."""

import os
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

NAMESAKE = (
    "the distributions `resample` and `hybrid-resample` are installed in one environment and both "
    "import as `resample`: pip uninstall resample, then pip install --force-reinstall --no-deps "
    "hybrid-resample, or give each an environment of its own"
)


def warn_of_namesake(folder: str) -> None:
    """Warn if another project's package of this name was installed over this one."""
    if os.path.exists(os.path.join(folder, "jackknife.py")):  # one of its modules; takes 5 µs
        import warnings

        warnings.warn(NAMESAKE, RuntimeWarning, stacklevel=3)


def installed_version() -> str:
    """Version of the distribution; what tells it takes 30 ms to import."""
    from importlib.metadata import version

    return version("hybrid-resample")


def attributes(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """`__getattr__` of a package: `homes` says in which module each public name lives.

    That is one of the package's own, or of the core by its full name. All know `__version__`.
    """

    def get(name: str) -> Any:
        if name == "__version__":
            return installed_version()
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = homes[name]
        whole = home if home.startswith("resample.") else f"{package}.{home}"
        return getattr(import_module(whole), name)

    return get


def listing(homes: Mapping[str, str]) -> Callable[[], list[str]]:
    """`__dir__` of a package: its public names."""
    return lambda: sorted([*homes, "__version__"])
