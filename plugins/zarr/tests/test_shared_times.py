"""Films of volumes that change: of stores, time after time, and by several processes."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from resample.command import workers
from resample.command.workers import WorkerPool
from resample_volume import cli
from resample_volume.data import scanning
from resample_volume.files.source import open_recording, open_streamed
from resample_volume.series import Series, whole
from resample_zarr import volumes as zarr_files
from tests import commands
from tests.killing import Killing

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
TIMES, SHAPE = 3, (18, 13, 16)  # a layer of bricks is thinner than the others
LONG = (18, 13, 120)  # so that windows show parts of it
LARGE = ["--path", "still", "--size", "64", "--frames", "4"]
FILM = ["--path", "still", "--size", "24", "--frames", "4"]
CROPPED = ["--transfer", "20..120", "--crop", "2:,:,1:12"]
ANOTHER = "vessel-tree:size=16:transfer=gray"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(zarr_files, "SIDE", 8)
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))


def beats(kind, *, channels=None, padding=None, shape=SHAPE):
    """Balls that move and become brighter, as a file in memory and as a store."""
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    rng = np.random.default_rng(4)
    values = np.empty((TIMES, channels or 1, *shape))
    for time, channel in np.ndindex(values.shape[:2]):
        away = np.sqrt((x - 0.3 * time) ** 2 + (y + 0.2 * channel) ** 2 + z**2)
        values[time, channel] = (60 + 40 * time) * np.clip(3 * (0.7 - away), 0, 1)
    values += 6 * rng.random(values.shape)
    if padding is not None:
        values[0, :, :, :2] = padding
    stored = values.astype(kind)
    if stored.dtype.kind == "f":
        stored[1, :, 3:6, 4, 5:9] = np.nan
    np.save("a.npy", stored if channels else stored[:, 0])
    assert ended("convert", "a.npy", "a.zarr", "--chunk", "8") == 0


def frames(folder):
    found = [path.read_bytes() for path in sorted(Path(folder).glob("*.png"))]
    assert len(found) == 4
    assert len(set(found)) == TIMES
    return found


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        pytest.param("uint8", [], id="auto"),
        pytest.param(
            "float32",
            ["--transfer", "gray", "--gradient-opacity", "0.1/0.6", "--fit", "volume"],
            id="faded",
        ),
        pytest.param("float32", ["--projection", "average"], id="means"),
        *(
            pytest.param(kind, words, id=name, marks=pytest.mark.sweep)
            for name, kind, words in [
                ("regions", "uint8", ["--transfer", "surfaces"]),
                ("range", "float32", [*CROPPED, "--depth-cue", "0.4"]),
                ("with another", "uint16", ["--transfer", "gray", "--also", ANOTHER]),
                ("post", "float32", ["--classify", "post", "--transfer", "gray"]),
            ]
        ),
    ],
)
def test_a_film_of_a_store_is_that_of_a_file(kind, words, capsys):
    beats(kind)
    for name, film in (("a.npy", "a"), ("a.zarr", "b")):
        assert ended("animate", name, *FILM, *words, "-o", film) == 0
    assert frames("a") == frames("b")
    is_streamed = words[:1] != ["--projection"] and "--also" not in words
    told = "a: 3 times of 16 x 13 x 18 voxels are read one after the other, brick by brick"
    assert (told in capsys.readouterr().err) == is_streamed


@pytest.mark.sweep
def test_padding_is_that_of_all_times_of_a_store():
    beats("int16", padding=-3000)
    series = Series.of(open_streamed("a.zarr"))
    given = Series.of(open_recording("a.npy"))
    assert series.known.padding == given.known.padding == (-3000,)
    for found, wanted in zip(series, given, strict=True):
        assert np.array_equal(found.values.whole(), wanted.values)
        low, high = found.values.ends
        assert (low.min(), high.max()) == (wanted.values.min(), wanted.values.max())
    for name in ("a.npy", "a.zarr"):
        assert ended("animate", name, *FILM, "-o", name[2:]) == 0
    assert frames("npy") == frames("zarr")


@pytest.mark.sweep
def test_a_channel_of_a_store_is_filmed(capsys):
    beats("uint8", channels=2)
    for name in ("a.npy", "a.zarr"):
        assert ended("animate", name, *FILM, "--channel", "1", "-o", name[2:]) == 0
    assert frames("npy") == frames("zarr")
    capsys.readouterr()
    assert "choose one by channel, 0 to 1 (--channel 0; " in refused(
        capsys, "animate", "a.zarr", *FILM, "-o", "c"
    )
    one = ["--time", "1", "--channel", "0", "--frames", "1", "--size", "24"]
    for name in ("a.npy", "a.zarr"):
        assert ended("animate", name, *one, "-o", f"one-{name[2:]}") == 0
    found = [Path(f"one-{kind}/frame-0000.png").read_bytes() for kind in ("npy", "zarr")]
    assert found[0] == found[1]


@pytest.mark.sweep
def test_all_times_are_looked_at_once_and_then_what_is_seen_of_each():
    beats("uint8")
    series = Series.of(open_streamed("a.zarr"))
    assert series.together.values.reads == TIMES * 3 * 2 * 2
    for volume in series:
        assert volume.values.ends[0].shape == (3, 2, 2)
        assert volume.values.reads == 0
    every = whole(open_streamed("a.zarr")).values
    assert [every.box((n, 0, 0))[0] for n in range(6)] == [
        *(slice(0, 8), slice(8, 16), slice(16, 18)),
        *(slice(18, 26), slice(26, 34), slice(34, 36)),
    ]


@pytest.mark.sweep
def test_times_that_do_not_fit_in_memory_have_the_same_frames(capsys):
    beats("uint8", shape=LONG)
    words = [*LARGE, "--transfer"]
    dense, few = "0/white/0.02,240/red/0.5", ["--memory", "2500kB"]
    assert ended("animate", "a.npy", *words, dense, "-o", "a") == 0
    assert ended("animate", "a.zarr", *words, dense, *few, "-o", "b") == 0
    assert frames("a") == frames("b")
    Path("b/frame-0002.png").unlink()
    assert ended("animate", "a.zarr", *words, dense, *few, "-o", "b", "--resume") == 0
    assert frames("a") == frames("b")
    other = dense.replace("red", "blue")
    assert ended("animate", "a.zarr", *words, other, *few, "-o", "b", "--resume") == 2
    assert "holds frames of another animation" in capsys.readouterr().err


@pytest.mark.sweep
@pytest.mark.usefixtures("pickled")
def test_windows_of_times_are_painted_by_others_too():
    beats("uint8", shape=LONG)
    words = [*LARGE, "--transfer", "0/white/0.02,240/red/0.5", "--memory", "5MB"]
    assert ended("animate", "a.npy", *words[:-2], "-o", "a") == 0
    assert ended("animate", "a.zarr", *words, "-o", "b", "--workers", "2") == 0
    assert frames("a") == frames("b")


class Elsewhere:
    """Does as processes would: what it is given is pickled."""

    def __init__(self, executor):
        self.executor = executor

    def map(self, job, parts):
        return self.executor.map(pickle.loads(pickle.dumps(job)), parts)


@pytest.fixture
def pickled(monkeypatch):
    """Workers that are threads of this process, but know nothing of what it holds."""

    @contextmanager
    def hiring(sharing, threads=None):
        with ThreadPoolExecutor(1) as executor:
            crew = WorkerPool(Elsewhere(executor), sharing.workers or 1, threads or 1, None, True)
            yield lambda: crew if sharing.has_workers else None

    monkeypatch.setattr(workers, "worker_pools", hiring)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("name", "words", "is_kept"),
    [
        ("a.npy", [], False),
        ("a.zarr", ["--transfer", "surfaces"], True),
        *(
            pytest.param("a.zarr", words, False, marks=pytest.mark.sweep)
            for words in ([], ["--projection", "maximum", "--memory", "100MB"])
        ),
    ],
)
@pytest.mark.usefixtures("pickled")
def test_frames_of_times_are_shared_out(name, words, is_kept, monkeypatch):
    monkeypatch.setattr(scanning, "LEAST", 0 if is_kept else 1 << 30)
    beats("float32")
    assert ended("animate", name, *FILM, *words, "-o", "a") == 0
    assert ended("animate", name, *FILM, *words, "-o", "b", "--workers", "2") == 0
    assert frames("a") == frames("b")
    Path("b/frame-0001.png").unlink()
    more = ["--resume", "--workers", "1"]
    assert ended("animate", name, *FILM, *words, "-o", "b", *more) == 0
    assert frames("a") == frames("b")


@pytest.mark.parametrize("name", ["vessel-tree:size=8", "a.npy"])
@pytest.mark.usefixtures("pickled")
def test_rays_that_become_voxels_beside_another_volume_are_shared_out(name):
    beats("uint8")
    few = ["--path", "still", "--size", "16", "--frames", "4", "--order", "rays"]
    words = [name, *few, "--also", ANOTHER]
    assert ended("animate", *words, "-o", "a") == 0
    assert ended("animate", *words, "-o", "b", "--workers", "2") == 0
    found, wanted = (
        [path.read_bytes() for path in sorted(Path(folder).glob("*.png"))] for folder in "ba"
    )
    assert len(found) == 4
    assert found == wanted


@pytest.mark.sweep
@pytest.mark.parametrize("is_kept", [False, pytest.param(True, marks=pytest.mark.sweep)])
@pytest.mark.usefixtures("pickled")
def test_padding_of_all_times_is_known_elsewhere_too(is_kept, monkeypatch):
    monkeypatch.setattr(scanning, "LEAST", 0 if is_kept else 1 << 30)
    beats("int16", padding=-3000)
    assert ended("animate", "a.zarr", *FILM, "-o", "a") == 0
    assert ended("animate", "a.zarr", *FILM, "-o", "b", "--workers", "1") == 0
    assert frames("a") == frames("b")


@pytest.mark.sweep
def test_a_killed_worker_costs_a_film_of_times_its_own_frames_alone(monkeypatch):
    beats("uint8")
    assert ended("animate", "a.zarr", *FILM, "-o", "a") == 0
    asked, killers = workers.worker_pools, []

    @contextmanager
    def hiring(sharing, threads=None):
        with asked(sharing, threads) as start_workers:
            Path("marks").mkdir()
            killers.append(
                Killing(start_workers().executor, Path("marks").resolve(), 1, is_late=True)
            )
            yield lambda: start_workers()._replace(executor=killers[0])

    monkeypatch.setattr(workers, "worker_pools", hiring)
    assert ended("animate", "a.zarr", *FILM, "-o", "b", "--workers", "2") == 0
    killers[0].redone(0)
    assert frames("a") == frames("b")
