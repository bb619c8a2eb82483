"""Files of several pictures, and several files, through the command line."""

import json
from fractions import Fraction
from functools import partial
from pathlib import Path

import av
import cv2
import numpy as np
import OpenImageIO
import pytest
from PIL import Image

from resample.files.images import read_channels
from resample.files.metadata.tags import Tag, add_tags
from resample.files.sequences import frames_of
from resample_texture import cli
from tests import commands

SAME = ["--matrix", "1,0,0,0,1,0"]
HALF = ["--matrix", "0.5,0,0,0,0.5,0"]
COLORS = [(200, 30, 60), (30, 220, 40), (20, 30, 230)]
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def frames(count: int = 3) -> list[Image.Image]:
    """Even frames of 32 × 24 px whose left half is white."""
    made = []
    for n in range(count):
        levels = np.full((24, 32, 3), COLORS[n % 3], np.uint8)
        levels[:, :16] = 255
        made.append(Image.fromarray(levels))
    return made


def animate(name: str, *, count: int = 3, **more: object) -> None:
    first, *others = frames(count)
    choices = {"webp": {"lossless": True}, "png": {"format": "PNG"}}.get(name[-4:].lstrip("."), {})
    first.save(name, save_all=True, append_images=others, **choices, **more)


def film(name: str, *, rotation: int = 0, color: bool = True, codec: str = "libx264") -> None:
    with av.open(name, "w") as target:
        stream = target.add_stream(codec, rate=10)
        stream.width, stream.height, stream.pix_fmt = 32, 24, "yuv420p"
        if rotation:
            stream.set_display_rotation(rotation)
        if color:
            from av.video.reformatter import ColorRange, Colorspace

            stream.codec_context.colorspace = Colorspace.ITU709
            stream.codec_context.color_range = ColorRange.MPEG
        for image in frames():
            picture = av.VideoFrame.from_image(image)
            space = {"dst_colorspace": Colorspace.ITU709} if color else {}
            target.mux(stream.encode(picture.reformat(format="yuv420p", **space)))
        target.mux(stream.encode(None))


def seen(name: str) -> list[tuple[np.ndarray, float]]:
    """Frames (H, W, 4) of an animated picture, and milliseconds that they are shown."""
    with Image.open(name) as image:
        kept = []
        for n in range(getattr(image, "n_frames", 1)):
            image.seek(n)
            levels = np.array(image.convert("RGBA"))
            kept.append((levels, image.info["duration"]))
        return kept


# Pages


def test_every_page_of_a_tiff_is_warped_alike():
    rng = np.random.default_rng(4)
    levels = [rng.integers(0, 256, (12, 16), np.uint8), rng.integers(0, 256, (9, 7, 3), np.uint8)]
    pages = [Image.fromarray(level) for level in levels]
    pages[0].save("in.tif", save_all=True, append_images=pages[1:])
    assert ended("warp", "in.tif", "-o", "out.tif", *SAME) == 0
    with Image.open("out.tif") as image:
        assert image.n_frames == 2
        for n, level in enumerate(levels):
            image.seek(n)
            assert np.array_equal(np.array(image), level)


def test_pages_of_16_bits_and_floats_stay_so():
    deep = np.random.default_rng(4).integers(0, 65536, (12, 16), np.uint16)
    real = np.random.default_rng(4).normal(size=(12, 16)).astype(np.float32)
    Image.fromarray(deep).save("in.tif", save_all=True, append_images=[Image.fromarray(real)])
    assert ended("warp", "in.tif", "-o", "out.tif", *SAME) == 0
    with Image.open("out.tif") as image:
        assert np.array_equal(np.array(image), deep)
        image.seek(1)
        assert np.array_equal(np.array(image), real)


def test_smaller_copies_and_masks_are_no_pages(capsys):
    pages = [Image.fromarray(np.full((12, 16), level, np.uint8)) for level in (50, 60, 70, 80)]
    pages[0].save("in.tif", save_all=True, append_images=pages[1:])
    kinds = [Tag(4, np.array([bits], np.uint32)) for bits in (0, 1, 4, 2)]
    add_tags(Path("in.tif"), [{254: kind} for kind in kinds])
    assert ended("warp", "in.tif", "-o", "out.tif", *SAME) == 0
    assert capsys.readouterr().err == "resample: in.tif: its masks are ignored\n"
    with Image.open("out.tif") as image:
        assert image.n_frames == 2
        assert image.getpixel((3, 3)) == 50
        image.seek(1)
        assert image.getpixel((3, 3)) == 80


# Animated pictures and films


@pytest.mark.some(1)
@pytest.mark.parametrize("target", ["gif", "webp", "apng", "png"])
@pytest.mark.parametrize("source", ["gif", "webp", "png"])
def test_animations_keep_frames_and_times(source, target):
    animate(f"in.{source}", duration=[50, 100, 200])
    assert ended("warp", f"in.{source}", "-o", f"out.{target}", *SAME) == 0
    kept = seen(f"out.{target}")
    assert [time for _, time in kept] == [50, 100, 200]
    for (levels, _), color in zip(kept, COLORS, strict=True):
        assert (levels[..., 3] == 255).all()
        assert np.abs(levels[12, 24, :3].astype(int) - color).max() <= 6  # losses of WebP
        assert np.abs(levels[12, 8, :3].astype(int) - 255).max() <= 6


@pytest.mark.some(2)
@pytest.mark.parametrize("target", ["gif", "webp", "apng"])
def test_what_lies_beyond_a_frame_is_transparent(target):
    animate("in.gif", duration=100)
    assert ended("warp", "in.gif", "-o", f"out.{target}", *HALF) == 0
    for levels, _ in seen(f"out.{target}"):
        assert (levels[2:10, 2:14, 3] == 255).all()
        assert (levels[14:, :, 3] == 0).all()
        assert (levels[:, 18:, 3] == 0).all()
    assert len(seen(f"out.{target}")) == 3


@pytest.mark.sweep
def test_a_frame_does_not_shine_through_the_next():
    made = []
    for n in range(3):
        levels = np.zeros((24, 32, 4), np.uint8)
        levels[:, 8 * n : 8 * n + 8] = (*COLORS[n], 255)
        made.append(Image.fromarray(levels))
    made[0].save("in.png", save_all=True, append_images=made[1:], duration=100, disposal=1, blend=0)
    for target in ("gif", "apng", "webp"):
        assert ended("warp", "in.png", "-o", f"out.{target}", *SAME) == 0
        for n, (levels, _) in enumerate(seen(f"out.{target}")):
            opaque = levels[12, :, 3] > 128
            assert opaque.nonzero()[0].tolist() == list(range(8 * n, 8 * n + 8))
            assert np.abs(levels[12, 8 * n + 4, :3].astype(int) - COLORS[n]).max() <= 8


@pytest.mark.some(1)
@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
def test_films_keep_frames_times_and_colors(suffix):
    film(f"in.{suffix}")
    assert ended("warp", f"in.{suffix}", "-o", "out.mp4", *SAME) == 0
    with av.open("out.mp4") as kept:
        stream = kept.streams.video[0]
        images = list(kept.decode(stream))
        assert [round(float(frame.time), 3) for frame in images] == [0.0, 0.1, 0.2]
        assert stream.average_rate == Fraction(10)
    for image, color in zip(images, COLORS, strict=True):
        from av.video.reformatter import Colorspace

        levels = image.to_ndarray(format="rgb24", src_colorspace=Colorspace.ITU709)
        assert np.abs(levels[12, 26].astype(int) - color).max() <= 6  # two losses of H.264


def test_films_that_do_not_tell_their_colors_are_as_of_old_television():
    film("in.mkv", color=False)
    assert ended("warp", "in.mkv", "-o", "out.apng", *SAME) == 0
    for (levels, _), color in zip(seen("out.apng"), COLORS, strict=True):
        assert np.abs(levels[12, 26, :3].astype(int) - color).max() <= 4


def test_what_a_film_does_not_show_stays_clear():
    levels = np.full((24, 32, 4), (200, 30, 60, 255), np.uint8)
    levels[:, 16:, 3] = 0
    with av.open("in.mov", "w") as target:
        stream = target.add_stream("qtrle", rate=10)
        stream.width, stream.height, stream.pix_fmt = 32, 24, "argb"
        for _ in range(2):
            target.mux(stream.encode(av.VideoFrame.from_ndarray(levels, format="rgba")))
        target.mux(stream.encode(None))
    assert ended("warp", "in.mov", "-o", "out.tif", *SAME) == 0
    alpha = read_channels("out.tif", 1)["A"]
    assert (alpha[:, :16] == 1).all()
    assert not alpha[:, 16:].any()


def film_with_sound(name: str, codec: str, *, late: float = 0.0) -> np.ndarray:
    """Write three frames at 10 per second with a rising tone; return its samples at 8 kHz.

    All times of the film are `late` seconds later.
    """
    tone = np.sin(np.linspace(0, 15, 2400) ** 2).astype(np.float32) / 2
    with av.open(name, "w") as target:
        stream, sound = target.add_stream("libx264", rate=10), target.add_stream(codec, rate=8000)
        stream.width, stream.height, stream.pix_fmt = 32, 24, "yuv420p"
        sound.layout = "mono"
        for n, image in enumerate(frames()):
            picture = av.VideoFrame.from_image(image)
            picture.pts, picture.time_base = round(late * 10) + n, Fraction(1, 10)
            target.mux(stream.encode(picture))
        heard = av.AudioFrame.from_ndarray(tone[None], "fltp", "mono")
        heard.sample_rate, heard.time_base, heard.pts = 8000, Fraction(1, 8000), round(late * 8000)
        target.mux(sound.encode(av.AudioResampler(sound.format, "mono", 8000).resample(heard)[0]))
        target.mux(stream.encode(None))
        target.mux(sound.encode(None))
    return tone


def heard_in(name: str) -> tuple[str, np.ndarray]:
    """Codec of a film's sound, and its samples at 8 kHz from 0.1 s before the first picture on."""
    with av.open(name) as film:
        stream = film.streams.audio[0]
        found = list(film.decode(stream))
        turned = av.AudioResampler("fltp", "mono", 8000)
        parts = [each.to_ndarray()[0] for one in found for each in turned.resample(one)]
        begin = 800 + round(float(found[0].time) * 8000)
        whole = np.concatenate([np.zeros(max(0, begin)), *parts, np.zeros(4000)])
        return stream.codec_context.name, whole[max(0, -begin) :]


@pytest.mark.parametrize(
    ("name", "codec"), [("in.mp4", "aac"), ("in.mov", "pcm_s16le"), ("in.mkv", "flac")]
)
def test_sound_stays_beside_the_pictures_it_is_heard_with(name, codec, capsys):
    tone = film_with_sound(name, codec, late=0.5)
    assert ended("warp", name, "-o", "out.mp4", *SAME) == 0
    assert capsys.readouterr().err == ""
    kept, heard = heard_in("out.mp4")
    assert kept == ("aac" if codec.startswith("pcm") else codec)
    lags = range(-400, 401, 4)
    alike = [np.corrcoef(heard[800 + lag :][:1500], tone[:1500])[0, 1] for lag in lags]
    assert max(alike) > 0.95
    assert abs(lags[int(np.argmax(alike))]) <= 16  # samples: 2 ms


@pytest.mark.parametrize(
    ("name", "layout", "rate"),
    [("in.mkv", "7.1", 48000), ("in.mkv", "octagonal", 48000), ("in.mkv", "mono", 192000),
     ("in.avi", "stereo", 11025)],
)  # fmt: skip
def test_sound_of_any_channels_and_rate_becomes_aac(name, layout, rate, capsys):
    """AVI does not state the layout of channels."""
    with av.open(name, "w") as target:
        stream, sound = (target.add_stream(each, rate=each_rate) for each, each_rate in
                         (("libx264", 10), ("pcm_s16le", rate)))  # fmt: skip
        stream.width, stream.height, stream.pix_fmt = 32, 24, "yuv420p"
        sound.layout = layout
        for image in frames():
            target.mux(stream.encode(av.VideoFrame.from_image(image)))
        count = rate * 3 // 10
        tone = np.repeat((np.sin(np.arange(count) / 9) * 9000).astype(np.int16), sound.channels)
        heard = av.AudioFrame.from_ndarray(tone[None], "s16", layout)
        heard.sample_rate, heard.time_base, heard.pts = rate, Fraction(1, rate), 0
        target.mux(sound.encode(heard))
        target.mux(stream.encode(None))
        target.mux(sound.encode(None))
    assert ended("warp", name, "-o", "out.mp4", *SAME) == 0
    assert capsys.readouterr().err == ""
    kept, samples = heard_in("out.mp4")
    assert kept == "aac"
    assert np.abs(samples[900:2900]).max() > 0.05


def test_a_target_without_sound_says_so(capsys):
    film_with_sound("in.mp4", "aac")
    assert ended("warp", "in.mp4", "-o", "out.webp", *SAME) == 0
    said = "resample: in.mp4: sound and subtitles are copied to .mp4, .mov, .mkv alone\n"
    assert capsys.readouterr().err == said


def test_films_are_opaque_and_black_where_nothing_is():
    animate("in.webp")
    assert ended("warp", "in.webp", "--matrix", "1,0,16,0,1,0,0,0,1", "-o", "out.mp4") == 0
    with av.open("out.mp4") as film:
        levels = next(film.decode(video=0)).to_ndarray(format="rgb24")
    assert levels[:, :14].max() < 24
    assert levels[:, 18:].min() > 230


@pytest.mark.parametrize("listed", ["ffconcat version 1.0\nfile b.mp4\n", "#EXTM3U\nb.mp4\n"])
def test_a_list_of_films_is_not_followed(listed, capsys):
    film("b.mp4")
    Path("a.mp4").write_text(listed)
    assert ended("warp", "a.mp4", "-o", "out.mp4", *SAME) == 2
    assert "a.mp4 is not a film that can be read" in capsys.readouterr().err


def test_a_film_of_an_unknown_codec_is_refused(capsys):
    film("in.mp4")
    Path("in.mp4").write_bytes(Path("in.mp4").read_bytes().replace(b"avc1", b"zzzz"))
    assert ended("warp", "in.mp4", "-o", "out.mp4", *SAME) == 2
    assert "its codec is unknown" in capsys.readouterr().err


@pytest.mark.some(1)
@pytest.mark.parametrize("rotation", [90, 180, 270])
def test_a_sideways_film_is_turned(rotation):
    film("in.mp4", rotation=rotation)
    assert ended("warp", "in.mp4", "-o", "out.apng", *SAME) == 0
    levels = seen("out.apng")[0][0][..., :3].astype(int)
    expected = np.rot90(np.asarray(frames(1)[0]).astype(int), rotation // 90)
    assert levels.shape == expected.shape
    assert np.median(np.abs(levels - expected)) <= 4


@pytest.mark.sweep
def test_films_become_animations_and_the_other_way_round():
    animate("in.gif", duration=[50, 100, 200])
    assert ended("warp", "in.gif", "-o", "out.mp4", *SAME) == 0
    with av.open("out.mp4") as kept:
        times = [round(float(frame.time), 3) for frame in kept.decode(video=0)]
    assert times == [0.0, 0.05, 0.15]
    film("in.mp4")
    assert ended("warp", "in.mp4", "-o", "out.gif", *SAME) == 0
    assert [time for _, time in seen("out.gif")] == [100, 100, 100]


def test_pages_may_come_from_frames():
    animate("in.gif", duration=100)
    assert ended("warp", "in.gif", "-o", "out.tif", *SAME) == 0
    assert len(frames_of(Path("out.tif")).seconds) == 3
    assert sorted(read_channels("out.tif", 2)) == sorted("RGB")


def test_a_film_is_black_or_as_the_background_where_nothing_is():
    film("in.mp4")
    for more, red in (([], (0, 20)), (["--background", "red"], (200, 255))):
        assert ended("warp", "in.mp4", "-o", "out.mp4", *HALF, *more) == 0
        with av.open("out.mp4") as kept:
            levels = next(kept.decode(video=0)).to_ndarray(format="rgb24")
        assert red[0] <= levels[20, 28, 0] <= red[1]
        assert levels[20, 28, 1] < 50


@pytest.mark.some(3)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["-o", "out.exr"], "the 3 pictures of in.gif are written as .tif"),
        (["-o", "out.jpg"], "the 3 pictures of in.gif are written as .tif"),
        (["-o", "out.gif", "--bits", "16"], "animations have 8 bits per channel, not 16"),
        (["-o", "out.gif", "--coverage", "c.png"], "--coverage works with one picture"),
        (["-o", "none/out.gif"], "none/out.gif: cannot be written"),
    ],
)
def test_what_several_pictures_cannot_become_is_one_line(words, complaint, capsys):
    animate("in.gif", duration=100)
    assert complaint in refused(capsys, "warp", "in.gif", *SAME, *words)


def test_of_a_gif_that_is_cut_off_the_whole_frames_are_taken(capsys):
    animate("in.gif", duration=100, count=9)
    Path("cut.gif").write_bytes(Path("in.gif").read_bytes()[:-1])
    assert ended("warp", "cut.gif", "-o", "out.gif", *SAME) == 0
    assert "cut.gif is cut off after 9 frames" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", ["mp4", "webp"])
def test_a_damaged_film_is_one_line_and_leaves_nothing(suffix, capsys):
    film("in.mp4") if suffix == "mp4" else animate(f"in.{suffix}", duration=100)
    data = Path(f"in.{suffix}").read_bytes()
    Path(f"cut.{suffix}").write_bytes(data[: len(data) // 2])
    Path(f"text.{suffix}").write_text("no picture")
    for name in (f"cut.{suffix}", f"text.{suffix}"):
        assert name in refused(capsys, "warp", name, "-o", "out.gif", *SAME)


def test_stats_tell_how_many_frames():
    animate("in.gif", duration=100)
    assert ended("warp", "in.gif", "-o", "out.gif", *SAME, "--stats", "s.json") == 0
    assert json.loads(Path("s.json").read_text())["frames"] == 3


# Several files


def pictures(*names: str) -> None:
    for n, name in enumerate(names):
        Path(name).parent.mkdir(exist_ok=True)
        levels = np.full((12, 16, 3), 20 + 20 * n, np.uint8)
        Image.fromarray(levels).save(name)


def names(folder: str) -> list[str]:
    return sorted(path.name for path in Path(folder).iterdir())


@pytest.mark.some(1)
@pytest.mark.parametrize("given", [["in"], ["in/*.*g"], ["in/a.png", "in/b.jpg", "in/c.png"]])
def test_many_files_go_to_a_folder_under_their_names(given):
    pictures("in/a.png", "in/b.jpg", "in/c.png")
    Path("in/notes.txt").write_text("no picture")
    assert ended("warp", *given, "-o", "out", *SAME) == 0
    assert names("out") == ["a.png", "b.jpg", "c.png"]
    assert cv2.imread("out/c.png")[0, 0].tolist() == [60] * 3


EVERY = {  # commands for many files; what follows these
    "warp": SAME,
    "resize": ["--size", "50%"],
    "scale": ["--factor", "0.5"],
    "rotate": ["--degrees", "90"],
    "undistort": ["--lens", "20,20,8,6,0.1,0,0,0"],
    "project": ["--from", "perspective:fov=90", "--to", "fisheye:fov=90", "--size", "9"],
    "rectify": ["--corners", "1,1 9,1 9,9 1,9"],
}


@pytest.mark.parametrize("command", EVERY)
@pytest.mark.parametrize("last", [["out"], ["-o", "out"], ["-o", "out/small-*.webp"]])
def test_every_command_takes_files_as_shells_list_them(command, last):
    pictures("in/a.png", "in/b.jpg")
    words = EVERY[command]
    assert ended(command, "in/a.png", "in/b.jpg", *last, *words) == 0
    found = names("out")
    assert found == (
        ["a.png", "b.jpg"] if "*" not in last[-1] else ["small-a.webp", "small-b.webp"]
    )


def test_a_pattern_names_one_picture_as_well():
    pictures("a.png")
    assert ended("warp", "a.png", "-o", "out/*.jpg", *SAME) == 0
    assert names("out") == ["a.jpg"]


def test_a_single_file_may_go_to_a_folder():
    pictures("a.png")
    Path("out").mkdir()
    assert ended("warp", "a.png", "-o", "out", *SAME) == 0
    assert names("out") == ["a.png"]


def test_a_name_with_brackets_is_no_pattern():
    pictures("a[1].png")
    assert ended("warp", "a[1].png", "-o", "out.png", *SAME) == 0


def test_forms_that_are_not_written_become_others():
    pictures("in/a.bmp")
    animate("in/b.gif", duration=100)
    frames(1)[0].save("in/c.gif")
    film("in/d.avi")
    assert ended("warp", "in", "-o", "out", *SAME) == 0
    assert names("out") == ["a.png", "b.gif", "c.png", "d.mp4"]
    assert len(seen("out/b.gif")) == 3


def test_what_fails_is_said_and_the_others_go_on(capsys):
    pictures("in/a.png", "in/c.png")
    Path("in/b.png").write_text("no picture")
    assert ended("warp", "in", "-o", "out", *SAME) == 2
    failed, error = capsys.readouterr().err.splitlines()
    assert failed.startswith("resample: b.png failed: in/b.png is not a picture")
    assert error == "resample: error: 1 of 3 files could not be warped"
    assert names("out") == ["a.png", "c.png"]


def test_stats_tell_of_every_file():
    pictures("in/a.png", "in/b.png")
    assert ended("warp", "in", "-o", "out", *SAME, "--stats", "s.json") == 0
    told = json.loads(Path("s.json").read_text())
    assert [file["file"] for file in told["files"]] == ["out/a.png", "out/b.png"]


@pytest.mark.some(6)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["in", "-o", "out.png"], "several pictures are written to a folder; give its name"),
        (["in", "-o", "a.png"], "a.png is not a folder"),
        (["in", "-o", "in"], "would be replaced; give another folder"),
        (["in", "other", "-o", "out"], "would both become out/a.png"),
        (["empty", "-o", "out"], "empty: no pictures found"),
        (["in/*.tif", "-o", "out"], "in/*.tif: no pictures found"),
        (["in", "-o", "out", "--coverage", "c.png"], "--coverage works with one picture"),
        (["in", "-o", "none/out"], "none/out"),
        (["in", "-o", "none/out/*.png"], "none/out"),
        (["in", "-o", "a.png/*.png"], "a.png is not a folder"),
        (["in", "-o", "in/*.png"], "would be replaced; give another folder"),
    ],
)
def test_a_bad_batch_is_one_line(words, complaint, capsys):
    pictures("a.png", "in/a.png", "other/a.png")
    Path("empty").mkdir()
    assert complaint in refused(capsys, "warp", *words, *SAME)


def test_a_batch_shows_how_far_it_is(monkeypatch):
    shares = []

    def bar(what):
        from contextlib import nullcontext

        assert what == "warping 2 files"
        return nullcontext(shares.append)

    monkeypatch.setattr("resample_texture.command.jobs.progress_bar", bar)
    pictures("in/a.png", "in/b.png")
    assert ended("warp", "in", "-o", "out", *SAME) == 0
    assert shares == [0.5, 1.0]


def test_the_spec_of_pages_is_openimageios():
    assert OpenImageIO.ImageOutput.create("a.tif").supports("appendsubimage")


def test_an_animation_has_the_times_of_its_own_frames(tmp_path):
    path, times = tmp_path / "a.gif", (100, 300, 50)
    first, *others = (Image.fromarray(np.full((4, 5), 80 * n, np.uint8)) for n in range(3))
    first.save(path, save_all=True, append_images=others, duration=times)
    assert frames_of(path).seconds == pytest.approx([time / 1000 for time in times])
