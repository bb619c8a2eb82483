"""A workload and those who do it, and the table that becomes of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from benchmarks.measure import Run, Spread, child, peak_memory, ratio, take_turns
from benchmarks.tables import Row, Section


class AbsentError(LookupError):
    """A peer or data set that is not on this machine; says which and why."""


@dataclass(frozen=True)
class Options:
    """What is measured and how thoroughly; holds nothing but text and numbers."""

    quick: bool = False
    rounds: int = 7
    data: str | None = None  # folder with the folder `volumes`
    scratch: str = "."  # folder for what one process leaves for another
    sides: tuple[int, ...] = (400, 1024)  # px, of pictures of volumes

    @classmethod
    def of(cls, known: Mapping[str, Any]) -> "Options":
        """Options that went to another process as JSON, which has no tuples."""
        return cls(**{**known, "sides": tuple(known.get("sides", cls.sides))})

    @property
    def volumes(self) -> Path:
        """Folder of real volumes."""
        from tests.conftest import DATA

        folder = Path(self.data) if self.data else DATA
        return folder / "volumes" if (folder / "volumes").is_dir() else folder


@dataclass(frozen=True)
class Goal:
    """What is asked of a contender."""

    milliseconds: float | None = None  # at most
    stretch: float | None = None  # milliseconds that would be better still
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
        """Whether it is met, and how far away it is where it is not."""
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
    """Someone who does a workload."""

    name: str
    prepare: Callable[[], Run]  # may raise `AbsentError`; what it gives is timed
    quality: Callable[[], float] | None = None  # dB
    goal: Goal | None = None
    remark: Callable[[], str] | None = None  # said below the table when all is measured
    is_ready: bool = False  # nothing is compiled or loaded by its first run
    has_memory: bool = True  # whether it is cheap enough to be had again in a fresh process


@dataclass(frozen=True)
class Workload:
    """What contenders do; the first of them is whom the others are compared with."""

    title: str
    text: str
    contenders: Sequence[Contender]
    quality: str = "dB"  # heading of the column
    has_memory: bool = True
    further: Callable[[str, float, float | None], Row] = field(default=lambda *_: {})


class Group(Protocol):
    """Module whose workloads can be had again in another process."""

    __name__: str

    def workloads(self, options: Options) -> Sequence[Workload]:
        """All of them, cheap to list: data are loaded by `Contender.prepare`."""


def contest(group: str, workload: Workload, options: Options) -> Section:
    """Table of all contenders that are to be had.

    Parameters
    ----------
    group
        Full name of the module that lists the workload, for measurements in other processes.
    workload
        What is to be done.
    options
        How thoroughly.

    Raises
    ------
    AbsentError
        The reference is not there, so that there is nothing to compare with.
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
    """Peak MiB of a fresh process that has imported the library and done nothing."""
    return int(child("benchmarks.contest", group="", title="", name="", options={})["peak"])


def in_child(group: str, title: str, name: str, options: dict[str, Any]) -> dict[str, float]:
    """Peak memory of one contender of one workload; without a group, of importing alone."""
    import_module("resample.resampler")
    if group:
        workloads = import_module(group).workloads(Options.of(options))
        workload = next(each for each in workloads if each.title == title)
        contender = next(each for each in workload.contenders if each.name == name)
        contender.prepare()()
    return {"peak": round(peak_memory())}
