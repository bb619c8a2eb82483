"""Films through keyframes: how many frames they have."""

import pytest

from resample.command.films import tour_of

CAMERAS = "[[camera]]\ntime = 0\nazimuth = 30\n[[camera]]\ntime = {end}\nazimuth = 90\n"


@pytest.mark.parametrize(
    ("end", "fps", "frames"), [(1.0, 10, 11), (0.96, 10, 11), (0.94, 10, 10), (2.0, 2.4, 6)]
)
def test_frames_fill_the_time_between_keyframes_to_the_nearest(tmp_path, end, fps, frames):
    """One more than there are steps of time."""
    (tmp_path / "a.toml").write_text(CAMERAS.format(end=end))
    assert tour_of(tmp_path / "a.toml", None, fps, 60.0).frames == frames


def test_a_number_of_frames_is_kept_whatever_the_times(tmp_path):
    (tmp_path / "a.toml").write_text(CAMERAS.format(end=1.0))
    assert tour_of(tmp_path / "a.toml", 7, 10, 60.0).frames == 7


@pytest.mark.parametrize(("frames", "end"), [(0, 1.0), (None, 1e9)])
def test_too_few_and_too_many_frames_are_refused_by_the_name_of_the_file(tmp_path, frames, end):
    (tmp_path / "a.toml").write_text(CAMERAS.format(end=end))
    with pytest.raises(ValueError, match=r"a\.toml: "):
        tour_of(tmp_path / "a.toml", frames, 25, 60.0)
