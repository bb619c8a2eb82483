import numpy as np
import pytest
from PIL import Image

from resample_texture.animation import Flight, Paint, check_target, frames, with_alpha, write
from resample_texture.rivals import Bilinear

SMALL = (24, 40)
SKY = Paint(Bilinear(), background=(0.0, 0.0, 1.0))


@pytest.fixture
def red() -> np.ndarray:
    return np.full((16, 24, 3), (1, 0, 0), np.float32)


@pytest.mark.parametrize("path", ["fly", "turn"])
def test_the_picture_is_seen_before_the_background(path, red):
    for frame in frames(red, Flight(path, 4, SMALL), SKY):
        assert (frame == (255, 0, 0)).all(axis=2).mean() > 0.05
        assert (frame == (0, 0, 255)).all(axis=2).mean() > 0.05


@pytest.mark.parametrize("path", ["fly", "turn"])
def test_the_path_is_closed(path):
    flight = Flight(path, 6, SMALL)
    first, last = flight.camera(0).view(), flight.camera(6).view()
    assert np.allclose(first.rotation, last.rotation)
    assert np.allclose(first.translation, last.translation)


def test_every_frame_of_a_turn_sees_the_whole_picture():
    flight = Flight("turn", 12, SMALL)
    corners = np.array([[x, y, 0] for x in (-0.5, 0.5) for y in (-0.34, 0.34)])  # 3 to 2
    for n in range(12):
        view = flight.camera(n).view()
        x, y, z = (corners @ view.rotation.T + view.translation).T
        screen = view.focal * np.stack([x / z, y / z], axis=1) + view.principal
        assert (screen > 0).all()
        assert (screen < SMALL[::-1]).all()


def test_progress_is_told_for_every_frame(red):
    shares: list[float] = []
    list(frames(red, Flight(frames=4, size=SMALL), SKY, shares.append))
    assert shares == [0.25, 0.5, 0.75, 1]


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_gray_and_rgb_with_and_without_alpha_are_shown(channels, rng):
    picture = rng.random((4, 5, channels)).astype(np.float32)
    shown = with_alpha(picture)
    assert shown.shape == (4, 5, 4)
    assert np.array_equal(shown[..., 0], picture[..., 0])
    expected = picture[..., -1] if channels in (2, 4) else 1
    assert np.array_equal(shown[..., 3], np.broadcast_to(expected, (4, 5)))


def test_other_channels_are_refused():
    with pytest.raises(ValueError, match="a picture of 5 channels"):
        with_alpha(np.zeros((4, 5, 5), np.float32))


@pytest.mark.parametrize("suffix", ["gif", "apng"])
def test_an_animation_has_all_frames_and_their_rate(suffix, tmp_path, red):
    path = tmp_path / f"a.{suffix}"
    write(path, frames(red, Flight(frames=5, size=SMALL), SKY), 20)
    with Image.open(path) as animation:
        assert (animation.n_frames, animation.size) == (5, (40, 24))
        assert animation.info["duration"] == 50
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_a_folder_gets_numbered_frames_and_keeps_its_other_files(tmp_path, red):
    (tmp_path / "notes.txt").write_text("keep me")
    write(tmp_path, frames(red, Flight(frames=2, size=SMALL), SKY), 24)
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        *("frame-0000.png", "frame-0001.png", "notes.txt")
    ]


@pytest.mark.parametrize("name", ["a.gif", "frames"])
def test_what_fails_half_way_leaves_nothing(name, tmp_path, red):
    def broken():
        yield next(iter(frames(red, Flight(frames=2, size=SMALL), SKY)))
        raise MemoryError

    with pytest.raises(MemoryError):
        write(tmp_path / name, broken(), 24)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("count", [0, 10_001])
def test_a_number_of_frames_is_checked(count):
    with pytest.raises(ValueError, match=f"{count} frames; 1 to 10000 are allowed"):
        Flight(frames=count)


@pytest.mark.parametrize("fps", [0, -1, float("nan")])
def test_a_rate_is_checked(fps, tmp_path):
    with pytest.raises(ValueError, match="frames per second"):
        write(tmp_path / "a.gif", iter([]), fps)


def test_films_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"written as \.gif, \.apng or a folder"):
        check_target(tmp_path / "a.mp4")
