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
    """An executor whose processes are killed: one at each of its maps of more parts than one."""

    executor: object
    folder: Path
    part: int
    is_late: bool
    maps: int = 0

    def map(self, job, parts):
        folder = self.folder / str(self.maps)
        folder.mkdir()
        self.maps += 1
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
