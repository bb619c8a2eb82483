"""Work that processes share: the same files, also where one of them is killed."""

import builtins
import os
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import SimpleNamespace

import cyclopts
import numpy as np
import pytest

from resample.command import workers
from resample.command.settings import Sharing
from resample.command.workers import at_work, check_sharing, share_memory, worker_pools
from resample.files.animations import Shots, made_by, write_film
from resample.memory import ALLOWED, allowing
from resample.progress import WorkerPool
from tests.commands import ended
from tests.killing import Killing


def frame(n):
    return np.full((20, 30, 3), 9 * n, np.uint8)


def version_of_process(_):
    return str(os.getpid())


SHOTS = Shots(6, frame, {"of": "numbers"})


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_frames_are_made_by_any_executor(tmp_path):
    shares = []
    write_film(tmp_path / "one", SHOTS, 24)
    with ThreadPoolExecutor(3) as executor:
        write_film(tmp_path / "three", SHOTS, 24, executor=executor, progress=shares.append)
    assert content(tmp_path / "one") == content(tmp_path / "three")
    assert shares == [(n + 1) / 6 for n in range(6)]


def test_a_film_goes_on_with_others_where_it_was_left(tmp_path):
    def stopping(n):
        if n == 3:
            raise OSError("full")
        return frame(n)

    with pytest.raises(OSError, match="full"):
        write_film(tmp_path / "film", SHOTS._replace(frame=stopping), 24)
    made = []
    with ThreadPoolExecutor(2) as executor:
        rest = SHOTS._replace(frame=lambda n: made.append(n) or frame(n))
        write_film(tmp_path / "film", rest, 24, resume=True, executor=executor)
    assert sorted(made) == [3, 4, 5]


def test_memory_is_shared_with_workers_of_this_machine():
    with allowing("3GiB"):
        share_memory(Sharing(scheduler="tcp://a:1"))
        assert ALLOWED.get() == 3 << 30
        share_memory(Sharing(workers=2))
        assert ALLOWED.get() == 1 << 30
    with allowing(None):
        share_memory(Sharing(workers=2))
        assert ALLOWED.get() is None


@pytest.mark.parametrize(("is_local", "memory"), [(True, 1 << 30), (False, None)])
def test_frames_are_made_within_the_memory_that_their_process_may_use(is_local, memory):
    known = []

    def read(_threads):
        known.append(ALLOWED.get())
        return lambda n: known.append(ALLOWED.get()) or frame(n)

    with allowing("1GiB"):
        made, _ = made_by(WorkerPool(None, 2, 1, None, is_local), SHOTS, read)
    np.testing.assert_array_equal(made.frame(3), frame(3))
    assert known == [memory, memory]
    assert ALLOWED.get() is None


@pytest.mark.sweep
@pytest.mark.slow
def test_a_killed_worker_costs_a_film_its_own_frames_alone(tmp_path):
    write_film(tmp_path / "whole", SHOTS, 24)
    (tmp_path / "marks").mkdir()
    with at_work(Sharing(workers=2)) as crew:
        killing = Killing(crew.executor, tmp_path / "marks", 2, is_late=True)
        write_film(tmp_path / "film", SHOTS, 24, executor=killing)
    killing.redone(0)
    assert content(tmp_path / "whole") == content(tmp_path / "film")


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("count", "part", "is_late"), [(1, 0, True), (2, 5, False), (3, 1, True), (4, 3, False)]
)
def test_a_worker_may_be_killed_at_any_time(count, part, is_late, tmp_path):
    write_film(tmp_path / "whole", SHOTS, 24)
    (tmp_path / "marks").mkdir()
    with at_work(Sharing(workers=count)) as crew:
        killing = Killing(crew.executor, tmp_path / "marks", part, is_late)
        write_film(tmp_path / "film", SHOTS, 24, executor=killing)
    killing.redone(0)
    assert content(tmp_path / "whole") == content(tmp_path / "film")


@pytest.mark.sweep
@pytest.mark.slow
def test_a_scheduler_that_runs_has_its_workers_do_it(tmp_path, monkeypatch):
    from distributed import LocalCluster

    own = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "memory_limit": "1GiB"}
    write_film(tmp_path / "whole", SHOTS, 24)
    with LocalCluster(n_workers=1, threads_per_worker=2, **own) as cluster:
        asked = Sharing(scheduler=cluster.scheduler_address)
        with at_work(asked) as crew:
            assert (crew.tasks, crew.threads, crew.memory) == (2, 1, 1 << 28)
            write_film(tmp_path / "film", SHOTS, 24, executor=crew.executor)
        monkeypatch.setattr("importlib.metadata.version", version_of_process)
        other = pytest.raises(ValueError, match=r"workers have hybrid-resample \d+ and this is")
        with other, at_work(asked):
            pass
        cluster.scale(0)
        while cluster.scheduler_info["workers"]:
            time.sleep(0.01)
        with pytest.raises(OSError, match="has no workers; start some"), at_work(asked):
            pass
    assert content(tmp_path / "whole") == content(tmp_path / "film")


def test_workers_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="give only one"):
        check_sharing(Sharing(workers=2, scheduler="tcp://127.0.0.1:1"))
    with (
        pytest.raises(OSError, match="no scheduler of dask answers at nowhere"),
        at_work(Sharing(scheduler="nowhere://127.0.0.1:1")),
    ):
        pass


@pytest.mark.parametrize(("count", "own"), [(1, 8), (3, 2), (8, 1), (9, 1)])
def test_workers_of_this_machine_share_its_cores(monkeypatch, count, own):
    """Each has one thread at least, or as many as were asked for."""
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    client = SimpleNamespace(get_executor=lambda **_: None)
    for threads, expected in ((None, own), (5, 5)):
        pool = workers._pool_of(client, Sharing(workers=count), threads)
        assert (pool.tasks, pool.threads, pool.is_local) == (count, expected, True)


def refused_to_start(*_, **__):
    raise RuntimeError("Nanny failed to start.")


def test_workers_that_end_as_they_begin_are_an_error_in_words(monkeypatch):
    monkeypatch.setattr("distributed.LocalCluster", refused_to_start)
    ended = pytest.raises(ChildProcessError, match="--workers 2: one ended before it was ready")
    with ended, at_work(Sharing(workers=2)):
        pass


def test_workers_that_never_come_back_are_waited_for_no_longer():
    from distributed import scheduler

    gone = pytest.raises(ChildProcessError, match="none restarted within 60 seconds")
    with gone, worker_pools(Sharing(workers=2)):
        raise scheduler.NoWorkerError("a task", 60)


@pytest.mark.slow
def test_processes_that_are_killed_as_they_begin_are_said_in_one_line(monkeypatch, tmp_path, capfd):
    (tmp_path / "sitecustomize.py").write_text("import os, signal; os.kill(os.getpid(), 9)\n")
    monkeypatch.setattr(workers, "_environment", lambda: {"PYTHONPATH": str(tmp_path)})
    app = cyclopts.App()

    @app.command
    def work() -> None:
        with at_work(Sharing(workers=1)):
            pass

    before = dict(os.environ)
    assert ended(app, "work") == 2
    assert dict(os.environ) == before
    assert capfd.readouterr().err == (
        "resample: error: --workers 1: one ended before it was ready, most likely killed because "
        "memory ran out; use fewer workers, or none\n"
    )


def test_without_dask_workers_say_which_extra_they_need(monkeypatch):
    own = builtins.__import__

    def missing(name, *args, **kwargs):
        if name == "distributed":
            raise ModuleNotFoundError("No module named 'distributed'", name=name)
        return own(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(ValueError, match=r"pip install 'hybrid-resample\[dist\]'"):
        check_sharing(Sharing(workers=2))


NONSENSE = {
    "a web server": b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n",
    "zeros": bytes(64),
    "one endless frame": (1).to_bytes(8, "little") + (1 << 60).to_bytes(8, "little"),
    "endlessly many frames": (1 << 40).to_bytes(8, "little"),
    "noise": bytes(np.random.default_rng(7).integers(0, 256, 4096, np.uint8)),
    "nobody, who hangs up": None,
    "silence": b"",
}


@pytest.mark.parametrize("said", NONSENSE.values(), ids=NONSENSE)
def test_a_scheduler_that_answers_nonsense_is_refused_in_a_line(said, capsys, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "ANSWER", 2)
    app, met = cyclopts.App(), []

    @app.default
    def work(scheduler: str) -> None:
        with at_work(Sharing(scheduler=scheduler)):
            pass

    def answer() -> None:
        caller, _ = server.accept()
        met.append(caller)
        with suppress(OSError):
            caller.close() if said is None else caller.sendall(said)

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=answer, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        start = time.monotonic()
        assert ended(app, address) == 2
        assert time.monotonic() - start < 10
    told = capsys.readouterr().err
    assert told.startswith(f"resample: error: no scheduler of dask answers at {address}: ")
    assert told.count("\n") == 1
    (caller,) = met
    caller.close()
