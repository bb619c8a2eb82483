"""Commands on a failing machine: no memory, full disk, no write access, no reader.

    python -m benchmarks.faults

Every command of `benchmarks.signals` is run with every fault. It must end with status 0 or 2 and
one line, without a traceback, and its target must be complete or unchanged. Kernels are compiled
first.
"""

import argparse
import contextlib
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.signals import COMMANDS, PATIENCE, content, ended, inputs, is_whole, remove

RIGHTS = "-dac_override,-dac_read_search"  # capabilities by which root may write everywhere


class Fault(NamedTuple):
    """A fault of the machine."""

    begins: Callable[[], object] | None = None  # called in the process before the command
    folder: str = ""  # of the target
    variables: Mapping[str, str] = {}
    within: tuple[str, ...] = ()  # program that runs the command
    together: int = 1  # number of commands with the same target
    is_unread: bool = False  # whether its output is not read
    ahead: float = 0.0  # seconds by which file times are in the future: the clock went back
    is_refused: bool = True  # otherwise the command may succeed


def limited(kind: int, count: int) -> Callable[[], object]:
    """Set a resource limit of this process."""
    return lambda: resource.setrlimit(kind, (count, count))


def without_streams() -> None:
    """Close stdin, stdout and stderr."""
    os.closerange(0, 3)


FAULTS = {
    "disk full": Fault(limited(resource.RLIMIT_FSIZE, 64)),
    "addresses": Fault(limited(resource.RLIMIT_AS, 700 << 20), is_refused=False),
    "fewer addresses": Fault(limited(resource.RLIMIT_AS, 400 << 20), is_refused=False),
    "data": Fault(limited(resource.RLIMIT_DATA, 300 << 20), is_refused=False),
    "few files": Fault(limited(resource.RLIMIT_NOFILE, 24), is_refused=False),
    "no folder": Fault(folder="gone/"),
    "no cache": Fault(variables={"NUMBA_CACHE_DIR": "/proc/none"}, is_refused=False),
    "no home": Fault(variables={"HOME": "/proc/none"}, is_refused=False),
    "two at once": Fault(together=2, is_refused=False),
    "nobody reads": Fault(is_unread=True, is_refused=False),
    "no streams": Fault(without_streams, is_refused=False),
    "clock back": Fault(ahead=3e7, is_refused=False),
}
IS_ROOT = hasattr(os, "getuid") and os.getuid() == 0
if shutil.which("setpriv") or not IS_ROOT:
    within = ("setpriv", "--bounding-set", RIGHTS) if IS_ROOT else ()
    FAULTS["read-only folder"] = Fault(folder="locked/", within=within)


def begun(target: str, fault: Fault) -> subprocess.Popen[str]:
    """Start a command in this folder, with a fault."""
    if fault.ahead:
        for file in (file for file in Path().rglob("*") if file.is_file()):
            os.utime(file, (time.time() + fault.ahead,) * 2)
    process = subprocess.Popen(
        [*fault.within, sys.executable, "-m", *COMMANDS[target], fault.folder + target],
        stdout=subprocess.PIPE if fault.is_unread else subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **fault.variables},
        preexec_fn=fault.begins,  # noqa: PLW1509  no threads here
    )
    if process.stdout is not None:
        process.stdout.close()
    return process


def wrong_with(target: str, fault: Fault, *, is_there: bool) -> Iterator[str]:
    """Run a command with a fault; yields what is wrong with the result."""
    place = Path(target)
    remove(place)
    if is_there and place.suffix != ".zarr":  # stores are not overwritten
        place.write_bytes(b"old")
    before = content(place)
    processes = [begun(target, fault) for _ in range(fault.together)]
    for process in processes:
        said = process.communicate(timeout=PATIENCE)[1]
        ends = (2,) if fault.is_refused else (0, 2)
        if process.returncode not in ends or "Traceback" in said:
            yield f"status {process.returncode}: {said[-500:]}"
        if process.returncode == 2 and said.count("error: ") != 1:
            yield f"said {said[-500:]}"
    ends_well = any(process.returncode == 0 for process in processes)
    if not is_whole(place) and (ends_well or content(place) != before):
        yield "its target is damaged"


def main(arguments: Sequence[str]) -> int:
    """Run all; returns 1 if a command misbehaves."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description=__doc__)
    parser.add_argument("--only", default="", help="one target, such as a.png")
    parser.add_argument("--fault", default="", help=", ".join(FAULTS))
    choices = parser.parse_args(arguments)
    targets = [name for name in COMMANDS if choices.only in name]
    faults = {name: fault for name, fault in FAULTS.items() if choices.fault in name}
    found = 0
    with tempfile.TemporaryDirectory(prefix="faults-") as folder, contextlib.chdir(folder):
        inputs()
        Path("locked").mkdir(mode=0o555)
        for target in targets:
            ended(target)
            for n, (name, fault) in enumerate(faults.items()):
                remove(Path(f".{target}.frames"))  # interrupted films would be resumed
                for wrong in wrong_with(target, fault, is_there=n % 2 == 0):
                    found += 1
                    sys.stdout.write(f"{target}, {name}: {wrong}\n")
                    sys.stdout.flush()
            remove(Path(f".{target}.frames"))
    sys.stdout.write(f"{len(targets) * len(faults)} runs, {found} faults\n")
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
