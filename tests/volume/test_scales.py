"""Fields over decades, on logarithmic scales."""

from functools import partial

import numpy as np
import pytest
from matplotlib.colors import LogNorm, SymLogNorm

from resample.command.settings import Resampling
from resample_volume import cli
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.classification.presets import transfer_for
from resample_volume.classification.scales import LogScale, edges_of, on_scale, scale_named, scaled
from resample_volume.classification.value_statistics import survey
from resample_volume.command.choices import AppearanceChoices, ReadOptions
from resample_volume.command.inputs import prepared
from resample_volume.files.source import describe
from resample_volume.inputs import as_volume
from resample_volume.scenes import picked
from resample_volume.viewing import volume_view
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
VALUES = np.array([-300.0, -0.02, -0.004, 0.0, 0.004, 0.01, 0.5, 7000.0])
SIZE = {"size": (32, 32)}


def galaxy():
    """Density (16, 16, 16) over twelve decades, from the middle on; nothing in the last slice."""
    z, y, x = np.indices((16, 16, 16)) - 7.5
    density = 1e-20 * 10.0 ** -((x**2 + y**2 + z**2) ** 0.5)
    density[-1] = 0
    return density


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("galaxy.npy", galaxy())
    return "galaxy.npy"


def test_a_symmetric_logarithm_is_that_of_matplotlib():
    norm = SymLogNorm(0.01, vmin=-300, vmax=7000)
    place = LogScale(0.01).scaled(VALUES)
    share = (place - place[0]) / (place[-1] - place[0])
    np.testing.assert_allclose(share, norm(VALUES), rtol=1e-12)
    np.testing.assert_allclose(LogScale(0.01).value(place), VALUES, rtol=1e-12)


def test_a_logarithm_is_that_of_matplotlib():
    given = VALUES[4:]
    place = LogScale().scaled(given)
    share = (place - place[0]) / (place[-1] - place[0])
    np.testing.assert_allclose(share, LogNorm(*given[[0, -1]])(given), rtol=1e-12)
    assert np.isnan(LogScale().scaled(VALUES[:4])).all()


@pytest.mark.parametrize("text", ["symlog", "symlog:linear=0", "ln", "log:10", "symlog:linear=a"])
def test_a_scale_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match=r"give linear, log, or symlog:linear=0\.01"):
        scale_named(text)


def test_what_has_no_logarithm_is_missing_and_said():
    found = scaled(as_volume(galaxy()), "log")
    assert np.isnan(found.values[-1]).all()
    assert found.note == "256 voxels of 0 or below have no logarithm and are left out"
    np.testing.assert_allclose(found.values[:-1], np.log10(galaxy()[:-1]), rtol=1e-6)
    with pytest.raises(ValueError, match="no value above 0; take the scale symlog or linear"):
        scaled(as_volume(-galaxy()), "log")
    with pytest.raises(ValueError, match="array has colors; leave the scale log out"):
        scaled(as_volume(np.ones((4, 4, 4, 3))), "log")
    with pytest.raises(ValueError, match="has the scale log; leave the scale log out"):
        scaled(found, "log")


def test_padding_is_found_before_values_are_scaled():
    values = np.where(galaxy() > 0, 1e21 * galaxy(), -9999.0)
    found = scaled(as_volume(values), "symlog:linear=1e-5")
    assert found.note == "256 voxels of -9999 are taken for padding and left out"
    assert survey(found).high - survey(found).low < 7


def test_arrays_are_put_on_a_scale():
    found = as_volume(galaxy(), scale="log")
    np.testing.assert_array_equal(found.values, scaled(as_volume(galaxy()), "log").values)


def test_what_is_linear_stays_as_it_is():
    volume = as_volume(galaxy())
    assert scaled(volume, "linear") is volume


@pytest.mark.some(4)
@pytest.mark.parametrize("look", ["auto", "viridis", "1e-26/red/0,1e-24/gold/0.5", "1e-24.."])
@pytest.mark.parametrize("post", [False, True])
def test_a_field_of_decades_is_the_field_of_its_logarithms(look, post):
    density = galaxy()[:-1]
    logs = as_volume(np.log10(density).astype(np.float32))._replace(units="none")
    own = transfer_for(look, scaled(as_volume(density), "log"))
    points = look.replace("1e-26", "-26").replace("1e-24", "-24")
    same = transfer_for(points, logs) if ".." not in look else own
    how = {"light": None, "classification": "post" if post else "pre"}
    one = render(scaled(as_volume(density), "log"), Appearance(look, **how), **SIZE)
    two = render(logs, Appearance(same, **how), **SIZE)
    assert one.rgba[..., 3].max() > 0.2
    np.testing.assert_allclose(one.rgba, two.rgba, atol=1e-6)


def test_points_of_a_look_are_in_the_units_of_values():
    volume = scaled(as_volume(galaxy()), "log")
    look = transfer_for("1e-26/red/0,1e-24/gold/0.5", volume)
    np.testing.assert_allclose(look.value, [-26, -24])
    assert look.opacities(np.array([-25.0]), (0, 1)) == pytest.approx(0.25)
    with pytest.raises(ValueError, match="value 0 has no logarithm; on the scale log give"):
        transfer_for("0/red/0,1e-24/gold/0.5", volume)
    both = on_scale(transfer_for("1e-26..+1e-22..1e-20", as_volume(galaxy())), "log")
    assert [part.value[0] for part in both.parts] == pytest.approx([-26, -22])


def test_a_window_and_a_surface_are_in_the_units_of_values():
    volume = scaled(as_volume(galaxy()), "log")
    look = AppearanceChoices(transfer="gray", window="1e-26..1e-22").appearance(volume)
    np.testing.assert_allclose(look.transfer.value, [-26, -22])
    with pytest.raises(ValueError, match="the window's end -160 has no logarithm"):
        AppearanceChoices(window="40/400").appearance(volume)
    plain = as_volume(galaxy())
    assert AppearanceChoices(window="1..5").appearance(plain) == AppearanceChoices(
        window="3/4"
    ).appearance(plain)


@pytest.mark.parametrize("projection", ["maximum", "first-hit"])
def test_projections_are_of_logarithms(file, projection):
    volume = prepared(ReadOptions(scale="log"), file)
    iso = 1e-24 if projection == "first-hit" else None
    resampler = AppearanceChoices().renderer(
        Resampling(projection=projection, iso=iso), volume.scale
    )
    frame = render(volume, Appearance("gray"), (0, 0), resampler=resampler, **SIZE)
    if projection == "maximum":
        logs = as_volume(volume.values)
        same = render(logs, Appearance("gray"), (0, 0), resampler=resampler, **SIZE)
        np.testing.assert_array_equal(frame.value, same.value)
    else:
        assert resampler.iso == -24
        assert frame.rgba[16, 16, 3] == 1


def test_information_is_in_the_units_of_values(file, capsys):
    assert ended("info", file, "--scale", "log", "--bins", 4) == 0
    said = capsys.readouterr().out
    assert "scale        log" in said
    assert "256 voxels of 0 or below have no logarithm" in said
    facts = describe(prepared(ReadOptions(scale="log"), file), 4)
    inside = galaxy()[galaxy() > 0]
    np.testing.assert_allclose(facts["range"], [inside.min(), inside.max()], rtol=1e-5)
    counts, _ = np.histogram(np.log10(inside).astype(np.float32), 4)
    assert facts["histogram"] == counts.tolist()
    edges = edges_of((1e-8, 1.0), 4, "log")
    np.testing.assert_allclose(edges, [1e-8, 1e-6, 1e-4, 1e-2, 1], rtol=1e-12)


@pytest.mark.parametrize(
    ("scale", "span", "texts"),
    [
        (
            LogScale(),
            (1e-24, 1e-18),
            ["1e−24", "1e−23", "1e−22", "1e−21", "1e−20", "1e−19", "1e−18"],
        ),
        (LogScale(), (1.0, 100.0), ["1", "2", "5", "10", "20", "50", "100"]),
        (LogScale(), (1e-24, 1.0), ["1e−24", "1e−20", "1e−16", "1e−12", "1e−08", "0.0001", "1"]),
        (LogScale(0.1), (-10.0, 10.0), ["−10", "−1", "−0.1", "0", "0.1", "1", "10"]),
    ],
)
def test_decades_stand_beside_a_color_bar(scale, span, texts):
    low, high = scale.scaled(np.array(span)).tolist()
    ticks = scale.ticks((low, high), 7)
    assert list(ticks.values()) == texts
    values = [float(text.replace("−", "-")) for text in texts]
    np.testing.assert_allclose(list(ticks), scale.scaled(np.array(values)), rtol=1e-12, atol=1e-12)


def test_a_narrow_range_has_ticks_too():
    low, high = LogScale().scaled(np.array([3.1, 3.4])).tolist()
    assert len(LogScale().ticks((low, high), 7)) >= 2


@pytest.mark.sweep
def test_a_picture_on_a_scale_has_its_bar(file):
    words = ("--scale", "log", "--transfer", "viridis", "--color-bar", "--size", 64)
    assert ended("render", file, "-o", "a.png", *words) == 0


def test_what_is_converted_keeps_its_values(file, capsys):
    assert "leave the scale log out" in refused(
        capsys, "convert", file, "a.ome.zarr", "--scale", "log"
    )


@pytest.mark.sweep
def test_a_page_speaks_of_values(file):
    view = volume_view(file, ReadOptions(scale="log"))
    assert view.about["histogram"]["scale"] == "log"
    painter = view.painter()
    told = painter.tell({"transfer": "1e-26/red/0,1e-24/gold/0.5"}, "points")
    assert [point[0] for point in told["points"]] == pytest.approx([1e-26, 1e-24])
    assert told["transfer"] == "1e-26,#ff0000,0 1e-24,#ffd700,0.5"


def test_the_voxel_that_is_picked_has_its_value():
    density = galaxy()
    found = picked(scaled(as_volume(density), "log"), np.ravel_multi_index((5, 8, 9), (16,) * 3))
    assert found.value == pytest.approx(density[5, 8, 9], rel=1e-5)
