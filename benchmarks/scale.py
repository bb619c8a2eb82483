"""Volumes larger than memory: `python -m benchmarks.scale`, or `make demo-scale`.

A sparse volume is generated as OME-Zarr, box by box, and rendered within a memory budget: by a
fresh process, and by several that share its rows. A small one is rendered in
memory too. All results must have the same bits.
"""

import argparse
import hashlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from benchmarks.sparse import Bubbles
from resample.cameras.viewpoints import Orbit
from resample.memory import GIB, bytes_of
from resample_zarr.volumes import RECENT

if TYPE_CHECKING:
    from resample.types import Frame
    from resample_volume.types import Volume

LOOK, CAMERA = "60/#804020/0,120/#e0a060/0.5,240/white/0.9", Orbit(30.0, 20.0)
DENSE = "0/#203040/0.001,120/#e0a060/0.5,240/white/0.9"  # makes empty space visible too
SIDE = 800  # px of the picture
COMPARED = 256  # voxels of the volume that is also rendered in memory
MIB = 1 << 20


def main(arguments: Sequence[str]) -> int:
    """Generate, render and compare; returns 1 if pictures differ or a budget was exceeded."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scale", description=__doc__)
    parser.add_argument("--size", type=int, action="append", help="voxels along a side; 256, 1024")
    parser.add_argument("--memory", default="2GiB", help="that each picture may take")
    parser.add_argument("--workers", type=int, default=2, help="processes; 0: no such picture")
    parser.add_argument("--dense", action="store_true", help="show nearly all voxels")
    parser.add_argument("--child", nargs=4, help=argparse.SUPPRESS)
    choices = parser.parse_args(arguments)
    if choices.child is not None:
        path, memory, how, look = choices.child
        job = Job(Path(path), int(memory), how, look, choices.workers)
        sys.stdout.write(json.dumps(rendered(job)) + "\n")
        return 0
    sizes, look = choices.size or [COMPARED, 1024], DENSE if choices.dense else LOOK
    with tempfile.TemporaryDirectory(prefix="scale-") as folder:
        is_good = True
        for size in sizes:
            job = Job(Path(folder) / f"{size}.ome.zarr", bytes_of(choices.memory), "", look)
            is_good &= demonstrated(size, job._replace(workers=choices.workers))
    _tell(f"the same bits, within {choices.memory} beside Python and its libraries: {is_good}")
    return 0 if is_good else 1


class Job(NamedTuple):
    """A picture to render."""

    path: Path
    memory: int  # bytes, of all processes together
    how: str  # "memory", "streamed" or "workers"
    look: str
    workers: int = 2


def demonstrated(size: int, job: Job) -> bool:
    """Whether all pictures of a volume are equal and within budget; prints the results."""
    start = time.perf_counter()
    generated(job.path, size)
    stored = sum(file.stat().st_size for file in job.path.rglob("*") if file.is_file())
    _tell(
        f"{size}^3: generated in {time.perf_counter() - start:.0f} s, {size**3 / GIB:.2f} GiB "
        f"of voxels in {stored / MIB:.0f} MiB of files"
    )
    time.sleep(RECENT)  # nothing just written may count as recent
    names = {"streamed": "one process", "workers": f"{job.workers} processes"}
    hows = [how for how in names if how == "streamed" or job.workers]
    hashes, is_good = set(), True
    for how in [*hows, *(["memory"] if size <= COMPARED else [])]:
        told = measured(job._replace(how=how))
        hashes.add(told["hash"])
        is_good &= how == "memory" or told["added"] <= job.memory
        _tell(f"  {names.get(how, 'in memory'):12} {_facts(told)}")
    return is_good and len(hashes) == 1


def generated(path: Path, size: int) -> None:
    """Write a sparse volume as OME-Zarr."""
    from resample_volume.types import Recording
    from resample_zarr.volumes import Single
    from resample_zarr.writing import Layered, write_store

    values: Any = Single(Bubbles(size).bricks())
    recording = Recording(values, np.ones(3), np.zeros(3), np.eye(3), f"bubbles {size}")
    write_store(path, recording, Layered(is_layered=False))


def measured(job: Job) -> dict[str, Any]:
    """Facts of a picture from a fresh process, see `rendered`."""
    words = [str(job.path), str(job.memory), job.how, job.look, "--workers", str(job.workers)]
    words = [sys.executable, "-m", "benchmarks.scale", "--child", *words]
    ended = subprocess.run(words, check=True, capture_output=True, text=True)
    told: dict[str, Any] = json.loads(ended.stdout)
    return told


def rendered(job: Job) -> dict[str, Any]:
    """Facts of a picture: memory in bytes, bricks read, seconds and a hash."""
    from resample_volume.calls import render
    from resample_volume.command.choices import ReadOptions
    from resample_volume.command.inputs import prepared
    from resample_volume.data.values import Bricks
    from resample_volume.files.source import generate

    render(generate("checker-box:size=16"), LOOK, size=(32, 32))  # compiles or loads kernels
    base, start, busy = _peak(), time.perf_counter(), _busy()
    source = ReadOptions(memory=f"{job.memory / 1000:.3f}kB")
    volume = prepared(source, str(job.path), streamed=job.how != "memory")
    frame = _shared(volume, job) if job.how == "workers" else _alone(volume, job)
    digest = hashlib.sha256()
    for part in (frame.rgba, frame.depth, frame.coverage):
        digest.update(np.ascontiguousarray(part).tobytes())
    values: Any = volume.values
    in_bricks = isinstance(values, Bricks)
    worker = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    workers = job.workers * max(0, worker - base) if job.how == "workers" else 0
    return {
        "peak": max(_peak(), worker),
        "added": _peak() - base + workers,
        "voxels": frame.statistics.samples,
        "bricks": int(np.prod(values.count)) if in_bricks else 0,
        "reads": values.reads if in_bricks else 0,
        "seconds": time.perf_counter() - start,
        "busy": _busy() - busy,
        "hash": digest.hexdigest()[:16],
    }


def _alone(volume: "Volume", job: Job) -> "Frame":
    """Picture by this process."""
    from resample_volume.appearance import BY_DEFAULT, Appearance
    from resample_volume.rendering import Subject

    subject = Subject.of(volume, Appearance(job.look), BY_DEFAULT, around=volume)
    camera = subject.camera(CAMERA, SIDE, SIDE)
    return BY_DEFAULT(subject.samples_for(camera), camera, height=SIDE, width=SIDE)


def _shared(volume: "Volume", job: Job) -> "Frame":
    """Picture by several processes, each with its part of the memory."""
    from resample.command.settings import Sharing
    from resample.command.workers import at_work
    from resample_volume.appearance import BY_DEFAULT, Appearance
    from resample_volume.command.rendering import painted_by
    from resample_volume.voxels.framing import bounding_sphere, centered

    whole, _ = centered(volume)
    camera = CAMERA.around(bounding_sphere(whole), SIDE, SIDE)
    with at_work(Sharing(workers=job.workers)) as crew:
        if crew is None:
            raise RuntimeError("there are no workers")
        media = [(volume, Appearance(job.look))]
        return painted_by(crew, media, BY_DEFAULT, "volume", camera, (SIDE, SIDE))


def _busy() -> float:
    """CPU seconds of this process and of its finished children."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _peak() -> int:
    """Peak memory of this process in bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _facts(told: dict[str, Any]) -> str:
    reads = f", {told['bricks']} bricks, {told['reads']} reads" if told["bricks"] else ""
    return (
        f"{told['seconds']:.1f} s ({told['busy']:.1f} s of CPU), RSS {told['peak'] / MIB:.0f} MiB, "
        f"{told['added'] / MIB:.0f} of all the picture's, {told['voxels']} samples{reads}"
        f", hash {told['hash']}"
    )


def _tell(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
