"""What a release has to have: one version, known licences, files that are safe to read."""

import ast
import re
import runpy
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = [
    path
    for top in ("resample", "apps", "plugins", "tools", "benchmarks")
    for path in (ROOT / top).rglob("*.py")
]
WORDS = re.compile("allow_pickle|shell|load|eval|exec|pickle|shelve|marshal|dill")
FORBIDDEN = {"pickle", "cPickle", "shelve", "marshal", "dill"}


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    assert cited is not None
    assert {project["version"], cited[1], version("hybrid-resample")} == {"0.3.0"}


def test_licences_that_are_unknown_or_unwanted_are_named():
    unwanted = runpy.run_path(str(ROOT / "tools" / "licences.py"))["unwanted"]
    assert unwanted("MIT AND (BSD-3-Clause OR PSF-2.0)") == []
    assert unwanted("MIT AND GPL-3.0-or-later") == ["GPL-3.0-or-later"]
    assert unwanted("") == [""]


@pytest.fixture(scope="module")
def nodes():
    """Calls and imports of all sources that have one of the words, with where they are."""
    kinds = ast.Call | ast.Import | ast.ImportFrom
    texts = ((path, path.read_text("utf-8")) for path in SOURCES)
    trees = [(path, ast.parse(text)) for path, text in texts if WORDS.search(text)]
    return [
        (node, path) for path, tree in trees for node in ast.walk(tree) if isinstance(node, kinds)
    ]


def keywords(nodes, name):
    for node, path in nodes:
        for keyword in getattr(node, "keywords", []):
            if keyword.arg == name:
                yield getattr(keyword.value, "value", None), f"{path}:{node.lineno}"


@pytest.mark.sweep
def test_arrays_are_never_read_with_pickled_objects(nodes):
    assert [place for value, place in keywords(nodes, "allow_pickle") if value is not False] == []
    calls = [n for n, _ in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Attribute)]
    loads = [n for n in calls if n.func.attr == "load" and ast.unparse(n.func) == "np.load"]
    assert loads
    assert all(any(k.arg == "allow_pickle" for k in load.keywords) for load in loads)


# What numba has compiled for this user is unpickled from the user's own cache, after its checksum.
OWN_CACHE = ("resample/engine/compiled/compiling.py", "tools/kernels/link.py")


def test_nothing_unpickles_evaluates_or_asks_a_shell(nodes):
    assert list(keywords(nodes, "shell")) == []
    for node, path in nodes:
        if isinstance(node, ast.Call):
            assert getattr(node.func, "id", "") not in ("eval", "exec"), (path, node.lineno)
        else:
            names = {alias.name for alias in node.names} | {getattr(node, "module", "")}
            is_own = path.as_posix().endswith(OWN_CACHE) or "tests" in path.relative_to(ROOT).parts
            allowed = {"pickle"} if is_own else set()
            assert not (FORBIDDEN - allowed) & names, (path, names)


def test_what_builds_and_tests_is_installed_by_hash():
    """Trials of other versions, and of what a user installs, take the newest there are."""
    texts = [(ROOT / name).read_text("utf-8") for name in ("Makefile", "pyproject.toml")]
    calls = [
        line.strip()
        for line in "\n".join(texts).replace(" && ", "\n").splitlines()
        if re.match(r"[^#]*(pip install|-m pip|tool run)", line)
    ]
    loose = [line for line in calls if not re.search("--require-hashes|--no-deps", line)]
    assert len(calls) > 6
    assert all("$(VERSIONS)" in line or "--group dev" in line for line in loose), loose
    assert all("isolation" in line for line in calls if "--no-deps" in line)
    assert "pip-audit --strict" in texts[0]  # what the index does not know has not been audited
