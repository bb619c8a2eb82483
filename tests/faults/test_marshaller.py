"""The library's marshaller with the compiler's checks of memory, called with wrong arguments."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

from tests.processes import PATIENCE

HERE, SOURCES = Path(__file__).parent, Path(__file__).parents[2] / "tools" / "kernels"
COMPILER = os.environ.get("CC", "cc")
pytestmark = [
    pytest.mark.sweep,
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="checks of memory are loaded as on Linux"),
    pytest.mark.skipif(shutil.which(COMPILER) is None, reason="there is no C compiler"),
]


def test_no_argument_reads_or_writes_outside_of_what_it_is(tmp_path):
    library = tmp_path / "_kernels.so"
    include = [SOURCES, np.get_include(), sysconfig.get_path("include")]
    checks = [
        "-fsanitize=address,undefined",
        "-fno-sanitize-recover=all",
        "-fno-omit-frame-pointer",
    ]
    files = [SOURCES / "marshal.c", SOURCES / "runtime.c", HERE / "marshaller.c"]
    words = [COMPILER, "-shared", "-fPIC", "-O1", "-g", *checks, *(f"-I{each}" for each in include)]
    subprocess.run([*words, *map(str, files), "-lm", "-o", str(library)], check=True)
    runtime = subprocess.run(  # which has to be loaded before Python
        [COMPILER, "-print-file-name=libasan.so"], check=True, capture_output=True, text=True
    ).stdout.strip()
    ended = subprocess.run(
        [sys.executable, str(HERE / "marshaller.py"), str(library)],
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        cwd=HERE.parents[1],
        env={
            **os.environ,
            "LD_PRELOAD": runtime,
            "PYTHONPATH": ".",
            "ASAN_OPTIONS": "detect_leaks=0",
            "PYTHONMALLOC": "malloc",
        },
    )
    assert ended.returncode == 0, ended.stderr[-3000:]
    calls, answers = map(int, ended.stdout.split())
    assert calls > 10_000
    assert 1000 < answers < calls
