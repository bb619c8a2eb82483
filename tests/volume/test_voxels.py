"""Which voxels are kept, where they lie, how their values slope."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import sobel
from scipy.spatial.transform import Rotation

from resample.types import Doubles
from resample_volume.classification.presets import load_transfer
from resample_volume.classification.transfer import TransferTable, from_points, tabulated
from resample_volume.types import Volume
from resample_volume.voxels.visible import GRADIENTS, Voxels, classify, finite_range, lattice_of

WHITE = (1.0, 1.0, 1.0)
ALL = from_points([(0, (1.0, 0.0, 0.0), 0.5), (100, WHITE, 0.5)])
NONE = from_points([(0, WHITE, 0.0)])
UPPER = from_points([(40, WHITE, 0.0), (40, WHITE, 0.2), (100, (1.0, 0.5, 0.0), 0.9)])
# Of doubles, what finds slopes is compiled once more; central differences show it.
SLOPES = {
    test: [
        pytest.param("sobel", marks=pytest.mark.sweep) if name == "sobel" else name
        for name in GRADIENTS
    ]
    for test in (
        "test_a_linear_field_has_its_exact_gradient_everywhere",
        "test_missing_and_infinite_values_change_no_gradient",
        "test_a_voxel_among_missing_values_is_flat",
    )
}
FEW_KINDS, FURTHER_KINDS = ["u1", "f4", "f8"], ["i1", "u2", "i2", "i4"]  # of codes and numbers


def unit_volume(values: np.ndarray) -> Volume:
    return Volume(values, np.ones(3), np.zeros(3), np.eye(3), "test")


def tilted(values: np.ndarray, *, mirror: bool = True) -> Volume:
    """Rotated, of unequal spacing, and left-handed."""
    turn = Rotation.from_euler("xyz", [20, 35, -50], degrees=True).as_matrix()
    direction = turn * [1, 1, -1] if mirror else turn
    return Volume(values, np.array([0.5, 1.25, 3.0]), np.array([10.0, -4.0, 7.0]), direction, "t")


def naive_position(volume: Volume, z: int, y: int, x: int) -> Doubles:
    position = volume.origin.copy()
    for axis, count in enumerate((x, y, z)):
        position += count * volume.spacing[axis] * volume.direction[:, axis]
    return position


def linear(slope: Doubles, shape: tuple[int, int, int] = (5, 6, 7)) -> Volume:
    """A field with the same scene gradient everywhere."""
    volume = tilted(np.zeros(shape))
    for voxel in np.ndindex(shape):
        volume.values[voxel] = slope @ naive_position(volume, *voxel)
    return volume


def naive_slope(values: np.ndarray, voxel: tuple[int, ...], axis: int) -> float:
    """Mean of the known differences to both neighbours along an axis."""

    def value(shift: int) -> float:
        place = list(voxel)
        place[axis] += shift
        is_inside = all(0 <= p < size for p, size in zip(place, values.shape, strict=True))
        return float(values[tuple(place)]) if is_inside else np.nan

    differences = [value(1) - value(0), value(0) - value(-1)]
    known = [difference for difference in differences if np.isfinite(difference)]
    return float(np.mean(known)) if known else np.nan


def naive_gradient(values: np.ndarray, voxel: tuple[int, ...], reach: int) -> list[float]:
    """Along x, y and z, per voxel."""
    gradient = []
    for axis in (2, 1, 0):
        total = weight = 0.0
        for shift in itertools.product(range(-reach, reach + 1), repeat=2):
            line = list(voxel)
            for other, count in zip([a for a in range(3) if a != axis], shift, strict=True):
                line[other] += count
            slope = naive_slope(values, tuple(line), axis)
            if np.isfinite(slope):
                share = (reach + 1 - abs(shift[0])) * (reach + 1 - abs(shift[1]))
                total, weight = total + share * slope, weight + share
        gradient.append(total / weight if weight else 0.0)
    return gradient


def assert_same(found: Voxels, expected: Voxels) -> None:
    for field, wanted in zip(found, expected, strict=True):
        np.testing.assert_array_equal(field, wanted)


def test_only_voxels_that_are_seen_are_kept_z_slowest_in_a_brick(rng: np.random.Generator) -> None:
    values = rng.integers(0, 100, (4, 5, 6), np.uint8)
    voxels = classify(unit_volume(values), UPPER)
    expected = np.argwhere(values >= 40)[:, ::-1]
    np.testing.assert_array_equal(voxels.position, expected)


def test_voxels_lie_where_the_volume_says(rng: np.random.Generator) -> None:
    volume = tilted(rng.random((3, 4, 5)))
    position = classify(volume, ALL).position
    expected = [naive_position(volume, *voxel) for voxel in np.ndindex(3, 4, 5)]
    np.testing.assert_array_equal(position, np.float32(expected))
    assert position.dtype == np.float32


def test_the_lattice_is_made_of_the_steps_between_voxels() -> None:
    volume = tilted(np.ones((2, 2, 2)))
    position = classify(volume, ALL).position
    steps = position[[1, 2, 4]] - position[0]
    np.testing.assert_allclose(lattice_of(volume).T, steps, atol=2e-6)  # float32 near 10
    np.testing.assert_array_equal(classify(volume, ALL).lattice, lattice_of(volume))


@pytest.mark.parametrize(
    "kind", [*FEW_KINDS, *(pytest.param(kind, marks=pytest.mark.sweep) for kind in FURTHER_KINDS)]
)
def test_all_types_give_the_same_voxels(kind: str, rng: np.random.Generator) -> None:
    values = rng.integers(0, 100, (4, 9, 8))
    expected = classify(unit_volume(values.astype(np.float64)), UPPER)
    assert_same(classify(unit_volume(values.astype(kind)), UPPER), expected)


@pytest.mark.parametrize("kind", ["i2", pytest.param("i1", marks=pytest.mark.sweep)])
def test_negative_codes_are_looked_up_right(kind: str) -> None:
    ramp = from_points([(-100, WHITE, 0.1), (100, WHITE, 0.9)])
    values = np.arange(-100, 101).astype(kind).reshape(3, 67, 1)
    direct = classify(unit_volume(values.astype("f4")), ramp)
    np.testing.assert_array_equal(classify(unit_volume(values), ramp).extinction, direct.extinction)


def test_large_volumes_are_looked_at_in_chunks(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = unit_volume(rng.normal(50, 30, (7, 6, 5)))
    whole = classify(volume, UPPER)
    monkeypatch.setattr("resample_volume.data.values.CHUNK", 70)  # 2 slices, 1 left over
    assert_same(classify(volume, UPPER), whole)


def test_a_mapped_file_gives_the_same_voxels(tmp_path: Path, rng: np.random.Generator) -> None:
    values = rng.integers(0, 100, (4, 5, 6), np.uint8)
    values.tofile(tmp_path / "raw")
    mapped = np.memmap(tmp_path / "raw", np.uint8, "r", 0, values.shape)
    assert_same(classify(unit_volume(mapped), UPPER), classify(unit_volume(values), UPPER))


@pytest.mark.sweep
def test_values_need_not_be_contiguous(rng: np.random.Generator) -> None:
    values = rng.normal(50, 30, (6, 5, 8))
    strided = values.T[::2]
    assert_same(classify(unit_volume(strided), UPPER), classify(unit_volume(strided.copy()), UPPER))


@pytest.mark.parametrize("gradient", [*GRADIENTS, None])
@pytest.mark.parametrize("kind", ["u1", "f4"])
def test_a_transparent_volume_has_no_voxels(kind: str, gradient: str | None) -> None:
    ramp = None if gradient is None else (0.1, 0.5)
    volume = unit_volume(np.zeros((2, 3, 4), kind))
    voxels = classify(volume, NONE, gradient=gradient, gradient_opacity=ramp)
    assert [field.shape for field in voxels[:5]] == [(0, 3), (0, 3), (0,), (0, 3), (3, 3)]
    assert {field.dtype.name for field in voxels[:4]} == {"float32"}


def test_missing_values_are_not_seen() -> None:
    values = np.full((3, 3, 3), 50.0)
    values[1, 1, 1] = np.nan
    assert len(classify(unit_volume(values), ALL).position) == 26


def test_the_range_leaves_out_what_is_not_finite(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("resample_volume.data.values.CHUNK", 1)
    values = np.array([np.nan, -3, np.inf, 8, -np.inf, np.nan]).reshape(6, 1, 1)
    assert finite_range(values) == (-3, 8)
    assert finite_range(np.full((2, 2, 2), np.nan)) == (0, 1)
    assert finite_range(np.arange(8, dtype=np.int16).reshape(2, 2, 2)) == (0, 7)


@pytest.mark.parametrize("kind", ["i2", "f4"])
def test_normalized_functions_span_the_volume_s_own_range(kind: str) -> None:
    values = np.arange(-500, 1500).astype(kind).reshape(2, 10, 100)
    voxels = classify(unit_volume(values), load_transfer("gray"))
    half = 1 - np.exp(-np.median(voxels.extinction))
    assert len(voxels.position) == 1999  # all but the least value
    assert half == pytest.approx(0.5, abs=1e-3)


def test_voxels_come_brick_after_brick(rng: np.random.Generator) -> None:
    values = rng.integers(0, 80, (19, 9, 25), np.uint8)
    place = np.rint(classify(unit_volume(values), UPPER).position).astype(int)
    brick = [tuple(place[n, ::-1] // 8) for n in range(len(place))]
    assert len(place) == np.count_nonzero(values >= 40)
    assert brick == sorted(brick)
    assert len(set(map(tuple, place))) == len(place)


def test_with_an_opacity_unit_finer_voxels_leave_the_depth_per_length() -> None:
    transfer = from_points([(0, WHITE, 0.3)], opacity_unit=2.0)
    coarse = unit_volume(np.ones((2, 2, 2)))
    fine = coarse._replace(spacing=np.full(3, 0.5))
    expected = -np.log(1 - 0.3) / 2
    for volume in (coarse, fine):
        np.testing.assert_allclose(classify(volume, transfer).extinction, expected, rtol=1e-6)


def test_without_a_unit_opacity_is_that_of_a_voxel() -> None:
    volume = tilted(np.ones((2, 2, 2)))  # of 0.5 × 1.25 × 3
    length = (0.5 * 1.25 * 3) ** (1 / 3)
    depth = classify(volume, ALL).extinction * length
    np.testing.assert_allclose(1 - np.exp(-depth), 0.5, rtol=1e-6)


@pytest.mark.parametrize(
    "gradient", SLOPES["test_a_linear_field_has_its_exact_gradient_everywhere"]
)
def test_a_linear_field_has_its_exact_gradient_everywhere(gradient: str) -> None:
    slope = np.array([3.0, -2.0, 0.5])
    found = classify(linear(slope), ALL, gradient=gradient).gradient
    np.testing.assert_allclose(found, np.tile(slope, (len(found), 1)), atol=1e-5)


@pytest.mark.parametrize("gradient", SLOPES["test_missing_and_infinite_values_change_no_gradient"])
@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
def test_missing_and_infinite_values_change_no_gradient(gradient: str, missing: float) -> None:
    slope = np.array([3.0, -2.0, 0.5])
    volume = linear(slope)
    volume.values[2, [2, 3, 3], [2, 3, 4]] = missing
    found = classify(volume, ALL, gradient=gradient).gradient
    is_known = np.isfinite(volume.values[~np.isnan(volume.values)])
    np.testing.assert_allclose(found[is_known], np.tile(slope, (207, 1)), atol=1e-5)
    assert np.isfinite(found).all()


@pytest.mark.parametrize("gradient", SLOPES["test_a_voxel_among_missing_values_is_flat"])
def test_a_voxel_among_missing_values_is_flat(gradient: str) -> None:
    values = np.full((3, 3, 3), np.nan)
    values[1, 1, 1] = 50
    np.testing.assert_array_equal(
        classify(unit_volume(values), ALL, gradient=gradient).gradient, np.zeros((1, 3))
    )


@pytest.mark.parametrize(
    ("gradient", "reach", "kind"),
    [
        pytest.param(
            *(gradient, reach, kind),
            marks=pytest.mark.sweep
            if kind in FURTHER_KINDS or (gradient, kind) == ("sobel", "f8")
            else (),
        )
        for gradient, reach in GRADIENTS.items()
        for kind in FEW_KINDS + FURTHER_KINDS
    ],
)
def test_gradients_agree_with_the_obvious_loop(
    gradient: str, reach: int, kind: str, rng: np.random.Generator
) -> None:
    values = rng.integers(0, 100, (3, 4, 5)).astype(kind)
    if kind[0] == "f":
        values[rng.random(values.shape) < 0.3] = np.nan
    found = classify(unit_volume(values), ALL, gradient=gradient).gradient
    seen = np.argwhere(~np.isnan(values))
    expected = [naive_gradient(values, tuple(voxel), reach) for voxel in seen]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-5)


def test_the_smooth_gradient_is_sobel_s(rng: np.random.Generator) -> None:
    values = rng.random((6, 7, 8)).astype(np.float32)
    found = classify(unit_volume(values), ALL, gradient="sobel").gradient.reshape(6, 7, 8, 3)
    inner = (slice(1, -1),) * 3
    for c, axis in enumerate((2, 1, 0)):
        expected = sobel(values.astype(float), axis) / 32  # weights 16, over two steps
        np.testing.assert_allclose(found[(*inner, c)], expected[inner], atol=1e-6)


def test_sobel_s_gradient_is_less_noisy(rng: np.random.Generator) -> None:
    volume = unit_volume(rng.normal(50, 5, (12, 12, 12)).astype(np.float32))
    central, smooth = (classify(volume, ALL, gradient=name).gradient for name in GRADIENTS)
    assert smooth.std() < 0.5 * central.std()  # noise-free weights would give 3 / 8


def test_gradients_are_left_out_when_not_asked_for() -> None:
    assert classify(unit_volume(np.ones((2, 2, 2))), ALL, gradient=None).gradient.shape == (0, 3)


def test_gradient_opacity_keeps_edges_and_drops_even_regions() -> None:
    values = np.zeros((3, 3, 20))
    values[..., 10:] = 50
    voxels = classify(unit_volume(values), ALL, gradient_opacity=(0.1, 0.9))
    assert set(voxels.position[:, 0]) == {9, 10}
    np.testing.assert_allclose(voxels.extinction, np.log(2), rtol=1e-6)
    assert len(voxels.color) == len(voxels.gradient) == 18


def test_gradient_opacity_rises_between_its_two_lengths() -> None:
    x = np.arange(21.0)
    values = np.broadcast_to(x * x, (2, 2, 21)).copy()  # slope 2 x within
    voxels = classify(unit_volume(values), ALL, gradient_opacity=(0.25, 0.75))
    steepest = np.percentile(np.tile(np.r_[1, 2 * x[1:-1], 39], 4), 99)
    share = np.clip((2 * voxels.position[:, 0] / steepest - 0.25) / 0.5, 0, 1)
    inner = voxels.position[:, 0] < 20
    opacity = 1 - np.exp(-voxels.extinction)
    np.testing.assert_allclose(opacity[inner], 0.5 * share[inner], atol=1e-6)


def test_gradient_opacity_leaves_an_even_volume_alone() -> None:
    voxels = classify(unit_volume(np.ones((3, 3, 3))), ALL, gradient_opacity=(0.1, 0.5))
    np.testing.assert_allclose(voxels.extinction, np.log(2), rtol=1e-6)


@pytest.mark.parametrize(
    ("gradient", "ramp", "match"),
    [
        ("prewitt", None, "unknown gradient 'prewitt'; known: central, sobel, None"),
        (None, (0.1, 0.5), "needs a gradient; choose central or sobel"),
        ("central", (0.5, 0.1), "two fractions that ascend from 0"),
        ("central", (-0.1, 0.1), "two fractions that ascend from 0"),
        ("central", (0.1, np.nan), "two fractions that ascend from 0"),
    ],
)
def test_impossible_choices_are_refused(
    gradient: str | None, ramp: tuple[float, float] | None, match: str
) -> None:
    with pytest.raises(ValueError, match=match):
        classify(unit_volume(np.ones((2, 2, 2))), ALL, gradient=gradient, gradient_opacity=ramp)


def test_what_does_not_fit_in_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("resample.memory.physical_memory", lambda: 1000)
    assert len(classify(unit_volume(np.ones((1, 1, 5))), ALL).position) == 5
    with pytest.raises(ValueError, match="test with 6 visible voxels needs"):
        classify(unit_volume(np.ones((1, 1, 6))), ALL)


SHOWN = {  # control points: values that are seen
    "above": [(60, WHITE, 0.0), (90, WHITE, 0.9)],
    "step": [(85, WHITE, 0.0), (85, WHITE, 0.9)],
    "band": [(30, WHITE, 0.0), (40, WHITE, 0.9), (50, WHITE, 0.0)],
    "all": [(0, WHITE, 0.3)],
    "nothing": [(0, WHITE, 0.0)],
}


def smooth(kind: str, rng: np.random.Generator) -> np.ndarray:
    """Blobs of 0 to 99 in mostly low values."""
    values = np.clip(rng.normal(0, 40, (9, 10, 11)), 0, 99)
    if kind[0] == "f":
        values[rng.random(values.shape) < 0.1] = np.nan
    return values.astype(kind)


def transfer_table(points: list, columns: int = 100) -> TransferTable:
    return tabulated(from_points(points), (0.0, 99.0), 0.0, 1.0, (1, columns))
