"""Run cases of the tests against mutants, each in a process of its own that a worker forks."""

import gc
import importlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from tools.mutants.sites import Site

# What tests and the sources import and mutants do not change; forked processes have it at once.
LIBRARIES = (
    *("numpy", "numba", "scipy.ndimage", "scipy.spatial", "scipy.special", "scipy.optimize"),
    *("scipy.sparse", "scipy.interpolate", "cv2", "PIL.Image", "pydantic"),
    *("cyclopts", "rich.console", "pytest", "hypothesis", "docstring_parser", "platformdirs"),
    *("numba.core.typed_passes", "llvmlite.binding", "numba.np.ufunc", "SimpleITK", "matplotlib"),
    *("zarr", "anyio", "trimesh", "jinja2", "scipy.stats", "pytest_httpserver"),
)
PATIENCE = 12  # wall seconds for each CPU second that a run may take
MEMORY = 12 << 30  # bytes of address space
SHORT = 300  # letters of a message
CRASHES = (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL)
FIRST = 3  # files of tests that are tried before others
LINES = 12  # of what pytest says where it fails itself


class Outcome(NamedTuple):
    """What became of the tests of a mutant."""

    status: str  # killed, survived, stuck (at its limit of CPU time) or unreached
    cpu: float  # seconds
    tried: int  # cases
    killed_by: Sequence[str] = ()
    message: str = ""


class Watch:
    """Plugin of pytest: runs the wanted cases alone, and notes failures in a file."""

    def __init__(self, cases: list[str], notes: Path) -> None:
        self.place = {case: n for n, case in enumerate(cases)}
        self.notes = notes

    def _note(self, **facts: object) -> None:
        with self.notes.open("a") as file:
            file.write(json.dumps(facts) + "\n")

    def pytest_collection_modifyitems(self, config: Any, items: list[Any]) -> None:
        """Keep the wanted cases that `make test` runs, file by file."""
        files: dict[str, int] = {}
        for case, n in self.place.items():
            files.setdefault(case.partition("::")[0], n)
        wanted = [
            item
            for item in items
            if item.nodeid in self.place and not item.get_closest_marker("sweep")
        ]
        others = set(items) - set(wanted)
        config.hook.pytest_deselected(items=list(others))
        items[:] = sorted(
            wanted,
            key=lambda item: (files[item.nodeid.partition("::")[0]], self.place[item.nodeid]),
        )

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed:
            self._note(failed=report.nodeid, why=_last_line(report.longreprtext))

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._note(begun=nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self._note(failed=report.nodeid, why=_last_line(report.longreprtext))


def _last_line(text: str) -> str:
    told = [line for line in text.splitlines() if line.startswith("E ")]
    return (told or text.splitlines() or [""])[0][:SHORT]


def set_environment(folder: Path, root: Path) -> None:
    """Let this process and those that it starts keep kernels in a folder of their own.

    The folder begins with links to the user's kernels: what is there need not be compiled again,
    and kernels of mutants do not get there. Before numba is imported, which reads the variables.
    """
    from platformdirs import user_cache_dir

    kept = Path(os.environ.get("HYBRID_RESAMPLE_CACHE") or user_cache_dir("hybrid-resample"))
    kernels = Path(os.environ.get("NUMBA_CACHE_DIR") or kept / "kernels")
    (folder / "kernels").mkdir(parents=True, exist_ok=True)
    for file in kernels.glob("*.kernel"):
        with suppress(OSError):
            os.link(file, folder / "kernels" / file.name)
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    data = os.environ.get("RESAMPLE_TEST_DATA") or (root / "../shared/data").resolve()
    os.environ |= {
        "NUMBA_CACHE_DIR": str(folder / "kernels"),
        "NUMBA_NUM_THREADS": "2",
        "RESAMPLE_LOG": "warning",
        "RESAMPLE_TEST_DATA": str(data),
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # their assertions need no rewriting
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]),
    }


def import_libraries() -> None:
    """Import what is large, and nothing of this repository."""
    for name in LIBRARIES:
        with suppress(ImportError):
            importlib.import_module(name)
    gc.freeze()  # forked processes need not look at what there is


def copied(root: Path, folder: Path) -> Path:
    """Copy a repository's files, with their byte code and without what git ignores."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True).stdout
    files = [root / name for name in listed.split("\0") if name]
    folders = {file.parent for file in files if file.suffix == ".py"}
    files += [file for each in folders for file in each.glob("__pycache__/*.pyc")]
    for file in files:
        if file.is_file():
            target = folder / file.relative_to(root)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(file, target)
    return folder


class Worker:
    """A copy of the repository, in which one mutant after the other is tried."""

    def __init__(self, root: Path, folder: Path, seconds: float) -> None:
        self.root = copied(root, folder / "repository")
        self.folder = folder
        self.seconds = seconds  # CPU time of a mutant
        self._count = 0

    def run(self, cases: list[str], site: Site | None = None) -> Outcome:
        """Run cases until one fails, against a mutant or the sources as they are.

        To import a file of tests takes as long as many cases: the first few files are tried alone.
        """
        files = list(dict.fromkeys(case.partition("::")[0] for case in cases))
        parts = [files[:FIRST], files[FIRST:]] if site is not None else [files]
        cpu, tried = 0.0, 0
        with self._mutated(site):
            for part in filter(None, parts):
                some = [case for case in cases if case.partition("::")[0] in part]
                outcome = self._outcome(some, is_mutant=site is not None)
                cpu, tried = cpu + outcome.cpu, tried + outcome.tried
                if outcome.status != "survived":
                    return outcome._replace(cpu=cpu, tried=tried)
        return Outcome("survived" if tried else "unreached", cpu, tried)

    def _outcome(self, cases: list[str], *, is_mutant: bool) -> Outcome:
        """Run cases in a forked process and read its notes."""
        scratch = Path(tempfile.mkdtemp(dir=self.folder))
        status, cpu = self._forked(cases, scratch, is_mutant=is_mutant)
        notes = scratch / "notes"
        told = [json.loads(line) for line in notes.open()] if notes.exists() else []
        output = (scratch / "output").read_text(errors="replace").split("\n")[-LINES:]
        shutil.rmtree(scratch, ignore_errors=True)
        failed = list(dict.fromkeys(note["failed"] for note in told if "failed" in note))
        begun = [note["begun"] for note in told if "begun" in note]
        if failed:
            why = next(note["why"] for note in told if "failed" in note)
            return Outcome("killed", cpu, len(begun), failed, why)
        if -status in CRASHES:
            return Outcome("killed", cpu, len(begun), begun[-1:], f"crashed: status {status}")
        if status != 0:
            why = "\n".join([*output, f"status {status}"])
            return Outcome("stuck", cpu, len(begun), begun[-1:], why)
        return Outcome("survived", cpu, len(begun))

    @contextmanager
    def _mutated(self, site: Site | None) -> Iterator[None]:
        """Put a fault into its file for a while; a time of change of its own outdates byte code."""
        if site is None:
            yield
            return
        path = self.root / site.file
        raw, known = path.read_bytes(), path.stat()
        self._count += 1
        path.write_bytes(raw[: site.begin] + site.new.encode() + raw[site.end :])
        os.utime(path, (known.st_atime, known.st_mtime - self._count))
        try:
            yield
        finally:
            path.write_bytes(raw)
            os.utime(path, (known.st_atime, known.st_mtime))

    def _forked(self, cases: list[str], scratch: Path, *, is_mutant: bool) -> tuple[int, float]:
        """Exit status and CPU time of pytest in a forked process."""
        process = os.fork()
        if process == 0:
            status = 70
            try:
                os.setsid()
                limit = int(self.seconds if is_mutant else 20 * self.seconds)
                resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
                resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
                status = self._test(cases, scratch, is_mutant=is_mutant)
            except BaseException:
                (scratch / "output").open("a").write(traceback.format_exc())
            finally:
                os._exit(status)
        begin = time.monotonic()
        while True:
            ended, status, used = os.wait4(process, os.WNOHANG)
            if ended:
                break
            if time.monotonic() - begin > PATIENCE * self.seconds * (1 if is_mutant else 20):
                os.killpg(process, signal.SIGKILL)
            time.sleep(0.05)
        with suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)  # what it has started and left
        return os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime

    def _test(self, cases: list[str], scratch: Path, *, is_mutant: bool) -> int:
        """Run pytest in the copy, with a cache of its own for all but kernels."""
        import pytest

        output = os.open(scratch / "output", os.O_WRONLY | os.O_CREAT)
        nothing = os.open(os.devnull, os.O_RDONLY)
        for taken, stream in ((nothing, 0), (output, 1), (output, 2)):
            os.dup2(taken, stream)
        os.chdir(self.root)
        packages = [*self.root.glob("apps/*"), *self.root.glob("plugins/*")]
        tops = [str(self.root), *map(str, sorted(packages))]
        sys.path[:0] = tops
        os.environ["PYTHONPATH"] = os.pathsep.join(tops)
        os.environ["HYBRID_RESAMPLE_CACHE"] = str(scratch / "cache")
        sys.argv = ["pytest"]
        files = list(dict.fromkeys(case.partition("::")[0] for case in cases))
        options = ["-q", "-p", "no:cacheprovider", "-p", "pytest_httpserver.pytest_plugin"]
        options.append(f"--basetemp={scratch}/tests")
        options += ["-x"] if is_mutant else []
        watch = Watch(cases, scratch / "notes")
        status = pytest.main([*options, *files], plugins=[watch])
        return 0 if status in (0, 1, 5) else int(status)
