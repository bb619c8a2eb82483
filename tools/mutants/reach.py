"""Which cases of the tests to try for a mutant: those that run through it, cheap ones first."""

import ast
import gzip
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Container, Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from tools.mutants.marks import FOLDER, ROOT, blocks, is_kernel
from tools.mutants.sites import PACKAGES, Site

Name = tuple[str, str]  # a module, and a name of its top level
SIGNATURES = r"inspect\.signature\(|import .*\bparameters\b"  # tests that read them call nothing
STARTING = 0.02  # CPU seconds of a case beside what it does
FILES = 12  # of tests; to import one takes as long as many cases
NEARER = 0.2  # worth of a case in a file that names the module or the function
MANY = 20  # marks; a case that meets no more is about little


class Case(NamedTuple):
    """A case of the tests."""

    name: str  # pytest's id
    seconds: float
    marks: frozenset[int]


class Reach(NamedTuple):
    """What all cases run through."""

    commit: str
    files: dict[str, str]  # digests of the files of tests
    marks: dict[str, int]  # numbers of blocks `file:function:n`, and of kernels `module:name`
    cases: list[Case]


def record(commit: str, workers: int, files: Sequence[str] = ()) -> Reach:
    """Run tests of `make test` once, all or those of some files, with marks in all functions."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "sitecustomize.py").write_text("import tools.mutants.marks\n")
        path = os.pathsep.join([folder, str(ROOT)])
        environment = {**os.environ, FOLDER: folder, "PYTHONPATH": path}
        options = ["-q", "--assert=plain", "-n", str(workers), "--dist", "worksteal"]
        command = [sys.executable, "-m", "pytest", *options, "-p", "tools.mutants.marks"]
        subprocess.run(
            [*command, "-m", "not sweep and not browser", *files],
            cwd=ROOT,
            env=environment,
            check=False,
        )
        lines = [line for file in Path(folder).glob("*.jsonl") for line in file.open()]
    return _gathered(commit, [json.loads(line) for line in lines], digests(ROOT))


def merged(known: Reach, new: Reach, files: Sequence[str]) -> Reach:
    """What was known of cases, with what is new of those of some files."""
    lines = [
        [case.name, case.seconds, "passed", [names[n] for n in case.marks]]
        for reach in (known, new)
        for names in [list(reach.marks)]
        for case in reach.cases
        if reach is new or case.name.partition("::")[0] not in files
    ]
    now = {file: new.files[file] for file in files if file in new.files}
    return _gathered(known.commit, lines, known.files | now)


def digests(root: Path) -> dict[str, str]:
    """Digests of all files of tests."""
    folders = [root / "tests", *sorted(root.glob("plugins/*/tests"))]
    files = sorted(file for folder in folders for file in folder.rglob("test_*.py"))
    return {
        file.relative_to(root).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
    }


def _gathered(commit: str, lines: list[list], files: dict[str, str]) -> Reach:
    """Cases that passed, with what their processes met."""
    met, seconds, failed = defaultdict(set), {}, set()
    for case, spent, outcome, marks in lines:
        met[case].update(marks)
        if outcome:
            seconds[case] = spent
            if outcome != "passed":
                failed.add(case)
    names = sorted(set().union(*met.values()))
    numbers = dict(zip(names, range(len(names)), strict=True))
    cases = [
        Case(case, spent, frozenset(numbers[mark] for mark in met[case]))
        for case, spent in sorted(seconds.items())
        if case not in failed
    ]
    return Reach(commit, files, numbers, cases)


def write(reach: Reach, file: Path) -> None:
    """Keep what cases run through in a file."""
    cases = [(case.name, case.seconds, sorted(case.marks)) for case in reach.cases]
    known = {"commit": reach.commit, "files": reach.files, "marks": list(reach.marks)}
    text = json.dumps({**known, "cases": cases})
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(gzip.compress(text.encode()))


def read(file: Path) -> Reach:
    """What a file tells of what cases run through."""
    known = json.loads(gzip.decompress(file.read_bytes()))
    marks = {name: n for n, name in enumerate(known["marks"])}
    cases = [Case(name, spent, frozenset(met)) for name, spent, met in known["cases"]]
    return Reach(known["commit"], known["files"], marks, cases)


class Mentions:
    """Which functions mention a constant, a class or a kernel, also through others of these."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.defined: dict[Name, ast.stmt] = {}
        self.files: dict[str, str] = {}
        self._users: defaultdict[Name, set[Name]] = defaultdict(set)
        trees = {}
        for package in PACKAGES:
            for path in sorted((root / package).rglob("*.py")):
                module = _module(path.relative_to(root))
                trees[module] = ast.parse(path.read_bytes())
                self.files[module] = path.relative_to(root).as_posix()
        for module, tree in trees.items():
            for statement in tree.body:
                self.defined |= {(module, name): statement for name in _bound(statement)}
        for module, tree in trees.items():
            self._read(module, tree)

    def _read(self, module: str, tree: ast.Module) -> None:
        imported = dict(_imported(tree))
        for statement in tree.body:
            for user in _bound(statement):
                for name in _names(statement):
                    used = imported.get(name, (module, name))
                    self._users[used].add((module, user))
                # A body of a role is used by whoever calls the role.
                for decorator in getattr(statement, "decorator_list", ()):
                    if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "plays":
                        role = ast.unparse(decorator.args[0])
                        self._users[module, user].add(imported.get(role, (module, role)))

    def marks(self, module: str, name: str, known: Container[str]) -> Iterator[str]:
        """Known marks of functions that mention a name, and of kernels that have it in them.

        Where a function's own mark is not known, those of what mentions the function are given.
        """
        seen, waiting = {(module, name)}, [(module, name)]
        while waiting:
            current = waiting.pop()
            node = self.defined.get(current)
            is_python = isinstance(node, ast.FunctionDef) and not is_kernel(node)
            parts = [n.name for n in ast.walk(node or ast.Pass()) if isinstance(n, ast.FunctionDef)]
            own = f"{self.files.get(current[0])}:{current[1]}"
            marks = [":".join(current), f"{own}:0", *(f"{own}.{part}:0" for part in parts)]
            met = [mark for mark in marks if mark in known]
            yield from met
            if is_python and met:
                continue
            new = self._users[current] - seen
            seen |= new
            waiting += new


def _module(path: Path) -> str:
    parts = path.with_suffix("").parts
    parts = parts[2:] if parts[0] in ("apps", "plugins") else parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _bound(statement: ast.stmt) -> list[str]:
    """Names that a statement of a module's top level defines."""
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return [statement.name]
    names = [part for part in ast.walk(statement) if isinstance(part, ast.Name)]
    return [part.id for part in names if isinstance(part.ctx, ast.Store)]


def _imported(tree: ast.Module) -> Iterator[tuple[str, Name]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                yield alias.asname or alias.name, (node.module, alias.name)


def _names(statement: ast.stmt) -> set[str]:
    """Names that a statement mentions, the last parts of dotted ones among them."""
    names = {part.id for part in ast.walk(statement) if isinstance(part, ast.Name)}
    return names | {part.attr for part in ast.walk(statement) if isinstance(part, ast.Attribute)}


class Chooser:
    """Chooses cases for mutants."""

    def __init__(self, root: Path, reach: Reach) -> None:
        self.root, self.reach = root, reach
        self._files: dict[str, tuple[ast.Module, list[tuple[str, int, int]]]] = {}
        # What a case costs, and how much it meets beside a mutant; less is better.
        self._worth = [(c.seconds + STARTING) * (len(c.marks) + MANY) for c in reach.cases]
        self._met_by: defaultdict[int, list[int]] = defaultdict(list)
        for n, case in enumerate(reach.cases):
            for mark in case.marks:
                self._met_by[mark].append(n)

    @cached_property
    def _mentions(self) -> Mentions:
        return Mentions(self.root)

    def cases(self, site: Site, budget: float) -> list[str]:
        """Cases that run through a mutant, as many as the CPU seconds `budget` allow.

        Those come first that are cheap, meet little, and are in files that name the module or the
        function; but not many of one test: each further case of a test counts as dearer.
        """
        reached = {n for mark in self._marks(site) for n in self._met_by[mark]}
        reached = (reached | self._importing(site)) or self._named(site)
        if site.kind == "default":
            reached |= self._of(SIGNATURES)
        near = self._named(site)
        cases, order, seen = self.reach.cases, [], defaultdict(int)
        worth = {n: self._worth[n] * (NEARER if n in near else 1.0) for n in reached}
        for n in sorted(reached, key=worth.__getitem__):
            test = cases[n].name.partition("[")[0]
            seen[test] += 1
            order.append((worth[n] * seen[test], n))
        chosen, spent, files = [], 0.0, set()
        for _, n in sorted(order):
            name, seconds = cases[n].name, cases[n].seconds + STARTING
            files |= {name.partition("::")[0]} if len(files) < FILES else set()
            if name.partition("::")[0] in files and (spent + seconds <= budget or not chosen):
                spent += seconds
                chosen.append(name)
        return chosen

    @cached_property
    def _texts(self) -> dict[str, str]:
        """Files of tests."""
        files = {case.name.partition("::")[0] for case in self.reach.cases}
        paths = {file: self.root / file for file in files}
        return {file: path.read_text() for file, path in paths.items() if path.exists()}

    def _named(self, site: Site) -> set[int]:
        """Cases of files that name the function or its module, for what no mark tells of."""
        last = site.function.rpartition(".")[2] or "\0"
        return self._of(rf"\b({re.escape(last)}|{re.escape(_module(Path(site.file)))})\b")

    def _importing(self, site: Site) -> set[int]:
        """Cases of files that import and name a function or constant, such as a kernel's body."""
        parent, _, leaf = map(re.escape, _module(Path(site.file)).rpartition("."))
        name = site.function.partition(".")[0] or re.split(r"\W", site.before, maxsplit=1)[0]
        imports = rf"from {parent}(\.{leaf} import|[ ]import (\([^)]*|[^\n]*)\b{leaf}\b)"
        return self._of(imports) & self._of(rf"\b{re.escape(name)}\b")

    def _of(self, pattern: str) -> set[int]:
        """Cases of files with a pattern."""
        named = {file for file, text in self._texts.items() if re.search(pattern, text)}
        cases = self.reach.cases
        return {n for n in range(len(cases)) if cases[n].name.partition("::")[0] in named}

    def _parsed(self, file: str) -> tuple[ast.Module, list[tuple[str, int, int]]]:
        """A module, and the first and last lines of its blocks."""
        if file not in self._files:
            tree = ast.parse((self.root / file).read_bytes())
            bodies = [(name, body[0].lineno, body[-1].end_lineno) for name, body in blocks(tree)]
            self._files[file] = tree, bodies
        return self._files[file]

    def _marks(self, site: Site) -> Iterable[int]:
        """The innermost block that is marked, else what mentions the function or constant."""
        tree, bodies = self._parsed(site.file)
        line = site.line
        around = [f"{site.file}:{site.function}:0"]  # also of what is before the body
        around += [f"{site.file}:{name}" for name, first, last in bodies if first <= line <= last]
        known = self.reach.marks
        met = [known[name] for name in around if name in known]
        if met:
            return [met[-1]]  # blocks come from the outermost to the innermost
        module = _module(Path(site.file))
        top = [s for s in tree.body if s.lineno <= line <= s.end_lineno]
        bound = [name for statement in top for name in _bound(statement)]
        return {known[m] for name in bound for m in self._mentions.marks(module, name, known)}
