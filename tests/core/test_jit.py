import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event, Timer
from types import SimpleNamespace

import numba
import numpy as np
import pytest
from numba.core.event import install_recorder

from resample.engine import jit
from resample.engine.compiled import compiling
from tests.processes import PATIENCE

compiled_only = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="plain Python has no machine code to store"
)


@pytest.fixture
def kept(monkeypatch, tmp_path):
    """A folder of our own for kernels."""
    monkeypatch.setattr(compiling, "folder", lambda: tmp_path / "kernels")
    return tmp_path / "kernels"


def files(folder):
    return sorted(folder.glob("*.kernel"))


@compiled_only
def test_bounds_checks_have_a_cache_of_their_own(kept, monkeypatch):
    jit.kernel(double)(1.0)
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    jit.kernel(double)(1.0)
    assert len(files(kept)) == 2


@compiled_only
@pytest.mark.parametrize(
    ("flag", "value"),
    [
        ("SLP_VECTORIZE", 1),
        ("LOOP_VECTORIZE", 0),
        ("OPT", 1),
        ("CPU_NAME", "generic"),
        ("CPU_FEATURES", "+sse2"),
    ],
)
def test_a_trial_of_the_compilers_flags_has_a_cache_of_its_own(monkeypatch, flag, value):
    plain = path_of(jit.kernel(double))
    monkeypatch.setattr(numba.config, flag, value)
    assert path_of(jit.kernel(double)) != plain


def path_of(called):
    """File of a kernel of one number."""
    return jit.dispatcher(called)._cache.path((numba.float64,))


@compiled_only
def test_a_flag_that_is_set_later_leaves_nothing_in_the_cache(kept, monkeypatch):
    tried = jit.kernel(double)
    jit.compiler()
    with monkeypatch.context() as trial:
        trial.setattr(numba.config, "SLP_VECTORIZE", 1)
        assert tried(3.0) == 6.0
    assert not files(kept)
    assert jit.kernel(halve)(3.0) == 1.5
    assert [file.name.partition("-")[0] for file in files(kept)] == ["halve"]


@compiled_only
def test_packed_kernels_are_stored_under_the_flags_that_were_asked_for(kept):
    packed, numbers = jit.packed_kernel(add_one), np.zeros(3)
    packed(numbers)
    (file,) = files(kept)
    signature = jit.dispatcher(packed).signatures[0]
    assert jit.dispatcher(packed)._cache.path(signature) == file


def test_what_was_asked_for_is_known_only_while_a_packed_kernel_is_compiled():
    """Also if that fails."""
    before, asked = numba.config.SLP_VECTORIZE, len(compiling._asked)

    def compile_now(signature):
        assert (numba.config.SLP_VECTORIZE, compiling._asked[asked:]) == (1, [before])
        if signature is None:
            raise TypeError
        return signature

    compiled = SimpleNamespace(compile=compile_now)
    compiling._pack(compiled)
    assert compiled.compile(3) == 3
    with pytest.raises(TypeError):
        compiled.compile(None)
    assert (numba.config.SLP_VECTORIZE, len(compiling._asked)) == (before, asked)


def halve(number):
    return number / 2.0


def add_one(counter, numbers):
    if counter[0] == 0:
        counter[0] = 1
        numbers += 1.0


@compiled_only
def test_kernels_work_where_no_folder_can_be_written_to(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setattr(compiling, "folder", lambda: tmp_path / "file")
    assert jit.kernel(double)(3.0) == 6.0


def double(number):
    return 2.0 * number


@compiled_only
@pytest.mark.usefixtures("kept")
def test_no_call_of_the_compiler_is_timed():
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
    is_compiling, is_forking = Event(), Event()

    def compiles():
        with compiling.global_compiler_lock:
            is_compiling.set()
            assert is_forking.wait(PATIENCE)

    with ThreadPoolExecutor(1) as threads:
        threads.submit(compiles)
        assert is_compiling.wait(PATIENCE)
        Timer(0.1, is_forking.set).start()  # the fork waits for it
        child = os.fork()
        if child == 0:
            signal.alarm(PATIENCE)
            with compiling.global_compiler_lock, compiling._packs:
                os._exit(0)
        assert os.waitpid(child, 0)[1] == 0


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_process_does_not_keep_others_from_compiling(kept):
    ends, lives = os.pipe()
    with compiling.in_turn(kept / "a_kernel.kernel"):
        lock = os.open(kept / "a_kernel.lock", os.O_RDWR)
        child = os.fork()
        if child == 0:
            os.close(lives)
            os.read(ends, 1)  # lives on, with all that was open
            os._exit(0)
    compiling.fcntl.flock(lock, compiling.fcntl.LOCK_EX | compiling.fcntl.LOCK_NB)
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
from resample.engine import jit, levels

print(jit.__file__, flush=True)
sys.stdin.readline()
levels.put_levels(np.zeros(256, np.uint8), np.ones(4, np.float32), np.zeros(4, np.uint8))
stats = jit.dispatcher(levels.put_levels).stats
print(sum(stats.cache_misses.values()), sum(stats.cache_hits.values()))
"""


def wanting(cache, root=Path(jit.__file__).parents[2]):
    """A process that is ready to use a kernel, of the sources below `root`."""
    return subprocess.Popen(
        [sys.executable, "-c", WANTED],
        cwd=root,
        env={
            **os.environ,
            "NUMBA_CACHE_DIR": str(cache),
            "PYTHONPATH": str(root),
            "RESAMPLE_KERNELS": "off",
        },
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def compiled_and_loaded(process):
    """How often a process compiled the kernel, and took it from the disk."""
    printed, _ = process.communicate("now\n")
    return [int(count) for count in printed.split()[-2:]]


@pytest.mark.sweep
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


SLOW_FOR_INTEGERS = """
import sys
from numba import types
from numba.extending import overload
from resample.engine import jit

def same(x):
    return x

@overload(same)
def compiled(x):
    if isinstance(x, types.Integer):
        print("compiling", flush=True)
        sys.stdin.readline()
    return lambda x: x

@jit.kernel
def doubled(x):
    return 2 * same(x)

print(doubled(2.5 if "real" in sys.argv else 2), flush=True)
"""


@pytest.mark.sweep
@compiled_only
def test_a_process_that_compiles_a_kernel_keeps_no_other_from_compiling_it_for_other_types(
    tmp_path,
):
    source = tmp_path / "a_kernel_of_a_test.py"
    source.write_text(SLOW_FOR_INTEGERS)
    cache = tmp_path / "cache"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    command = [sys.executable, str(source)]
    with subprocess.Popen(command, env=environment, **pipes) as slow:
        try:
            assert slow.stdout.readline() == "compiling\n"
            printed = subprocess.check_output(
                [*command, "real"], env=environment, timeout=PATIENCE, text=True
            )
            assert printed == "5.0\n"
            assert slow.poll() is None
        finally:
            printed = slow.communicate("go on\n", PATIENCE)[0]
    assert printed == "4\n"
    assert len(files(cache)) == 2
    assert not list(cache.glob("*.lock"))


@pytest.mark.sweep
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


@pytest.mark.sweep
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


PART = {"fastmath": jit.LANES, "forceinline": True}


@pytest.mark.parametrize(
    ("decorator", "is_packed", "options"),
    [
        (jit.kernel, False, {}), (jit.making_kernel, False, {"_nrt": True}),
        (jit.lane_kernel, False, {"fastmath": jit.LANES}),
        (jit.inner_kernel, False, {"_nrt": False}),
        (jit.lane_step, False, PART), (jit.inner_step, False, {**PART, "_nrt": False}),
        (jit.parallel_kernel, False, {}), (jit.packed_kernel, True, {"fastmath": jit.LANES}),
    ],
)  # fmt: skip
def test_each_kind_of_kernel_is_compiled_with_options_of_its_own(
    monkeypatch, decorator, is_packed, options
):
    told = []
    monkeypatch.setattr(jit.compiler(), "define", lambda *given: told.append(given[2:]))
    jit.dispatcher(decorator(print))
    assert told == [(is_packed, options)]


def test_a_kernel_of_the_library_gets_its_arguments_as_they_are_given(monkeypatch):
    taken = []

    def ready(args, kwargs):
        taken.append((args, kwargs))
        return NotImplemented if "c" in kwargs else 5

    monkeypatch.setattr(jit.library, "kernel", lambda _: ready)
    monkeypatch.setattr(jit.compiler(), "define", lambda *_: lambda *args, **kwargs: (args, kwargs))
    call = jit.kernel(print)
    assert call(1, b=2) == 5
    assert call(1, c=3) == ((1,), {"c": 3})  # which the library has not: it is compiled
    assert taken == [((1,), {"b": 2}), ((1,), {"c": 3})]
