"""Volumes larger than memory: `python -m benchmarks.scale`, or `make demo-scale`.

A sparse volume is generated as OME-Zarr, box by box, and rendered in a fresh process within a
budget of memory. Below that, sizes are compared, and the same picture of a volume in memory.
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
from typing import Any

import numpy as np

from benchmarks.sparse import Bubbles
from resample.memory import GIB, bytes_of

LOOK, CAMERA = "60/#804020/0,120/#e0a060/0.5,240/white/0.9", (30.0, 20.0)
SIDE = 800  # px of the picture
COMPARED = 256  # voxels of the volume that is rendered in memory, too
MIB = 1 << 20


def main(arguments: Sequence[str]) -> int:
    """Generate, render and compare; 1 if pictures differ or a budget was not kept."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scale", description=__doc__)
    parser.add_argument("--size", type=int, action="append", help="voxels along a side; 256, 1024")
    parser.add_argument("--memory", default="2GiB", help="that each picture may take")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    choices = parser.parse_args(arguments)
    if choices.child is not None:
        path, memory, how = choices.child
        sys.stdout.write(json.dumps(rendered(Path(path), int(memory), how)) + "\n")
        return 0
    sizes = choices.size or [COMPARED, 1024]
    with tempfile.TemporaryDirectory(prefix="scale-") as folder:
        return demonstrated(sizes, Path(folder), bytes_of(choices.memory))


def demonstrated(sizes: Sequence[int], folder: Path, memory: int) -> int:
    """Pictures of volumes of some sizes, told line by line; see `main`."""
    is_good = True
    for size in sizes:
        path = folder / f"{size}.ome.zarr"
        start = time.perf_counter()
        generated(path, size)
        stored = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        _tell(
            f"{size}^3: generated in {time.perf_counter() - start:.0f} s, {size**3 / GIB:.2f} GiB "
            f"of voxels in {stored / MIB:.0f} MiB of files"
        )
        streamed = measured(path, memory, "streamed")
        _tell(f"  streamed   {_facts(streamed)}")
        is_good &= streamed["added"] <= memory
        if size <= COMPARED:
            whole = measured(path, memory, "memory")
            _tell(f"  in memory  {_facts(whole)}")
            is_good &= whole["hash"] == streamed["hash"]
            _tell(f"  the same bits: {whole['hash'] == streamed['hash']}")
    _tell(f"within {memory / GIB:.2f} GiB beside what Python and its libraries take: {is_good}")
    return 0 if is_good else 1


def generated(path: Path, size: int) -> None:
    """Write a sparse volume as OME-Zarr."""
    from resample_volume.files.stores.chunks import Single
    from resample_volume.files.stores.writing import Layered, write_store
    from resample_volume.types import Recording

    values: Any = Single(Bubbles(size).bricks())
    recording = Recording(values, np.ones(3), np.zeros(3), np.eye(3), f"bubbles {size}")
    write_store(path, recording, Layered(is_layered=False))


def measured(path: Path, memory: int, how: str) -> dict[str, Any]:
    """What a fresh process tells of a picture, see `rendered`."""
    words = [sys.executable, "-m", "benchmarks.scale", "--child", str(path), str(memory), how]
    ended = subprocess.run(words, check=True, capture_output=True, text=True)
    told: dict[str, Any] = json.loads(ended.stdout)
    return told


def rendered(path: Path, memory: int, how: str) -> dict[str, Any]:
    """Facts of a picture: memory in bytes, bricks and their reads, seconds and a hash."""
    from resample_volume.command.choices import Source
    from resample_volume.command.inputs import opened
    from resample_volume.files.source import generate
    from resample_volume.rendering import render
    from resample_volume.voxels.bricks import Bricks

    render(generate("checker-box:size=16"), LOOK, size=(32, 32))  # kernels are compiled or loaded
    base, start, busy = _peak(), time.perf_counter(), time.process_time()
    source = Source(memory=f"{memory / 1000:.3f}kB")
    volume = opened(source, str(path), streamed=how == "streamed")
    frame = render(volume, LOOK, CAMERA, size=(SIDE, SIDE))
    digest = hashlib.sha256()
    for part in (frame.rgba, frame.depth, frame.coverage):
        digest.update(np.ascontiguousarray(part).tobytes())
    values: Any = volume.values
    in_bricks = isinstance(values, Bricks)
    return {
        "peak": _peak(),
        "added": _peak() - base,
        "voxels": frame.statistics.samples,
        "bricks": int(np.prod(values.count)) if in_bricks else 0,
        "reads": values.reads if in_bricks else 0,
        "seconds": time.perf_counter() - start,
        "busy": time.process_time() - busy,
        "hash": digest.hexdigest()[:16],
    }


def _peak() -> int:
    """Bytes that this process has held at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _facts(told: dict[str, Any]) -> str:
    reads = f", {told['bricks']} bricks, {told['reads']} reads" if told["bricks"] else ""
    return (
        f"{told['seconds']:.1f} s ({told['busy']:.1f} s of CPU), RSS {told['peak'] / MIB:.0f} MiB, "
        f"{told['added'] / MIB:.0f} of it the picture's, {told['voxels']} visible voxels{reads}, "
        f"hash {told['hash']}"
    )


def _tell(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
