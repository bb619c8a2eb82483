"""Gaussians are checked, colored, moved, joined and cropped."""

import logging

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from resample_points import gaussian_camera, render_gaussians
from resample_points.data.gaussians import (
    Gaussians,
    checked_gaussians,
    colors_along,
    cropped_gaussians,
    joined_gaussians,
    placed_gaussians,
)
from resample_points.data.harmonics import harmonics_along, turned_harmonics

COUNT = 40
TURN = Rotation.from_euler("xyz", [0.3, -1.1, 2.0])
POSE = np.concatenate([2.5 * TURN.as_matrix(), [[1], [-2], [3]]], 1)


def gaussians(width=15, seed=3, **changes):
    """Random Gaussians whose colors are above 0 along all directions."""
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(COUNT, 4))
    made = Gaussians(
        position=rng.uniform(-2, 2, (COUNT, 3)).astype(np.float32),
        scale=rng.uniform(0.01, 0.5, (COUNT, 3)).astype(np.float32),
        rotation=(rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).astype(np.float32),
        opacity=rng.uniform(0, 1, COUNT).astype(np.float32),
        color=rng.uniform(2, 4, (COUNT, 3)).astype(np.float32),
        harmonics=rng.integers(-32767, 32768, (COUNT, width, 3)).astype(np.int16),
        harmonic_step=0.05 / 32767,
    )
    return made._replace(**changes)


def directions(count, seed=1):
    made = np.random.default_rng(seed).normal(size=(count, 3))
    return made / np.linalg.norm(made, axis=1, keepdims=True)


def covariances(made):
    axes = Rotation.from_quat(np.roll(made.rotation.astype(float), -1, axis=1)).as_matrix()
    return np.einsum("nij,nj,nkj->nik", axes, made.scale.astype(float) ** 2, axes)


# Harmonics


def test_harmonics_are_those_of_scipy_in_real_form():
    along = directions(50)
    polar, azimuth = np.arccos(along[:, 2]), np.arctan2(along[:, 1], along[:, 0])
    expected = []
    for degree in (1, 2, 3):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            part = value.imag if order < 0 else value.real
            expected.append(part * (np.sqrt(2) if order else 1))
    assert np.allclose(harmonics_along(along, 15), np.stack(expected, 1), atol=1e-14)


@pytest.mark.parametrize("count", [3, 8, 15])
def test_turning_harmonics_is_a_rotation_with_a_block_per_degree(count):
    matrix = turned_harmonics(TURN.as_matrix(), count)
    assert np.allclose(matrix @ matrix.T, np.eye(count), atol=1e-13)
    degree = np.repeat([1, 2, 3], [3, 5, 7])[:count]
    assert np.allclose(matrix[degree[:, None] != degree], 0, atol=1e-13)


def test_two_turns_of_harmonics_are_the_turn_of_both():
    other = Rotation.from_euler("zyx", [1.0, 0.2, -0.4])
    first, second = (turned_harmonics(one.as_matrix(), 15) for one in (TURN, other))
    both = turned_harmonics((other * TURN).as_matrix(), 15)
    assert np.allclose(second @ first, both, atol=1e-13)


# Colors


def test_colors_are_half_the_constant_and_the_harmonics_and_not_below_0():
    made = gaussians(width=3, color=np.zeros((COUNT, 3), np.float32))
    one = np.zeros((COUNT, 3, 3), np.int16)
    one[:, 1] = 32767
    made = made._replace(harmonics=one, harmonic_step=2.0 / 32767)
    up, down = (colors_along(made, (0, 0, z)) for z in (1, -1))
    assert np.allclose(up, 0.5 + 2 * np.sqrt(3 / (4 * np.pi)), atol=1e-12)
    assert np.array_equal(down, np.zeros((COUNT, 3)))


# Poses


@pytest.mark.parametrize("width", [0, 3, 8, 15])
def test_moved_gaussians_show_the_same_color_from_the_moved_direction(width):
    made = gaussians(width)
    moved = placed_gaussians(made, POSE)
    along = directions(COUNT)
    error = np.abs(colors_along(moved, TURN.apply(along)) - colors_along(made, along))
    assert error.max() < 8 * 0.05 * 2 / 32767  # half a step of 15 coefficients, at most


def test_moved_gaussians_have_moved_centers_and_turned_covariances():
    made = gaussians()
    moved = placed_gaussians(made, np.concatenate([POSE, [[0, 0, 0, 1]]]))
    assert np.allclose(moved.position, made.position @ POSE[:, :3].T + POSE[:, 3], atol=1e-5)
    expected = POSE[:, :3] @ covariances(made) @ POSE[:, :3].T
    assert np.allclose(covariances(moved), expected, atol=1e-5)


def test_a_shift_keeps_the_bits_of_what_it_does_not_move():
    made = gaussians(up="y")
    moved = placed_gaussians(made, np.eye(4))
    assert all(np.array_equal(*pair) for pair in zip(moved, made, strict=True))
    assert placed_gaussians(made, POSE).up is None


@pytest.mark.parametrize(
    "pose",
    [
        np.diag([1, 1, -1, 1]),
        np.diag([1, 2, 1, 1]),
        np.zeros((3, 4)),
        np.eye(3),
        np.full((4, 4), np.nan),
        np.eye(4) * 2,
    ],
)
def test_poses_that_mirror_shear_or_are_none_are_refused(pose):
    with pytest.raises(ValueError, match="a pose"):
        placed_gaussians(gaussians(), pose)


# Joining


def test_joined_scenes_keep_their_colors():
    few, many = gaussians(3, up="y"), gaussians(15, seed=4, harmonic_step=0.001 / 32767, up="y")
    none = gaussians(0, seed=5, up="y")
    joined = joined_gaussians([few, none, many])
    along = directions(COUNT)
    expected = np.concatenate([colors_along(part, along) for part in (few, none, many)])
    found = colors_along(joined, np.tile(along, (3, 1)))
    assert np.abs(found - expected).max() < 8 * 0.05 / 32767
    assert joined.harmonics.shape == (3 * COUNT, 15, 3)
    assert joined.up == "y"


def test_joined_scenes_of_the_same_step_keep_their_bits():
    first, second = gaussians(), gaussians(seed=9)
    joined = joined_gaussians([first, second], [None, None])
    for name in ("position", "harmonics", "rotation", "opacity"):
        both = np.concatenate([getattr(first, name), getattr(second, name)])
        assert np.array_equal(getattr(joined, name), both)


def test_each_joined_scene_has_a_pose_of_its_own():
    joined = joined_gaussians([gaussians(), gaussians()], [POSE, None])
    assert np.array_equal(joined.position[:COUNT], placed_gaussians(gaussians(), POSE).position)
    assert np.array_equal(joined.position[COUNT:], gaussians().position)


def test_joining_antialiased_scenes_with_others_is_said(caplog):
    with caplog.at_level(logging.WARNING, "resample"):
        joined = joined_gaussians([gaussians(is_antialiased=True), gaussians()])
    assert not joined.is_antialiased
    assert "antialiased" in caplog.text
    assert joined_gaussians([gaussians(is_antialiased=True)] * 2).is_antialiased


def test_joining_needs_scenes_and_a_pose_for_each():
    with pytest.raises(ValueError, match="0 scenes and no poses"):
        joined_gaussians([])
    with pytest.raises(ValueError, match="1 scenes and 2 poses"):
        joined_gaussians([gaussians()], [None, None])


# Cropping


def test_cropping_keeps_what_is_within_the_box_opaque_and_small():
    made, box = gaussians(), ((-1, -1, -1), (1, 2, 2))
    found = cropped_gaussians(made, box=box, least_opacity=0.2, largest=0.45)
    kept = [
        n
        for n in range(COUNT)
        if all(
            low <= x <= high for low, x, high in zip(box[0], made.position[n], box[1], strict=True)
        )
        and made.opacity[n] >= 0.2
        and max(made.scale[n]) <= 0.45
    ]
    assert 0 < len(kept) < COUNT
    assert np.array_equal(found.position, made.position[kept])
    assert np.array_equal(found.harmonics, made.harmonics[kept])


@pytest.mark.parametrize(
    ("choices", "match"),
    [
        ({"box": ((5, 5, 5), (6, 6, 6))}, "none of the 40 Gaussians"),
        ({"box": ((1, 0, 0), (0, 1, 1))}, "lowest and highest corner"),
        ({"box": (1, 2, 3)}, "lowest and highest corner"),
        ({"least_opacity": 1.5}, "least opacity of 1.5"),
        ({"largest": 0.0}, "largest size of 0"),
        ({"largest": np.nan}, "largest size of nan"),
    ],
)
def test_invalid_crops_are_refused(choices, match):
    with pytest.raises(ValueError, match=match):
        cropped_gaussians(gaussians(), **choices)


# Checks


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("position", np.nan),
        ("position", np.inf),
        ("position", 1e38),
        ("scale", 0),
        ("scale", -1),
        ("scale", np.inf),
        ("scale", np.nan),
        ("rotation", 0),
        ("rotation", np.nan),
        ("rotation", 1e30),
        ("opacity", 1.001),
        ("opacity", -0.001),
        ("opacity", np.nan),
        ("color", np.nan),
    ],
)
def test_gaussians_that_cannot_be_drawn_are_left_out_and_counted_once(name, value, caplog):
    made = gaussians()
    getattr(made, name)[[3, 7]] = value
    with caplog.at_level(logging.WARNING, "resample"):
        found = checked_gaussians(made, "a.ply")
    kept = np.delete(np.arange(COUNT), [3, 7])
    assert np.array_equal(found.position, made.position[kept])
    assert np.array_equal(found.harmonics, made.harmonics[kept])
    assert [record.getMessage()[:34] for record in caplog.records] == [
        "a.ply: 2 of 40 Gaussians are left "
    ]


def test_quaternions_of_any_length_become_unit_ones():
    made = gaussians()
    scaled = made._replace(rotation=made.rotation * np.linspace(1e-9, 1e9, COUNT)[:, None])
    assert np.allclose(checked_gaussians(scaled).rotation, made.rotation, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"scale": np.ones((COUNT, 2))}, "scale of Gaussians has the shape"),
        ({"opacity": np.ones((COUNT, 1))}, "opacity of Gaussians has the shape"),
        ({"position": np.ones(3)}, "position of Gaussians has the shape"),
        ({"color": np.full((COUNT, 3), "a")}, "color of Gaussians has the shape"),
        ({"harmonics": np.ones((COUNT, 4, 3), np.int16)}, "K = 0, 3, 8 or 15"),
        ({"harmonics": np.ones((COUNT, 3, 3), np.float32)}, "must be int16"),
        ({"harmonic_step": 0.0}, "harmonic step of 0"),
        ({"opacity": np.full(COUNT, 2.0)}, "no Gaussians that can be drawn"),
    ],
)
def test_wrong_shapes_and_types_are_refused(changes, match):
    with pytest.raises(ValueError, match=match):
        checked_gaussians(gaussians(**changes))


@pytest.mark.parametrize("scale", [0.1, 1e4])  # one by itself; many, each around all others
def test_gaussians_larger_than_their_distances_are_framed_whole(scale):
    count = 1 if scale < 1 else 50
    place = np.random.default_rng(7).normal(size=(count, 3)).astype(np.float32)
    parts = place, np.full((count, 3), scale, np.float32), np.ones((count, 4), np.float32)
    rest = np.full(count, 0.9, np.float32), np.ones((count, 3), np.float32)
    scene = Gaussians(*parts, *rest)
    camera = gaussian_camera(scene, size=(32, 24), azimuth=20)
    alpha = render_gaussians(scene, camera, size=(32, 24)).rgba[..., 3]
    assert alpha.max() > 0.85
    assert alpha[0, 0] < 0.3
