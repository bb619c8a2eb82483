"""Workloads, their contenders, and the table of results."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from benchmarks.measure import Run, Spread, child, peak_memory, ratio, take_turns
from benchmarks.tables import Row, Section


class AbsentError(LookupError):
    """A program or data set is missing on this machine; the message says which and why."""


@dataclass(frozen=True)
class Options:
    """What to measure and how thoroughly; contains only text and numbers."""

    quick: bool = False
    rounds: int = 7
    data: str | None = None  # parent of the folder `volumes`
    scratch: str = "."  # folder through which processes exchange data
    sides: tuple[int, ...] = (400, 1024)  # px, of pictures of volumes

    @classmethod
    def of(cls, known: Mapping[str, Any]) -> "Options":
        """Restore options from JSON, which has no tuples."""
        return cls(**{**known, "sides": tuple(known.get("sides", cls.sides))})

    @property
    def volumes(self) -> Path:
        """Folder of real volumes."""
        from tests.conftest import DATA

        folder = Path(self.data) if self.data else DATA
        return folder / "volumes" if (folder / "volumes").is_dir() else folder


@dataclass(frozen=True)
class Goal:
    """Targets of a contender."""

    milliseconds: float | None = None  # at most
    stretch: float | None = None  # better target in milliseconds
    decibels: float | None = None  # at least
    share: float | None = None  # of the reference's time, at most

    def __str__(self) -> str:
        parts = [f"≥ {self.decibels:g} dB"] if self.decibels is not None else []
        if self.milliseconds is not None:
            parts.append(f"≤ {self.milliseconds:g} ms")
        if self.share is not None:
            parts.append(f"≤ {self.share:g} × reference")
        stretch = f" (stretch {self.stretch:g})" if self.stretch is not None else ""
        return ", ".join(parts) + stretch

    def verdict(self, milliseconds: float, decibels: float | None, share: float) -> str:
        """Whether the goal is met, and by how much it is missed."""
        missed = []
        if self.decibels is not None and (decibels is None or decibels < self.decibels):
            missed.append("no quality" if decibels is None else f"{decibels:.1f} dB")
        if self.milliseconds is not None and milliseconds > self.milliseconds:
            missed.append(f"{milliseconds / self.milliseconds:.2g} × the time")
        if self.share is not None and share > self.share:
            missed.append(f"{share:.2g} × reference")
        if missed:
            return f"no: {', '.join(missed)}"
        is_stretch = self.stretch is not None and milliseconds <= self.stretch
        return "yes, stretch too" if is_stretch else "yes"


@dataclass(frozen=True)
class Contender:
    """A program that does a workload."""

    name: str
    prepare: Callable[[], Run]  # may raise `AbsentError`; its result is timed
    quality: Callable[[], float] | None = None  # dB
    goal: Goal | None = None
    remark: Callable[[], str] | None = None  # printed below the table at the end
    is_ready: bool = False  # nothing is compiled or loaded in its first run
    has_memory: bool = True  # whether it is cheap enough to repeat in a fresh process


@dataclass(frozen=True)
class Workload:
    """A task for contenders; the first of them is the reference."""

    title: str
    text: str
    contenders: Sequence[Contender]
    quality: str = "dB"  # heading of the quality column
    has_memory: bool = True
    further: Callable[[str, float, float | None], Row] = field(default=lambda *_: {})


class Group(Protocol):
    """Module whose workloads can be repeated in another process."""

    __name__: str

    def workloads(self, options: Options) -> Sequence[Workload]:
        """All workloads; cheap to list, since `Contender.prepare` loads the data."""


def contest(group: str, workload: Workload, options: Options) -> Section:
    """Measure all available contenders.

    Parameters
    ----------
    group
        Full name of the module that lists the workload, for measurements in other processes.
    workload
        The task.
    options
        How thoroughly to measure.

    Raises
    ------
    AbsentError
        The reference is missing.
    """
    section = Section(workload.title, workload.text)
    runs: dict[str, Run] = {}
    for contender in workload.contenders:
        try:
            runs[contender.name] = contender.prepare()
        except AbsentError as error:
            if not runs:
                raise
            section.notes.append(f"{contender.name}: left out, {error}")
    ready = [contender.name for contender in workload.contenders if contender.is_ready]
    times = take_turns(runs, options.rounds, ready=ready)
    reference = times[next(iter(times))]
    for contender in workload.contenders:
        if contender.name not in runs:
            continue
        section.rows.append(
            _row(group, workload, contender, times[contender.name], reference, options)
        )
        if contender.remark is not None:
            section.notes.append(contender.remark())
    return section


def _row(
    group: str,
    workload: Workload,
    contender: Contender,
    times: list[float],
    reference: list[float],
    options: Options,
) -> Row:
    seconds, share = Spread.of(times), ratio(times, reference)
    decibels = None if contender.quality is None else contender.quality()
    row: Row = {
        "": contender.name,
        workload.quality: "" if decibels is None else decibels,
        "ms": seconds.times(1000),
        "ratio": share,
    }
    if workload.has_memory and contender.has_memory:
        row["peak MiB"] = memory_of(group, workload.title, contender.name, options)
    row |= workload.further(contender.name, seconds.median, decibels)
    if contender.goal is not None:
        row["target"] = str(contender.goal)
        row["met"] = contender.goal.verdict(1000 * seconds.median, decibels, share.median)
    return row


def memory_of(group: str, title: str, name: str, options: Options) -> int:
    """Peak MiB of a fresh process in which a contender prepares and runs once."""
    answer = child(
        "benchmarks.contest", group=group, title=title, name=name, options=asdict(options)
    )
    return int(answer["peak"])


def idle_memory() -> int:
    """Peak MiB of a fresh process that only imports the library."""
    return int(child("benchmarks.contest", group="", title="", name="", options={})["peak"])


def in_child(group: str, title: str, name: str, options: dict[str, Any]) -> dict[str, float]:
    """Peak memory of one contender of a workload; without a group, of importing only."""
    import_module("resample.resampler")
    if group:
        workloads = import_module(group).workloads(Options.of(options))
        workload = next(each for each in workloads if each.title == title)
        contender = next(each for each in workload.contenders if each.name == name)
        contender.prepare()()
    return {"peak": round(peak_memory())}
