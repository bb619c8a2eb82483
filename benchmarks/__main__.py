"""Run benchmarks: `python -m benchmarks [GROUP ...]`, or all groups with `make bench`."""

import argparse
import json
import shlex
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from benchmarks.contest import AbsentError, Options
from benchmarks.measure import machine
from benchmarks.tables import Section, as_json, document, markdown

GROUPS = ("growth", "startup", "interactive", "view")
QUICK_ROUNDS = 2


def parsed(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the arguments."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"of {', '.join(GROUPS)}; all")
    parser.add_argument(
        "--quick", action="store_true", help="small sizes, to check that everything works"
    )
    parser.add_argument("--rounds", type=int, help="number of rounds; default: 7, or 2 if quick")
    parser.add_argument("--data", type=Path, help="parent of the folder `volumes`")
    parser.add_argument(
        "--side",
        type=int,
        action="append",
        help="of pictures of volumes, px; default: 400 and 1024",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers to this file")
    parser.add_argument(
        "--markdown", type=Path, metavar="FILE", help="write all tables to this file"
    )
    choices = parser.parse_args(arguments)
    unknown = [group for group in choices.groups if group not in GROUPS]
    if unknown:
        parser.error(f"unknown group {unknown[0]!r}; there are {', '.join(GROUPS)}")
    if choices.rounds is not None and choices.rounds < 1:
        parser.error(f"{choices.rounds} rounds; give 1 or more")
    if choices.data is not None and not choices.data.is_dir():
        parser.error(f"{choices.data}: there is no such folder")
    return choices


def main() -> int:
    """Run each group, then print and write its tables; returns 1 if a group failed."""
    choices = parsed(sys.argv[1:])
    report = Report(choices.json, choices.markdown)
    failed = 0
    with tempfile.TemporaryDirectory(prefix="benchmark-") as scratch:
        rounds = choices.rounds or (QUICK_ROUNDS if choices.quick else Options.rounds)
        data = None if choices.data is None else str(choices.data.resolve())
        sides = tuple(choices.side or Options.sides)
        options = Options(choices.quick, rounds, data, scratch, sides)
        for group in choices.groups or GROUPS:
            start = time.perf_counter()
            try:
                for section in import_module(f"benchmarks.{group}").sections(options):
                    report.add(section)
            except AbsentError as error:
                _say(f"{group}: left out, {error}")
            except Exception:  # the remaining groups are still worth running
                _say(f"{group}: failed\n{traceback.format_exc()}")
                failed = 1
            _say(f"{group}: {time.perf_counter() - start:.0f} s\n")
    return failed


class Report:
    """Tables so far, on the screen and in files."""

    def __init__(self, json_file: Path | None, markdown_file: Path | None) -> None:
        self.files = json_file, markdown_file
        self.command = shlex.join(["python", "-m", "benchmarks", *sys.argv[1:]])
        self.facts = machine()
        self.sections: list[Section] = []

    def add(self, section: Section) -> None:
        """Print a table and rewrite the files."""
        self.sections.append(section)
        _say(markdown(section))
        known = self.command, self.facts, self.sections
        json_file, markdown_file = self.files
        if json_file is not None:
            text = json.dumps(as_json(*known), indent=1, ensure_ascii=False)
            json_file.write_text(text + "\n", encoding="utf-8")
        if markdown_file is not None:
            markdown_file.write_text(document(*known), encoding="utf-8")


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
