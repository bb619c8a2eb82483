"""What the library of kernels is on each platform: processor level, compiler options, file name.

Tried on Linux (x86-64, and aarch64 in an emulator); docs/developers.md says what was not.
"""

import os
import platform
import shlex
import sys
import sysconfig
from pathlib import Path
from typing import NamedTuple

# Functions of the C library that are called through runtime.c (FIRST).
WRAPPED = ("exp", "exp2", "log", "log2", "pow", "expf", "exp2f", "logf", "log2f", "powf")
WRAPPED += ("hypot", "hypotf", "fmod", "fmodf")


class Level(NamedTuple):
    """What machine code asks of a processor, in LLVM's names."""

    cpu: str
    features: str = ""


# What the marshaller checks (`lacking`): the first level always, the second for WIDE kernels.
X86_64_V3 = Level(
    "x86-64-v3",
    "+avx,+avx2,+bmi,+bmi2,+cx16,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sahf,+sse4.2,+xsave",
)
X86_64_V4 = Level(
    "x86-64-v4",
    f"{X86_64_V3.features},+avx512f,+avx512bw,+avx512cd,+avx512dq,+avx512vl",
)
LEVELS = {
    ("linux", "x86_64"): X86_64_V3,
    ("win32", "AMD64"): X86_64_V3,
    ("linux", "aarch64"): Level("generic", "+fp-armv8,+neon"),  # any 64-bit processor of ARM's
    ("darwin", "arm64"): Level("apple-m1"),
}


def level() -> Level | None:
    """Level of this platform; None if no library is built for it."""
    return LEVELS.get((sys.platform, platform.machine()))


def wide_level() -> Level | None:
    """Second level, for which some kernels are included again; None if there is none."""
    return X86_64_V4 if level() == X86_64_V3 else None


def file_name() -> str:
    """Name of the library's file, as Python finds modules of its stable interface."""
    return "_kernels.pyd" if sys.platform == "win32" else "_kernels.abi3.so"


def compiler() -> list[str]:
    """Command of the C compiler: $CC, or what understands the code on this platform."""
    return shlex.split(os.environ.get("CC", "clang" if sys.platform == "win32" else "cc"))


def options() -> list[str]:
    """Options for the C compiler that link a module of Python's."""
    common = ["-O2", "-Wall", "-Wextra"]
    match sys.platform:
        case "win32":
            stable = Path(sysconfig.get_config_var("installed_base"), "libs")
            return [*common, "-shared", f"-L{stable}", "-lpython3"]
        case "darwin":
            found_later = ["-bundle", "-undefined", "dynamic_lookup"]
            return [*common, *found_later, "-fvisibility=hidden", "-Wl,-dead_strip", "-Wl,-x"]
    linked = ["--strip-all", "-Bsymbolic", "--gc-sections", *(f"--wrap={name}" for name in WRAPPED)]
    shared = ["-shared", "-fPIC", "-fvisibility=hidden", "-lm"]
    return [*common, *shared, *(f"-Wl,{each}" for each in linked)]
