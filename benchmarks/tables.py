"""Format results as Markdown and JSON."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from benchmarks.measure import Spread

Cell: TypeAlias = str | float | int | Spread | None
Row: TypeAlias = dict[str, Cell]


@dataclass
class Section:
    """A table with its text and notes."""

    title: str
    text: str
    rows: list[Row] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def number(value: float) -> str:
    """Three digits, without an exponent where possible."""
    if not math.isfinite(value):
        return "∞" if value > 0 else str(value)
    size = abs(value)
    if size >= 1e7 or 0 < size < 1e-3:
        return f"{value:.2e}"
    decimals = 0 if size >= 100 else 1 if size >= 10 else 2 if size >= 1 else 3
    return f"{value:,.{decimals}f}"


def shown(cell: Cell) -> str:
    """Format a cell: numbers with three digits, spreads as `median (quartile to quartile)`."""
    if cell is None:
        return ""
    if isinstance(cell, Spread):
        if cell.size < 2:
            return number(cell.median)
        return f"{number(cell.median)} ({number(cell.low)} to {number(cell.high)})"
    if isinstance(cell, float):
        return number(cell)
    return f"{cell:,}" if isinstance(cell, int) else cell


def columns(rows: Iterable[Row]) -> list[str]:
    """Names of all non-empty columns, in order of first occurrence."""
    return list(dict.fromkeys(name for row in rows for name, cell in row.items() if cell != ""))


def table(rows: list[Row]) -> str:
    """Markdown table."""
    names = columns(rows)
    lines = [names, ["---"] * len(names)]
    lines += [[shown(row.get(name)) for name in names] for row in rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def markdown(section: Section) -> str:
    """A section with its heading, table and notes."""
    parts = [f"### {section.title}\n", f"{section.text}\n" if section.text else ""]
    parts.append(table(section.rows) if section.rows else "")
    parts.append("".join(f"- {note}\n" for note in dict.fromkeys(section.notes)))
    return "\n".join(part for part in parts if part)


def document(command: str, facts: Mapping[str, str], sections: Iterable[Section]) -> str:
    """All sections, after the command and the machine."""
    head = "## Measured\n\n```\n" + command + "\n```\n"
    lines = "".join(f"| {name} | {fact} |\n" for name, fact in facts.items())
    explained = (
        "Times are medians of warm repetitions in which all contenders of a table took turns, with "
        "their quartiles in\nbrackets; ratios are taken round by round. Memory is the peak of a "
        "fresh process that loads the data,\nprepares and draws once.\n"
    )
    body = "\n".join(markdown(section) for section in sections)
    return f"{head}\n| | |\n| --- | --- |\n{lines}\n{explained}\n{body}"


def as_json(command: str, facts: Mapping[str, str], sections: Iterable[Section]) -> dict[str, Any]:
    """All sections as JSON; a spread is an object with median, low, high and size."""
    return {
        "command": command,
        "machine": dict(facts),
        "sections": [
            {
                "title": section.title,
                "rows": [
                    {name: _plain(cell) for name, cell in row.items()} for row in section.rows
                ],
                "notes": section.notes,
            }
            for section in sections
        ],
    }


def _plain(cell: Cell) -> Any:
    if isinstance(cell, Spread):
        return cell._asdict()
    if isinstance(cell, float) and not math.isfinite(cell):
        return str(cell)
    return cell
