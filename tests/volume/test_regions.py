"""Transfer functions over values and gradients: what they give, what files hold, tables."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from resample.colors import from_srgb
from resample_volume.classification.presets import PRESETS, load_transfer
from resample_volume.classification.transfer import (
    MOST_OPAQUE,
    Faded,
    Region,
    RegionTransfer,
    from_points,
    tabulated,
)
from resample_volume.types import Volume
from resample_volume.voxels.visible import classify, max_gradient

RED, BLUE, WHITE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)
BYTE = (0.0, 255.0)
INF = float("inf")
BOX = Region((50, 150), RED, 0.5, (10, 40))
SOFT = Region((50, 150), BLUE, 0.8, (10, 40), (20, 10))


def one(*regions: Region, **options: object) -> RegionTransfer:
    return RegionTransfer(regions, **options)


def opacities(transfer: RegionTransfer, values: object, slopes: object) -> list[float]:
    value, slope = np.array(values, float), np.array(slopes, np.float32)
    opacity = transfer.classify(value, slope, BYTE, 20.0)[1]
    return [round(float(share), 6) for share in opacity]


def naive_share(place: float, span: tuple[float, float], soft: float) -> float:
    if not span[0] <= place <= span[1]:
        return 0.0
    depth = min(place - span[0], span[1] - place)
    return min(depth / soft, 1.0) if soft else 1.0


def naive_looks(transfer: RegionTransfer, value: float, slope: float) -> tuple[np.ndarray, float]:
    """Closed regions of data units, one after the other."""
    clear, weight, color = 1.0, 0.0, np.zeros(3)
    for region in transfer.regions:
        share = naive_share(value, region.value, region.softness[0])
        opacity = region.opacity * share * naive_share(slope, region.gradient, region.softness[1])
        clear *= 1 - opacity
        weight += opacity
        color += opacity * from_srgb(np.array(region.color))
    return color / weight if weight else color, 1 - clear


def ramp_volume(rng: np.random.Generator, kind: str = "f4") -> Volume:
    values = (rng.random((6, 7, 8)) * 200).astype(kind)
    return Volume(values, np.ones(3), np.zeros(3), np.eye(3), "test")


def test_a_hard_region_holds_its_borders() -> None:
    found = opacities(one(BOX), [49.99, 50, 150, 150.01, 100, 100], [20, 10, 40, 20, 9.9, 40.1])
    assert found == [0, 0.5, 0.5, 0, 0, 0]


def test_a_soft_region_rises_from_its_borders_inwards() -> None:
    found = opacities(one(SOFT), [50, 55, 60, 70, 140, 150], [25] * 6)
    assert found == pytest.approx([0, 0.2, 0.4, 0.8, 0.4, 0])
    found = opacities(one(SOFT), [100] * 4, [10, 15, 20, 35])
    assert found == pytest.approx([0, 0.4, 0.8, 0.4])


def test_a_range_without_an_end_is_not_soft_there() -> None:
    open_end = Region((50, INF), RED, 0.5, (0, 40), (20, 10))
    assert opacities(one(open_end), [1e30, 60], [0, 0]) == [0.5, 0.25]


def test_normalized_ranges_are_open_where_the_data_end() -> None:
    whole = one(Region((0, 1), RED, 0.5, (0.5, 1), (0.2, 0.2)), normalized=True)
    assert opacities(whole, [0, 255, -9, 300], [20, 99, 20, 20]) == [0.5] * 4


def test_normalized_gradients_are_fractions_of_a_full_surface_s() -> None:
    steep = one(Region((0, 1), RED, 0.5, (0.5, 1)), normalized=True)
    assert opacities(steep, [7, 7], [9.9, 10]) == [0, 0.5]  # 20 is full


def test_an_even_volume_has_gradients_of_0() -> None:
    inner = one(Region((0, 1), RED, 0.5, (0, 0.5)), normalized=True)
    _, opacity = inner.classify(np.ones(2), np.array([0, 1], np.float32), BYTE, 0.0)
    assert opacity.tolist() == [0.5, 0]


def test_constant_data_are_at_the_top_of_normalized_values() -> None:
    top = one(Region((0.9, 1), RED, 0.5), normalized=True)
    assert top.classify(np.full(1, 3.0), np.zeros(1, np.float32), (3.0, 3.0), 1.0)[1] == 0.5


def test_nan_is_transparent_and_black() -> None:
    for transfer in (one(BOX, SOFT), PRESETS["surfaces"]()):
        color, opacity = transfer.classify(
            np.array([np.nan]), np.full(1, 20, np.float32), BYTE, 20.0
        )
        assert opacity == 0
        assert (color == 0).all()
        assert transfer.opacities([np.nan], BYTE) == 0


def test_regions_that_overlap_agree_with_the_obvious_loop(rng: np.random.Generator) -> None:
    transfer = one(BOX, SOFT, Region((100, 200), WHITE, 0.3, (0, 20)))
    value, slope = rng.uniform(30, 220, 400), rng.uniform(0, 50, 400).astype(np.float32)
    color, opacity = transfer.classify(value, slope, BYTE, 20.0)
    for n in range(400):
        wanted, share = naive_looks(transfer, value[n], float(slope[n]))
        assert opacity[n] == pytest.approx(share, abs=1e-6)
        np.testing.assert_allclose(color[n], wanted, atol=1e-6)


def test_the_order_of_regions_does_not_matter(rng: np.random.Generator) -> None:
    value, slope = rng.uniform(0, 255, 99), rng.uniform(0, 50, 99).astype(np.float32)
    some = one(BOX, SOFT).classify(value, slope, BYTE, 1.0)
    other = one(SOFT, BOX).classify(value, slope, BYTE, 1.0)
    for left, right in zip(some, other, strict=True):
        np.testing.assert_allclose(left, right, atol=1e-6)


def test_many_values_are_looked_at_in_chunks(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    value, slope = rng.uniform(0, 255, 99), rng.uniform(0, 50, 99).astype(np.float32)
    whole = one(BOX, SOFT).classify(value, slope, BYTE, 1.0)
    monkeypatch.setattr("resample_volume.classification.transfer.CHUNK", 10)
    for left, right in zip(one(BOX, SOFT).classify(value, slope, BYTE, 1.0), whole, strict=True):
        np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("name", ["box", "soft", "surfaces"])
def test_no_slope_makes_a_value_more_opaque_than_was_said(
    name: str, rng: np.random.Generator
) -> None:
    transfer = {"box": one(BOX), "soft": one(BOX, SOFT), "surfaces": PRESETS["surfaces"]()}[name]
    value, slope = rng.uniform(0, 255, 999), rng.uniform(0, 50, 999).astype(np.float32)
    assert (transfer.classify(value, slope, BYTE, 30.0)[1] <= transfer.opacities(value, BYTE)).all()


def test_thinned_regions_have_a_share_of_their_opacity() -> None:
    assert opacities(one(BOX).thinned(0.2), [100], [20]) == [0.1]


def test_what_is_cut_is_transparent_and_the_rest_of_a_hard_region_stays() -> None:
    cut = one(BOX, Region((0, 60), BLUE, 1.0)).cut(100)
    assert opacities(cut, [55, 99.9, 100, 150], [20] * 4) == [0, 0, 0.5, 0.5]
    assert opacities(one(BOX).cut(200), [100, 250], [20] * 2) == [0, 0]


def test_a_cut_through_a_soft_border_leaves_a_region_that_is_allowed() -> None:
    found = opacities(one(SOFT).cut(130), [129, 140, 145], [20] * 3)
    assert found == pytest.approx([0, 0.8, 0.4])  # softness 10 is all that fits


@pytest.mark.parametrize("kind", ["u1", "i2", "f4"])
def test_classified_voxels_are_those_that_regions_show(kind: str, rng: np.random.Generator) -> None:
    volume, transfer = ramp_volume(rng, kind), one(BOX, SOFT)
    voxels = classify(volume, transfer)
    whole = classify(volume, from_points([(0, WHITE, 0.5)]))
    length = np.linalg.norm(whole.gradient, axis=1)
    color, opacity = transfer.classify(volume.values.ravel(), length, BYTE, 0.0)
    is_seen = opacity > 0
    assert 0 < is_seen.sum() < is_seen.size
    np.testing.assert_array_equal(voxels.position, whole.position[is_seen])
    np.testing.assert_array_equal(voxels.color, color[is_seen])
    np.testing.assert_array_equal(voxels.gradient, whole.gradient[is_seen])
    np.testing.assert_allclose(1 - np.exp(-voxels.extinction), opacity[is_seen], atol=1e-6)


def test_gradient_opacity_fades_regions_too(rng: np.random.Generator) -> None:
    volume = ramp_volume(rng)
    free = Region((0, 255), RED, 0.5)
    faded = classify(volume, one(free), gradient_opacity=(0.2, 0.6))
    same = classify(volume, from_points([(0, RED, 0.5)]), gradient_opacity=(0.2, 0.6))
    np.testing.assert_array_equal(faded.position, same.position)
    np.testing.assert_array_equal(faded.extinction, same.extinction)


def test_regions_without_a_gradient_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(
        ValueError, match=r"regions or .* needs a gradient; choose central or sobel"
    ):
        classify(ramp_volume(rng), one(BOX), gradient=None)


@pytest.mark.parametrize(
    ("region", "options", "match"),
    [
        ({"value": (5, 1)}, {}, r"regions.0.value: must be two numbers that ascend, .*got 5, 1"),
        ({"value": (0, np.nan)}, {}, r"regions.0.value: must be two numbers that ascend"),
        ({"value": (0, 9)}, {"normalized": True}, r"regions.0.value: .* from 0 to 1 \(got 0, 9\)"),
        ({"gradient": (-1, 5)}, {}, r"regions.0.gradient: .*ascend, from 0 to inf \(got -1, 5\)"),
        ({"gradient": (0, 5)}, {"normalized": True}, r"regions.0.gradient: .* from 0 to 1"),
        ({"opacity": 2}, {}, r"regions.0.opacity: must be between 0 and 1 \(got 2\)"),
        ({"color": (0, 0, 2)}, {}, r"regions.0.color: must be between 0 and 1"),
        (
            {"softness": (60, 0)},
            {},
            r"regions.0.softness: .*half the range's width \(got 60 for 50",
        ),
        ({"softness": (0, -1)}, {}, r"regions.0.softness: must be from 0"),
        ({}, {"opacity_unit": 0.0}, "opacity_unit: must be greater than 0"),
    ],
)
def test_numbers_out_of_range_are_refused(region: dict, options: dict, match: str) -> None:
    whole = replace(BOX, value=(0.2, 0.4), gradient=(0, INF)) if "normalized" in options else BOX
    with pytest.raises(ValueError, match=match):
        one(replace(whole, **region), **options)


def test_no_regions_are_refused() -> None:
    with pytest.raises(ValueError, match="needs at least one"):
        RegionTransfer(())


def test_ranges_without_an_end_are_null_in_json_and_inf_in_toml(tmp_path: Path) -> None:
    region = '"value": [50, null], "color": "#ff0000", "opacity": 0.5'
    as_json = f'{{"opacity_unit": 0.1, "regions": [{{{region}}}]}}'
    as_toml = region.replace('"value":', "value =").replace('"color":', "color =")
    as_toml = as_toml.replace('"opacity":', "opacity =").replace("null", "inf")
    (tmp_path / "a.json").write_text(as_json, "utf-8")
    (tmp_path / "a.toml").write_text(f"opacity_unit = 0.1\nregions = [{{{as_toml}}}]", "utf-8")
    wanted = one(Region((50, INF), (1.0, 0.0, 0.0), 0.5), opacity_unit=0.1)
    assert load_transfer(tmp_path / "a.json") == load_transfer(tmp_path / "a.toml") == wanted


def test_a_region_in_a_file_may_leave_out_gradient_and_softness(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(
        "regions = [{ value = [80, inf], color = 'tomato', opacity = 0.5 }]", encoding="utf-8"
    )
    (region,) = load_transfer(tmp_path / "a.toml").regions
    assert (region.value, region.gradient, region.softness) == ((80, INF), (0, INF), (0, 0))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("regions = []", "regions: .*at least 1 item"),
        ("regions = [3]", "regions.0: must be a table of value, color, opacity, gradient, soft"),
        ("regions = [{ value = [1, 2], color = 'red' }]", "regions.0.opacity: is missing$"),
        ("regions = [{ VALUE }]", "regions.0.value: must be two numbers, .*least, greatest"),
        ("regions = [{ value = [2, 1], REST }]", "regions.0.value: must be two numbers that asc"),
        ("regions = [{ value = [1, 2], soft = 1, REST }]", "soft: is unknown; known: value, color"),
        (
            "regions = [{ value = [1, 2], softness = 0.5, REST }]",
            r"regions.0.softness: must be two numbers, \[along values",
        ),
        ("regions = [{ value = [1, nan], REST }]", r"must be two numbers, \[least"),
        ("points = []\nregions = [{ value = [1, 2], REST }]", "points: is unknown; known: .*regio"),
        ("region = []", "region: is unknown; known: normalized, opacity_unit, points, regions"),
    ],
)
def test_one_line_says_what_is_wrong_with_a_file(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "a.toml"
    rest = "color = 'red', opacity = 1"
    path.write_text(text.replace("VALUE", f"value = 3, {rest}").replace("REST", rest), "utf-8")
    with pytest.raises(ValueError, match=rf"a\.toml: .*{match}") as error:
        load_transfer(path)
    assert "\n" not in str(error.value)


def test_a_function_of_values_is_tabulated_in_one_row() -> None:
    looks = tabulated(load_transfer("engine"), BYTE, 30.0, 2.0, (8, 256))
    color, opacity = load_transfer("engine")(np.arange(256), BYTE)
    assert looks.table.shape == (1, 256, 4)
    assert looks[1:] == (0, 255, 1)
    np.testing.assert_array_equal(looks.table[0, :, :3], color)
    np.testing.assert_allclose(1 - np.exp(-2 * looks.table[0, :, 3]), opacity, atol=1e-6)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "transfer",
    [
        one(SOFT),
        PRESETS["surfaces"](),
        Faded(from_points([(0, RED, 0.1), (255, RED, 0.3)]), (0.1, 0.6)),
    ],
    ids=["absolute", "normalized", "faded"],
)
def test_a_table_looks_like_the_function_at_any_slope(
    transfer: RegionTransfer, rng: np.random.Generator
) -> None:
    looks = tabulated(transfer, BYTE, 50.0, 1.0, (512, 1024))
    value, slope = rng.uniform(0, 255, 500), rng.uniform(0, 90, 500).astype(np.float32)
    row, column = slope / looks.steep * 511, value / 255 * 1023
    wanted = transfer.classify(value, slope, BYTE, 50.0)[1]
    # Bilinear, beyond the last row and column as there
    from scipy.ndimage import map_coordinates

    found = 1 - np.exp(
        -map_coordinates(looks.table[..., 3].astype(float), [row, column], order=1, mode="nearest")
    )
    np.testing.assert_allclose(found, wanted, atol=0.01)  # cells of 0.25 and 0.1, ramps of 10


def test_a_hard_upper_border_is_kept_by_a_table() -> None:
    looks = tabulated(one(BOX), BYTE, 5.0, 1.0, (16, 256))
    assert looks.table[-1, :, 3].max() == 0  # what is steeper than all rows looks like the last
    assert looks.table[-2, 100, 3] > 0


def test_constant_data_are_tabulated_over_a_range_that_is_none() -> None:
    looks = tabulated(load_transfer("gray"), (3.0, 3.0), 0.0, 1.0, (1, 4))
    assert looks[1:] == (3, 4, 1)
    np.testing.assert_allclose(looks.table[..., 3], -np.log(1 - MOST_OPAQUE), rtol=1e-6)


def test_a_full_surface_is_the_99th_percentile() -> None:
    assert max_gradient(np.arange(101, dtype=np.float32)) == 99
    assert max_gradient(np.empty(0, np.float32)) == 0
    assert max_gradient(None) == 0


@pytest.mark.parametrize("transfer", [one(BOX), Faded(from_points([(0, RED, 1.0)]), (3.0, 9.0))])
def test_transfers_over_gradients_classify_nothing_without_them(transfer: object) -> None:
    with pytest.raises(ValueError, match="gradients"):
        transfer.classify(np.zeros(3), None, BYTE, 1.0)  # type: ignore[attr-defined]
