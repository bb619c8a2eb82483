"""Processes that share work, of which one is killed while it does so."""

import os
import signal
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4


@dataclass
class Fatal:
    """A job of numbered parts that ends its process at one of them, the first time."""

    job: object
    folder: Path  # of marks: a file for each time that a part was done
    part: int
    is_late: bool  # whether that is after the part's work

    def __call__(self, numbered):
        number, part = numbered
        (self.folder / f"{number}-{os.getpid()}-{uuid4().hex}").touch()
        if not self.is_late:
            self._end(number)
        result = self.job(part)
        if self.is_late:
            self._end(number)
        return result

    def _end(self, number):
        mark = self.folder / "dead"
        if number == self.part and not mark.exists():
            mark.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)


@dataclass
class Killing:
    """An executor of processes, of which one is killed at some of its maps."""

    executor: object
    folder: Path
    part: int
    is_late: bool
    at: tuple[int, ...] = (0,)  # maps, by their number
    maps: int = 0

    def map(self, job, parts):
        number, self.maps = self.maps, self.maps + 1
        if number not in self.at:
            return self.executor.map(job, parts)
        folder = self.folder / str(number)
        folder.mkdir()
        return self.executor.map(
            Fatal(job, folder, self.part, self.is_late), list(enumerate(parts))
        )

    def redone(self, number):
        """Parts of a map that were done more than once; they are the dead process's own."""
        folder = self.folder / str(number)
        marks = [name.split("-") for name in os.listdir(folder) if name != "dead"]
        count = Counter(int(part) for part, *_ in marks)
        dead = (folder / "dead").read_text()
        own = {int(part) for part, process, _ in marks if process == dead}
        again = {part for part, times in count.items() if times > 1}
        assert self.part in again
        assert again <= own
        return again
