"""Clouds on the command line: colors by columns, bars, films, and what is refused."""

import json
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from resample.files.images import read_image
from resample.memory import mapped
from resample_points import Cloud, cli
from resample_points.data.columns import colored
from resample_points.geometry import spacing
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
SMALL = ["--size", "80x64", "--camera", "0/0/1"]
TAB10 = [  # of matplotlib
    (31, 119, 180), (255, 127, 14), (44, 160, 44), (214, 39, 40), (148, 103, 189),
    (140, 86, 75), (227, 119, 194), (127, 127, 127), (188, 189, 34), (23, 190, 207),
]  # fmt: skip
FILM = ["animate", "scan.csv", "--size", "32x24", "--frames", "4"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command, with scan.csv: a square at y 0 of two classes."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv(mapped.FOLDER_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(spacing, "LEAST_POINTS", 1)
    x, z = np.mgrid[:30, :30] / 10.0
    table = np.column_stack([x.ravel(), np.zeros(900), z.ravel(), x.ravel() > 1.45])
    np.savetxt("scan.csv", table, delimiter=",", header="x,y,z,class", comments="")
    return tmp_path


def shown(*words: object) -> np.ndarray:
    """Picture (H, W, 3) of sRGB levels that `render` makes."""
    assert ended("render", "scan.csv", *SMALL, "--background", "white", *words, "-o", "o.png") == 0
    return cv2.imread("o.png")[..., ::-1]


@pytest.mark.sweep
def test_colors_are_those_of_a_column():
    picture = shown("--color-by", "class", "--colormap", "tab10", "--range", "0,9")
    sides = {tuple(picture[32, 30].tolist()), tuple(picture[32, 50].tolist())}
    assert sides == {(31, 119, 180), (255, 127, 14)}  # tab10's first and second


@pytest.mark.sweep
def test_a_bar_widens_the_picture():
    plain, barred = shown("--color-by", "x"), shown("--color-by", "x", "--color-bar")
    assert len(barred) == len(plain)
    assert barred.shape[1] > plain.shape[1] + 20
    np.testing.assert_array_equal(barred[:, :80], plain)


@pytest.mark.sweep
def test_a_range_may_begin_below_zero():
    words = ["--color-by", "z", "--colormap", "gray"]
    assert shown(*words, "--range", "-3,3")[32, 40, 0] > shown(*words)[32, 40, 0] + 20


@pytest.mark.sweep
def test_a_cloud_is_measured_once_for_all_pictures(folder):
    one = shown()
    assert len(list((folder / "cache" / "clouds").iterdir())) == 1
    np.testing.assert_array_equal(shown("--color-by", "z", "--range", "9,10")[32, 40] > -1, True)
    assert len(list((folder / "cache" / "clouds").iterdir())) == 1
    np.testing.assert_array_equal(shown(), one)


@pytest.mark.sweep
def test_nothing_is_kept_where_that_is_asked_for(folder):
    shown("--no-cache")
    assert not (folder / "cache").exists()


@pytest.mark.sweep
def test_threads_and_limits_of_discs_are_taken():
    plain = shown()
    np.testing.assert_array_equal(shown("--threads", "1"), plain)
    np.testing.assert_array_equal(shown("--disc-limit", "inf"), plain)
    assert (shown("--disc-limit", "0.5") != plain).any()


@pytest.mark.sweep
def test_the_field_of_view_of_a_camera_file_is_heeded():
    Path("wide.toml").write_text("azimuth = 0\nelevation = 0\nfov = 100\n")
    Path("long.toml").write_text("azimuth = 0\nelevation = 0\nfov = 5\n")
    depths = []
    for name in ("wide.toml", "long.toml"):
        assert ended("render", "scan.csv", "--camera", name, "--size", "40", "-o", "o.exr") == 0
        depths.append(read_image("o.exr")[20, 20])
        assert read_image("o.exr")[..., 3].mean() > 0.7


@pytest.mark.sweep
def test_a_film_goes_around_a_cloud():
    assert ended(*FILM, "-o", "frames") == 0
    frames = [cv2.imread(f"frames/frame-000{n}.png") for n in range(4)]
    covered = [(frame.max(axis=2) > 60).mean() for frame in frames]
    assert covered[0] > 0.3
    assert covered[1] < 0.7 * covered[0]  # the square from aside
    assert covered[2] == pytest.approx(covered[0], abs=0.02)


@pytest.mark.some(1)
@pytest.mark.parametrize("name", ["a.gif", "a.mp4"])
def test_films_are_written_with_their_bar(name):
    words = ["--size", "80x64", "--color-by", "z", "--color-bar", "--path", "sway"]
    assert ended("animate", "scan.csv", "--frames", "3", *words, "-o", name) == 0
    assert Path(name).stat().st_size > 500
    if name.endswith("gif"):
        with Image.open(name) as film:
            assert film.n_frames == 3
            assert film.width > 100


@pytest.mark.sweep
def test_a_film_follows_keyframes():
    keys = (
        "[[camera]]\ntime = 0\nazimuth = 0\nzoom = 1\n[[camera]]\ntime = 1\nazimuth = 0\nzoom = 2\n"
    )
    Path("keys.toml").write_text(keys)
    assert ended(*FILM, "--path", "keys.toml", "-o", "frames") == 0
    covered = [(cv2.imread(f"frames/frame-000{n}.png").max(axis=2) > 60).mean() for n in range(4)]
    assert covered == sorted(covered)
    assert covered[-1] > 1.5 * covered[0]


def test_a_film_follows_poses():
    pose = "1 0 0 -1.5\n0 0 -1 1.5\n0 1 0 4\n0 0 0 1\n"
    Path("poses.txt").write_text(pose + pose.replace("4\n", "8\n", 1))
    assert ended(*FILM, "--path", "poses.txt", "-o", "frames") == 0
    first, last = (cv2.imread(f"frames/frame-000{n}.png").max(axis=2) > 60 for n in (0, 3))
    assert first.mean() > 2 * last.mean() > 0


@pytest.mark.sweep
def test_a_film_is_gone_on_with(capsys):
    assert ended(*FILM, "-o", "frames") == 0
    whole = Path("frames/frame-0002.png").read_bytes()
    Path("frames/frame-0002.png").unlink()
    assert ended(*FILM, "-o", "frames", "--resume", "--threads", "1") == 0
    assert Path("frames/frame-0002.png").read_bytes() == whole
    assert json.loads(Path("frames/animation.json").read_text())["frames"] == 4
    for words in (["--color-by", "z"], ["--camera", "1/2/3"], ["--background", "red"]):
        error = refused(capsys, *FILM, "-o", "frames", "--resume", *words)
        assert "frames of another animation" in error


@pytest.mark.some(6)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--color-by", "time"], "no column 'time'; known: x, y, z, class"),
        (["--color-by", "z", "--colormap", "virids"], "unknown colormap 'virids'"),
        (["--color-by", "z", "--range", "1"], "a range of '1'; give low,high"),
        (["--range", "1,2"], "--color-bar and --range belong to --color-by"),
        (["--color-bar"], "--color-bar and --range belong to --color-by"),
        (["--color-by", "z", "--color-bar", "--size", "60"], "at least 64 px high, not 60"),
        (["--disc-limit", "0"], "discs of at most 0 times"),
        (["--filter", "grauss"], "grauss"),
        (["--panorama", "cube"], "cube"),
        (["--panorama", "fisheye", "--intrinsics", "1,1,1,1"], "leave them out of --panorama"),
        (["--edl", "-1"], "eye-dome lighting of strength -1"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_line(words, complaint, capsys):
    assert complaint in refused(capsys, "render", "scan.csv", "-o", "o.png", *words)


def test_a_bar_is_for_pictures_of_the_screen(capsys):
    words = ["--color-by", "z", "--color-bar"]
    assert "no depth" in refused(capsys, "render", "scan.csv", *words, "-o", "o.exr")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--path", "walk"], "unknown path 'walk'; known: orbit, sway, still, or a file"),
        (["--path", "walk.toml"], "walk.toml"),
        (["--camera", "eye.toml"], "the path orbit goes around the cloud; give --camera as"),
    ],
)
def test_films_are_refused_in_one_line(words, complaint, capsys):
    Path("eye.toml").write_text("eye = [0, 9, 0]\ntarget = [0, 0, 0]\nup = [0, 0, 1]\n")
    assert complaint in refused(capsys, *FILM, "-o", "a.gif", *words)


@pytest.mark.sweep
def test_films_of_no_kind_and_of_no_frames_are_refused(capsys):
    assert "written as .mp4" in refused(capsys, *FILM, "-o", "a.avi")
    assert "0 frames; 1 to 10000" in refused(capsys, *FILM[:-1], "0", "-o", "a.gif")


@pytest.mark.sweep
def test_float32_positions_far_from_the_origin_are_said_to_be_rounded(capsys):
    corner = np.array([500_000, 5_000_000, 200])
    place = corner + np.random.default_rng(2).uniform(0, 100, (300, 3))
    for name, kind, said in (
        ("single", "f4", "its float32 positions are rounded to 0.5 there"),
        ("double", "f8", "positions are exact"),
    ):
        word = {"f4": "float", "f8": "double"}[kind]
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(place)}\n"
        head += "".join(f"property {word} {axis}\n" for axis in "xyz") + "end_header\n"
        Path(f"{name}.ply").write_bytes(head.encode() + place.astype("<" + kind).tobytes())
        assert ended("render", f"{name}.ply", *SMALL, "-o", "o.png") == 0
        assert said in capsys.readouterr().err


def test_a_bar_of_classes_shows_a_field_for_each():
    words = ["--color-by", "class", "--colormap", "tab10", "--range", "0,9"]
    plain, barred = shown(*words), shown(*words, "--color-bar")
    bar = barred[:, plain.shape[1] :].reshape(-1, 3)
    counts = {tuple(color): int((bar == color).all(axis=1).sum()) for color in TAB10}
    first, second = counts[TAB10[0]], counts[TAB10[1]]
    assert min(first, second) > 150
    assert abs(first - second) < 20  # halves of the bar, within a row of px
    assert sum(counts.values()) == first + second


def test_classes_of_laser_scans_have_their_names():
    number = np.array([2, 6, 2, 5], np.uint8)
    cloud = Cloud(np.eye(4, 3), np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    named, scale = colored(cloud._replace(columns={"classification": number}), "classification")
    assert scale.class_names() == ["2 ground", "5 high vegetation", "6 building"]
    np.testing.assert_array_equal(scale.class_colors()[1], named.color[3])
    _, other = colored(cloud._replace(columns={"row": number}), "row")
    assert other.class_names() == ["2", "5", "6"]
    _, halves = colored(cloud._replace(columns={"row": number / 4}), "row")
    assert halves.classes == ()


@pytest.mark.sweep
def test_parallel_views_show_both_ends_at_one_scale():
    near = shown("--fov", "0")
    rows = np.flatnonzero((near != 255).any(axis=(1, 2)))
    assert abs(len(rows) - 0.95 * 64) <= 2  # a square of 3 units fills the picture's height
    Path("flat.toml").write_text("azimuth = 0\nelevation = 0\nfov = 0\n")
    assert ended("render", "scan.csv", "--camera", "flat.toml", *SMALL[:2], "-o", "o.png") == 0
    film = ["animate", "scan.csv", "--fov", "0", "--frames", "2", *SMALL[:2], "-o", "o.gif"]
    assert ended(*film) == 0


def test_a_panorama_is_made_at_a_pose_or_where_the_camera_is():
    np.savetxt(
        "pose.txt", np.linalg.inv([[1, 0, 0, 1.5], [0, 0, 1, -1], [0, -1, 0, 1.5], [0, 0, 0, 1]])
    )
    words = ["--size", "64x32", "--background", "white"]
    for name in ("equirectangular", "fisheye:fov=220"):
        aim = ["--panorama", name, "--pose", "pose.txt"]
        assert ended("render", "scan.csv", *aim, *words, "-o", "o.png") == 0
        picture = cv2.imread("o.png")
        assert (picture[16, 32] != 255).all()  # the square is ahead
        assert (picture[2, 2] == 255).all()
    assert ended("render", "scan.csv", "--panorama", "fisheye", *words, "-o", "o.png") == 0
    assert (cv2.imread("o.png")[16, 32] != 255).all()


def test_several_files_are_a_film_of_one_frame_each(capsys):
    table = np.loadtxt("scan.csv", delimiter=",", skiprows=1)
    for n in range(3):
        moved = table + np.array(
            [0.4 * n, 0, 0, 7 * n]
        )  # classes 0 and 1 in the first, 14 and 15 at last
        np.savetxt(f"{n}.csv", moved, delimiter=",", header="x,y,z,class", comments="")
    look = ["--size", "80x64", "--camera", "0,0", "--color-by", "class"]
    assert ended("animate", "0.csv", "1.csv", "2.csv", *look, "-o", "sweep") == 0
    frames = [cv2.imread(f"sweep/frame-{n:04d}.png").astype(int) for n in range(3)]
    assert not Path("sweep/frame-0003.png").exists()
    middles = [np.argwhere(frame.any(axis=2)).mean(axis=0) for frame in frames]
    across = np.diff([middle[1] for middle in middles])
    assert (across > 4).all()  # px to the right: the camera is that of the first file
    assert len(np.unique(frames[0][frames[0].any(axis=2)], axis=0)) > 2  # at edges
    assert len({tuple(color) for color in frames[2][28:36, 60:68].reshape(-1, 3)}) == 1
    assert ended("render", "0.csv", *look, "--background", "black", "-o", "one.png") == 0
    np.testing.assert_array_equal(cv2.imread("one.png"), frames[0])
    capsys.readouterr()
    assert "a frame each" in refused(
        capsys, "animate", "0.csv", "1.csv", "--frames", "5", "-o", "a.gif"
    )
