"""Commands that get a signal, wherever they are."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.processes import PATIENCE

BEGUN = """
import signal, sys

signal.signal(signal.SIGINT, signal.default_int_handler)  # shells have background jobs ignore it
from resample.command.stopping import start

start("slow")
"""
WORKING = """
import time

def work():
    print("working", flush=True)
    time.sleep(60)

"""
MOMENTS = {
    "while it is imported": "work()",
    "while it works": "main = work",
    "in code that is given as a text": "def main(): exec('work()')",
    "where Python cannot raise it": """
import ctypes

def main():
    back = ctypes.CFUNCTYPE(None)(lambda: print("working", flush=True) or time.sleep(60))
    back()
    time.sleep(60)
""",
    "beside a thread": """
from concurrent.futures import ThreadPoolExecutor

def main():
    with ThreadPoolExecutor() as threads:
        threads.submit(time.sleep, 1.0)
        work()
""",
}


def told_to_stop(folder: Path, moment: str, *signals: signal.Signals) -> tuple[int, str]:
    """Status and last words of a command that gets signals while it sleeps."""
    (folder / "slow.py").write_text(WORKING + MOMENTS[moment])
    return ended_by(folder, *signals)


def ended_by(folder: Path, *signals: signal.Signals) -> tuple[int, str]:
    """Status and last words of a command, `slow.py`, that gets signals while it sleeps."""
    with subprocess.Popen(
        [sys.executable, "-c", BEGUN],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "working\n"
        for number in signals:
            process.send_signal(number)
        return process.wait(PATIENCE), process.stderr.read()


@pytest.mark.some(3)
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_command_that_is_interrupted_says_so_in_one_line(moment, tmp_path):
    assert told_to_stop(tmp_path, moment, signal.SIGINT) == (130, "resample: interrupted\n")


@pytest.mark.some(1)
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_command_that_is_terminated_says_so_in_one_line(moment, tmp_path):
    assert told_to_stop(tmp_path, moment, signal.SIGTERM) == (143, "resample: terminated\n")


def test_a_library_in_c_that_is_being_loaded_is_left_to_end(tmp_path):
    # Such as OpenImageIO's, which would end the process: enumerations are made in its midst.
    (tmp_path / "slow.py").write_text("""
import os, signal

class ExtensionFileLoader:
    def exec_module(self):
        os.kill(os.getpid(), signal.SIGTERM)
        print("loaded", flush=True)

def main():
    import time

    ExtensionFileLoader().exec_module()
    time.sleep(60)
""")
    ended = subprocess.run(
        [sys.executable, "-c", BEGUN],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert (ended.returncode, ended.stdout) == (143, "loaded\n")
    assert ended.stderr == "resample: terminated\n"


def test_a_thread_that_does_not_end_is_not_waited_for(tmp_path):
    (tmp_path / "slow.py").write_text(
        WORKING
        + """
from threading import Thread

from resample.command import stopping

stopping.AT_LAST = 0.5

def main():
    Thread(target=time.sleep, args=(60,)).start()
    work()
"""
    )
    start = time.monotonic()
    assert ended_by(tmp_path, signal.SIGTERM) == (143, "resample: terminated\n")
    assert time.monotonic() - start < 20


@pytest.mark.sweep
def test_whoever_presses_twice_is_told_once(tmp_path):
    moment = "beside a thread"
    status, said = told_to_stop(tmp_path, moment, *3 * [signal.SIGINT])
    assert (status, said) == (130, "resample: interrupted\n")


def test_a_command_that_ignores_interrupts_as_background_jobs_do_goes_on_doing_so(tmp_path):
    (tmp_path / "slow.py").write_text(
        "import os, signal\ndef main(): os.kill(os.getpid(), signal.SIGINT); print('done')\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", BEGUN.replace("default_int_handler", "SIG_IGN")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "done\n", "")
