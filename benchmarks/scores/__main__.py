"""Run the scores: `python -m benchmarks.scores [GROUP ...]`, or `make scores`.

Rows of the groups that are run replace those in docs/scores.json, and the tables of README.md,
docs/quality.md and docs/performance.md are generated from it. All groups take a quarter of an hour.
"""

import argparse
import os
import resource
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from benchmarks.scores import pages, record
from benchmarks.scores.judging import DATA, AbsentError, Judge, say


def parsed(words: list[str]) -> argparse.Namespace:
    """Choices of a command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scores", description=__doc__)
    known = ", ".join(record.GROUPS)
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"{known}; all without")
    parser.add_argument("--quick", action="store_true", help="fewer cases, and nothing is recorded")
    parser.add_argument("--check", action="store_true", help="compute truths a second way instead")
    parser.add_argument("--tables", action="store_true", help="only rewrite the pages' tables")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of files (%(default)s)")
    choices = parser.parse_args(words)
    for group in choices.groups:
        if group not in record.GROUPS:
            parser.error(f"there is no group {group}; there are {known}")
    return choices


def spent() -> float:
    """CPU seconds of this process and its children."""
    whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    used = [resource.getrusage(who) for who in whose]
    return sum(one.ru_utime + one.ru_stime for one in used)


def judged(group: str, choices: argparse.Namespace) -> record.Taken:
    """Run a group in a folder of its own."""
    measure, start = record.yardstick(), spent()
    say(f"== {group} (yardstick {measure:.1f} ms)")
    with tempfile.TemporaryDirectory(prefix=f"scores-{group}-") as folder:
        judge = Judge(Path(folder), choices.data, choices.quick)
        for part in import_module(f"benchmarks.scores.{group}").PARTS:
            try:
                part(judge)
            except AbsentError as error:
                judge.skip(str(error))
        return record.taken(judge, measure, spent() - start)


def checked(group: str, choices: argparse.Namespace) -> bool:
    """Whether a group's truths hold."""
    say(f"== {group}: truths")
    try:
        found = list(import_module(f"benchmarks.scores.{group}").check(Judge(Path(), choices.data)))
    except AbsentError as error:
        say(f"   left out: {error}")
        return True
    for text, holds in found:
        say(f"   {text}{'' if holds else ': WRONG'}")
    return all(finding.holds for finding in found)


def main() -> int:
    """Run, check, or rewrite tables; returns 1 if a truth does not hold."""
    choices = parsed(sys.argv[1:])
    os.environ.pop("RESAMPLE_LOG", None)  # commands tell when they compile kernels
    groups = choices.groups or record.GROUPS
    if choices.check:
        return 0 if all(checked(group, choices) for group in groups) else 1
    if not choices.tables:
        for group in groups:
            found = judged(group, choices)
            say(f"   ({found.spent:.0f} CPU s)")
            if not choices.quick:
                record.write({**record.read(), group: found})
    if not choices.quick:
        pages.rewrite()
    return 0


if __name__ == "__main__":
    sys.exit(main())
