import numpy as np
import pytest

from resample_comparisons.texture.opencv import InterLinear
from resample_texture.command.rendering import FlightOptions, Flyover, frame, shots, with_alpha

SMALL = (24, 40)
SKY = FlightOptions(InterLinear(), background=(0.0, 0.0, 1.0))


@pytest.fixture
def red() -> np.ndarray:
    return np.full((16, 24, 3), (1, 0, 0), np.float32)


@pytest.mark.parametrize("path", ["fly", "turn"])
def test_the_picture_is_seen_before_the_background(path, red):
    for n in range(4):
        seen = frame(with_alpha(red), Flyover(path, 4, SMALL), SKY, n)
        assert (seen == (255, 0, 0)).all(axis=2).mean() > 0.05
        assert (seen == (0, 0, 255)).all(axis=2).mean() > 0.05


@pytest.mark.parametrize("path", ["fly", "turn"])
def test_the_path_is_closed(path):
    flight = Flyover(path, 6, SMALL)
    first, last = flight.camera(0).view(), flight.camera(6).view()
    assert np.allclose(first.rotation, last.rotation)
    assert np.allclose(first.translation, last.translation)


def test_every_frame_of_a_turn_sees_the_whole_picture():
    flight = Flyover("turn", 12, SMALL)
    corners = np.array([[x, y, 0] for x in (-0.5, 0.5) for y in (-0.34, 0.34)])  # 3 to 2
    for n in range(12):
        view = flight.camera(n).view()
        x, y, z = (corners @ view.rotation.T + view.translation).T
        screen = view.focal * np.stack([x / z, y / z], axis=1) + view.principal
        assert (screen > 0).all()
        assert (screen < SMALL[::-1]).all()


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


@pytest.mark.parametrize("count", [0, 10_001])
def test_a_number_of_frames_is_checked(count):
    with pytest.raises(ValueError, match=f"{count} frames; 1 to 10000 are allowed"):
        Flyover(frames=count)


def test_the_shots_are_the_flights_frames(red):
    flight, source = Flyover(frames=3, size=SMALL), with_alpha(red)
    made = shots(source, flight, SKY)
    assert made.total == 3
    assert np.array_equal(made.frame(1), frame(source, flight, SKY, 1))


def test_whatever_changes_the_frames_changes_the_job(red):
    flight, source = Flyover(frames=3, size=SMALL), with_alpha(red)
    job = shots(source, flight, SKY).job
    others = [
        shots(source * 0.5, flight, SKY),
        shots(source, Flyover("turn", 3, SMALL), SKY),
        shots(source, flight, FlightOptions(InterLinear())),
    ]
    assert job == shots(source.copy(), flight, SKY).job
    assert all(job != other.job for other in others)


def test_a_turn_looks_at_the_middle_from_one_height():
    """35 degrees above the picture, at 1.3 of its longer side."""
    flight = Flyover("turn", 8, SMALL)
    for n in range(8):
        pose = flight.camera(n).view()
        eye, angle = -pose.rotation.T @ pose.translation, 2 * np.pi * n / 8
        flat = 1.3 * np.cos(np.radians(35.0)) * np.array([np.sin(angle), -np.cos(angle)])
        np.testing.assert_allclose(eye, [*flat, 1.3 * np.sin(np.radians(35.0))], atol=1e-12)
        np.testing.assert_allclose(pose.rotation[2], -eye / 1.3, atol=1e-12)


def test_a_flight_goes_over_the_picture_s_front_and_back():
    eyes = []
    for n in range(4):
        pose = Flyover("fly", 4, SMALL).camera(n).view()
        eyes.append(-pose.rotation.T @ pose.translation)
        assert pose.rotation[2, 1] > 0 > pose.rotation[2, 2]  # ahead, and down
    wanted = [(0, -0.55, 0.16), (0.12, -0.35, 0.16), (0, -0.15, 0.16), (-0.12, -0.35, 0.16)]
    np.testing.assert_allclose(eyes, wanted, atol=1e-12)
