"""Build hook: add the kernel library from `make kernels`, and its platform tag, to wheels."""

import platform
import re
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER = Path("resample", "engine", "compiled")
NAMES = ("_kernels.abi3.so", "_kernels.pyd")  # tools/kernels/platforms.py: file_name
OLDEST = (2, 17)  # the oldest glibc used in tags


class KernelLibrary(BuildHookInterface):  # type: ignore[misc]
    """Build hook that adds the library to wheels that are not editable."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the library's file and the wheel's tag."""
        built = [name for name in NAMES if Path(self.root, FOLDER, name).exists()]
        if version != "standard" or not built:
            return
        library = Path(self.root, FOLDER, built[0])
        build_data["pure_python"] = False
        build_data["tag"] = f"cp311-abi3-{platform_tag(library.read_bytes())}"
        build_data["force_include"][str(library)] = str(FOLDER / built[0])


def platform_tag(library: bytes) -> str:
    """Platform tag of a shared library.

    On Linux it says the newest glibc version that the library needs, elsewhere the system that this
    Python was built for.
    """
    if sys.platform != "linux":
        return re.sub(r"[.-]", "_", sysconfig.get_platform())
    asked = {(int(a), int(b)) for a, b in re.findall(rb"GLIBC_(\d+)\.(\d+)", library)}
    major, minor = max({OLDEST, *asked})
    return f"manylinux_{major}_{minor}_{platform.machine()}"
