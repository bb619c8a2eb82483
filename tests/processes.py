"""Run Python in a process of its own, as a user's command would."""

import subprocess
import sys

PATIENCE = 600  # s; what takes longer hangs, on however busy a machine


def python(code: str) -> str:
    """What a program prints; it must end well."""
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, timeout=PATIENCE
    )
    return ended.stdout.decode()  # libraries loaded by other tests may have changed the locale
