"""Light that gets to voxels past all others, against integrals along every voxel's own way."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from resample.cameras.viewpoints import Orbit
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_comparisons.volume.painting import ImageSheets
from resample_volume.appearance import Appearance, Classification
from resample_volume.calls import render
from resample_volume.classification.transfer import from_points
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from resample_volume.voxels import shading
from resample_volume.voxels.shading import SKIPPED, Light, light_transmittance, optical_depths
from tests.record import Record

WHITE = (1.0, 1.0, 1.0)
LOOK = from_points([(99.0, WHITE, 0.0), (100.0, WHITE, 0.9)])
UNEVEN = np.array([[1.0, 0.1, 0.0], [0.0, 1.2, 0.2], [0.0, 0.0, 0.8]])
FAR = 60.0  # cells
SHORT = 0.05  # cells, a step
EACH = 7  # one cell of so many is looked at; shares no factor with the sides of a volume
WAYS = [(1, 0.5, 0.3), (-0.2, -1, 0.4), (0.3, 0.4, -1), (0, 0, 1), (0, -1, 0), (-1, 1, 1)]


def smooth(shape: tuple[int, int, int] = (24, 27, 30)) -> NDArray[np.float32]:
    """Two soft balls."""
    index = np.moveaxis(np.indices(shape), 0, -1)
    parts = [
        np.exp(-(((index - np.array(center)) / 4) ** 2).sum(axis=-1))
        for center in ((9, 10, 11), (15, 18, 16))
    ]
    return np.asarray(0.1 * parts[0] + 0.07 * parts[1], np.float32)


def slow_depths(
    extinction: NDArray[np.float32], lattice: NDArray[np.float64], toward: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Integrals from 1½ slices beside cells on, in short steps through trilinear values."""
    along = np.linalg.solve(lattice, toward / np.linalg.norm(toward))[::-1]
    index = np.indices(extinction.shape).reshape(3, -1)[:, ::EACH]
    begin = (SKIPPED - 0.5) / np.abs(along).max()
    total = np.zeros(index.shape[1])
    for way in np.arange(begin + SHORT / 2, FAR, SHORT):
        place = index + along[:, None] * way
        total += SHORT * map_coordinates(
            extinction, place, np.float64, order=1, mode="grid-constant"
        )
    return total


@pytest.mark.sweep
@pytest.mark.parametrize("toward", WAYS)
@pytest.mark.parametrize("lattice", [np.eye(3), UNEVEN], ids=["even", "uneven"])
def test_depths_are_integrals_toward_the_light(
    toward: tuple[float, ...], lattice: NDArray[np.float64], record: Record
) -> None:
    extinction, way = smooth(), np.array(toward, float)
    depth = np.full(extinction.shape, np.nan)
    for place, part in optical_depths(extinction, lattice, way / np.linalg.norm(way)):
        depth[place] = part
    slow = slow_depths(extinction, lattice, way)
    assert slow.max() > 0.5
    record.error("largest", np.abs(depth.ravel()[::EACH] - slow).max())


def test_what_is_out_of_reach_takes_nothing() -> None:
    extinction = np.zeros((30, 4, 4), np.float32)
    extinction[20:] = 1.0
    depth = np.empty_like(extinction)
    for place, part in optical_depths(extinction, np.eye(3), np.array([0.0, 0, 1]), reach=6.0):
        depth[place] = part
    near = 20 - 6 - SKIPPED
    assert not depth[: near + 1].any()
    np.testing.assert_allclose(depth[near + 1 : near + 7, 2, 2], [1, 2, 3, 4, 5, 6], rtol=1e-5)


def test_a_ball_casts_a_shadow_as_thick_as_itself() -> None:
    z, y, x = np.indices((60, 40, 40))
    ball = (z - 45) ** 2 + (y - 20) ** 2 + (x - 20) ** 2 < 8.0**2
    light = Light((0, 0, 1), shadows=True)
    share = light_transmittance(np.float32(0.05) * ball, np.eye(3), light)[..., 0] / 255
    assert share[10, 20, 20] == pytest.approx(np.exp(-0.05 * 15), abs=0.01)
    chord = 2 * np.sqrt(8.0**2 - 5.0**2)
    assert share[10, 20, 25] == pytest.approx(np.exp(-0.05 * chord), abs=0.04)
    assert (share[:, 20, 32] == 1).all()
    assert (share[55:] == 1).all()


@pytest.mark.sweep
def test_walls_darken_corners_and_floors_do_not() -> None:
    extinction = np.zeros((40, 60, 60), np.float32)
    extinction[:10] = 3.0
    flat = light_transmittance(extinction, np.eye(3), Light(occlusion=True))[..., 1] / 255
    assert flat[10, 30, 30] > 0.85
    assert flat[30, 30, 30] == 1
    extinction[:, :, 40:] = 3.0
    walled = light_transmittance(extinction, np.eye(3), Light(occlusion=True))[..., 1] / 255
    assert walled[11, 30, 37] < 0.75 * flat[11, 30, 30]
    assert walled[11, 30, 10] == pytest.approx(flat[11, 30, 10], abs=0.02)


def test_light_is_all_there_where_it_is_not_asked_for() -> None:
    assert (light_transmittance(smooth(), np.eye(3), Light((1, 0, 0))) == 255).all()


def lamps(light: Light, volume: NDArray[np.generic], **choices: object) -> NDArray[np.float32]:
    look = Appearance(LOOK, light=light, framing=LOOK, **choices)  # type: ignore[arg-type]
    return render(volume, look, Orbit(0, 35, 1), size=(120, 120)).rgba


def table_and_block() -> NDArray[np.float32]:
    values = np.zeros((40, 44, 44), np.float32)
    values[4:10, 2:-2, 2:-2] = 200
    values[22:34, 16:28, 16:28] = 200
    return values


@pytest.mark.sweep
@pytest.mark.parametrize("classification", list(Classification))
def test_a_block_shades_the_table_below_it(classification: Classification) -> None:
    lit = Light((0, 0, 1), specular=0.0)
    bright = lamps(lit, table_and_block(), classification=classification)
    shaded = lamps(
        Light((0, 0, 1), specular=0.0, shadows=True),
        table_and_block(),
        classification=classification,
    )
    dark = bright[..., 0] - shaded[..., 0] > 0.3
    # 12 of 40 columns of the table are in the shadow, of which the block hides some.
    on_table = bright[..., 0] > 0.5
    assert 0.02 < dark.sum() / on_table.sum() < 0.2
    np.testing.assert_allclose(shaded[..., 3], bright[..., 3], atol=0.004)


def test_what_is_cut_away_casts_no_shadow(record: Record) -> None:
    light, cut = Light((0, 0, 1), specular=0.0, shadows=True), "0/0/-1/0"
    for classification in Classification:
        given = {"classification": classification, "clip": (cut,)}
        shaded = lamps(light, table_and_block(), **given)
        bright = lamps(Light((0, 0, 1), specular=0.0), table_and_block(), **given)
        on_top = bright[..., 0] > 0.8
        assert on_top.sum() > 500
        record.error(f"{classification} on top", np.abs(shaded - bright)[on_top].max())


def test_surfaces_take_shadows_and_gaps_cast_none() -> None:
    values = table_and_block()
    paint = Resampler(order=Rays(), projection=Projection.FIRST_HIT, iso=100.0)
    shade = Light((0, 0, 1), specular=0.0, shadows=True)

    def seen(light: Light, volume: NDArray[np.generic]) -> NDArray[np.float32]:
        look = Appearance(LOOK, light=light)
        return render(volume, look, Orbit(0, 35), size=(90, 90), resampler=paint).rgba

    def darkness(volume: NDArray[np.generic]) -> float:
        bright = seen(Light((0, 0, 1), specular=0.0), volume)
        return float((bright[..., 0] - seen(shade, volume)[..., 0] > 0.3).mean())

    assert darkness(values) > 0.005
    values[22:34] = np.nan
    assert darkness(values) < 0.001


@pytest.mark.sweep
def test_large_volumes_share_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    light = Light((1, -1, 2), shadows=True, occlusion=True)
    for classification in Classification:
        fine = lamps(light, table_and_block(), classification=classification)
        monkeypatch.setattr(shading, "FINEST", 22)
        coarse = lamps(light, table_and_block(), classification=classification)
        monkeypatch.undo()
        assert 1e-4 < np.abs(fine - coarse).mean() < 0.02


@pytest.mark.sweep
def test_fading_even_regions_changes_what_takes_light() -> None:
    values = gaussian_filter(table_and_block(), 1.0)
    solid = lamps(Light((0, 0, 1), shadows=True), values, classification=Classification.POST)
    for classification in Classification:
        hollow = lamps(
            Light((0, 0, 1), shadows=True),
            values,
            classification=classification,
            gradient_opacity=(0.2, 0.6),
        )
        assert np.isfinite(hollow).all()
        assert hollow[..., :3].mean() != solid[..., :3].mean()


def test_nothing_to_see_is_a_picture_of_nothing() -> None:
    light = Light((0, 0, 1), shadows=True, occlusion=True)
    for classification in Classification:
        with pytest.warns(UserWarning, match="nothing of .* is visible|all values of"):
            nothing = lamps(light, np.zeros((5, 5, 5)), classification=classification)
        assert not nothing.any()


def test_a_lamp_at_the_eye_casts_no_shadows() -> None:
    with pytest.raises(ValueError, match=r"casts no visible shadows; give it a direction"):
        Light(shadows=True)


@pytest.mark.parametrize(
    ("paint", "message"),
    [
        (
            Resampler(order=Rays(), projection=Projection.MAXIMUM),
            "need the projection composite or first-hit",
        ),
        (Resampler(order=ImageSheets()), "needs the order rays"),
    ],
)
def test_shadows_say_what_they_need(paint: Resampler, message: str) -> None:
    look = Appearance(LOOK, Light((0, 0, 1), shadows=True), classification=Classification.POST)
    with pytest.raises(ValueError, match=message):
        Subject.of(as_volume(table_and_block()), look, paint)
