"""Films for two eyes: what players read, times, sound, parts, black bars."""

import re
import struct
from fractions import Fraction
from functools import partial
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from resample.files import sequences
from resample.files.films import mark_stereo
from resample_warp3d import cli
from resample_warp3d.command.stereo import StereoRendering
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
HOLDING = ("moov", "trak", "mdia", "minf", "stbl", "stsd", "avc1", "hvc1", "hev1", "av01", "sv3d")
TIMES = [0, 3000, 9000, 12000, 16500, 24000, 27000, 30000]  # 1/90000 s
WORDS = ["stereo", "in.mp4", "z.npy", "--depth-kind", "relative", "--method", "mcmillan-zbuffer"]
WORDS += ["--refine", "none", "--temporal", "none", "--divergence", "10"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A film of 8 pictures at uneven times, with sound, between black bars; depth of all."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    depth = np.full((8, 48, 64), 0.2, np.float32)
    depth[:, 20:28, 24:40] = 0.8
    depth[:, :8], depth[:, 40:] = 7.0, -7.0  # of what a network sees in bars
    np.save("z.npy", depth)
    pictures = np.zeros((8, 48, 64, 3), np.uint8)
    for n, levels in enumerate(pictures):
        levels[8:40] = rng.integers(0, 256, (8, 16, 3)).repeat(4, 0).repeat(4, 1)
        levels[2:6, 8 * n : 8 * n + 8] = 3  # noise that is black
    write_film(pictures)


def write_film(pictures):
    """Write pictures at uneven times, with sound."""
    with av.open("in.mp4", "w") as film:
        stream = film.add_stream("libx264", rate=24, options={"crf": "4"})
        stream.height, stream.width, stream.pix_fmt = *pictures.shape[1:3], "yuv444p"
        stream.codec_context.time_base = Fraction(1, 90_000)
        sound = film.add_stream("aac", rate=16_000, layout="mono")
        for levels, time in zip(pictures, TIMES, strict=True):
            picture = av.VideoFrame.from_ndarray(levels, format="rgb24")
            picture.pts, picture.time_base = time, Fraction(1, 90_000)
            film.mux(stream.encode(picture.reformat(format="yuv444p")))
        film.mux(stream.encode(None))
        wave = np.sin(np.arange(6400) / 3).astype(np.float32)[None]
        audio = av.AudioFrame.from_ndarray(wave, format="fltp", layout="mono")
        audio.sample_rate, audio.pts = 16_000, 0
        film.mux(sound.encode(audio))
        film.mux(sound.encode(None))


def boxes(data, kinds=()):
    """All boxes of an MP4 as (path of kinds, body)."""
    place = 0
    while place + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, place)
        body, path = data[place + 8 : place + size], (*kinds, kind.decode())
        yield path, body
        begin = {"stsd": 8, "avc1": 78, "hvc1": 78, "hev1": 78, "av01": 78}.get(path[-1], 0)
        if path[-1] in (*HOLDING, "proj"):
            yield from boxes(body[begin:], path)
        place += size


def marks(name):
    """The boxes of two eyes in a film's video, by kind."""
    found = {path[-1]: body for path, body in boxes(Path(name).read_bytes())}
    return {kind: found[kind] for kind in ("st3d", "svhd", "equi") if kind in found}


def seen(name):
    """Pictures of a film, their times, and its streams."""
    with av.open(name) as film:
        kinds = [stream.type for stream in film.streams]
        frames = [(f.to_ndarray(format="rgb24"), f.time, f) for f in film.decode(video=0)]
    return [f[0] for f in frames], [f[1] for f in frames], kinds, frames[0][2]


@pytest.mark.parametrize(
    ("layout", "mode", "codec", "suffix", "name"),
    [
        ("side-by-side", 2, "h264", ".mp4", "_LRF_Full_SBS"),
        ("half-top-bottom", 1, "hevc", ".mov", "_TB"),
        ("half-side-by-side", 2, "av1", ".mp4", "_LR"),
    ],
)
def test_players_find_both_eyes_sound_and_times(layout, mode, codec, suffix, name):
    words = [*WORDS, "--layout", layout, "--codec", codec, "--name-layout"]
    assert ended(*words, "-o", f"out{suffix}") == 0
    made, times, kinds, first = seen(f"out{name}{suffix}")
    assert marks(f"out{name}{suffix}") == {"st3d": bytes([0, 0, 0, 0, mode])}
    assert "STEREO3D" in {each.type.name for each in first.side_data}  # FFmpeg's reading
    assert made[0].shape == (48, 128 if layout == "side-by-side" else 64, 3)
    np.testing.assert_allclose(times, np.array(TIMES) / 90_000, atol=1e-4)
    assert sorted(kinds) == ["audio", "video"]


def test_boxes_leave_pictures_and_sound_where_their_tables_say(monkeypatch):
    """The same but for the boxes: growth of the tables moves all places in the file."""
    monkeypatch.setattr(sequences, "mark_stereo", lambda *_: None)
    assert ended(*WORDS, "-o", "plain.mp4") == 0
    monkeypatch.setattr(sequences, "mark_stereo", mark_stereo)
    assert ended(*WORDS, "-o", "marked.mp4") == 0
    growth = Path("marked.mp4").stat().st_size - Path("plain.mp4").stat().st_size
    assert growth == 8 + 5
    packets = []
    for name in ("plain.mp4", "marked.mp4"):
        with av.open(name) as film:
            packets.append([bytes(packet) for packet in film.demux() if packet.size])
    assert packets[0] == packets[1]
    assert len(packets[0]) > 8


@pytest.mark.parametrize(
    ("layout", "size", "side"), [("vr180", "32", 0x40000000), ("top-bottom", "64x32", 0)]
)
def test_players_find_directions(layout, size, side):
    np.save("z.npy", np.full((8, 48, 64), 2.0))
    around = ["--fov", "60"] if layout == "vr180" else ["--source-projection", "equirectangular"]
    if layout != "vr180":
        np.save("z.npy", np.full((8, 32, 64), 2.0))
        with av.open("in.mp4", "w") as film:
            stream = film.add_stream("libx264", rate=24)
            stream.width, stream.height, stream.pix_fmt = 64, 32, "yuv420p"
            for _ in range(8):
                film.mux(stream.encode(av.VideoFrame(64, 32, "yuv420p")))
            film.mux(stream.encode(None))
    words = ["stereo", "in.mp4", "z.npy", "--depth-kind", "z", "--eye-distance", "0.1", *around]
    assert ended(*words, "--layout", layout, "--size", size, "-o", "out.mp4") == 0
    found = marks("out.mp4")
    assert found["st3d"][4] == (2 if layout == "vr180" else 1)
    assert found["svhd"][4:] == b"hybrid-resample\0"
    assert struct.unpack(">5I", found["equi"]) == (0, 0, 0, side, side)


@pytest.mark.parametrize(
    ("layout", "mode"),
    [
        ("side-by-side", "left_right"),
        ("cross-eyed", "right_left"),
        ("anaglyph", "anaglyph_cyan_red"),
    ],
)
def test_matroska_says_its_layout_and_keeps_10_bits(layout, mode):
    words = ["--layout", layout, "--pixel-format", "yuv420p10le", "--crf", "10"]
    assert ended(*WORDS, *words, "-o", "out.mkv") == 0
    with av.open("out.mkv") as film:
        assert film.streams.video[0].metadata["stereo_mode"] == mode
        assert film.streams.video[0].codec_context.pix_fmt == "yuv420p10le"
        assert len(film.streams.audio) == 1
    assert ended(*WORDS, *words, "--start", "0.1", "-o", "cut.mkv") == 0
    _, times, _, _ = seen("cut.mkv")
    np.testing.assert_allclose(times, (np.array(TIMES[2:]) - TIMES[2]) / 90_000, atol=1.1e-3)


def test_a_part_is_that_part_of_the_whole():
    words = [*WORDS, "--crf", "1", "--pixel-format", "yuv444p", "--convergence", "50"]
    assert ended(*words, "-o", "whole.mp4") == 0
    assert ended(*words, "--start", "0:00.13", "--end", ".3", "-o", "part.mp4") == 0
    whole, part = seen("whole.mp4")[0], seen("part.mp4")[0]
    assert len(part) == 3
    error = np.abs(np.float32(part) - np.float32(whole[3:6]))
    assert error.mean() < 1.0
    assert np.quantile(error, 0.999) <= 8.0


def test_a_bit_rate_bounds_the_file():
    assert ended(*WORDS, "--bitrate", "2M", "-o", "large.mp4") == 0
    assert ended(*WORDS, "--bitrate", "60k", "-o", "small.mp4") == 0
    assert Path("small.mp4").stat().st_size < 0.5 * Path("large.mp4").stat().st_size


def test_black_bars_stay_and_do_not_scale_the_depth(capsys):
    """A network's numbers in bars are out of all range; the box and the wall are what there is."""
    assert ended(*WORDS, "--crf", "1", "--convergence", "50", "-o", "out.mp4") == 0
    behind, before = map(
        float, re.search(r"from (\S+) to (\S+) px", capsys.readouterr().err).groups()
    )
    assert before - behind == pytest.approx(6.4, abs=0.11)
    assert before == pytest.approx(-behind, abs=0.11)
    for picture in seen("out.mp4")[0]:
        assert picture[:6].max() <= 8
        assert picture[42:].max() <= 8
        # The wall is half of its parallax to the right in the left eye's picture, and the box ...
    source, made = seen("in.mp4")[0][4], seen("out.mp4")[0][4]
    error = {
        shift: np.abs(made[10:18, 16:48].astype(float) - source[10:18, 16 + shift : 48 + shift])
        for shift in (-3, -2, -1, 0, 1, 2, 3)
    }
    assert min(error, key=lambda shift: error[shift].mean()) in (1, 2)


def test_an_interrupted_film_goes_on_as_if_it_had_not_been(monkeypatch, capsys):
    """Its bytes are those of a film made at once: also what was chosen for the shot is the same."""
    monkeypatch.setattr(sequences, "PART", 3)
    pictures, depth = np.zeros((8, 96, 128, 3), np.uint8), np.full((96, 128), 0.2, np.float32)
    pictures[:, 12:84] = np.random.default_rng(5).integers(90, 140, (72, 128, 3))
    pictures[:, 30:70, 40:80] += np.uint8(100)
    depth[30:70, 40:80] = 0.8
    write_film(pictures)
    np.save("z.npy", np.tile(cv2.GaussianBlur(depth, (0, 0), 3), (8, 1, 1)))
    words = [*WORDS[:-6], "--divergence", "10", "--foreground-scale", "2", "--preserve-borders"]
    assert ended(*words, "-o", "whole.mp4") == 0
    assert "soft edges" in capsys.readouterr().err
    render, made = StereoRendering.render, []

    def failing(*given):
        made.append(1)
        if len(made) == 8:
            raise OSError("out of power")
        return render(*given)

    monkeypatch.setattr(StereoRendering, "render", failing)
    assert ended(*words, "-o", "out.mp4") == 2
    assert "6 frames are kept; run the same command with --resume" in capsys.readouterr().err
    assert ended(*words, "--crf", "3", "--resume", "-o", "out.mp4") == 2
    assert "holds frames of another" in capsys.readouterr().err
    assert ended(*words, "--resume", "-o", "out.mp4") == 0
    assert len(made) == 8 + 2
    assert not Path(".out.mp4.parts").exists()
    assert Path("out.mp4").read_bytes() == Path("whole.mp4").read_bytes()


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--start", "soon"], "--start 'soon'; give seconds, or a time such as 1:02:03.5"),
        (["--start", "3", "--end", "2"], "--end 2 is not after --start 3"),
        (["--start", "9"], "in.mp4 has no picture from 9 to inf s; it is 0."),
        (["--bitrate", "fast"], "--bitrate 'fast'; give bits per second, such as 20M"),
        (["--codec", "av1", "--pixel-format", "yuv444p"], "av1 has no yuv444p"),
        (["--eyes", "both", "--layout", "one"], "--layout one holds one eye's picture"),
    ],
)
def test_what_films_cannot_be_is_refused(capsys, words, complaint):
    assert complaint in refused(capsys, *WORDS, *words, "-o", "out.mp4")


def test_a_film_that_is_not_there_is_named(capsys):
    assert "none.mp4" in refused(capsys, "stereo", "none.mp4", *WORDS[2:], "-o", "out.mp4")
