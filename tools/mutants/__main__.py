"""Try mutants against the tests: `python -m tools.mutants --count 200 --seed 1`.

Results are appended to a file, so that a run that was stopped goes on where it was; which cases
run through which functions is recorded once (`--record`, a run of all tests) and kept beside it.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from platformdirs import user_cache_dir

from tools.mutants import reach, running
from tools.mutants.sites import Site, sample, sample_at

ROOT = Path(__file__).parents[2]
EQUIVALENT = Path(__file__).with_name("equivalent.json")
_worker: list[running.Worker] = []


def _start(folder: Path, seconds: float) -> None:
    """Give a process of the pool its copy of the repository."""
    _worker.append(running.Worker(ROOT, Path(tempfile.mkdtemp(dir=folder)), seconds))


def _try(cases: list[str], site: Site | None) -> running.Outcome:
    return _worker[0].run(cases, site)


def _tried(
    tasks: list[tuple[list[str], Site | None]], folder: Path, asked: argparse.Namespace
) -> Iterator[tuple[Site | None, running.Outcome]]:
    """Outcomes of tasks, as workers end them."""
    arguments = (asked.workers, get_context("fork"), _start, (folder, asked.seconds))
    with ProcessPoolExecutor(*arguments) as pool:
        sites = {pool.submit(_try, *task): task[1] for task in tasks}
        for done in as_completed(sites):
            yield sites[done], done.result()


def _recorded(asked: argparse.Namespace) -> reach.Reach:
    """What cases run through: all are run once, later those whose files have changed."""
    file = asked.folder / "reach.json.gz"
    known = reach.read(file) if file.exists() else None
    if asked.record is not None:
        files = asked.record
    elif known is None:
        files = []
    else:
        now = reach.digests(ROOT)
        files = [name for name, digest in now.items() if known.files.get(name) != digest]
        if not files:
            return known
    described = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(described, cwd=ROOT, capture_output=True, text=True, check=True)
    found = reach.record(commit.stdout.strip(), asked.workers, files)
    if files and known is not None:
        found = reach.merged(known, found, files)
    reach.write(found, file)
    return found


def run(wanted: list[Site], known: dict[str, dict], asked: argparse.Namespace) -> None:
    """Try the wanted mutants, append what becomes of them, and look at what has killed them."""
    chooser = reach.Chooser(ROOT, _recorded(asked))
    unfit_file = asked.folder / "unfit.json"  # cases that fail here without a fault
    unfit = set(json.loads(unfit_file.read_text())) if unfit_file.exists() else set()
    with tempfile.TemporaryDirectory(prefix="mutants-") as name:
        folder = Path(name)
        running.set_environment(folder, ROOT)
        running.import_libraries()
        while wanted:
            tasks = [
                ([case for case in chooser.cases(site, asked.budget) if case not in unfit], site)
                for site in wanted
            ]
            for site, outcome in _tried(tasks, folder, asked):
                known[site.id] = outcome._asdict()
                with asked.results.open("a") as lines:
                    lines.write(json.dumps({"id": site.id, "text": site.text, **known[site.id]}))
                    lines.write("\n")
                told = f"{known[site.id]['status']}, {outcome.cpu:.1f} CPU s"
                sys.stdout.write(f"{site.id} {site.stratum}, {site.kind}: {told}\n")
                sys.stdout.flush()
            killers = {case for site in wanted for case in known[site.id]["killed_by"]}
            ((_, outcome),) = _tried([(sorted(killers), None)], folder, asked)
            failing = set(outcome.killed_by) & killers
            unfit |= failing
            unfit_file.write_text(json.dumps(sorted(unfit), indent=1))
            wanted = [site for site in wanted if failing & set(known[site.id]["killed_by"])]


def _line(site: Site, known: dict) -> str:
    """A mutant, and what became of it."""
    by = f" by {known['killed_by'][0]}" if known["killed_by"] else ""
    by += f": {known['message']}" if known["message"] else ""
    told = f"{known['status']}, {known['tried']} cases, {known['cpu']:.1f} CPU s{by}"
    place = f"{site.id} {site.stratum}, {site.kind}: {site.file}:{site.line} {site.function}"
    return f"{place}\n  - {site.before}\n  + {site.after}\n  {told}"


def summary(sites: list[Site], known: dict[str, dict], equivalent: dict[str, str]) -> Iterator[str]:
    """Lines: those that survived, and how many were killed of each stratum and kind."""
    counted = [site for site in sites if site.id in known and site.text not in equivalent]
    for site in counted:
        if known[site.id]["status"] != "killed":
            yield _line(site, known[site.id])
    for what in ("stratum", "kind"):
        yield f"\n{what:20} killed of"
        every = Counter(getattr(site, what) for site in counted)
        killed = _killed(counted, known, what)
        for name, count in sorted(every.items()):
            yield f"{name:20} {killed[name]:6d} {count:2d}  {killed[name] / count:4.0%}"
    killed = sum(known[site.id]["status"] == "killed" for site in counted)
    same = sum(site.text in equivalent for site in sites)
    left = len(sites) - same - len(counted)
    share = killed / max(1, len(counted))
    yield f"\n{killed} of {len(counted)} killed ({share:.1%}); {same} equivalent, {left} not tried"


def _killed(sites: Iterable[Site], known: dict[str, dict], what: str) -> Counter[str]:
    return Counter(getattr(s, what) for s in sites if known[s.id]["status"] == "killed")


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tools.mutants", description=__doc__)
    add = parser.add_argument
    add("--count", type=int, default=200, help="mutants of the sample")
    add("--seed", type=int, default=1, help="seed of the sample")
    add("--at", metavar="COMMIT", help="sample of the sources of a commit, as far as they last")
    add("--stratum", action="append", help="take these strata only")
    add("--only", action="append", metavar="ID", help="try these mutants again")
    add("--again", action="store_true", help="try those again that were not killed")
    add("--list", action="store_true", help="show the sample and try nothing")
    add("--summary", action="store_true", help="show results and try nothing")
    add("--workers", type=int, default=2, help="mutants at a time")
    add("--budget", type=float, default=8, help="CPU seconds of the cases that are chosen")
    add("--seconds", type=float, default=30, help="CPU seconds that a mutant may take")
    add("--record", nargs="*", metavar="FILE", help="record anew what cases of files run through")
    add("--folder", type=Path, default=Path(user_cache_dir("hybrid-resample")) / "mutants")
    add("--results", type=Path, help="file of results; default: one per seed in the folder")
    return parser


def main(words: list[str] | None = None) -> int:
    """Run the command line; the exit status is 0 also if mutants survive."""
    asked = _options().parse_args(words)
    asked.folder.mkdir(parents=True, exist_ok=True)
    asked.results = asked.results or asked.folder / f"results-{asked.seed}.jsonl"
    known = {}
    if asked.results.exists():
        for line in asked.results.open():
            result = json.loads(line)
            known[result["id"]] = result
    drawn = (asked.count, asked.seed)
    sites = sample_at(asked.at, ROOT, *drawn) if asked.at else sample(ROOT, *drawn)
    sites = [site for site in sites if not asked.stratum or site.stratum in asked.stratum]
    equivalent = {each["mutant"]: each["reason"] for each in json.loads(EQUIVALENT.read_text())}
    wanted = [site for site in sites if site.text not in equivalent]
    if asked.only:
        wanted = [site for site in sites if site.id in asked.only]
    elif asked.again:
        wanted = [s for s in wanted if known.get(s.id, {}).get("status") != "killed"]
    else:
        wanted = [s for s in wanted if s.id not in known]
    if asked.list:
        lines = [f"{s.id} {s.stratum}, {s.kind}: {s.text} (line {s.line})" for s in sites]
        sys.stdout.writelines(f"{line}\n" for line in lines)
        return 0
    if asked.record is not None:
        _recorded(asked)
    elif wanted and not asked.summary:
        run(wanted, known, asked)
    sys.stdout.writelines(f"{line}\n" for line in summary(sites, known, equivalent))
    return 0


if __name__ == "__main__":
    sys.exit(main())
