import json
import os
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from resample.files.animations import Shots, check_count, check_film, fingerprint, write_film
from resample.files.films import new_film, new_stream
from resample.files.sequences import frames_of
from tests.processes import PATIENCE

COLORS = np.array([(200, 30, 60), (30, 220, 40), (20, 30, 230), (128, 128, 128)], np.uint8)


def shots(count: int = 4, *, seen: list[int] | None = None, **job: object) -> Shots:
    """Even frames of 40 × 24 px in four colors; `seen` is told which were asked for."""

    def frame(n: int) -> np.ndarray:
        if seen is not None:
            seen.append(n)
        return np.full((24, 40, 3), COLORS[n % 4], np.uint8)

    return Shots(count, frame, job)


def stopping(after: int, error: type[BaseException] = KeyboardInterrupt) -> Shots:
    """The same, of which only so many come."""
    whole = shots()

    def frame(n: int) -> np.ndarray:
        if n == after:
            raise error
        return whole.frame(n)

    return whole._replace(frame=frame)


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("suffix", ["gif", "apng", "webp"])
def test_an_animated_picture_has_all_frames_and_their_rate(suffix, tmp_path):
    path = tmp_path / f"a.{suffix}"
    write_film(path, shots(), 20)
    with Image.open(path) as animation:
        assert (animation.n_frames, animation.size) == (4, (40, 24))
        for n in range(4):
            animation.seek(n)
            shown = animation.convert("RGB").getpixel((20, 12))
            assert animation.info["duration"] == 50
            assert np.abs(np.subtract(shown, COLORS[n], dtype=float)).max() <= 4  # WebP's loss
    assert files(tmp_path) == [path.name]


def test_a_film_has_all_frames_and_their_rate_and_colors(tmp_path):
    path = tmp_path / "a.MP4"
    write_film(path, shots(), 23.976)
    with av.open(path) as film:
        stream = film.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt) == ("h264", "yuv420p")
        assert float(stream.average_rate) == pytest.approx(23.976)
        for n, frame in enumerate(film.decode(stream)):
            pixel = frame.to_ndarray(format="rgb24")[12, 20].astype(int)
            assert np.abs(pixel - COLORS[n]).max() <= 4  # 8-bit YUV, and the decoder's rounding
    assert n == 3
    assert files(tmp_path) == ["a.MP4"]


def test_the_index_of_a_film_comes_first_so_that_it_starts_at_once(tmp_path):
    write_film(tmp_path / "a.mp4", shots(), 24)
    data = (tmp_path / "a.mp4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")


def test_a_film_is_encoded_by_one_thread_so_that_its_bytes_are_the_same_anywhere(tmp_path):
    with new_film(tmp_path / "a.mp4") as film:
        assert new_stream(film, 24, (64, 96)).codec_context.thread_count == 1
    for name in ("b.mp4", "c.mp4"):
        write_film(tmp_path / name, shots(), 24)
    assert (tmp_path / "b.mp4").read_bytes() == (tmp_path / "c.mp4").read_bytes()


def test_odd_sides_of_a_film_become_even(tmp_path):
    odd = Shots(1, lambda _: np.full((23, 41, 3), 99, np.uint8), {})
    write_film(tmp_path / "a.mp4", odd, 24)
    with av.open(tmp_path / "a.mp4") as film:
        stream = film.streams.video[0]
        assert (stream.height, stream.width) == (24, 42)
        edge = next(film.decode(stream)).to_ndarray(format="rgb24")[-1, -1]
    assert np.abs(edge.astype(int) - 99).max() <= 2  # 8-bit YUV


def test_a_folder_gets_numbered_frames_and_keeps_its_other_files(tmp_path):
    (tmp_path / "notes.txt").write_text("keep me")
    write_film(tmp_path, shots(2), 24)
    assert files(tmp_path) == ["animation.json", "frame-0000.png", "frame-0001.png", "notes.txt"]


def test_progress_is_told_for_every_frame(tmp_path):
    shares: list[float] = []
    write_film(tmp_path / "frames", shots(), 24, progress=shares.append)
    assert shares == [0.25, 0.5, 0.75, 1]


def test_progress_is_not_told_for_frames_that_are_there_so_that_the_time_left_is_right(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        write_film(tmp_path / "frames", stopping(2), 24)
    shares: list[float] = []
    write_film(tmp_path / "frames", shots(), 24, resume=True, progress=shares.append)
    assert shares == [0.75, 1]


@pytest.mark.parametrize("name", ["a.gif", "a.mp4", "frames"])
@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_an_ended_run_is_gone_on_with(name, error, tmp_path, capsys):
    with pytest.raises(error):
        write_film(tmp_path / name, stopping(2, error), 24)
    assert (
        "2 frames are kept; run the same command with --resume to continue"
        in capsys.readouterr().err
    )
    assert not (tmp_path / name).is_file()
    seen: list[int] = []
    write_film(tmp_path / name, shots(seen=seen), 24, resume=True)
    assert seen == [2, 3]
    assert files(tmp_path) == [name]


def test_a_run_without_any_frame_leaves_nothing(tmp_path, capsys):
    for name in ("a.gif", "frames"):
        with pytest.raises(KeyboardInterrupt):
            write_film(tmp_path / name, stopping(0), 24)
    assert files(tmp_path) == []
    assert capsys.readouterr().err == ""


def test_a_frame_cut_short_is_made_again(tmp_path):
    write_film(tmp_path, shots(), 24)
    frame = tmp_path / "frame-0001.png"
    whole = frame.read_bytes()
    frame.write_bytes(whole[: len(whole) // 2])
    (tmp_path / "frame-0002.png").write_bytes(b"")
    seen: list[int] = []
    write_film(tmp_path, shots(seen=seen), 24, resume=True)
    assert seen == [1, 2]
    assert frame.read_bytes() == whole


KILLED_AT_EVERY_STEP = """
import itertools, os, signal, sys
from pathlib import Path

import numpy as np
from PIL import Image

from resample.files.animations import Shots, write_film

STEPS = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir"}
shots = Shots(3, lambda n: np.full((8, 8, 3), 40 * n, np.uint8), {})


def ends_well(target, at=None):
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1] == 0
    steps = itertools.count()

    def kill(step, _):
        if step in STEPS and next(steps) == at:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(kill)
    write_film(target, shots, 24, resume=at is None)
    os._exit(0)


def content(folder):
    return {path.relative_to(folder): path.is_file() and path.read_bytes()
            for path in folder.rglob("*")}


Image.init()  # of its modules, which are not to be counted
for name in ("a.gif", "frames"):
    whole = Path(f"{name}-whole")
    whole.mkdir()
    assert ends_well(whole / name)
    for at in itertools.count():
        folder = Path(f"{name}-{at}")
        folder.mkdir()
        if ends_well(folder / name, at):
            break
        assert ends_well(folder / name)
        assert content(folder) == content(whole), (name, at, content(folder))
    print(at)
"""


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that can be forked")
def test_a_run_killed_at_any_file_operation_is_gone_on_with(tmp_path):
    ended = subprocess.run(
        [sys.executable, "-W", "error", "-c", KILLED_AT_EVERY_STEP],
        check=False,
        cwd=tmp_path,
        capture_output=True,
        timeout=PATIENCE,
    )
    assert ended.returncode == 0, ended.stderr.decode()
    assert all(int(steps) > 15 for steps in ended.stdout.split())


@pytest.mark.parametrize("name", ["a.gif", "frames"])
def test_a_film_that_another_process_makes_is_refused_and_left_alone(name, tmp_path):
    target = tmp_path / name

    def frame(n):
        with pytest.raises(OSError, match=f"{name} is being made by another process; wait"):
            write_film(target, shots(2), 24)
        return shots(2).frame(n)

    if not target.suffix:
        target.mkdir()
    write_film(target, shots(2)._replace(frame=frame), 24)
    assert (target if target.is_file() else target / "frame-0001.png").exists()
    write_film(target, shots(2), 24)


def test_frames_of_another_job_are_refused(tmp_path):
    write_film(tmp_path, shots(speed=1), 24)
    with pytest.raises(ValueError, match=r"speed is 1 there and 2 here\); without --resume"):
        write_film(tmp_path, shots(speed=2), 24, resume=True)
    with pytest.raises(ValueError, match="frames is 4 there and 3 here"):
        write_film(tmp_path, shots(3, speed=1), 24, resume=True)
    assert json.loads((tmp_path / "animation.json").read_text()) == {"frames": 4, "speed": 1}


def test_frames_with_damaged_facts_are_refused(tmp_path):
    write_film(tmp_path, shots(2), 24)
    (tmp_path / "animation.json").write_text("[")
    with pytest.raises(ValueError, match="another animation"):
        write_film(tmp_path, shots(2), 24, resume=True)


def test_without_resuming_all_frames_are_made_anew(tmp_path):
    write_film(tmp_path, shots(4), 24)
    seen: list[int] = []
    write_film(tmp_path, shots(2, seen=seen), 24)
    assert seen == [0, 1]
    assert files(tmp_path) == ["animation.json", "frame-0000.png", "frame-0001.png"]


def test_frames_of_unknown_origin_are_not_taken_for_ones_own(tmp_path):
    Image.new("RGB", (40, 24)).save(tmp_path / "frame-0000.png")
    seen: list[int] = []
    write_film(tmp_path, shots(2, seen=seen), 24, resume=True)
    assert seen == [0, 1]


def test_a_film_that_cannot_be_written_in_the_end_keeps_its_frames(tmp_path, monkeypatch):
    monkeypatch.setattr("resample.files.films.PRESETS", {"h264": "magic"})
    with pytest.raises(OSError, match="cannot be written"):
        write_film(tmp_path / "a.mp4", shots(), 24)
    assert files(tmp_path) == [".a.mp4.frames"]


def test_a_missing_codec_is_named_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ValueError, match=r"pip install 'hybrid-resample\[film\]'") as caught:
        write_film(tmp_path / "a.mp4", shots(), 24)
    assert "\n" not in str(caught.value)
    assert files(tmp_path) == []
    (tmp_path / "b.mkv").write_bytes(b"film")
    with pytest.raises(ValueError, match=r"b\.mkv: films need PyAV"):
        frames_of(tmp_path / "b.mkv")
    write_film(tmp_path / "a.webp", shots(), 24)
    assert files(tmp_path) == ["a.webp", "b.mkv"]


def test_a_webp_keeps_time_at_rates_that_are_no_whole_milliseconds(tmp_path):
    write_film(tmp_path / "a.webp", shots(), 24)
    with Image.open(tmp_path / "a.webp") as animation:
        shown = 0
        for n in range(4):
            animation.seek(n)
            animation.load()
            shown += animation.info["duration"]
    assert shown == 167  # ms; four times 1000 / 24, rounded once


@pytest.mark.parametrize("fps", [0, -1, float("nan"), 1e9])
def test_a_rate_is_checked(fps, tmp_path):
    with pytest.raises(ValueError, match="frames per second"):
        check_film(tmp_path / "a.gif", fps)


def test_targets_are_checked(tmp_path):
    (tmp_path / "file").write_text("a file")
    with pytest.raises(ValueError, match=r"written as \.mp4, \.webp, \.gif, \.apng or a folder"):
        check_film(tmp_path / "a.avi", 24)
    with pytest.raises(OSError, match="is not a folder"):
        check_film(tmp_path / "file", 24)
    with pytest.raises(OSError, match="cannot be written"):
        check_film(tmp_path / "none" / "a.mp4", 24)
    with pytest.raises(OSError, match="cannot be written"):
        check_film(tmp_path / "none" / "frames", 24)


@pytest.mark.parametrize("count", [0, 10_001])
def test_a_number_of_frames_is_checked(count):
    with pytest.raises(ValueError, match=f"{count} frames; 1 to 10000 are allowed"):
        check_count(count)


def test_a_fingerprint_tells_values_shapes_and_types_apart(rng):
    array = rng.random((4, 6))
    others = [array + 1e-9, array.reshape(6, 4), array.view(np.int64)]
    assert fingerprint(array) == fingerprint(array.copy())
    assert len({fingerprint(array), *map(fingerprint, others)}) == 4
