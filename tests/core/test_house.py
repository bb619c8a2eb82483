import ast
import importlib.util
from pathlib import Path

import pytest

HOUSE = Path(__file__).parents[2] / "tools" / "house.py"


@pytest.fixture(scope="module")
def house():
    spec = importlib.util.spec_from_file_location("house", HOUSE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def circles_in(house, texts):
    known = [
        house.Module(Path(path), path.removesuffix(".py").replace("/", "."), ast.parse(text))
        for path, text in texts.items()
    ]
    return list(house.circles_of_folders(known))


@pytest.mark.parametrize(
    "back",
    [
        "from app.data import bricks",
        "from app.data.bricks import Bricks",
        "import app.data.bricks",
        "if TYPE_CHECKING:\n    from app.data.bricks import Bricks",
        "def late():\n    from app.data.bricks import Bricks",
        "def late():\n    return import_module('app.data.bricks')",
    ],
)
def test_two_folders_that_import_each_other_are_a_circle_though_their_modules_are_none(house, back):
    texts = {
        "app/data/bricks.py": "",
        "app/data/files.py": "from app.looks import tables",
        "app/looks/tables.py": "",
        "app/looks/labels.py": back,
    }
    assert circles_in(house, texts) == ["folders import each other: app.data, app.looks"]


def test_a_folder_and_one_inside_it_are_a_circle_if_both_import_the_other(house):
    texts = {
        "app/files/headers.py": "",
        "app/files/readers.py": "from app.files.formats import nrrd",
        "app/files/formats/nrrd.py": "from app.files import headers",
    }
    assert circles_in(house, texts) == ["folders import each other: app.files, app.files.formats"]


def test_modules_at_the_top_of_a_package_are_places_of_their_own(house):
    texts = {
        "app/types.py": "",
        "app/rendering.py": "from app.looks import tables",
        "app/looks/tables.py": "from app import types",
    }
    assert circles_in(house, texts) == []


def test_folders_that_a_circle_leads_to_are_not_in_it(house):
    texts = {
        "app/a/one.py": "from app.b import one",
        "app/b/one.py": "from app.a import two\nfrom app.c import one",
        "app/a/two.py": "",
        "app/c/one.py": "",
    }
    assert circles_in(house, texts) == ["folders import each other: app.a, app.b"]


def described(house, head, *names):
    lines = "".join(f"    {name}\n        What it is.\n" for name in names)
    text = f'def f({head}):\n    """Do.\n\n    Parameters\n    ----------\n{lines}    """\n'
    return list(
        house.described_arguments([house.Module(Path("app/a.py"), "app.a", ast.parse(text))])
    )


def test_docstrings_describe_arguments_that_there_are(house):
    assert described(house, "a, /, b, *c, d=1, **e", "a, b", "*c", "d", "e") == []
    assert described(house, "a, *b", "b", "old") == [
        "app/a.py:f: describes old, which it does not take"
    ]
    wrong = described(house, "mask", "Of pixels that, each")
    assert len(wrong) == 2
    assert any("Of pixels that" in line for line in wrong)
