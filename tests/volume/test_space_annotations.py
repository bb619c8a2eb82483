"""Axes, boxes, cubes and scale bars in pictures of volumes."""

import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.viewpoints import Orbit
from resample.files.images import read_image
from resample.types import Frame, Statistics
from resample_volume import Annotations, annotate, annotations, open_volume
from resample_volume.annotations import (
    AXES,
    PATIENT,
    Stroke,
    cube_picture,
    round_length,
    with_lines,
)
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.cli import app
from resample_volume.files.source import write_volume
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from resample_volume.voxels.framing import corners

SIZE = (60, 80)
WHITE = (1.0, 1.0, 1.0)


def medium(alpha=0.0, near=10.0, deep=12.0, color=(0.0, 0.5, 0.0)):
    """Even picture of something between two depths."""
    rgba = np.zeros((*SIZE, 4), np.float32)
    rgba[..., :3], rgba[..., 3] = alpha * np.array(color), alpha
    depth = np.full(SIZE, deep if alpha else np.inf, np.float32)
    first = np.full(SIZE, near if alpha else np.inf, np.float32)
    return Frame(
        rgba,
        depth,
        first,
        np.full(SIZE, float(alpha > 0), np.float32),
        Statistics(0, 0, 0, 0, 1, {}),
    )


def view(parallel=True):
    if parallel:
        return Orthographic(1.0, 1.0, SIZE[1] / 2, SIZE[0] / 2, np.eye(4)).view()
    matrix = np.array([[20.0, 0, SIZE[1] / 2], [0, 20.0, SIZE[0] / 2], [0, 0, 1]])
    return Camera(matrix, np.eye(4)).view()


def across(z, width=3.0, color=WHITE):
    """Line through the middle of the picture at one depth."""
    return Stroke(np.array([[-100.0, 0.0, z], [100.0, 0.0, z]]), color, width)


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.9, 1.0])
def test_a_line_in_front_is_on_top_and_one_behind_is_dimmed_by_all(alpha):
    front = with_lines(medium(alpha), view(), [across(5.0)]).rgba[30, 40]
    behind = with_lines(medium(alpha), view(), [across(20.0)]).rgba[30, 40]
    np.testing.assert_allclose(front, 1, atol=1e-6)
    seen = alpha * np.array([0.0, 0.5, 0.0, 1.0]) + (1 - alpha)
    np.testing.assert_allclose(behind, seen, atol=1e-6)


def test_a_line_that_goes_away_dims_smoothly():
    slanted = Stroke(np.array([[-40.0, 0.0, 5.0], [40.0, 0.0, 20.0]]), WHITE, 3.0)
    red = with_lines(medium(0.9), view(), [slanted]).rgba[30, 2:-2, 0]
    assert (np.diff(red) <= 1e-6).all()
    assert np.abs(np.diff(red)).max() < 0.12
    assert red[0] > 0.99
    assert abs(red[-1] - 0.1) < 0.01


def test_a_medium_is_put_together_again_between_lines():
    clear = [Stroke(across(z).ends, WHITE, 1e-7) for z in (10.5, 11.0, 12.5)]
    before = medium(0.7)
    np.testing.assert_allclose(with_lines(before, view(), clear).rgba, before.rgba, atol=1e-6)


def test_several_lines_are_composited_by_depth_whatever_their_order():
    red, blue = across(11.0, color=(1.0, 0.0, 0.0)), across(13.0, color=(0.0, 0.0, 1.0))
    one, two = (with_lines(medium(0.5), view(), lines) for lines in ([red, blue], [blue, red]))
    np.testing.assert_array_equal(one.rgba, two.rgba)
    assert one.rgba[30, 40, 2] < 1e-6
    assert one.rgba[30, 40, 0] > 0.5


@pytest.mark.parametrize("parallel", [True, False])
def test_lines_have_their_width_and_fade_over_a_pixel(parallel):
    z, width = 7.0, 4.0
    frame = with_lines(medium(), view(parallel), [across(z, width)])
    column = frame.rgba[:, 40, 3]
    np.testing.assert_allclose(column.sum(), width, atol=0.05)
    np.testing.assert_allclose(frame.depth[30, 40], z, rtol=1e-5)
    np.testing.assert_allclose(frame.first_depth[30, 40], z, rtol=1e-5)
    assert frame.coverage[30, 40] == 1
    assert np.isinf(frame.depth[5, 5])


def test_depth_along_a_line_is_right_in_perspective():
    slanted = Stroke(np.array([[-5.0, 0.0, 5.0], [20.0, 0.0, 30.0]]), WHITE, 2.0)
    frame = with_lines(medium(), view(parallel=False), [slanted])
    for column in range(25, 50):
        share = (column + 0.5 - 40) / 20  # x / z
        z = 10 / (1 - share)  # x = z - 10
        np.testing.assert_allclose(frame.depth[30, column], z, rtol=1e-4)


def test_what_is_behind_the_camera_is_cut():
    through = Stroke(np.array([[1.0, 1.0, -50.0], [1.0, 1.0, 50.0]]), WHITE, 2.0)
    frame = with_lines(medium(), view(parallel=False), [through])
    assert np.isfinite(frame.rgba).all()
    assert frame.rgba[31:33, 41:43, 3].max() > 0.5  # toward infinity: the middle
    gone = Stroke(through.ends - [0, 0, 60.0], WHITE, 2.0)
    assert with_lines(medium(), view(parallel=False), [gone]).rgba.max() == 0


def test_round_lengths():
    assert [round_length(most) for most in (1.0, 1.9, 4.99, 7.0, 23.0, 0.034, 999.0)] == [
        1, 1, 2, 5, 20, 0.02, 500,
    ]  # fmt: skip


def test_the_cube_shows_the_faces_that_look_at_the_camera():
    ahead = np.diag([1.0, -1.0, -1.0])  # from +z, y up
    top = cube_picture(ahead, 40, AXES)
    assert top.shape == (40, 40, 4)
    filled = top[..., 3] > 0.5
    assert 0.2 < filled.mean() < 0.5  # one face of side 1 / 1.75
    assert not np.array_equal(top, cube_picture(ahead, 40, PATIENT))
    other = cube_picture(np.diag([-1.0, -1.0, 1.0]), 40, AXES)
    assert not np.array_equal(top, other)


def test_corners_are_half_a_voxel_beyond_voxels():
    volume = as_volume(np.zeros((4, 5, 6), np.uint8))._replace(origin=np.array([1.0, 2.0, 3.0]))
    found = corners(volume)
    np.testing.assert_allclose(
        [found.min(axis=0), found.max(axis=0)], [[0.5, 1.5, 2.5], [6.5, 6.5, 6.5]]
    )


def blob():
    axis = np.linspace(-1, 1, 24)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return as_volume((255 * np.exp(-4 * (x**2 + y**2 + z**2))).astype(np.uint8))


@pytest.mark.some(1)
@pytest.mark.parametrize("fov", [30.0, 0.0])
def test_an_orbit_and_its_camera_draw_the_same(fov):
    volume, orbit = blob()._replace(origin=np.array([100.0, -30.0, 5.0])), Orbit(30, 20, 0.6, fov)
    frame = render(volume, "gray", orbit, size=(90, 80))
    one = annotate(frame, orbit, volume, appearance="gray")
    subject = Subject.of(volume, Appearance("gray"))
    there = subject.camera(orbit, 80, 90)

    class Moved:
        """The orbit's camera in the volume's own scene."""

        def view(self):
            own = there.view()
            return own._replace(translation=own.translation - own.rotation @ subject.middle)

    two = annotate(frame, Moved(), volume)
    np.testing.assert_allclose(one.rgba, two.rgba, atol=1e-4)
    assert np.abs(one.rgba - frame.rgba).max() > 0.3
    assert np.isfinite(one.rgba).all()


@pytest.mark.some(1)
@pytest.mark.parametrize("name", ["axes", "box", "cube", "scale_bar"])
def test_each_is_drawn_by_itself_and_keeps_what_it_was_given(name):
    volume = blob()
    frame = render(volume, "gray", Orbit(30, 20, 0.6), size=(90, 80))
    kept = frame.rgba.copy()
    none = {"axes": False, "box": False, "cube": False, "scale_bar": False}
    drawn = annotate(
        frame, Orbit(30, 20, 0.6), volume, Annotations(**(none | {name: True})), appearance="gray"
    )
    np.testing.assert_array_equal(frame.rgba, kept)
    changed = np.abs(drawn.rgba - kept).max(axis=2) > 0.02
    assert 20 < changed.sum() < 0.5 * changed.size
    if name == "cube":
        assert not changed[:50].any()
    if name == "scale_bar":
        assert not changed[:, :45].any()


def test_the_box_is_behind_what_is_opaque():
    volume = as_volume(np.full((20, 20, 20), 200, np.uint8))
    orbit = Orbit(30, 20, 0.6, 0)
    frame = render(volume, "gray", orbit, size=(100, 100))
    box = Annotations(axes=False, cube=False, scale_bar=False)
    drawn = annotate(frame, orbit, volume, box, appearance="gray")
    changed = np.abs(drawn.rgba - frame.rgba).max(axis=2) > 0.02
    assert frame.rgba[..., 3].max() > 0.9
    inside = frame.rgba[..., 3] > 0.999
    assert inside.sum() > 300
    assert changed.any()


@pytest.mark.sweep
def test_the_command_draws_on_any_background_and_in_films(tmp_path):
    words = ["checker-box:size=16,block=4", "--size", "64", "--camera", "30/20/0.6"]
    drawn = ["--axes", "--box", "--cube", "--scale-bar"]
    pictures = {}
    for name, more in {
        "plain": [],
        "dark": drawn,
        "bright": [*drawn, "--background", "white"],
    }.items():
        path = tmp_path / f"{name}.png"
        app(["render", *words, "-o", str(path), *more], result_action="return_value")
        pictures[name] = read_image(path)
    assert np.abs(pictures["dark"] - pictures["plain"]).max() > 0.5
    bar = (slice(52, 64), slice(32, 64))
    assert pictures["bright"][bar].min() < 0.1
    assert pictures["dark"][bar].max() > 0.7
    film = tmp_path / "film"
    app(["animate", *words, "-o", str(film), "--frames", "2", *drawn], result_action="return_value")
    first = read_image(sorted(film.glob("*.png"))[0])
    np.testing.assert_allclose(first[..., :3], pictures["dark"][..., :3], atol=0.01)


def test_a_patients_directions_are_known_from_the_file(tmp_path):
    write_volume(tmp_path / "head.nii.gz", blob())
    write_volume(tmp_path / "head.nrrd", blob())
    assert open_volume(tmp_path / "head.nii.gz").space == "lps"
    assert open_volume(tmp_path / "head.nrrd").space == ""


@pytest.mark.parametrize("width", [1.0, 3.5])
def test_pixels_near_a_line_are_all_that_it_may_touch(rng, width):
    """Each once, and those of the picture alone."""
    size = height, width_px = 12, 17
    row, column = np.mgrid[:height, :width_px]
    center = np.stack([column, row], axis=-1) + 0.5
    ends = rng.uniform(-6.0, 20.0, (60, 2, 2))
    ends[0] = [[-3.0, 0.2], [30.0, 0.2]]  # along the edges
    ends[1] = [[0.2, -3.0], [0.2, 30.0]]
    ends[2] = ends[2, 0]  # of no length
    for spot in ends:
        rows, columns = annotations._near(spot, width, size)
        found = np.zeros(size, int)
        np.add.at(found, (rows, columns), 1)
        assert found.max(initial=0) <= 1
        way = spot[1] - spot[0]
        along = ((center - spot[0]) @ way / max(way @ way, 1e-12)).clip(0, 1)[..., None]
        away = np.linalg.norm(center - spot[0] - along * way, axis=-1)
        assert found[away < width / 2 + 0.5].all()
        assert not found[away > 3 * (width / 2 + 2)].any()


@pytest.mark.parametrize("near", [0.5, 1.0, 2.0, 4.0, 5.0])
def test_lines_are_cut_at_the_near_plane(near):
    for ends in (np.array([[0, 0, 1.0], [3, 6, 4.0]]), np.array([[3, 6, 4.0], [0, 0, 1.0]])):
        found = annotations._cut(ends, near)
        if near >= 4.0:
            assert found.shape == (0, 3)
            continue
        depth = np.maximum(ends[:, 2], near)
        wanted = np.column_stack([depth - 1, 2 * (depth - 1), depth])
        np.testing.assert_allclose(found, wanted)
