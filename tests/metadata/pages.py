"""The page of the documentation that lists all variants."""

import importlib
import re
from pathlib import Path

from tests.metadata.corpus import Variant, table

PAGE = Path(__file__).parents[2] / "docs" / "metadata.md"
TABLE = re.compile(r"(<!-- variants -->\n).*(<!-- end -->)", re.DOTALL)


def variants() -> list[Variant]:
    """All variants: what the modules beside this one call `VARIANTS`."""
    found = sorted(path.stem for path in Path(__file__).parent.glob("test_*.py"))
    modules = [importlib.import_module(f"tests.metadata.{name}") for name in found]
    return [one for module in modules for one in getattr(module, "VARIANTS", ())]


def filled(page: str) -> str:
    """The page with the table and the count of today."""
    every = variants()
    text = f"{len(every)} variants are tried.\n\n{table(every)}\n"
    return TABLE.sub(lambda found: f"{found[1]}{text}{found[2]}", page)
