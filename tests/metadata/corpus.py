"""Variants of files: fields that move, scale, turn or color what a file holds.

Each variant is written anew by a function and has an answer that is known beforehand. A field is

- obeyed: the reader gives what the field says;
- told: the reader does something else, and a message says so;
- refused: an error of one line names the field.

Nothing else may happen. `python -m tests.metadata` writes the table of `docs/metadata.md`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

Outcome = Literal["obeyed", "told", "refused"]


class Variant(NamedTuple):
    """A file with a field of which the answer is known."""

    format: str  # as in the table: "NIfTI"
    field: str  # as the format's specification spells it: "xyzt_units"
    case: str  # what is in the field: "micron"
    outcome: Outcome
    write: Callable[[Path], Any]  # writes into an empty folder, returns what the test compares with
    says: str = ""  # pattern of the message of what is told or refused

    def __str__(self) -> str:
        """Name of the test."""
        return f"{self.format}: {self.field}, {self.case}"


def table(variants: list[Variant]) -> str:
    """Format, field, outcome and cases, as Markdown; a line for a field and an outcome."""
    cases: dict[tuple[str, str, Outcome], list[str]] = {}
    for one in variants:
        cases.setdefault((one.format, one.field, one.outcome), []).append(one.case)
    lines = ["| Format | Field | | Tried |", "|---|---|---|---|"]
    for (name, field, outcome), tried in sorted(cases.items(), key=lambda pair: pair[0][0].lower()):
        lines.append(f"| {name} | {field} | {outcome} | {'; '.join(tried)} |")
    return "\n".join(lines)
