"""Transfer functions: what they give, what files hold, what users are told."""

import json
from pathlib import Path

import numpy as np
import pytest

from resample.colors import from_srgb
from resample_volume.classification.presets import PRESETS, load_transfer
from resample_volume.classification.transfer import (
    MOST_OPAQUE,
    TransferFunction,
    evaluated,
    extinction,
    from_points,
    visible_places,
)

BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
RAMP = from_points([(10.0, BLACK, 0.2), (20.0, WHITE, 0.6)])
BYTE = (0.0, 255.0)

POINTS = "points = [{ value = 0, color = 'black', opacity = 0 }, { value = 1, %s }]"


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def opacities(transfer: TransferFunction, *values: float) -> list[float]:
    return [round(float(opacity), 6) for opacity in transfer.opacities(values, BYTE)]


def test_opacity_is_linear_between_points_and_goes_on_beyond_them() -> None:
    assert opacities(RAMP, -5, 10, 12.5, 20, 99) == pytest.approx([0.2, 0.2, 0.3, 0.6, 0.6])


def test_infinite_values_are_beyond_the_last_points() -> None:
    assert opacities(RAMP, -np.inf, np.inf) == pytest.approx([0.2, 0.6])


def test_nan_is_transparent_and_black() -> None:
    color, opacity = RAMP(np.array([np.nan]), BYTE)
    assert opacity == 0
    assert (color == 0).all()


def test_results_are_float32_of_one_color_per_value() -> None:
    color, opacity = RAMP(np.arange(5), BYTE)
    assert (color.shape, color.dtype) == ((5, 3), np.float32)
    assert (opacity.shape, opacity.dtype) == ((5,), np.float32)


def test_color_is_interpolated_as_displayed_then_made_linear() -> None:
    halfway = RAMP.colors([15.0], BYTE)
    np.testing.assert_allclose(halfway, from_srgb(np.full((1, 3), 0.5)), rtol=1e-6)


@pytest.mark.parametrize("count", [1, 3, 50])  # np.interp takes other ways for many values
def test_the_later_of_two_points_holds_at_and_above_their_value(count: int) -> None:
    step = from_points([(0, WHITE, 0.1), (5, WHITE, 0.1), (5, WHITE, 0.8), (9, WHITE, 0.8)])
    assert opacities(step, *[np.nextafter(5, 0), 5.0] * count) == [0.1, 0.8] * count


def test_a_step_may_be_first_or_last() -> None:
    box = from_points([(3, WHITE, 0.0), (3, WHITE, 0.5), (7, WHITE, 0.5), (7, WHITE, 0.0)])
    assert opacities(box, 2.9, 3, 5, 6.999999, 7, 8) == [0, 0.5, 0.5, 0.5, 0, 0]


def test_a_single_point_is_a_constant() -> None:
    assert opacities(from_points([(4, WHITE, 0.3)]), 0, 4, 9) == pytest.approx([0.3] * 3)


def test_normalized_points_span_the_range_of_the_data() -> None:
    ramp = PRESETS["gray"]()
    assert ramp.opacities([-2, 0, 2], (-2, 2)).tolist() == [0, 0.5, 1]


def test_a_normalized_function_of_constant_data_takes_its_last_point() -> None:
    assert PRESETS["gray"]().opacities([0.1], (0.1, 0.1)).tolist() == [1]


def test_extinction_undoes_the_law_of_beer_and_lambert() -> None:
    opacity = np.array([0, 0.3, 0.9])
    depth = extinction(opacity, 2.5) * 2.5
    np.testing.assert_allclose(1 - np.exp(-depth), opacity, atol=1e-7)


def test_an_opacity_of_one_is_capped_and_finite() -> None:
    assert extinction(np.ones(1), 1.0) == pytest.approx(-np.log(1 - MOST_OPAQUE))


def test_equal_functions_are_equal_and_hash_alike() -> None:
    again = from_points([(10.0, BLACK, 0.2), (20.0, WHITE, 0.6)])
    assert again == RAMP
    assert hash(RAMP) == hash(again)
    assert PRESETS["gray"]() != RAMP


def test_control_points_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        RAMP.opacity[0] = 1


@pytest.mark.parametrize(
    ("points", "options", "match"),
    [
        ([(1, WHITE, 1.5)], {}, r"points.0.opacity: must be between 0 and 1 \(got 1.5\)"),
        ([(1, (0, 2, 0), 1)], {}, r"points.0.color: must be between 0 and 1"),
        ([(2, WHITE, 1), (1, WHITE, 1)], {}, r"points.1.value: must be finite and not descend"),
        ([(np.nan, WHITE, 1)], {}, r"points.0.value: must be finite"),
        ([(0, WHITE, np.nan)], {}, r"points.0.opacity: must be between 0 and 1"),
        ([(64, WHITE, 1)], {"normalized": True}, r"between 0 and 1 where normalized \(got 64"),
        ([(1, WHITE, 1)], {"opacity_unit": 0.0}, r"opacity_unit: must be greater than 0"),
    ],
)
def test_points_out_of_range_are_refused(points: list, options: dict, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        from_points(points, **options)


def test_arrays_of_other_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match=r"\(2,\) values do not fit \(3,\) opacities"):
        TransferFunction(np.zeros(2), np.zeros((2, 3)), np.zeros(3))
    with pytest.raises(ValueError, match=r"2 points need colors of the shape \(2, 3\)"):
        TransferFunction(np.zeros(2), np.zeros((3, 2)), np.zeros(2))


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_loads_by_its_name_and_shows_something(name: str) -> None:
    transfer = load_transfer(name)
    assert transfer == PRESETS[name]()
    assert transfer.opacities(np.arange(256), BYTE).max() > 0.25


@pytest.mark.some(2)
@pytest.mark.parametrize(
    ("data", "preset", "count"),
    [
        ("engine", "paper-engine", 1_160_038),
        ("aneurism", "paper-aneurism", 114_695),
        ("lobster", "paper-lobster", 190_815),
    ],
)
def test_the_paper_s_voxel_counts_come_out(
    volumes: Path, data: str, preset: str, count: int
) -> None:
    itk = pytest.importorskip("SimpleITK")
    values = itk.GetArrayFromImage(itk.ReadImage(str(volumes / f"{data}.nhdr")))
    is_seen = load_transfer(preset).opacities(np.arange(256), BYTE) > 0
    assert int(is_seen[values].sum()) == count


def test_lobster_is_a_red_translucent_shell_around_white_meat() -> None:
    (shell, meat), (veil, solid) = load_transfer("lobster")([70, 136], BYTE)
    assert shell[0] > 10 * shell[1]
    assert (meat == 1).all()
    assert veil < 0.15
    assert solid > 0.5


def test_bone_hides_soft_tissue_of_both_heads() -> None:
    bone = load_transfer("bone")
    assert bone.opacities([1050, 2000], (0, 3926)).tolist() == pytest.approx([0, 0.7], abs=0.1)
    assert bone.opacities([68, 140], (1, 254)).tolist() == pytest.approx([0, 0.75], abs=0.1)


def test_a_colormap_rises_in_opacity() -> None:
    color, opacity = load_transfer("viridis")([0, 0.5, 1], (0, 1))
    np.testing.assert_allclose(opacity, [0, 0.5, 1], atol=1e-6)
    assert color[2, 0] > color[0, 0]  # from violet to yellow


def test_a_colormap_takes_an_opacity_and_a_least_value() -> None:
    transfer = load_transfer("viridis:opacity=0.2,low=0.3")
    opacity = transfer.opacities([0.299, 0.3, 1], (0, 1))
    np.testing.assert_allclose(opacity, [0, 0.06, 0.2], atol=1e-6)


def test_parameters_apply_to_presets_too() -> None:
    transfer = load_transfer("lobster:opacity=0.5,low=100")
    assert opacities(transfer, 99, 136) == pytest.approx([0, 0.32], abs=1e-6)


def test_points_may_be_given_in_words() -> None:
    transfer = load_transfer("-1e2/#ff0000/0,50.5/white/0.4,50.5/0.2/1")
    assert transfer == from_points(
        [(-100, (1, 0, 0), 0.0), (50.5, (1, 1, 1), 0.4), (50.5, (0.2, 0.2, 0.2), 1.0)]
    )
    assert opacities(load_transfer("0/red/0.5:opacity=0.5"), 7) == pytest.approx([0.25])
    both = load_transfer("0/red/0,9/red/0.5+0/blue/0.5,1e+1/blue/0.5")
    assert both.opacities(np.array([9.0]), (0, 9)) == pytest.approx([0.75])


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("40/redd/0,90/white/1", "40/redd/0: color must be '#rrggbb', a color's name"),
        ("40/red/0,30/white/1", "must be finite and not descend"),
        ("40/red/1.2", "opacity: must be between 0 and 1"),
        ("bonne", "'bonne'; did you mean 'bone'. known: bone, .*paper-lobster; .*colormap.*json"),
        ("viridis:low=2", "viridis:low=2: low must be between 0 and 1"),
        ("viridis:opacity=-1", "opacity must be between 0 and 1"),
        ("viridis:opacity=x", r"opacity must be a number \(got 'x'\)"),
        ("viridis:gamma=2", "unknown parameter 'gamma'; known: opacity, low"),
        ("engine:low=nan", "low must be finite"),
    ],
)
def test_a_wrong_name_or_parameter_is_explained(name: str, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        load_transfer(name)


def test_colors_may_be_codes_names_or_numbers(tmp_path: Path) -> None:
    points = [
        {"value": n, "color": color, "opacity": 1}
        for n, color in enumerate(["#ff6347", "tomato", [1, 99 / 255, 71 / 255]])
    ]
    path = write(tmp_path, "colors.json", json.dumps({"points": points}))
    np.testing.assert_allclose(np.diff(load_transfer(path).color, axis=0), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("point", "match"),
    [
        ("color = 'red', opacity = 1.7", r"1.opacity: must be between 0 and 1 \(got 1.7\)$"),
        ("color = 'red', opacity = nan", r"1.opacity: must be .*finite"),
        ("color = 'red', opacity = '1'", r"1.opacity: must be a valid number \(got '1'\)"),
        ("color = 'red'", "1.opacity: is missing$"),
        ("color = 'rde', opacity = 1", r"1.color: must be '#rrggbb', .* \(got 'rde'\)"),
        ("color = [1, 2, 0], opacity = 1", "1.color: must be '#rrggbb'"),
        ("color = [1, 0], opacity = 1", "1.color: must be '#rrggbb'"),
        (
            "color = 'red', opactiy = 1",
            "1.opacity: is missing; .*opactiy: is unknown; known: value",
        ),
        ("color = 'rde', opacity = 7", r"1.color: .*; points.1.opacity: "),
    ],
)
def test_one_line_names_the_file_the_key_and_what_is_allowed(
    tmp_path: Path, point: str, match: str
) -> None:
    path = write(tmp_path, "bone.toml", POINTS % point)
    with pytest.raises(ValueError, match=r"bone\.toml: points\." + match) as error:
        load_transfer(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("a.toml", "points = []", "points: .*at least 1 item"),
        ("a.toml", "points = [3]", r"points.0: must be a table of value, color, opacity \(got 3\)"),
        ("a.toml", "", "a.toml: points: is missing"),
        ("a.json", "[1]", r"a.json: must be a table of normalized, opacity_unit, points"),
        ("a.toml", "point = []", "point: is unknown; known: normalized, opacity_unit, points"),
        ("a.toml", "opacity_unit = 0\n" + POINTS % "color = 'red', opacity = 1", "greater than 0"),
        ("a.toml", "points = [\n1 2]", r"a.toml: .*\(at line 2, column 3\)"),
        ("a.json", '{"points":\n [1 2]}', r"a.json: .*\(at line 2, column 5\)"),
    ],
)
def test_a_malformed_file_is_explained(tmp_path: Path, name: str, text: str, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        load_transfer(write(tmp_path, name, text))


def test_points_of_a_file_that_descend_are_named(tmp_path: Path) -> None:
    text = POINTS % "color = 'red', opacity = 1"
    path = write(tmp_path, "a.toml", text.replace("value = 0", "value = 2"))
    with pytest.raises(ValueError, match=r"a\.toml: points\.1\.value: must be finite and not desc"):
        load_transfer(path)


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ValueError, match=r"a\.json: is not UTF-8 text \(at byte 0\)"):
        load_transfer(path)


def test_a_file_that_is_not_there_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"absent\.toml"):
        load_transfer(tmp_path / "absent.toml")


SHOWN = {  # control points: value, opacity
    "above": [(20, 0.0), (30, 0.5)],
    "below": [(-20, 0.5), (-10, 0.0)],
    "two bands": [(-90, 0.0), (-80, 0.4), (-70, 0.0), (40, 0.0), (40, 0.2), (60, 0.2), (60, 0.0)],
    "all": [(0, 0.1)],
    "nothing": [(0, 0.0)],
}


@pytest.mark.parametrize("kind", ["u1", "i1", "<u2", ">i2", "i4", "f4"])
@pytest.mark.parametrize("name", SHOWN)
def test_values_are_seen_where_they_have_some_opacity(
    name: str, kind: str, rng: np.random.Generator
) -> None:
    transfer = from_points([(value, WHITE, opacity) for value, opacity in SHOWN[name]])
    values = rng.integers(0, 120, 500) if kind == "u1" else rng.integers(-120, 120, 500)
    values = values.astype(kind)
    expected = np.flatnonzero(transfer.opacities(values.astype(float), BYTE) > 0)
    np.testing.assert_array_equal(visible_places(transfer, values, BYTE), expected)


@pytest.mark.parametrize("kind", ["u1", "i1", "<u2", ">i2"])
def test_tables_give_what_functions_give(kind: str, rng: np.random.Generator) -> None:
    values = rng.integers(0, 120, 500).astype(kind)
    np.testing.assert_array_equal(
        evaluated(RAMP.colors, values, BYTE), RAMP.colors(values.astype(float), BYTE)
    )
