import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event, Timer

import numba
import numpy as np
import pytest
from numba.core.event import install_recorder

from resample import types
from resample.engine import jit, lookup
from resample.engine.ellipsoids.deferred import paint_runs
from tests.processes import PATIENCE, python

compiled_only = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="plain Python has no machine code to store"
)


@compiled_only
@pytest.mark.parametrize("compiled", [paint_runs, lookup.unit_lookup])
def test_the_name_of_a_cache_file_holds_the_digest_of_all_kernels(compiled):
    assert jit.SOURCES[:12] in jit.index_of(compiled).name


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """The package's kernels and types in a folder of our own, where the digest now looks."""
    kernels = Path(jit.__file__).parent
    shutil.copytree(
        kernels, tmp_path / "engine", ignore=shutil.ignore_patterns("__pycache__", "*.nb?")
    )
    shutil.copy(types.__file__, tmp_path / "types.py")
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "engine" / "jit.py"))
    return tmp_path


def test_the_digest_is_that_of_the_sources(copied):
    assert copied.is_dir()
    assert jit._digest() == jit.SOURCES


@pytest.mark.parametrize("source", ["engine/over.py", "engine/points/cells.py", "types.py"])
@pytest.mark.usefixtures("copied")
def test_a_changed_source_changes_the_digest(source, copied):
    with (copied / source).open("a") as text:
        text.write("\n# a comment\n")
    assert jit._digest() != jit.SOURCES


def test_a_new_kernel_changes_the_digest(copied):
    (copied / "engine" / "another.py").write_text("ANSWER = 42\n")
    assert jit._digest() != jit.SOURCES


@compiled_only
def test_bounds_checks_have_a_cache_of_their_own(monkeypatch):
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    cache = jit._SourceAwareCache(lookup.unit_lookup.__wrapped__)
    assert "-checked" in Path(cache._cache_file._index_path).name


@compiled_only
@pytest.mark.parametrize(
    "flag",
    ["SLP_VECTORIZE=1", "LOOP_VECTORIZE=0", "OPT=1", "CPU_NAME=generic", "CPU_FEATURES=+sse2"],
)
def test_a_trial_of_the_compilers_flags_has_a_cache_of_its_own(flag):
    name, value = flag.split("=", 1)
    code = "from resample.engine import jit, lookup; print(jit.index_of(lookup.unit_lookup).name)"
    changed = python(f"import os; os.environ['NUMBA_{name}'] = '{value}'\n{code}")
    assert changed.strip() != jit.index_of(lookup.unit_lookup).name


@compiled_only
def test_a_flag_that_is_set_later_leaves_nothing_in_the_cache(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    tried, kept = jit.kernel(double), jit.kernel(halve)
    monkeypatch.setattr(numba.config, "SLP_VECTORIZE", 1)
    assert tried(3.0) == 6.0
    assert not jit.index_of(tried).exists()
    monkeypatch.undo()
    assert kept(3.0) == 1.5
    assert jit.index_of(kept).exists()


@compiled_only
def test_packed_kernels_are_stored_under_the_flags_that_were_asked_for(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    packed, plain = jit.packed_kernel(add_one), jit.kernel(double)
    numbers = np.zeros(3)
    packed(numbers)
    assert jit.index_of(packed).exists()
    ends = [jit.index_of(kernel).stem.rpartition("-")[2] for kernel in (packed, plain)]
    assert ends[0] == ends[1]


def halve(number):
    return number / 2.0


def add_one(counter, numbers):
    if counter[0] == 0:
        counter[0] = 1
        numbers += 1.0


@compiled_only
def test_kernels_work_where_no_folder_can_be_written_to(monkeypatch):
    def refuse(_):
        raise OSError("read-only")

    monkeypatch.setattr("numba.core.caching._CacheLocator.ensure_cache_path", refuse)
    doubled = jit.kernel(double)
    assert doubled(3.0) == 6.0
    assert jit.index_of(doubled) is None


def double(number):
    return 2.0 * number


@compiled_only
def test_no_call_of_the_compiler_is_timed(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    with install_recorder("numba:llvm_lock") as heard, install_recorder("numba:compile") as made:
        assert jit.kernel(double)(2.0) == 4.0
    assert made.buffer
    assert not heard.buffer


def test_a_division_by_zero_is_infinite_as_in_numpy():
    with np.errstate(divide="ignore"):
        assert jit.kernel(inverse)(np.zeros(1)) == np.inf


def inverse(array):
    return 1.0 / array[0]


@pytest.mark.parametrize("count", [0, 1, 2, 10_000, None])
def test_the_number_of_threads_is_put_back(count):
    before = jit.workers()
    with jit.threads(count):
        assert 1 <= jit.workers() <= numba.config.NUMBA_NUM_THREADS
        if count == 1:
            assert jit.workers() == 1
    assert jit.workers() == before


def test_the_number_of_threads_is_put_back_after_an_error():
    before = jit.workers()
    with pytest.raises(KeyError), jit.threads(1):
        raise KeyError
    assert jit.workers() == before


def count_up(counter, done):
    for task in jit.tasks(counter, done.size):
        done[task] += 1


@pytest.mark.parametrize("count", [1, 2, None])
@pytest.mark.parametrize("size", [0, 1, 1000])
def test_every_task_is_done_once(count, size):
    done = np.zeros(size, np.int64)
    with jit.threads(count):
        jit.parallel_kernel(count_up)(done)
    assert (done == 1).all()


def test_parallel_kernels_can_be_called_from_many_threads():
    counted = jit.parallel_kernel(count_up)
    arrays = [np.zeros(100, np.int64) for _ in range(20)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(counted, arrays))
    assert all((done == 1).all() for done in arrays)


def fail_at_seven(counter, done):
    for task in jit.tasks(counter, done.size):
        if task == 7:
            raise ValueError("the seventh")
        done[task] = 1


def test_an_error_in_a_task_reaches_the_caller():
    with pytest.raises(ValueError, match="the seventh"):
        jit.parallel_kernel(fail_at_seven)(np.zeros(20))


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_process_that_is_forked_while_another_thread_compiles_can_compile():
    compiling, forking = Event(), Event()

    def compiles():
        with jit.global_compiler_lock:
            compiling.set()
            assert forking.wait(PATIENCE)

    with ThreadPoolExecutor(1) as threads:
        threads.submit(compiles)
        assert compiling.wait(PATIENCE)
        Timer(0.1, forking.set).start()  # the fork waits for it
        child = os.fork()
        if child == 0:
            signal.alarm(PATIENCE)
            with jit.global_compiler_lock, jit._packs:
                os._exit(0)
        assert os.waitpid(child, 0)[1] == 0


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_process_does_not_keep_others_from_compiling(tmp_path):
    ends, lives = os.pipe()
    with jit._in_turn(str(tmp_path / "index")):
        child = os.fork()
        if child == 0:
            os.close(lives)
            os.read(ends, 1)  # lives on, with all that was open
            os._exit(0)
    lock = os.open(tmp_path / "index.lock", os.O_RDWR)
    jit.fcntl.flock(lock, jit.fcntl.LOCK_EX | jit.fcntl.LOCK_NB)
    for opened in (lock, ends, lives):
        os.close(opened)
    os.waitpid(child, 0)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_parallel_kernels_work_after_a_fork():
    counted = jit.parallel_kernel(count_up)
    counted(np.zeros(9, np.int64))
    child = multiprocessing.get_context("fork").Process(
        target=counted, args=(np.zeros(9, np.int64),)
    )
    child.start()
    child.join(PATIENCE)
    assert child.exitcode == 0


WANTED = """
import sys
import numpy as np
from resample.engine import jit, lookup

print(jit.__file__, flush=True)
sys.stdin.readline()
lookup.unit_lookup(np.ones(4, np.float32), 0.5)
stats = lookup.unit_lookup.compiled.stats
print(sum(stats.cache_misses.values()), sum(stats.cache_hits.values()))
"""


def wanting(cache, root=Path(jit.__file__).parents[2]):
    """A process that is ready to use a kernel, of the sources below `root`."""
    return subprocess.Popen(
        [sys.executable, "-c", WANTED],
        cwd=root,
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(root)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def compiled_and_loaded(process):
    """How often a process compiled the kernel, and took it from the disk."""
    printed, _ = process.communicate("now\n")
    return [int(count) for count in printed.split()[-2:]]


@compiled_only
def test_of_processes_that_want_one_kernel_at_once_one_compiles_it(tmp_path):
    processes = [wanting(tmp_path) for _ in range(3)]
    for process in processes:
        process.stdout.readline()
    for process in processes:
        process.stdin.write("now\n")
        process.stdin.flush()
    counts = [compiled_and_loaded(process) for process in processes]
    assert sorted(counts) == [[0, 1], [0, 1], [1, 0]]


@compiled_only
def test_copies_of_the_sources_share_the_kernels_of_a_folder_that_is_asked_for(tmp_path):
    package = Path(jit.__file__).parents[1]
    copied = shutil.copytree(
        package, tmp_path / "elsewhere" / "resample", ignore=shutil.ignore_patterns("__pycache__")
    )
    assert compiled_and_loaded(wanting(tmp_path / "cache")) == [1, 0]
    second = wanting(tmp_path / "cache", copied.parent)
    assert Path(second.stdout.readline().strip()) == copied / "engine" / "jit.py"
    assert compiled_and_loaded(second) == [0, 1]


@compiled_only
def test_what_is_compiled_is_logged_once_and_nothing_is_said_by_default(tmp_path):
    source = tmp_path / "kernels_of_a_test.py"
    source.write_text(
        "import logging, sys\n"
        "from resample.engine.jit import kernel\n"
        "@kernel\n"
        "def doubled(x):\n"
        "    return 2 * x\n"
        "if 'loud' in sys.argv:\n"
        "    logging.basicConfig(level=logging.DEBUG)\n"
        "    logging.getLogger('numba').setLevel(logging.ERROR)\n"
        "doubled(2)\n"
        "doubled(2.0)\n"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    said = []
    for words in (["loud"], ["loud"], []):
        command = [sys.executable, str(source), *words]
        told = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=True, timeout=PATIENCE
        )
        said.append(told.stderr)
    assert said[0].count("compiling kernels, once per installation") == 1
    assert said[0].count("compiling __main__.doubled") == 2
    assert said[1].count("__main__.doubled: taken from ") == len(said[1].splitlines()) == 2
    assert said[2] == ""
