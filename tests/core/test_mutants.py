"""The tool that puts small faults into sources: where it does, and that tests are asked."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tools.mutants import __main__ as command
from tools.mutants.marks import blocks
from tools.mutants.reach import Case, Chooser, Reach
from tools.mutants.sites import Site, sites, stratum_of

ROOT = Path(__file__).parents[2]
FILE = "resample/files/toy.py"
TOY = """
def doubled(x: int, y: int = 2) -> int:
    if x < 0 and not y:
        raise ValueError(-x)
    if x > 9:
        return int(round(x * 1.5))
    return min(x, 99) + np.radians(x).sum(axis=0)
"""


def toy_sites() -> list[Site]:
    return list(sites(FILE, TOY.encode()))


def site_of(after: str) -> Site:
    return next(site for site in toy_sites() if site.after == after)


def test_faults_of_many_kinds_are_found_in_a_source():
    found = {(site.kind, site.after) for site in toy_sites()}
    last = "return min(x, 99) + np.radians(x).sum(axis=0)"
    assert found >= {
        ("boundary", "if x <= 0 and not y:"),
        ("logic", "if x < 0 or not y:"),
        ("logic", "if x < 0 and (y):"),
        ("validation", "if False:"),
        ("sign", "raise ValueError((x))"),
        ("boundary", "if x >= 9:"),
        ("constant", "if x > 10:"),
        ("operator", "return int(round(x / 1.5))"),
        ("rounding", "return int(int(x * 1.5))"),
        ("default", "def doubled(x: int, y: int = 3) -> int:"),
        ("clip", last.replace("min(x, 99)", "x")),
        ("clip", last.replace("min", "max")),
        ("axis", last.replace("axis=0", "axis=1")),
        ("unit", last.replace("np.radians(x)", "x")),
        ("operator", last.replace("+", "-")),
    }
    assert {site.function for site in toy_sites()} == {"doubled"}
    assert len({site.id for site in toy_sites()}) == len(toy_sites())


def test_a_fault_changes_its_own_bytes_alone():
    for site in toy_sites():
        changed = (TOY[: site.begin] + site.new + TOY[site.end :]).splitlines()
        lines = [n for n, line in enumerate(TOY.splitlines()) if changed[n] != line]
        assert lines == [site.line - 1]
        assert " ".join(changed[lines[0]].split()) == site.after
        compile("\n".join(changed), FILE, "exec")


@pytest.mark.parametrize(
    ("file", "stratum"),
    [
        ("resample/engine/jit.py", "kernels"), ("resample/engine/compiled/entries.py", "plumbing"),
        ("apps/points/resample_points/kernels/cells.py", "kernels"), (FILE, "readers"),
        ("apps/warp3d/resample_warp3d/warping.py", "warp3d"), ("tests/core/test_mutants.py", None),
        ("plugins/figures/resample_figures/gallery.py", None), ("resample/messages.py", "plumbing"),
    ],
)  # fmt: skip
def test_a_file_belongs_to_a_stratum(file, stratum):
    assert stratum_of(file) == stratum


def test_cases_are_chosen_that_run_through_the_innermost_block(tmp_path):
    (tmp_path / "resample/files").mkdir(parents=True)
    (tmp_path / FILE).write_text(TOY)
    marks = {f"{FILE}:doubled:{n}": n for n in range(3)}
    cases = [
        Case("tests/a.py::test_all", 1.0, frozenset({0, 1, 2})),
        Case("tests/a.py::test_much", 0.1, frozenset({0, 2})),
        Case("tests/b.py::test_little", 0.1, frozenset({0})),
        Case("tests/b.py::test_dear", 9.0, frozenset({0})),
    ]
    chooser = Chooser(tmp_path, Reach("", {}, marks, cases))
    inner, outer = site_of("return int(round(x / 1.5))"), site_of("if x >= 9:")
    assert chooser.cases(inner, 5.0) == ["tests/a.py::test_much", "tests/a.py::test_all"]
    assert chooser.cases(outer, 5.0)[0] == "tests/b.py::test_little"
    assert "tests/b.py::test_dear" not in chooser.cases(outer, 5.0)


def test_blocks_of_nested_functions_are_their_own():
    import ast

    tree = ast.parse("def f():\n if a:\n  b()\n else:\n  def g():\n   for c in d: e()\n")
    assert [name for name, _ in blocks(tree)] == ["f:0", "f:1", "f:2", "f.g:0", "f.g:1"]


WORK = """
import json, sys
from pathlib import Path
import pytest, pytest_httpserver  # once for all that are forked
from tools.mutants.running import Worker, set_environment
from tools.mutants.sites import sites

root, file = Path(sys.argv[1]), "resample/files/toy.py"
set_environment(root.parent / "work", root)
worker = Worker(root, root.parent / "work", 20.0)
found = {s.after: s for s in sites(file, (root / file).read_bytes())}
cases = ["tests/test_toy.py::test_small", "tests/test_toy.py::test_large"]
tasks = [(cases, None)] + [(cases, found[after]) for after in sys.argv[2:]] + [([], None)]
told = [worker.run(*task)._asdict() for task in tasks]
assert (worker.root / file).read_bytes() == (root / file).read_bytes()
print(json.dumps(told))
"""


@pytest.mark.sweep
@pytest.mark.slow
def test_a_fault_is_killed_by_a_case_that_fails_and_survives_where_none_does(tmp_path):
    root = tmp_path / "toy"
    (root / "resample/files").mkdir(parents=True)
    (root / "tests").mkdir()
    for package in ("resample", "resample/files"):
        (root / package / "__init__.py").touch()
    (root / FILE).write_text("def half(x):\n    return x // 2 if x < 9 else 4\n")
    (root / "tests/test_toy.py").write_text(
        "from resample.files.toy import half\n\n\ndef test_small():\n    assert half(5) == 2\n\n\n"
        "def test_large():\n    assert half(20) == 4\n"
    )
    subprocess.run(["git", "init", "-q", str(root)], check=True)
    (tmp_path / "work").mkdir()
    mutants = [f"return x {rest}" for rest in ("/ 2 if x < 9 else 4", "// 2 if x < 9 else 5")]
    mutants.append("return x // 2 if x <= 9 else 4")
    command_line = [sys.executable, "-c", WORK, str(root), *mutants]
    out = subprocess.run(command_line, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    original, first, second, third, none = json.loads(out.splitlines()[-1])
    assert (original["status"], original["tried"]) == ("survived", 2)
    assert (first["status"], first["killed_by"]) == ("killed", ["tests/test_toy.py::test_small"])
    assert (second["status"], second["tried"]) == ("killed", 2)
    assert "assert 5 == 4" in second["message"]
    assert (third["status"], none["status"]) == ("survived", "unreached")


def test_the_summary_counts_what_is_not_equivalent():
    found = toy_sites()[:4]
    known = {
        site.id: {"status": status, "tried": 3, "cpu": 1.0, "killed_by": [], "message": ""}
        for site, status in zip(found, ["killed", "survived", "killed"], strict=False)
    }
    lines = list(command.summary(found, known, {found[0].text: "the same"}))
    assert lines[-1] == "\n1 of 2 killed (50.0%); 1 equivalent, 1 not tried"
    assert found[1].id in lines[0]


def test_each_equivalent_mutant_has_a_reason_and_a_file():
    for each in json.loads(command.EQUIVALENT.read_text()):
        assert len(each["reason"]) > 10
        assert (ROOT / each["mutant"].partition(" ")[0]).exists()
