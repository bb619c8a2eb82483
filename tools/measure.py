"""Measure the house: `python tools/measure.py` prints sizes of `resample` and `apps`.

Code lines are those of function bodies, without docstrings, blank lines and comments. A private
helper is called once if its name is read once in its module, and a record is built once if one
call in the house names it. Modules are those that a command has loaded when it is done.
"""

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
COMMANDS = {
    "resample_texture": "resize sample:bricks {} --size 100",
    "resample_warp3d": "render sample:room --move 0.1,0,0 -o {}",
    "resample_points": "render sample:knot-points -o {}",
    "resample_volume": "render sample:vessel-tree -o {}",
}
AT_EXIT = """
import atexit, sys
from {package}.__main__ import main
ours = ("resample", *{packages})
atexit.register(lambda: print(sum(name.split(".")[0] in ours for name in sys.modules)))
sys.argv = ["measure", *{words}]
main()
"""


def code_lines(node: ast.FunctionDef | ast.AsyncFunctionDef, lines: list[str]) -> int:
    """Count the lines of a function's body that are code."""
    body = node.body[1:] if ast.get_docstring(node) is not None else node.body
    if not body:
        return 0
    inside = (line.strip() for line in lines[body[0].lineno - 1 : body[-1].end_lineno])
    return sum(bool(line) and not line.startswith("#") for line in inside)


def is_record(node: ast.AST) -> bool:
    """Tell whether a class is a NamedTuple or a dataclass."""
    if not isinstance(node, ast.ClassDef):
        return False
    return "NamedTuple" in map(ast.unparse, node.bases) or any(
        "dataclass" in ast.unparse(each) for each in node.decorator_list
    )


def sizes() -> dict[str, float]:
    """Measure the sources."""
    paths = [path for top in ("resample", "apps") for path in (ROOT / top).rglob("*.py")]
    texts = [path.read_text() for path in paths]
    functions = code = helpers = 0
    records: list[str] = []
    built: Counter[str] = Counter()
    for text in texts:
        nodes = list(ast.walk(ast.parse(text)))
        used = Counter(
            each.id if isinstance(each, ast.Name) else each.attr
            for each in nodes
            if isinstance(each, ast.Attribute)
            or (isinstance(each, ast.Name) and isinstance(each.ctx, ast.Load))
        )
        built.update(
            ast.unparse(each.func).split(".")[-1] for each in nodes if isinstance(each, ast.Call)
        )
        records += [each.name for each in nodes if is_record(each)]
        for each in nodes:
            if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef):
                functions += 1
                code += code_lines(each, text.splitlines())
                private = each.name.startswith("_") and not each.name.startswith("__")
                helpers += private and used[each.name] == 1
    return {
        "lines": sum(text.count("\n") for text in texts),
        "files": len(paths),
        "functions": functions,
        "code lines per function": round(code / functions, 1),
        "private helpers called once": helpers,
        "records built once": sum(built[name] <= 1 for name in records),
    }


def modules_of(package: str, words: str) -> int:
    """Count our modules that are loaded when a command is done."""
    text = AT_EXIT.format(package=package, packages=tuple(COMMANDS), words=words.split())
    run = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    return int(run.stdout.split()[-1])


def main() -> None:
    """Write sizes, and the modules that each application's first command loads."""
    measured = {name: str(value) for name, value in sizes().items()}
    with TemporaryDirectory() as folder:
        picture = Path(folder, "picture.png")
        for package, words in COMMANDS.items():
            name = f"modules loaded by {package.replace('_', '-')} {words.split()[0]}"
            measured[name] = str(modules_of(package, words.format(picture)))
    sys.stdout.writelines(f"{name:45}{value:>10}\n" for name, value in measured.items())


if __name__ == "__main__":
    main()
