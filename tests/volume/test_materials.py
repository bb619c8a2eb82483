"""Transfer functions of several materials, of ranges of values and over windows."""

from dataclasses import replace

import numpy as np
import pytest

from resample_volume.classification.presets import PRESETS, load_transfer, transfer_for
from resample_volume.classification.transfer import Faded, Materials, Windowed, from_points, spread
from resample_volume.classification.value_statistics import POINTS, Units, survey, tissue
from resample_volume.inputs import as_volume

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
VALUES = np.arange(-1000, 3000, 7).astype(np.float32)
BYTE = (0.0, 255.0)


def head(added=0.0):
    """Air, flesh and bone, of a type that could hold anything."""
    z, y, x = np.mgrid[:24, :24, :24] - 11.5
    away = np.sqrt(x**2 + y**2 + z**2)
    values = np.where(away < 9, 40, -1000) + np.where(away < 4, 900, 0)
    return as_volume((values + added).astype(np.int16))


def test_transparencies_of_materials_multiply_and_colors_are_weighted():
    both = Materials((from_points([(0, RED, 0.5)]), from_points([(0, BLUE, 0.25)])))
    color, opacity = both.classify(np.zeros(1, np.float32), None, BYTE, 1.0)
    assert opacity == pytest.approx([1 - 0.5 * 0.75])
    assert color[0] == pytest.approx([2 / 3, 0, 1 / 3])
    assert both.opacities([0.0], BYTE) == pytest.approx(opacity)


def test_the_order_of_materials_does_not_matter():
    one, other = (
        load_transfer(name) for name in ("skin:opacity=0.1+bone", "bone+skin:opacity=0.1")
    )
    for a, b in zip(
        one.classify(VALUES, None, BYTE, 1), other.classify(VALUES, None, BYTE, 1), strict=True
    ):
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_where_one_material_is_seen_it_looks_as_it_does_alone():
    both = load_transfer("skin:opacity=0.1+metal")
    metal = tissue("metal")
    value = np.array([2600, 3000], np.float32)
    alone = metal.classify(value, None, BYTE, 1)[1]
    skin = tissue("skin").thinned(0.1).classify(value, None, BYTE, 1)[1]
    np.testing.assert_allclose(both.opacities(value, BYTE), 1 - (1 - alone) * (1 - skin), atol=1e-6)


def test_materials_have_one_unit_and_gradients_where_one_has():
    plain, region = load_transfer("gray"), load_transfer("surfaces")
    assert Materials((plain, region)).needs_gradient
    assert not Materials((plain,)).needs_gradient
    assert replace(Materials((plain, region)), opacity_unit=2.0).opacity_unit == 2.0
    with pytest.raises(ValueError, match="the same opacity_unit"):
        Materials((plain, replace(plain, opacity_unit=2.0)))
    with pytest.raises(ValueError, match="at least one"):
        Materials(())


@pytest.mark.parametrize(
    ("name", "value", "opacity"),
    [
        ("300..900", [299, 360, 600, 840, 901], [0, 1, 1, 1, 0]),
        ("300..900:opacity=0.4", [330, 600], [0.2, 0.4]),
        ("500..", [499, 500, 9000], [0, 1, 1]),
        ("..-5", [-9000, -6, -4], [1, 1, 0]),
        ("-700..-200", [-701, -450, -199], [0, 1, 0]),
        ("1e2..1e+3:opacity=0.5", [99, 500, 1001], [0, 0.5, 0]),
    ],
)
def test_a_range_of_values_is_a_material(name, value, opacity):
    assert load_transfer(name).opacities(value, BYTE) == pytest.approx(opacity)


def test_a_material_has_a_color_of_its_own():
    color, _ = load_transfer("300..900:color=red,opacity=0.4").classify(
        np.array([600.0]), None, BYTE, 1
    )
    assert color[0] == pytest.approx(RED)
    for name in ("bone", "surfaces", "viridis"):
        color, opacity = load_transfer(f"{name}:color=red").classify(
            np.linspace(0, 255, 99), np.full(99, 9, np.float32), BYTE, 9.0
        )
        np.testing.assert_allclose(color[opacity > 0], np.tile(RED, ((opacity > 0).sum(), 1)))


def test_a_material_keeps_its_surfaces_alone():
    surfaces = load_transfer("engine:gradient=0.2/0.5,opacity=0.5")
    assert isinstance(surfaces, Materials)
    value = np.full(3, 200.0)
    _, opacity = surfaces.classify(value, np.array([0.0, 3.5, 9.0], np.float32), BYTE, 10.0)
    assert opacity == pytest.approx([0, 0.175, 0.35])
    faded = Faded(load_transfer("engine:opacity=0.5"), (0.2, 0.5))
    np.testing.assert_array_equal(
        opacity, faded.classify(value, np.array([0.0, 3.5, 9.0], np.float32), BYTE, 10.0)[1]
    )


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("..", "has no ends"),
        ("900..300", "does not ascend; give 300..900"),
        ("bone+skn", "unknown transfer function 'skn'"),
        ("bone+", "unknown transfer function ''"),
        ("bone:color=reddish", "bone:color=reddish: must be '#rrggbb', a color's name"),
        ("bone:gradient=0.5", "gradient must be two fractions such as 0.1,0.5"),
        ("bone:gradient=0.5/0.1", "must be two fractions that ascend"),
    ],
)
def test_a_wrong_material_is_explained(name, match):
    with pytest.raises(ValueError, match=match):
        load_transfer(name)


@pytest.mark.parametrize("name", [name for name in PRESETS if load_transfer(name).normalized])
def test_a_window_moves_fractions(name):
    transfer = load_transfer(name)
    moved = spread(transfer, (100.0, 500.0))
    assert not moved.normalized
    value, slope = np.linspace(50, 550, 999), np.linspace(0, 9, 999, dtype=np.float32)
    looks = moved.classify(value, slope, (-1e6, 1e6), 5.0)
    for a, b in zip(looks, transfer.classify(value, slope, (100.0, 500.0), 5.0), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-5)  # positions are float64, rounded otherwise


def test_what_is_in_data_units_is_not_moved():
    assert spread(load_transfer("engine"), (0.0, 1.0)) == load_transfer("engine")
    both = spread(load_transfer("engine+gray"), (0.0, 1.0))
    assert both.parts == (load_transfer("engine"), spread(load_transfer("gray"), (0.0, 1.0)))


def test_a_windowed_function_can_be_changed_like_any():
    moved = spread(load_transfer("surfaces"), (100.0, 500.0))
    assert isinstance(moved, Windowed)
    assert replace(moved, opacity_unit=3.0).opacity_unit == 3.0
    value = np.array([300.0])
    assert moved.thinned(0.5).opacities(value, BYTE) < moved.opacities(value, BYTE)


@pytest.mark.parametrize("added", [0.0, 1024.0])
@pytest.mark.parametrize("name", POINTS)
def test_tissues_are_where_hounsfield_units_are(name, added):
    volume = head(added)._replace(units="hu+1024" if added else "hu")
    assert survey(volume).units == Units(added)
    at_zero = tissue(name).classify(VALUES, None, BYTE, 1)
    looks = transfer_for(name, volume).classify(VALUES + added, None, BYTE, 1)
    for a, b in zip(looks, at_zero, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_auto_is_ct_where_units_say_so():
    assert transfer_for("auto", head()) == tissue("ct")
    assert transfer_for("auto", head(1024.0)) == tissue("ct", 1024.0)
    assert transfer_for("auto", head()._replace(units="none")) != tissue("ct")


def test_bone_is_a_fraction_where_units_are_none():
    assert transfer_for("bone", head()._replace(units="none")) == load_transfer("bone")
    assert transfer_for("bone", head()) == tissue("bone")


@pytest.mark.parametrize("name", POINTS)
def test_air_is_transparent_in_all_looks(name):
    assert tissue(name).opacities([-1000.0, -990.0], BYTE).max() == 0
