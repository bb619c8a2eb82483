"""Crop boxes and clipping planes: which voxels' middles are kept, and what is refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from resample_volume.classification.transfer import from_points
from resample_volume.types import Volume
from resample_volume.voxels.framing import inside, keep, planes
from resample_volume.voxels.visible import classify, lattice_of

WHITE = from_points([(0, (1.0, 1.0, 1.0), 0.5)])
SHAPE = (5, 6, 7)
BOXES = ["2:5,:,1:", ":,:4,:", "1:,1:5,2:3", "-3:,:-2,-4:-1", "3,-1,0", " 1 : 4 , : , : "]


def straight() -> Volume:
    return Volume(np.ones(SHAPE, np.uint8), np.ones(3), np.zeros(3), np.eye(3), "test")


def tilted(*, mirror: bool) -> Volume:
    turn = Rotation.from_euler("xyz", [20, 35, -50], degrees=True).as_matrix()
    direction = turn * [1, -1, 1] if mirror else turn
    spacing, origin = np.array([0.5, 1.25, 3.0]), np.array([10.0, -4.0, 7.0])
    return Volume(np.ones(SHAPE, np.uint8), spacing, origin, direction, "tilted")


VOLUMES = {"straight": straight(), "turned": tilted(mirror=False), "mirrored": tilted(mirror=True)}
every_volume = pytest.mark.parametrize("name", VOLUMES)


def scene(volume: Volume, index: object) -> np.ndarray:
    """Scene positions of places between voxels, (N, 3) x, y, z."""
    return volume.origin + np.asarray(index, float) @ lattice_of(volume).T


def is_kept(rows: np.ndarray, position: np.ndarray) -> np.ndarray:
    return (position @ rows[:, :3].T + rows[:, 3] >= -1e-9).all(axis=1)


@every_volume
@pytest.mark.parametrize("box", BOXES)
def test_a_crop_keeps_the_voxels_that_numpy_would(name: str, box: str) -> None:
    volume = VOLUMES[name]
    wanted = np.zeros(SHAPE, bool)
    # The same crop as slices of an array (Z, Y, X)
    parts = []
    for part in box.split(","):
        words = [int(word) if word.strip() else None for word in part.split(":")]
        if len(words) == 1:
            words.append(None if words[0] == -1 else words[0] + 1)
        parts.append(slice(*words))
    wanted[tuple(parts[::-1])] = True
    z, y, x = np.indices(SHAPE).reshape(3, -1)
    found = is_kept(planes(volume, box), scene(volume, np.stack([x, y, z], axis=1)))
    np.testing.assert_array_equal(found, wanted.ravel())


@every_volume
def test_a_crop_cuts_half_way_between_voxels(name: str) -> None:
    volume = VOLUMES[name]
    rows = planes(volume, "2:5,:,1:")
    index = [(1.49, 3, 3), (1.51, 3, 3), (4.49, 3, 3), (4.51, 3, 3), (3, 3, 0.49), (3, 3, 0.51)]
    found = is_kept(rows, scene(volume, index))
    assert found.tolist() == [False, True, True, False, False, True]


@every_volume
def test_normals_have_length_1_so_that_distances_are_scene_units(name: str) -> None:
    rows = planes(VOLUMES[name], "1:5,1:5,1:4", ["3/4/0"])
    np.testing.assert_allclose(np.linalg.norm(rows[:, :3], axis=1), 1)
    assert rows.shape == (7, 4)


@pytest.mark.parametrize("box", [":,:,:", "0:7,:6,-5:", "0:99,:,:"])
def test_where_a_range_ends_with_the_volume_nothing_is_cut(box: str) -> None:
    assert planes(straight(), box).shape == (0, 4)


@every_volume
def test_a_clipping_plane_goes_through_the_middle_and_keeps_where_it_points(name: str) -> None:
    volume = VOLUMES[name]
    middle = scene(volume, (3, 2.5, 2))
    (row,) = planes(volume, clip=["1/0/-2"])
    normal = np.array([1, 0, -2]) / np.sqrt(5)
    assert row[:3] @ middle + row[3] == pytest.approx(0, abs=1e-12)
    assert row[:3] @ (middle + normal) + row[3] == pytest.approx(1)


def test_an_offset_moves_the_plane_along_its_normal() -> None:
    (row,) = planes(tilted(mirror=True), clip=["0/-3/0/1.5"])
    (still,) = planes(tilted(mirror=True), clip=["0/-3/0"])
    np.testing.assert_allclose(row - still, [0, 0, 0, -1.5])


def test_without_a_choice_there_are_no_planes() -> None:
    assert planes(straight()).shape == (0, 4)


@pytest.mark.parametrize(
    ("crop", "clip", "match"),
    [
        ("1:2,:", [], "crop '1:2,:'; give ranges of voxels along x, y and z, such as 64:192"),
        ("4:4,:,:", [], "x: '4:4' holds none of the 7 voxels"),
        (":,9:,:", [], "y: '9:' holds none of the 6 voxels"),
        (":,:,3:1", [], "z: '3:1' holds none of the 5 voxels"),
        ("9,:,:", [], "x: '9' holds none"),
        ("::2,:,:", [], "x: '::2' is not a range; give ranges"),
        ("a:,:,:", [], "x: 'a:' is not a range"),
        (",:,:", [], "x: '' is not a range"),
        ("1.5:,:,:", [], "x: '1.5:' is not a range"),
        (None, ["0/0/0"], "clip '0/0/0': the normal must not be 0,0,0; give a normal"),
        (None, ["1/0"], "clip '1/0'; give a normal, perhaps with"),
        (None, ["1/0/0/1/2"], "give a normal"),
        (None, ["1/0/x"], "give a normal"),
        (None, ["1/0/nan"], "give a normal"),
        (None, ["1/0/0/inf"], "give a normal"),
    ],
)
def test_a_malformed_choice_is_explained(crop: str | None, clip: list[str], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        planes(straight(), crop, clip)


@every_volume
def test_voxels_are_left_out_once_their_kernel_is_beyond_a_plane(name: str) -> None:
    volume = VOLUMES[name]
    rows = planes(volume, "3:,:,:")  # at 2.5; kernels of radius 2 reach from 0.5 on
    voxels = keep(classify(volume, WHITE), rows, 2.0)
    x = np.rint((voxels.position - volume.origin) @ np.linalg.inv(lattice_of(volume)).T)[:, 0]
    assert sorted(set(x)) == [1, 2, 3, 4, 5, 6]
    assert len(voxels.gradient) == len(voxels.color) == len(voxels.extinction) == len(x)


@every_volume
def test_a_kernel_that_is_left_out_has_no_part_in_what_is_kept(name: str) -> None:
    volume = VOLUMES[name]
    rows = planes(volume, None, ["1/2/-1/0.7"])
    voxels = classify(volume, WHITE, gradient=None)
    found = inside(voxels.position, voxels.lattice, rows, 1.5)
    ball = np.random.default_rng(7).normal(size=(5000, 3))
    ball *= 1.5 / np.linalg.norm(ball, axis=1, keepdims=True)
    reach = (ball @ lattice_of(volume).T @ rows[0, :3]).max()
    wanted = voxels.position @ rows[0, :3] + rows[0, 3] > -reach
    assert 0 < wanted.sum() < wanted.size
    np.testing.assert_array_equal(found, wanted)


def test_without_planes_voxels_stay_as_they_are() -> None:
    voxels = classify(straight(), WHITE)
    assert keep(voxels, planes(straight())) is voxels


def test_voxels_without_gradients_can_be_cropped() -> None:
    voxels = classify(straight(), WHITE, gradient=None)
    assert keep(voxels, planes(straight(), "5:,:,:"), 1.0).gradient.shape == (0, 3)
