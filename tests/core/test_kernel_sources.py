"""The fingerprint of a kernel changes with all that it is compiled from, and with nothing else."""

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from resample.engine.compiled import sources
from tests.processes import PATIENCE

FILES = {
    "kernels_a/__init__.py": "",
    "kernels_a/bundles.py": (
        "from typing import NamedTuple\nclass Bundle(NamedTuple):\n    n: int\n"
    ),
    "kernels_a/helpers.py": "STEP = 2\n",
    "kernels_a/loops.py": (
        "from kernels_a import (\n    helpers,  # a comment\n)\n"
        "from resample.engine.jit import kernel\n"
        "def body(bundle):\n    from kernels_a.late import LATE\n    return LATE + helpers.STEP\n"
    ),
    "kernels_a/late.py": "LATE = 1\n",
    "kernels_a/roles.py": (
        "from resample.engine.roles import role\n"
        "@role\ndef part(bundle):\n    raise NotImplementedError\n"
    ),
    "kernels_a/uses.py": "from kernels_a.roles import part\n",
    "kernels_b/__init__.py": "",
    "kernels_b/player.py": (
        "from kernels_a.bundles import Bundle\nfrom kernels_a.roles import part\n"
        "from resample.engine.roles import plays\nfrom kernels_b.numbers import N\n"
        "@plays(part, Bundle)\ndef played(bundle):\n    return N\n"
    ),
    "kernels_b/numbers.py": "N = 3\n",
    "kernels_a/unused.py": "import kernels_a.loops\n",
}
EDITS = {  # and whether they change the fingerprints of a kernel without and of one with a role
    "kernels_a/unused.py": (False, False),
    "kernels_b/__init__.py": (False, False),
    "kernels_a/loops.py": (True, False),
    "kernels_a/helpers.py": (True, False),
    "kernels_a/late.py": (True, False),
    "kernels_a/bundles.py": (False, True),
    "kernels_a/uses.py": (False, True),
    "kernels_b/player.py": (False, True),
    "kernels_b/numbers.py": (False, True),
}
CODE = """
import sys
import kernels_a.loops, kernels_a.uses, kernels_b.player
from kernels_a.bundles import Bundle
from resample.engine.compiled import sources

for edited in ["", *sys.argv[1:]]:
    if edited:
        open(edited, "a").write("# another line\\n")
    for cached in (sources.source, sources.closure, sources._digest_of):
        cached.cache_clear()
    print(sources.digest("kernels_a.loops"), sources.digest("kernels_a.uses", [Bundle]))
"""


@pytest.mark.sweep
def test_an_edit_changes_the_fingerprints_of_what_depends_on_it(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    ended = subprocess.run(
        [sys.executable, "-c", CODE, *EDITS],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE,
    )
    digests = [line.split() for line in ended.stdout.splitlines()]
    changed = [
        tuple(old != new for old, new in zip(before, after, strict=True))
        for before, after in pairwise(digests)
    ]
    assert dict(zip(EDITS, changed, strict=True)) == EDITS


def test_all_kernels_depend_on_what_compiles_them():
    needed = sources.closure("resample.engine.lookup")
    assert {
        "resample.engine.jit",
        "resample.engine.compiled.compiling",
        "resample.engine.roles",
    } <= needed
    assert "resample.types" in needed
    assert "resample.watching" not in needed


def test_a_kernel_of_the_engine_depends_on_a_part_of_it():
    modules = {
        f"resample.engine.{path.relative_to(root).with_suffix('').as_posix().replace('/', '.')}"
        for root in [Path(sources.__file__).parents[1]]
        for path in root.rglob("*.py")
        if path.name != "__init__.py"
    }
    needed = sources.closure("resample.engine.mixtures.deferred")
    assert len(needed & modules) < 0.6 * len(modules)


def test_what_has_no_file_has_no_fingerprint():
    assert sources.digest("no_module_at_all") is None
