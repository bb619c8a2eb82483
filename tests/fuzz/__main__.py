"""`python -m tests.fuzz`: try changed files, arrays and command lines; says what was found."""

import argparse
import random
import sys
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from tests.fuzz import arrays, files, lines
from tests.fuzz.pool import Found, Setup, Worker

SETUPS = {
    "files": Setup(files.make),
    "arrays": Setup(arrays.make, seconds=120.0, allowed=(TypeError,)),
    "commands": Setup(lines.make, seconds=120.0),
}


def main() -> int:
    """Run; status 1 if there are faults."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 40))
    parser.add_argument("--kind", choices=[*SETUPS, "all"], default="all")
    parser.add_argument("--only", type=int, help="one seed, in this process, with its traceback")
    given = parser.parse_args()
    kinds = list(SETUPS) if given.kind == "all" else [given.kind]
    if given.only is not None:
        folder = Path(f"fuzz-{given.only}")
        folder.mkdir(exist_ok=True)
        SETUPS[kinds[0]].make()(given.only, folder)
        return 0
    sys.stdout.write(f"seed {given.seed}\n")
    failed = False
    for kind in kinds:
        failed |= told(kind, run(kind, given.seed, given.seconds / len(kinds)))
    return int(failed)


def run(kind: str, first: int, seconds: float) -> list[Found]:
    """Results of as many seeds as there is time for."""
    worker, found, start = Worker(SETUPS[kind]), [], time.monotonic()
    try:
        while time.monotonic() - start < seconds:
            one = worker.tried(first + len(found))
            found.append(one)
            if one.is_fault:
                sys.stdout.write(f"{kind} {one.seed}: {one.result}\n")
                sys.stdout.flush()
    finally:
        worker.close()
    return found


def told(kind: str, found: Iterable[Found]) -> bool:
    """Say counts; whether there are faults."""
    counts = Counter("fault" if one.is_fault else one.result for one in found)
    sys.stdout.write(
        f"{kind}: {counts.total()} tried, {counts['read']} read, {counts['refused']} refused, "
        f"{counts['fault']} faults\n"
    )
    return counts["fault"] > 0


if __name__ == "__main__":
    sys.exit(main())
