"""Tables of README.md and docs/*.md, generated from the record.

A table stands between `<!-- scores: NAME -->` and `<!-- end -->`.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.scores.judging import ROOT, Row
from benchmarks.scores.options import label
from benchmarks.scores.record import GROUPS, Taken, read

PAGES = (ROOT / "README.md", ROOT / "docs" / "quality.md", ROOT / "docs" / "performance.md")
BLOCK = re.compile(r"(<!-- scores: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
TIMES = {"CPU s", "CPU ms", "ms"}  # units of performance.md's rows

Record = Mapping[str, Taken]


class Table(NamedTuple):
    """Rows of a group whose cases match; with a group `column` they become a grid."""

    group: str
    cases: str  # regular expression with a group `row`
    head: str  # of the first column
    unit: str = ""  # of a grid


QUALITY = (
    Table("images", r"(?P<row>.*)", "case"),
    Table("gaussians", r"(?P<row>.*)", "case"),
    Table(
        "clouds",
        r"(?P<row>(?:ball and floor|bunny),.*?)(?:: (?P<column>holes|beyond the rim))?",
        "case",
        "dB; holes and rim: % of px",
    ),
    Table("clouds", r"64 rings, (?P<row>.*)", "64 rings"),
    Table("volumes", r"(?P<row>(?:ball|maximum|X-ray|blocks).*)", "case"),
    Table(
        "volumes",
        r"wall of one voxel, (?P<row>.*), (?P<column>.*): area off by",
        "wall of one voxel: error of its area",
        "%",
    ),
    Table(
        "volumes",
        r"(?P<row>.*), (?P<column>.* px a voxel): as the formula",
        "formulas in 64³ voxels",
        "dB",
    ),
    Table(
        "volumes",
        r"(?P<row>.*) halved, (?P<column>.*): as the whole",
        "scans, halved, against the whole",
        "dB",
    ),
    Table("depth", r"depth (?P<row>.*), (?P<column>\w+)", "depth", "dB"),
    Table("depth", r"(?P<row>(?:behind|stereo).*)", "case"),
)
SUMMARY = {  # rows of README.md, chosen by what they show, not by who is ahead
    "images": ("rotate 7, mean of 4 photographs", "smaller 3.75, mean of 4 photographs"),
    "depth": ("depth exact, side", "depth bilinear, 1.74 x enlarged, in"),
    "gaussians": (
        "guitar, near: as the usual rasterizer",
        "guitar, 4 x out: as the native picture averaged",
    ),
    "clouds": ("bunny, mid (1.5 px apart)", "bunny, mid (1.5 px apart), 1 % strays"),
    "volumes": (
        "rings, 1 px a voxel: as the formula",
        "wall of one voxel, 0.5 px a voxel, 4 degrees: area off by",
        "engine halved, 1 px a voxel: as the whole",
        "engine, 1 px a voxel: CPU beyond start",
    ),
}


def number(value: float | None, unit: str) -> str:
    """A figure, as exact as its unit deserves."""
    if value is None:
        return "-"
    if unit in {"px", "cells", "files", "ms", "CPU ms"}:
        return f"{value:.0f}"
    return f"{value:.1f}" if unit == "%" and value >= 10 else f"{value:.2f}"


def verdict(row: Row) -> str:
    """How far a row is ahead of the best peer or what is asked."""
    gap = row.gap()
    if row.ours is None:
        return "no answer"
    if gap is None:
        return ""
    if gap == 0:
        return "level"
    return (
        f"ahead by {number(gap, row.unit)}"
        if gap > 0
        else f"**behind** by {number(-gap, row.unit)}"
    )


def both(row: Row) -> str:
    """Ours and the best peer's figure, the better one in bold."""
    gap, ours, peer = row.gap(), number(row.ours, row.unit), number(row.peer, row.unit)
    if row.is_behind():
        return f"{ours} / **{peer}**"
    return f"**{ours}** / {peer}" if gap else f"{ours} / {peer}"


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table."""
    lines = ["| " + " | ".join(line) + " |" for line in (head, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]]) + "\n"


def listed(head: str, rows: Sequence[tuple[str, Row]]) -> str:
    """A table with a line for each row."""
    labels = [label(row.commands) for _, row in rows]
    shared = set(labels) == {"default"}
    ours = "default" if shared else "ours"
    columns = [head, ours, "best peer", "of", "", *([] if shared else ["options"])]
    lines = []
    for (case, row), by in zip(rows, labels, strict=True):
        unit = f" {row.unit}" if row.unit else ""
        figures = number(row.ours, row.unit) + unit, number(row.peer, row.unit)
        lines.append([case, *figures, row.name, verdict(row), *([] if shared else [by])])
    return markdown(columns, lines)


def grid(table: Table, found: Sequence[tuple[re.Match[str], Row]]) -> str:
    """A table with a cell for each row: ours / the best peer's."""
    labels = {label(row.commands) for _, row in found}
    ours = " or ".join(sorted(labels))
    cells = {(match["row"], match["column"] or "picture"): both(row) for match, row in found}
    columns = list(dict.fromkeys(column for _, column in cells))
    head = [f"{table.head}; {ours} / best peer, {table.unit}", *columns]
    names = dict.fromkeys(row for row, _ in cells)
    return markdown(
        head, ([name, *(cells.get((name, column), "") for column in columns)] for name in names)
    )


def rendered_table(table: Table, record: Record) -> str:
    """The table of the record's rows; empty if there are none."""
    found = list(matches(table, record))
    if not found:
        return ""
    if "column" in found[0][0].groupdict():
        return grid(table, found)
    return listed(table.head, [(match["row"], row) for match, row in found])


def matches(table: Table, record: Record) -> Iterator[tuple[re.Match[str], Row]]:
    """Rows that a table shows."""
    taken = record.get(table.group)
    for row in taken.rows if taken else ():
        match = re.fullmatch(table.cases, row.case)
        if match and row.unit not in TIMES:
            yield match, row


def tables_of(group: str) -> Callable[[Record], str]:
    """All tables of a group in quality.md."""

    def block(record: Record) -> str:
        texts = (rendered_table(table, record) for table in QUALITY if table.group == group)
        return "\n".join(filter(None, texts))

    return block


def when(record: Record) -> str:
    """When and where the groups were taken."""
    lines = [
        [group, each.date, f"`{each.commit}`", f"{each.yardstick:.1f}", f"{each.spent:.0f}"]
        for group, each in record.items()
    ]
    left_out = [f"{group}: {what}" for group, each in record.items() for what in each.skipped]
    processors = ", ".join(dict.fromkeys(each.processor for each in record.values()))
    head = ["group", "taken", "commit", "yardstick, CPU ms", "run, CPU s"]
    note = f"\nLeft out: {'; '.join(dict.fromkeys(left_out))}.\n" if left_out else ""
    return f"Processor: {processors}.\n\n{markdown(head, lines)}{note}"


def counted(record: Record) -> str:
    """How many rows are ahead, level and behind."""
    rows = [row for each in record.values() for row in each.rows]
    behind = sum(row.is_behind() for row in rows)
    level = sum(row.gap() == 0 for row in rows if not row.is_behind())
    ahead = len(rows) - behind - level
    return (
        f"Of {len(rows)} rows, {ahead} are ahead of the best peer or of what is asked, {level} are "
        f"level with it, and {behind} are behind.\n"
    )


def behind(record: Record) -> str:
    """Rows that are behind, but for times."""
    lines = [
        [
            group,
            row.case,
            f"{number(row.ours, row.unit)} {row.unit}".strip(),
            number(row.peer, row.unit),
            row.name,
        ]
        for group, each in record.items()
        for row in each.rows
        if row.is_behind() and row.unit not in TIMES
    ]
    return markdown(["group", "case", "ours", "best peer", "of"], lines)


def summary(record: Record) -> str:
    """The table of README.md."""
    lines = []
    for group, cases in SUMMARY.items():
        rows = {row.case: row for row in record[group].rows} if group in record else {}
        for row in (rows[case] for case in cases if case in rows):
            by = label(row.commands)
            case = row.case if by == "default" else f"{row.case}, {by}"
            ours = f"{number(row.ours, row.unit)} {row.unit}"
            peer = f"{number(row.peer, row.unit)}: {row.name}"
            lines.append([group, case, ours, peer, verdict(row)])
    return f"{counted(record)}\n{markdown(['group', 'case', 'ours', 'best peer', ''], lines)}"


def times(record: Record) -> str:
    """Rows of CPU time."""
    lines = []
    for row in (row for each in record.values() for row in each.rows if row.unit in TIMES):
        figures = [number(row.ours, row.unit), number(row.peer, row.unit)]
        factor = "" if not (row.ours and row.peer) else f"{row.ours / row.peer:.1f}"
        factor = f"**{factor}**" if row.is_behind() else factor
        unit = "CPU ms" if row.unit == "ms" else row.unit
        lines.append(
            [row.case, label(row.commands), figures[0], figures[1], unit, row.name, factor]
        )
    head = ["case", "options", "ours", "best peer", "unit", "of", "ours / peer"]
    return markdown(head, lines)


def commands(record: Record) -> str:
    """CPU seconds of whole commands, start included."""
    found: dict[tuple[str, str], list[float]] = {}
    for group, each in record.items():
        for row in each.rows:
            if row.cpu is not None:
                program = " ".join(row.commands[-1].split()[:2])
                found.setdefault((group, program), []).append(row.cpu)
    lines = [
        [group, f"`{program}`", f"{min(took):.2f} to {max(took):.2f}", str(len(took))]
        for (group, program), took in found.items()
    ]
    return markdown(["group", "command", "CPU s", "rows"], lines)


BLOCKS: Mapping[str, Callable[[Record], str]] = {
    **{group: tables_of(group) for group in GROUPS},
    **{"summary": summary, "when": when, "counted": counted, "behind": behind},
    **{"times": times, "commands": commands},
}


def rendered(text: str, record: Record) -> str:
    """A page with its tables from the record."""
    return BLOCK.sub(lambda match: match[1] + BLOCKS[match[2]](record) + match[3], text)


def rewrite(record: Record | None = None, pages: Iterable[Path] = PAGES) -> None:
    """Write the tables of all pages."""
    known = read() if record is None else record
    for page in pages:
        text = page.read_text(encoding="utf-8")
        if (made := rendered(text, known)) != text:
            page.write_text(made, encoding="utf-8")
