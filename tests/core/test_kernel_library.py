"""A library of a few kernels gives what numba gives, and names types as numba does."""

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
from importlib.machinery import ExtensionFileLoader
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import _helperlib

from resample.engine import jit
from resample.engine.compiled import compiling, library
from tests import small_kernels
from tests.processes import python
from tests.small_kernels import Pair, Sums, copy_into, nothing, steps, sums

pytestmark = [
    pytest.mark.skipif(jit.IS_PLAIN, reason="plain Python has no machine code"),
    pytest.mark.skipif(sys.platform != "linux", reason="the library is built on Linux"),
    pytest.mark.skipif(
        shutil.which(os.environ.get("CC", "cc")) is None, reason="there is no C compiler"
    ),
]
PAIR = Pair(np.arange(6, dtype=np.float32).reshape(2, 3), np.arange(4.0))
RECORD = np.dtype([("x", "f4"), ("at", "i8", 2)])


@pytest.fixture(scope="module")
def native(tmp_path_factory):
    """The small kernels, compiled by numba, as a library of their own."""
    from tools.kernels.__main__ import used
    from tools.kernels.link import build

    folder = tmp_path_factory.mktemp("library")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiling, "folder", lambda: folder)
        patch.setenv("RESAMPLE_KERNELS_LOG", str(folder / "log"))
        # Anew, as other tests may have called them: what is in memory is not stored again.
        anew = [jit.making_kernel(each.__wrapped__) for each in (sums, steps, copy_into, nothing)]
        anew[0](PAIR, 2.0)
        anew[0](PAIR, 2.0, 5)
        anew[1](3, 0.5)
        anew[2](np.zeros(3), np.ones(3))
        anew[3](1)
        made = folder / "_kernels.abi3.so"
        build(used(folder / "log"), made)
    loader = ExtensionFileLoader("_kernels", str(made))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("_kernels", loader))
    loader.exec_module(module)
    module.set_dtype_name(library.dtype_name)
    return module


@pytest.fixture
def of_library(native, monkeypatch):
    """How a kernel of the small library is called."""
    monkeypatch.setattr(library, "_native", lambda: native)
    return lambda called: library.kernel(called.__wrapped__)


@pytest.mark.sweep
def test_a_kernel_gives_what_numba_gives(of_library):
    called = of_library(sums)
    for arguments in [(PAIR, 2.0), (PAIR, 2.0, 5)]:
        found = called(arguments, {})
        assert type(found) is Sums
        assert found == sums(*arguments)
        assert [type(part) for part in found] == [float, int, bool]


def test_arguments_may_be_named_and_left_out(of_library):
    called = of_library(sums)
    assert called((), {"factor": 2.0, "pair": PAIR}) == sums(PAIR, 2.0)
    assert called((PAIR,), {"most": 5, "factor": 2.0}) == sums(PAIR, 2.0, 5)


def test_arrays_that_a_kernel_makes_are_numpys(of_library):
    called = of_library(steps)
    flat, rows = called((3, 0.5), {})
    wanted = np.arange(6, dtype=np.float32) + np.float32(0.5)
    assert flat.dtype == np.float32
    np.testing.assert_array_equal(flat, wanted)
    np.testing.assert_array_equal(rows, wanted.reshape(3, 2))
    rows[0, 0] = 9.0  # one memory, as numba gives it
    assert flat[0] == 9.0
    assert rows.flags.c_contiguous
    assert rows.flags.writeable


@pytest.mark.sweep
def test_memory_of_arrays_goes_back(of_library):
    """A process that makes 1.6 GB, array by array, holds little of it."""
    resource = pytest.importorskip("resource")
    called = of_library(steps)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(40):
        called((5_000_000, 0.5), {})
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # KiB


@pytest.mark.parametrize(
    ("called", "arguments", "error"),
    [(steps, (2**60, 0.5), "array is too big"), (steps, (2**44, 0.5), "Allocation failed")],
)
def test_an_error_in_a_kernel_is_numbas(of_library, called, arguments, error):
    with pytest.raises((ValueError, MemoryError), match=error) as by_numba:
        called(*arguments)
    with pytest.raises(type(by_numba.value)) as by_library:
        of_library(called)(arguments, {})
    assert str(by_library.value) == str(by_numba.value)


def test_an_error_about_shapes_says_how_to_see_them(of_library):
    with pytest.raises(ValueError, match="RESAMPLE_KERNELS=off tells their shapes"):
        of_library(copy_into)((np.zeros(3), np.ones(4)), {})


@pytest.mark.parametrize(
    "arguments",
    [
        (PAIR, 2),
        (PAIR,),
        (PAIR, 2.0, 5, 6),
        (PAIR._replace(second=np.arange(4)), 2.0),
        (tuple(PAIR), 2.0),
        (PAIR._replace(second=PAIR.second.astype(">f8")), 2.0),
        (PAIR._replace(second=object()), 2.0),
    ],
)
def test_what_the_library_has_not_is_left_to_numba(of_library, arguments):
    assert of_library(sums)(arguments, {}) is NotImplemented


def test_a_kernel_of_changed_sources_is_not_run(of_library, monkeypatch):
    called, asked = of_library(sums), []
    with monkeypatch.context() as edited:
        edited.setattr(library, "source_digest", lambda *_: asked.append(1) or "0" * 64)
        assert called((PAIR, 2.0), {}) is NotImplemented
        assert called((PAIR, 2.0), {}) is NotImplemented
    assert asked == [1]  # the answer is kept: every call would ask else
    assert of_library(sums)((PAIR, 2.0), {}) == sums(PAIR, 2.0)


def test_kernels_that_are_not_there_have_no_call(native, of_library):
    assert of_library(jit.tasks) is None
    assert native.find("nowhere.at_all", (), ()) is None
    assert ("tests.small_kernels.nothing", "q") in native.entries()


@pytest.fixture
def nothing_is_asked_for(monkeypatch):
    """An environment that neither leaves the library alone nor asks for other code."""
    for variable in (library.VARIABLE, *(f"NUMBA_{name}" for name in library.OTHER_CODE)):
        monkeypatch.delenv(variable, raising=False)


@pytest.mark.usefixtures("nothing_is_asked_for")
def test_a_processor_that_lacks_something_has_no_library(native, monkeypatch):
    monkeypatch.setattr("resample.engine.compiled._kernels", native, raising=False)
    monkeypatch.setitem(sys.modules, "resample.engine.compiled._kernels", native)
    assert library._native.__wrapped__() is native
    assert native.lacking() == []
    monkeypatch.setattr(library, "lacking", lambda _: ("AVX2",))
    assert library._native.__wrapped__() is None


@pytest.mark.parametrize(
    ("variable", "value"),
    [("RESAMPLE_KERNELS", "off"), ("NUMBA_OPT", "1"), ("NUMBA_CPU_NAME", "x")],
)
@pytest.mark.usefixtures("nothing_is_asked_for")
def test_the_library_is_left_alone_where_that_is_asked_for(native, monkeypatch, variable, value):
    monkeypatch.setattr("resample.engine.compiled._kernels", native, raising=False)
    monkeypatch.setitem(sys.modules, "resample.engine.compiled._kernels", native)
    monkeypatch.setenv(variable, value)
    assert library._native.__wrapped__() is None


@pytest.mark.parametrize(
    "damage",
    [
        lambda _: b"",
        lambda data: data[: len(data) // 2],
        lambda data: data[:-1],
        lambda data: data + b"x",
        *(
            lambda data, at=at: data[: at % len(data)] + b"\xa5" + data[at % len(data) + 1 :]
            for at in (0, 100, 5000, -1, -10)
        ),
    ],
)
def test_a_library_that_is_damaged_is_not_loaded(native, tmp_path, monkeypatch, caplog, damage):
    for variable in (library.VARIABLE, *(f"NUMBA_{name}" for name in library.OTHER_CODE)):
        monkeypatch.delenv(variable, raising=False)
    whole = Path(native.__file__).read_bytes()
    assert library.is_whole(whole)
    (tmp_path / "_kernels.abi3.so").write_bytes(damage(whole))
    monkeypatch.setattr(library, "MODULE", "_kernels")
    monkeypatch.delitem(sys.modules, "_kernels", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    assert library._native.__wrapped__() is None
    assert "the library of kernels is damaged" in caplog.text
    assert "_kernels" not in sys.modules


def test_a_word_that_says_neither_is_refused(monkeypatch):
    monkeypatch.setenv("RESAMPLE_KERNELS", "maybe")
    with pytest.raises(ValueError, match="RESAMPLE_KERNELS is 'maybe': on or off"):
        library._native.__wrapped__()


plain = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    st.sampled_from(
        [
            np.float32(1.5),
            np.float64(2),
            np.int8(-3),
            np.uint16(4),
            np.int64(-5),
            np.uint64(6),
            np.bool_(True),
            np.int32(-7),
            np.uint32(8),
            np.uint8(9),
            np.int16(-10),
        ]
    ),
)


@st.composite
def arrays(draw):
    """Arrays of any dtype, number of axes and layout, that may be written to or not."""
    kind = draw(
        st.sampled_from(
            ["b1", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", "c8", "c16", RECORD]
        )
    )
    shape = draw(st.lists(st.integers(0, 3), min_size=0, max_size=4))
    array = np.zeros(shape, kind, order=draw(st.sampled_from("CF")))
    if shape and draw(st.booleans()):
        array = array[tuple(slice(None, None, draw(st.sampled_from([1, 2, -1]))) for _ in shape)]
    array.flags.writeable = draw(st.booleans())
    return array


values = st.recursive(
    st.one_of(plain, arrays()),
    lambda parts: st.one_of(
        st.builds(Pair, parts, parts), st.lists(parts, min_size=1, max_size=3).map(tuple)
    ),
    max_leaves=8,
)


@pytest.mark.sweep
@given(values)
def test_types_have_the_names_that_numba_would_give_them(native, value):
    named = native.find("tests.small_kernels.nothing", ("value",), ()).key((value,), {})
    assert named == compiling.key_of(numba.typeof(value))


@pytest.mark.sweep
@pytest.mark.usefixtures("nothing_is_asked_for")
def test_a_process_without_numba_runs_a_library(native, tmp_path):
    """What is in no library asks for numba, and says so."""
    (tmp_path / "numba.py").write_text("raise ImportError('numba is not installed')\n")
    where = Path(native.__spec__.origin).parent
    code = f"""
import sys
sys.path[:0] = [{str(tmp_path)!r}, {str(where)!r}, {str(Path(small_kernels.__file__).parents[1])!r}]
import _kernels
sys.modules["resample.engine.compiled._kernels"] = _kernels
import numpy as np
from tests.small_kernels import nothing, steps
print(steps(3, 0.5)[0])
try:
    nothing(1.5)
except ImportError as error:
    print(error)
"""
    assert python(code).splitlines() == ["[0.5 1.5 2.5 3.5 4.5 5.5]", "numba is not installed"]


def test_an_entry_names_the_modules_that_it_is_compiled_from(native):
    code = sums.__wrapped__.__code__
    names = code.co_varnames[: code.co_argcount]
    found = native.find("tests.small_kernels.sums", names, sums.__wrapped__.__defaults__)
    _, sources = found.match((PAIR, 2.0), {})
    digest, *modules = sources.split()
    assert {"tests.small_kernels", "resample.engine.compiled.compiling"} <= set(modules)
    assert digest == library.source_digest(*modules)


def test_the_digest_of_sources_changes_with_each_file(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("of_library_a", "of_library_b"):
        (tmp_path / f"{name}.py").write_text("STEP = 2\n")
    digests = {library.source_digest("of_library_a", "of_library_b")}
    for name in ("of_library_a", "of_library_b", "of_library_b"):
        with (tmp_path / f"{name}.py").open("a") as file:
            file.write("# another line\n")
        library._file_digest.cache_clear()
        digests.add(library.source_digest("of_library_a", "of_library_b"))
    (tmp_path / "of_library_a.py").unlink()
    library._file_digest.cache_clear()
    importlib.invalidate_caches()
    digests.add(library.source_digest("of_library_a", "of_library_b"))
    assert len(digests) == 5
    library._file_digest.cache_clear()


def test_a_view_of_other_dimensions_is_numbas(tmp_path):
    """Also where sizes differ, or are 0: then only the same number of items may be viewed."""
    runtime = Path(library.__file__).parents[3] / "tools" / "kernels" / "runtime.c"
    compiler = [os.environ.get("CC", "cc"), "-shared", "-fPIC", str(runtime), "-lm"]
    subprocess.run([*compiler, "-o", str(tmp_path / "runtime.so")], check=True)
    by_library = ctypes.CDLL(str(tmp_path / "runtime.so")).numba_attempt_nocopy_reshape
    kinds = [ctypes.c_ssize_t, *[ctypes.c_void_p] * 2] * 2 + [ctypes.c_ssize_t, ctypes.c_int]
    of_numba = ctypes.CFUNCTYPE(ctypes.c_int, *kinds)(
        _helperlib.c_helpers["attempt_nocopy_reshape"]
    )
    by_library.argtypes = kinds
    rng, fitting = np.random.default_rng(7), 0
    for _ in range(2000):
        given = np.zeros(rng.integers(0, 5, rng.integers(1, 4)), "f4")[:: rng.integers(1, 3)]
        given = given.transpose(rng.permutation(given.ndim))
        new = rng.integers(0, 5, rng.integers(1, 4))
        if rng.random() < 0.5:
            new = np.array([*given.shape[:-2], int(np.prod(given.shape[-2:]))])
        answers = []
        for reshape in (by_library, of_numba):
            dims, strides = np.array(given.shape), np.array(given.strides)
            made = np.zeros(len(new), np.intp)
            parts = (len(dims), dims.ctypes.data, strides.ctypes.data, len(new), new.ctypes.data)
            fits = reshape(*parts, made.ctypes.data, 4, 0)
            answers.append((fits, made[new > 1].tolist() if fits and new.all() else None))
        assert answers[0] == answers[1], (given.shape, given.strides, new)
        fitting += answers[0][0]
    assert 300 < fitting < 1700
