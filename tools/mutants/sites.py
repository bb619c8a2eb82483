"""Places in the sources where a small fault can be put, and a stratified sample of them."""

import ast
import hashlib
import re
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

PLUGINS = (
    *("chunks", "comparisons", "dropins", "figures", "formats", "gradients", "labels", "meshes"),
    *("particles", "sky", "zarr"),
)
PACKAGES = (
    "resample",
    *(f"apps/{a}/resample_{a}" for a in ("points", "texture", "volume", "warp3d")),
    *(f"plugins/{a}/resample_{a}" for a in PLUGINS),
)
# The first pattern that matches a path settles its stratum; None: no mutants.
STRATA = (
    (r"/data/|^resample/samples/|^resample/testing\.py", None),
    (r"/kernels/", "kernels"),
    (r"^plugins/(comparisons|figures)/", None),  # the paper's figures and other programs' methods
    (r"^resample/engine/compiled/", "plumbing"),
    (r"^resample/engine/", "kernels"),
    (r"^resample/hybrid/", "hybrid"),
    (r"^resample/(painting|profiles|cameras)/", "painting"),
    (r"^resample/(files|reading)/|^(apps|plugins)/\w+/\w+/(files|exchange|inputs)", "readers"),
    (r"^plugins/(formats|zarr)/", "readers"),
    (r"^resample/|/(command|viewing)(/|\.py)|/cli\.py|/__main__\.py", "plumbing"),
    (r"^(apps/points|plugins/particles)/", "points"),
    (r"^apps/texture/|^plugins/", "texture"),
    (r"^apps/volume/", "volume"),
    (r"^apps/warp3d/", "warp3d"),
)
FEWEST = 4  # mutants of a stratum

COMPARISONS = {
    ast.Lt: "<=",
    ast.LtE: "<",
    ast.Gt: ">=",
    ast.GtE: ">",
    ast.Eq: "!=",
    ast.NotEq: "==",
}
OPERATORS = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "/"),
    ast.Mod: ("%", "//"),
}
ATOMS = (ast.Name, ast.Attribute, ast.Call, ast.Subscript)  # parts that need no brackets
AXES = {0: 1, 1: 0, 2: 1}
TYPES = re.compile(r"(NDArray|Annotated|Literal|dict|tuple|list|Callable|Iterator|Sequence)")
UNITS = re.compile(r"(radians|deg2rad|degrees|rad2deg)$")
ROUNDINGS = {"round", "np.floor", "np.ceil", "np.round", "np.rint", "math.floor", "math.ceil"}
UNORDERED = {"isinstance", "issubclass", "getattr", "hasattr", "setattr", "zip", "print", "TypeVar"}


class Change(NamedTuple):
    """Bytes of a source file that a fault replaces."""

    kind: str
    node: ast.AST
    begin: int
    end: int
    new: str


class Site(NamedTuple):
    """A mutant: a fault at one place of a source file."""

    id: str
    stratum: str
    kind: str
    file: str  # relative to the root
    line: int
    function: str  # qualified; empty at the level of the module
    begin: int  # bytes
    end: int
    new: str
    before: str  # the source lines, on one line
    after: str

    @property
    def text(self) -> str:
        """What `equivalent.json` names a mutant by; edits elsewhere do not change it."""
        return f"{self.file} {self.function}: {self.before} -> {self.after}"


class Source:
    """A parsed source file."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.tree = ast.parse(raw)
        self.nodes: list[ast.AST] = [self.tree]
        self.parents: dict[ast.AST, ast.AST] = {}
        for node in self.nodes:  # which grows
            for child in ast.iter_child_nodes(node):
                if not isinstance(child, ast.expr_context):
                    self.parents[child] = node
                    self.nodes.append(child)

    @cached_property
    def _lines(self) -> list[int]:
        return [0, *np.cumsum([len(line) for line in self.raw.splitlines(keepends=True)]).tolist()]

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Where the bytes of a node begin and end."""
        begin = self._lines[node.lineno - 1] + node.col_offset
        return begin, self._lines[node.end_lineno - 1] + node.end_col_offset

    def text(self, node: ast.AST) -> str:
        return self.between(*self.span(node))

    def between(self, begin: int, end: int) -> str:
        return self.raw[begin:end].decode()

    def function(self, node: ast.AST) -> str:
        """Qualified name of the function or class that a node is in."""
        names = []
        while node in self.parents:
            node = self.parents[node]
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.append(node.name)
        return ".".join(reversed(names))

    def lines_around(self, begin: int, end: int) -> tuple[int, int]:
        """Begin and end of the lines that bytes are in."""
        last = self.raw.find(b"\n", end)
        return self.raw.rfind(b"\n", 0, begin) + 1, len(self.raw) if last < 0 else last


def sites(file: str, raw: bytes) -> Iterator[Site]:
    """All mutants of a source file."""
    stratum = stratum_of(file)
    if stratum is None:
        return
    source, seen = Source(raw), defaultdict(int)
    for change in _changes(source):
        begin, end = source.lines_around(change.begin, change.end)
        old = source.between(change.begin, change.end)
        if old == change.new:
            continue
        before = source.between(begin, end)
        after = source.between(begin, change.begin) + change.new + source.between(change.end, end)
        before, after = (" ".join(text.split()) for text in (before, after))
        function = source.function(change.node)
        text = f"{file} {function} {change.kind} {before} {after}"
        seen[text] += 1
        name = hashlib.sha256(f"{text} {seen[text]}".encode()).hexdigest()[:8]
        where = (file, change.node.lineno, function, change.begin, change.end)
        yield Site(name, stratum, change.kind, *where, change.new, before, after)


def stratum_of(file: str) -> str | None:
    """The stratum of a source file; None if it has no mutants."""
    if not file.startswith(PACKAGES):
        return None
    return next((name for pattern, name in STRATA if re.search(pattern, file)), None)


def _changes(source: Source) -> Iterator[Change]:
    skipped = set(_skipped(source))
    for node in source.nodes:
        if node in skipped:
            continue
        match node:
            case ast.Compare(ops=[only]) if type(only) in COMPARISONS:
                yield from _comparison(source, node, COMPARISONS[type(only)])
            case ast.BinOp() if type(node.op) in OPERATORS:
                yield from _operator(source, node)
            case ast.UnaryOp(op=ast.USub(), operand=part) if not isinstance(part, ast.Constant):
                yield Change("sign", node, *source.span(node), f"({source.text(part)})")
            case ast.UnaryOp(op=ast.Not(), operand=part):
                yield Change("logic", node, *source.span(node), f"({source.text(part)})")
            case ast.BoolOp():
                words = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
                yield from _between(source, "logic", node, node.values[:2], *words)
            case ast.Constant(value=bool() | int() | float()):
                yield _constant(source, node)
            case ast.Call():
                yield from _call(source, node)
            case ast.If(body=[ast.Raise()], orelse=[]):
                yield Change("validation", node, *source.span(node.test), "False")
        dropped = isinstance(node, ast.AugAssign) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and not _logs(node)
        )
        if dropped and not isinstance(source.parents[node], ast.Module):
            yield Change("dropped", node, *source.span(node), "pass")


def _skipped(source: Source) -> Iterator[ast.AST]:
    """Nodes of types and decorators, and imports for types alone."""
    for node in source.nodes:
        unused = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        unused += getattr(node, "decorator_list", ())
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            unused.append(node)
        if isinstance(node, ast.Subscript) and TYPES.fullmatch(getattr(node.value, "id", "")):
            unused.append(node)
        for part in unused:
            if isinstance(part, ast.AST):
                yield from ast.walk(part)


def _logs(node: ast.Expr) -> bool:
    return ast.unparse(node.value.func).startswith(("LOG", "logging", "print"))


def _between(
    source: Source, kind: str, node: ast.AST, parts: list[ast.expr], old: str, new: str
) -> Iterator[Change]:
    """Replace the operator between two operands."""
    begin, end = source.span(parts[0])[1], source.span(parts[1])[0]
    between = source.between(begin, end)
    if between.strip(" ()\n") == old:
        yield Change(kind, node, begin, end, between.replace(old, new))


def _comparison(source: Source, node: ast.Compare, new: str) -> Iterator[Change]:
    parts = [node.left, node.comparators[0]]
    kind = "equality" if new in ("!=", "==") else "boundary"
    old = next(old for old in ("<=", ">=", "==", "!=", "<", ">") if _has(source, parts, old))
    yield from _between(source, kind, node, parts, old, new)


def _has(source: Source, parts: list[ast.expr], operator: str) -> bool:
    return operator in source.between(source.span(parts[0])[1], source.span(parts[1])[0])


def _operator(source: Source, node: ast.BinOp) -> Iterator[Change]:
    sequences = (ast.List, ast.Tuple, ast.JoinedStr)
    parts = [node.left, node.right]
    if any(isinstance(part, sequences) or _is_text(part) for part in parts):
        return
    yield from _between(source, "operator", node, parts, *OPERATORS[type(node.op)])


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _constant(source: Source, node: ast.Constant) -> Change:
    """Another truth, axis or number."""
    parent, value = source.parents.get(node), node.value
    kind = "default" if isinstance(parent, ast.arguments) else "constant"
    if isinstance(value, bool):
        new = str(not value)
    elif isinstance(parent, ast.keyword) and parent.arg == "axis":
        kind, new = "axis", str(AXES.get(value, 0))
    elif isinstance(value, int):
        new = str(value + 1 if value < 1000 else value - 1)
    else:
        new = repr(value * 1.1 if value else 0.1)
    return Change(kind, node, *source.span(node), new)


def _call(source: Source, node: ast.Call) -> Iterator[Change]:
    """Calls that limit, convert units or round without doing so; others with swapped arguments."""
    name, given = ast.unparse(node.func), node.args
    whole = source.span(node)
    first = source.text(given[0]) if given else ""
    alone = first if given and isinstance(given[0], ATOMS) else f"({first})"
    if name in ("min", "max", "np.minimum", "np.maximum") and len(given) >= 2:
        yield Change("clip", node, *whole, alone)
        if name in ("min", "max"):
            other = "max" if name == "min" else "min"
            yield Change("clip", node, *source.span(node.func), other)
    elif name.endswith("clip") and given:
        is_method = isinstance(node.func, ast.Attribute) and name != "np.clip"
        yield Change("clip", node, *whole, source.text(node.func.value) if is_method else alone)
    elif UNITS.search(name) and given:
        yield Change("unit", node, *whole, alone)
    elif name in ROUNDINGS and given:
        is_whole = name == "round" and len(given) == 1
        yield Change("rounding", node, *whole, f"int({first})" if is_whole else alone)
    elif len(given) >= 2 and name not in UNORDERED and not name.startswith("LOG"):
        begin, end = source.span(given[0]), source.span(given[1])
        second = source.text(given[1])
        if not any(isinstance(argument, ast.Starred) for argument in given[:2]):
            swapped = second + source.between(begin[1], end[0]) + first
            yield Change("swapped arguments", node, begin[0], end[1], swapped)


def sample(root: Path, count: int, seed: int) -> list[Site]:
    """Mutants of all strata, in proportion to their lines; within a stratum all kinds alike.

    A larger count of the same seed adds mutants to those of a smaller one.
    """
    found, lines = defaultdict(list), defaultdict(int)
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            file = path.relative_to(root).as_posix()
            stratum = stratum_of(file)
            if stratum is not None:
                raw = path.read_bytes()
                found[stratum] += sites(file, raw)
                lines[stratum] += raw.count(b"\n")
    total = sum(lines.values())
    picked = []
    for stratum in sorted(found):
        most = max(FEWEST, round(count * lines[stratum] / total))
        picked += _drawn(found[stratum], most, np.random.default_rng([seed, *stratum.encode()]))
    return picked


def sample_at(commit: str, root: Path, count: int, seed: int) -> list[Site]:
    """The sample of the sources of a commit, without what has changed since then.

    An edit can change a sample, as its places are drawn by number; scores are of one sample.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = ["git", "archive", commit, *PACKAGES]
        packed = subprocess.run(command, cwd=root, check=True, capture_output=True).stdout
        subprocess.run(["tar", "-x", "-C", folder], input=packed, check=True)
        drawn = sample(Path(folder), count, seed)
    now = {}
    for file in {site.file for site in drawn}:
        if (root / file).exists():
            now |= {site.id: site for site in sites(file, (root / file).read_bytes())}
    return [now[site.id] for site in drawn if site.id in now]


def _drawn(known: list[Site], count: int, rng: np.random.Generator) -> list[Site]:
    """Sites in random order, of one kind after the other, as few as possible of one function."""
    kinds = defaultdict(list)
    for n in rng.permutation(len(known)):
        kinds[known[n].kind].append(known[n])
    order, used = [], defaultdict(int)
    while len(order) < min(count, len(known)):
        for kind in rng.permutation(sorted(kinds)):
            if kinds[kind] and len(order) < count:
                site = min(kinds[kind], key=lambda s: used[s.file, s.function])
                kinds[kind].remove(site)
                used[site.file, site.function] += 1
                order.append(site)
    return order
