"""A kernel is compiled anew after an edit of what it is compiled from, and after no other."""

import importlib
import sys

import pytest

from resample.engine import jit
from tests.processes import python

pytestmark = pytest.mark.skipif(jit.IS_PLAIN, reason="plain Python has no machine code")

FILES = {
    "edited/__init__.py": "",
    "edited/numbers.py": """
import numpy as np
BASE = 2
STEP = BASE * 3
UNUSED = 5
TABLE = np.array([1.0, 2.0])
LIMIT = 10
if BASE > 1:
    LIMIT = 20
""",
    "edited/same.py": "same = 1\n",
    "edited/stars.py": "from edited.numbers import *\nPAIR = (BASE, 1.5)\n",
    "edited/bundles.py": '''
from typing import NamedTuple
class Bundle(NamedTuple):
    """A bundle."""
    first: float
    second: float
class Inner(NamedTuple):
    number: float = 1.0
''',
    "edited/steps.py": """
from edited import numbers
from edited.numbers import STEP as stride
from edited.stars import PAIR
from resample.engine.jit import inner_kernel, kernel
WIDTH = stride + 1
@inner_kernel
def step(number, times=3):
    return number * WIDTH * times + PAIR[1]
def unrelated(number):
    return number
def made(factor):
    @kernel
    def inside(number):
        if number > numbers.LIMIT:
            return None
        return number * factor
    return inside
doubled, tripled = made(2), made(3)
""",
    "edited/roles.py": '''
from resample.engine.jit import called_role, role
@called_role
def part(bundle, number):
    """What is played."""
    raise NotImplementedError
''',
    "edited/players.py": """
from edited.bundles import Bundle, Inner
from edited.roles import part
from resample.engine.jit import plays
SHARE = 0.5
@plays(part, Bundle)
def _bundles(bundle, number):
    return bundle.second * number * SHARE
@plays(part, Inner)
def _inners(bundle, number):
    return bundle.number * number
class Other(Bundle):
    pass
@plays(part, Other)
def _others(bundle, number):
    return number
""",
    "edited/loops.py": '''
from edited import numbers, same, steps
from edited.bundles import Inner
from edited.roles import part
from edited.steps import doubled, tripled
from resample.engine.jit import kernel
@kernel
def loop(bundle, count):
    """Sum of steps."""
    total = 0.0
    for n in range(count):  # as many as are asked for
        total += steps.step(bundle.first) + part(bundle, n) + part(Inner(), n)
        total += numbers.TABLE[0] + same.same
    doubled(total)
    tripled(total)
    return total
''',
}
CHANGE_NOTHING = {
    "a comment": ("loops.py", "  # as many as are asked for", "  # all"),
    "a line before": ("loops.py", "@kernel\n", "\n\n@kernel\n"),
    "a docstring": ("loops.py", "Sum of steps", "All steps"),
    "a first docstring": (
        "steps.py",
        "        if number >",
        '        "Inside."\n        if number >',
    ),
    "a docstring of a class": ("bundles.py", "A bundle", "Two numbers"),
    "an annotation": ("bundles.py", "first: float", "first: int"),
    "a constant that no kernel reads": ("numbers.py", "UNUSED = 5", "UNUSED = 6"),
    "a new function": ("steps.py", "def unrelated", "def new():\n    return 1\ndef unrelated"),
    "a function that is not called": ("steps.py", "return number\n", "return number + 1\n"),
    "how a constant is written": ("numbers.py", "STEP = BASE * 3", "STEP = 6"),
    "what another class plays": ("players.py", "    return number\n", "    return -number\n"),
}
CHANGE_CODE = {
    "a kernel": ("loops.py", "total = 0.0", "total = 1.0"),
    "a function that it calls": ("steps.py", "number * WIDTH", "number + WIDTH"),
    "a constant two modules away": ("numbers.py", "BASE = 2", "BASE = 3"),
    "a constant by another name": ("numbers.py", "STEP = BASE * 3", "STEP = BASE * 4"),
    "a constant that is set if": ("numbers.py", "LIMIT = 20", "LIMIT = 21"),
    "what a star imports": ("stars.py", "PAIR = (BASE, 1.5)", "PAIR = (BASE, 2.5)"),
    "the type of a constant": ("stars.py", "PAIR = (BASE, 1.5)", "PAIR = (1.0 * BASE, 1.5)"),
    "a number of an array": ("numbers.py", "[1.0, 2.0]", "[1.0, 3.0]"),
    "the dtype of an array": ("numbers.py", "[1.0, 2.0]", "[1, 2]"),
    "an attribute with its module's name": ("same.py", "same = 1", "same = 2"),
    "a default": ("steps.py", "times=3", "times=4"),
    "the option of a decorator": ("steps.py", "@inner_kernel", "@kernel"),
    "free variables, exchanged": ("steps.py", "made(2), made(3)", "made(3), made(2)"),
    "what a name is imported as": (
        "loops.py",
        "doubled, tripled\n",
        "tripled as doubled, tripled\n",
    ),
    "a role's kind": ("roles.py", "@called_role", "@role"),
    "a role's body": ("players.py", "number * SHARE", "number - SHARE"),
    "a constant of a body": ("players.py", "SHARE = 0.5", "SHARE = 0.25"),
    "the body of a bundle made inside": ("players.py", "bundle.number * n", "bundle.number + n"),
    "names of fields": ("bundles.py", "second", "next"),
    "the order of fields": (
        "bundles.py",
        "    first: float\n    second: float",
        "    second: float\n    first: float",
    ),
    "the default of a field": ("bundles.py", "number: float = 1.0", "number: float = 2.0"),
}


@pytest.fixture
def digest(tmp_path, monkeypatch):
    """Gives the digest of `loop`, imported anew from the files as they are after an edit."""
    from resample.engine.compiled import digests

    def found(name="", old="", new=""):
        for file, text in FILES.items():
            is_edited = file == f"edited/{name}"
            assert not is_edited or old in text
            (tmp_path / file).parent.mkdir(exist_ok=True)
            (tmp_path / file).write_text(text.replace(old, new) if is_edited else text)
        for module in [each for each in sys.modules if each.partition(".")[0] == "edited"]:
            monkeypatch.delitem(sys.modules, module)
        importlib.invalidate_caches()
        loop = importlib.import_module("edited.loops").loop
        bundle = importlib.import_module("edited.players").Bundle
        return digests.made_from(loop, [bundle])[0]

    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(tmp_path)
    jit.compiler()
    return found


@pytest.mark.parametrize("edit", CHANGE_NOTHING)
def test_an_edit_that_changes_no_code_changes_no_digest(digest, edit):
    assert digest(*CHANGE_NOTHING[edit]) == digest()


@pytest.mark.parametrize("edit", CHANGE_CODE)
def test_an_edit_of_what_is_compiled_changes_the_digest(digest, edit):
    assert digest(*CHANGE_CODE[edit]) != digest()


def test_a_constant_counts_as_it_is_when_the_kernel_is_compiled(digest, monkeypatch):
    from resample.engine.compiled import digests

    before = digest()
    loops, players = (sys.modules[f"edited.{name}"] for name in ("loops", "players"))
    monkeypatch.setattr(players, "SHARE", 0.25)
    assert digests.made_from(loops.loop, [players.Bundle])[0] != before


FOURS = """
from resample.engine import jit
from resample.engine.rays import painting
jit.compiler()
from resample.engine.compiled import digests
print(*digests.made_from(painting.paint_rays, []))
"""


def test_a_digest_is_the_same_in_every_process(monkeypatch):
    told = []
    for seed in ("1", "2"):
        monkeypatch.setenv("PYTHONHASHSEED", seed)
        told.append(python(FOURS))
    assert told[0] == told[1]


def test_what_numba_compiles_in_place_of_a_function_counts():
    from resample.engine.compiled import digests
    from resample.engine.rays import coefficients as splines

    jit.compiler()
    adding = jit.kernel(lambda flat: splines.sums_at(flat, (1, 2), (0, 1, 2), (0.5, 0.5, 0.5)))
    parts = digests.made_from(adding, [])[1]
    assert "resample.engine.rays.spline_vectors" in parts  # whole: it makes LLVM's code
    assert "resample.engine.compiled.compiling" in parts


ADDED = """
from resample.engine.jit import kernel
@kernel
def added(number):
    if number > 4:
        raise ValueError("too large")
    return number + 1
"""


def test_a_kernel_runs_from_the_cache_after_an_edit_that_moves_lines(tmp_path, monkeypatch):
    jit.compiler()
    from resample.engine.compiled import compiling

    monkeypatch.setattr(compiling, "folder", lambda: tmp_path / "cache")
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(tmp_path)
    for text in (ADDED, ADDED.replace("@kernel", "# moved\n\n\n@kernel")):
        (tmp_path / "moved.py").write_text(text)
        monkeypatch.delitem(sys.modules, "moved", raising=False)
        importlib.invalidate_caches()
        added = importlib.import_module("moved").added
        assert added(2) == 3
        with pytest.raises(ValueError, match="too large"):
            added(5)
    assert sum(jit.dispatcher(added).stats.cache_hits.values()) == 1
    assert len([*(tmp_path / "cache").glob("*.kernel")]) == 1
