"""Run Python in a process of its own, as a user's command would."""

import subprocess
import sys


def python(code: str) -> str:
    """What a program prints; it must end well."""
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, timeout=60
    )
    return ended.stdout.decode()  # libraries loaded by other tests may have changed the locale
