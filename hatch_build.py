"""Build hook: add the kernel library from `make kernels`, and its platform tag, to wheels."""

import platform
import re
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

LIBRARY = Path("resample", "engine", "compiled", "_kernels.abi3.so")
OLDEST = (2, 17)  # the oldest glibc used in tags


class KernelLibrary(BuildHookInterface):  # type: ignore[misc]
    """Build hook that adds the library to wheels that are not editable."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the library's file and the wheel's tag."""
        library = Path(self.root) / LIBRARY
        if version != "standard" or not library.exists():
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"cp311-abi3-{platform_tag(library.read_bytes())}"
        build_data["force_include"][str(library)] = str(LIBRARY)


def platform_tag(library: bytes) -> str:
    """Platform tag of a shared library, from the newest glibc version that it needs."""
    machine = platform.machine()
    if sys.platform != "linux":
        raise ValueError(f"the library of kernels is built for Linux, not for {sys.platform}")
    asked = {(int(a), int(b)) for a, b in re.findall(rb"GLIBC_(\d+)\.(\d+)", library)}
    major, minor = max({OLDEST, *asked})
    return f"manylinux_{major}_{minor}_{machine}"
