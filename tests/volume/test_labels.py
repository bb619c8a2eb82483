"""Labels of voxels: what rules change, how they are read, what is refused."""

from pathlib import Path

import numpy as np
import pytest

from resample.colors import from_srgb
from resample_volume.classification.labels import Labels, Rule, parse_rules
from resample_volume.classification.transfer import Region, RegionTransfer, from_points
from resample_volume.data.values import Bricks
from resample_volume.files.source import read_labels
from resample_volume.types import Recording, Volume
from resample_volume.voxels.visible import classify
from resample_zarr.volumes import Single
from resample_zarr.writing import Layered, write_store

GRAY, TOMATO = (0.5, 0.5, 0.5), (1.0, 99 / 255, 71 / 255)
EVEN = from_points([(0, GRAY, 0.5)])


def volume_of(values: np.ndarray) -> Volume:
    return Volume(values, np.ones(3), np.zeros(3), np.eye(3), "test")


@pytest.fixture
def labeled(rng: np.random.Generator) -> tuple[Volume, np.ndarray]:
    values = rng.random((4, 5, 6)).astype(np.float32)
    return volume_of(values), rng.integers(0, 4, values.shape, np.int16)


def written(folder: Path, labels: np.ndarray) -> str:
    path = folder / "labels.npy"
    np.save(path, labels)
    return str(path)


def test_a_label_without_a_rule_is_shown_as_it_is(labeled: tuple[Volume, np.ndarray]) -> None:
    volume, label = labeled
    plain = classify(volume, EVEN)
    for rules in ({}, {7: Rule(opacity=0)}):
        found = classify(volume, EVEN, labels=Labels(label, rules))
        for left, right in zip(found, plain, strict=True):
            np.testing.assert_array_equal(left, right)


def test_rules_change_their_own_label_alone(labeled: tuple[Volume, np.ndarray]) -> None:
    volume, label = labeled
    rules = parse_rules(["1:color=tomato,opacity=0.5", "2:hidden", "3:opacity=4"])
    voxels = classify(volume, EVEN, labels=Labels(label, rules))
    own = label.ravel()[label.ravel() != 2]
    opacity = 1 - np.exp(-voxels.extinction)
    np.testing.assert_allclose(opacity, np.choose(own, [0.5, 0.25, 0, 1]), atol=2e-6)
    gray, tomato = (from_srgb(np.array(color)) for color in (GRAY, TOMATO))
    wanted = np.where((own == 1)[:, np.newaxis], tomato, gray)
    np.testing.assert_allclose(voxels.color, wanted, atol=1e-6)


def test_hidden_voxels_leave_no_gradient_behind(labeled: tuple[Volume, np.ndarray]) -> None:
    volume, label = labeled
    voxels = classify(volume, EVEN, labels=Labels(label, parse_rules(["0:opacity=0"])))
    whole = classify(volume, EVEN)
    np.testing.assert_array_equal(voxels.gradient, whole.gradient[label.ravel() != 0])
    np.testing.assert_array_equal(voxels.position, whole.position[label.ravel() != 0])


def test_hiding_a_label_does_not_change_how_others_fade(labeled: tuple[Volume, np.ndarray]) -> None:
    volume, label = labeled
    ramp = (0.2, 0.9)
    whole = classify(volume, EVEN, gradient_opacity=ramp)
    rest = classify(
        volume, EVEN, gradient_opacity=ramp, labels=Labels(label, parse_rules(["0:hidden"]))
    )
    index = whole.position.astype(int)
    is_left = label[index[:, 2], index[:, 1], index[:, 0]] != 0
    np.testing.assert_array_equal(rest.extinction, whole.extinction[is_left])


def test_labels_go_with_regions(labeled: tuple[Volume, np.ndarray]) -> None:
    volume, label = labeled
    regions = RegionTransfer((Region((0, 1), GRAY, 0.5),))
    voxels = classify(volume, regions, labels=Labels(label, parse_rules(["1:hidden"])))
    assert len(voxels.position) == (label != 1).sum()


@pytest.mark.sweep
def test_labels_need_not_be_contiguous(labeled: tuple[Volume, np.ndarray]) -> None:
    volume, label = labeled
    turned = volume_of(volume.values.T)
    voxels = classify(turned, EVEN, labels=Labels(label.T, parse_rules(["1:hidden"])))
    index = voxels.position.astype(int)
    assert (label.T[index[:, 2], index[:, 1], index[:, 0]] != 1).all()


def test_rules_are_read() -> None:
    found = parse_rules(["1:color=tomato,opacity=0.5", " -2 : hidden ", "3: color = #ff0000"])
    assert found == {1: Rule(TOMATO, 0.5), -2: Rule(None, 0.0), 3: Rule((1.0, 0.0, 0.0), 1.0)}


@pytest.mark.parametrize(
    ("rule", "match"),
    [
        ("liver:hidden", "rule 'liver:hidden': 'liver' is not a label; give label:color=tomato"),
        ("1", "rule '1': it changes nothing; give label:color"),
        ("1:", "it changes nothing"),
        ("1:colour=red", "'colour=red' is unknown; give label:color"),
        ("1:hidden=yes", "'hidden=yes' is unknown"),
        ("1:opacity=x", r"opacity must be a number \(got 'x'\)"),
        ("1:opacity=-1", r"opacity must be 0 or more \(got -1\)"),
        ("1:opacity=nan", r"opacity must be 0 or more \(got nan\)"),
        ("1:color=rde", "must be '#rrggbb', a color's name"),
    ],
)
def test_a_wrong_rule_is_explained(rule: str, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        parse_rules([rule])


def test_two_rules_for_a_label_are_refused() -> None:
    with pytest.raises(ValueError, match="rule '1:opacity=1': label 1 has another rule already"):
        parse_rules(["1:hidden", "1:opacity=1"])


def test_labels_come_from_a_file(tmp_path: Path, labeled: tuple[Volume, np.ndarray]) -> None:
    volume, label = labeled
    found = read_labels(written(tmp_path, label), ["1:hidden"], volume)
    np.testing.assert_array_equal(found.values, label)
    assert found.rules == {1: Rule(opacity=0.0)}


@pytest.mark.parametrize("kind", [np.uint8, np.int32])
def test_labels_of_a_volume_in_bricks_are_read_from_their_store(
    tmp_path: Path, labeled: tuple[Volume, np.ndarray], kind: type
) -> None:
    volume, label = labeled
    path = str(tmp_path / "labels.zarr")
    recording = Recording(Single(label.astype(kind)), *volume[1:5])
    write_store(Path(path), recording, Layered(chunk=8, is_layered=False))
    assert isinstance(read_labels(path, ["1:hidden"], volume).values, np.ndarray)
    bricks = Bricks(volume.values.__getitem__, volume.values.shape, volume.values.dtype, (2, 2, 2))
    found = read_labels(path, ["1:hidden"], volume._replace(values=bricks))
    np.testing.assert_array_equal(found.values, label)
    with pytest.raises(ValueError, match=r"no voxel has the label 9; there are 0, 1, 2, 3$"):
        read_labels(path, ["9:hidden"], volume._replace(values=bricks))


def test_labels_of_another_shape_are_refused(
    tmp_path: Path, labeled: tuple[Volume, np.ndarray]
) -> None:
    volume, label = labeled
    match = r"labels\.npy: labels of 5 x 5 x 4 voxels do not fit a volume of 6 x 5 x 4"
    with pytest.raises(ValueError, match=match):
        read_labels(written(tmp_path, label[..., :5]), [], volume)
    with pytest.raises(ValueError, match="do not fit"):
        classify(volume, EVEN, labels=Labels(label[1:], {}))


def test_labels_that_are_no_whole_numbers_are_refused(
    tmp_path: Path, labeled: tuple[Volume, np.ndarray]
) -> None:
    volume, _ = labeled
    with pytest.raises(ValueError, match=r"labels\.npy: labels must be whole numbers, not float32"):
        read_labels(written(tmp_path, volume.values), [], volume)


def test_a_rule_for_a_label_that_is_not_there_lists_those_that_are(
    tmp_path: Path, labeled: tuple[Volume, np.ndarray]
) -> None:
    volume, label = labeled
    with pytest.raises(ValueError, match=r"no voxel has the label 9; there are 0, 1, 2, 3$"):
        read_labels(written(tmp_path, label), ["9:hidden"], volume)
    many = np.arange(120, dtype=np.int32).reshape(4, 5, 6)
    with pytest.raises(ValueError, match=r"there are 0, 1, .*14, 15 and 104 more$"):
        read_labels(written(tmp_path, many), ["999:hidden"], volume)


def test_a_file_that_is_not_there_is_an_os_error(labeled: tuple[Volume, np.ndarray]) -> None:
    with pytest.raises(FileNotFoundError, match=r"absent\.npy"):
        read_labels("absent.npy", [], labeled[0])
