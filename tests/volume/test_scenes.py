"""A volume that is opened once: the same pictures as in one call, kept work, previews."""

import threading
import time

import numpy as np
import pytest
from numpy.typing import NDArray

from resample import Cancel, CancelledError
from resample.cameras.models import Camera
from resample.cameras.poses import look_at
from resample.cameras.viewpoints import Orbit
from resample.measuring.quality import psnr
from resample_volume import Appearance, Scene, render
from resample_volume.appearance import Classification
from resample_volume.classification.labels import Labels, Rule
from resample_volume.classification.transfer import from_points
from resample_volume.inputs import as_volume
from resample_volume.scenes import merged
from resample_volume.types import Volume
from resample_volume.voxels import gathered, visible
from tests.record import Record
from tests.volume.of_voxels import of_voxels

LOOK = from_points([(60.0, (0.9, 0.4, 0.1), 0.0), (140.0, (0.2, 0.6, 1.0), 0.2)])
PRE = of_voxels(LOOK)
POST = Appearance(LOOK, classification=Classification.POST)


def blob(side: int = 48) -> NDArray[np.uint8]:
    z, y, x = (np.indices((side, side, side)) + 0.5) / side - 0.5
    away = np.sqrt(x**2 + y**2 + 1.5 * z**2)
    ripple = 20 * np.sin(9 * x) * np.cos(7 * y)
    return np.clip(230 - 520 * away + ripple, 0, 255).astype(np.uint8)


@pytest.mark.some(1)
@pytest.mark.parametrize("look", [PRE, POST], ids=["pre", "post"])
def test_final_pictures_have_the_bits_of_a_call(look: Appearance) -> None:
    scene = Scene(blob())
    for camera in ((30, 20), (120, -10)):
        seen = scene.render(look, camera, size=(60, 40), fit="visible")
        assert seen.rgba.shape == (40, 60, 4)
        alone = render(blob(), look, camera, size=(60, 40))
        np.testing.assert_array_equal(seen.rgba, alone.rgba)
        assert not seen.statistics.is_preview


def test_a_look_is_worked_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, counts = Scene(blob()), [0]
    found = visible.gradients_at

    def counted(*given: object) -> object:
        counts[0] += 1
        return found(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(visible, "gradients_at", counted)
    for azimuth in (0, 40, 80):
        scene.render(PRE, (azimuth, 10), size=(20, 20))
    assert counts[0] == 1
    scene.render(of_voxels("bone"), size=(20, 20))
    assert counts[0] == 2


def test_the_view_stays_when_a_look_shows_less() -> None:
    scene = Scene(blob())
    thin = of_voxels(from_points([(180.0, (1.0, 1.0, 1.0), 0.0), (190.0, (1.0, 1.0, 1.0), 0.9)]))
    cut = of_voxels(LOOK, clip=("1/0/0",))
    spread = [scene.render(look, size=(60, 60)).coverage > 0.01 for look in (PRE, thin, cut)]
    assert spread[1].sum() < 0.7 * spread[0].sum()
    assert not (spread[1] & ~spread[0]).any()
    assert not (spread[2] & ~spread[0]).any()


@pytest.mark.some(1)
@pytest.mark.parametrize("look", [PRE, POST], ids=["pre", "post"])
def test_previews_are_alike_and_say_so(look: Appearance, record: Record) -> None:
    scene = Scene(blob(64))
    final = scene.render(look, size=(100, 100))
    preview = scene.render(look, size=(100, 100), quality="preview")
    assert preview.statistics.is_preview
    assert preview.statistics.samples < 0.2 * final.statistics.samples
    record.quality("preview", psnr(preview.rgba[..., :3], final.rgba[..., :3]))
    assert preview.rgba[..., 3].mean() == pytest.approx(final.rgba[..., 3].mean(), rel=0.05)


@pytest.mark.sweep
def test_fractions_of_the_range_stay_those_of_the_volume_in_previews() -> None:
    values = blob(64)
    values[32, 32, 32] = 255
    scene = Scene(values)
    final, preview = (
        scene.render(of_voxels("gray"), size=(60, 60), quality=quality)
        for quality in ("final", "preview")
    )
    assert preview.rgba[..., 3].mean() == pytest.approx(final.rgba[..., 3].mean(), rel=0.05)


def test_merged_voxels_are_means_at_their_place() -> None:
    values = np.arange(5 * 4 * 6, dtype=np.float64).reshape(5, 4, 6)
    values[0, 0, 0] = np.nan
    turn = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
    volume = Volume(values, np.array([1.0, 2, 3]), np.array([5.0, 6, 7]), turn, "v")
    coarse = merged(volume, 2)
    assert coarse.values.shape == (3, 2, 3)
    assert coarse.values[0, 0, 0] == pytest.approx(np.nanmean(values[:2, :2, :2]))
    assert coarse.values[2, 1, 2] == pytest.approx(values[4:, 2:, 4:].mean())
    np.testing.assert_allclose(coarse.spacing, [2, 4, 6])
    np.testing.assert_allclose(coarse.origin, [5 + 1, 6 + 0.5, 7 + 1.5])
    whole = merged(as_volume(np.full((4, 4, 4), 7, np.uint8)), 2)
    assert whole.values.dtype == np.uint8
    assert (whole.values == 7).all()


@pytest.mark.sweep
def test_a_picture_is_cancelled_and_the_next_is_the_same() -> None:
    scene, cancel = Scene(blob()), Cancel()
    before = scene.render(POST, size=(300, 300)).rgba
    threading.Timer(0.05, cancel.cancel).start()

    def again() -> None:
        until = time.perf_counter() + 30
        while time.perf_counter() < until:
            scene.render(POST, size=(300, 300), cancel=cancel)

    with pytest.raises(CancelledError):
        again()
    np.testing.assert_array_equal(scene.render(POST, size=(300, 300)).rgba, before)


def test_choices_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="quality 'best'; it can be final or preview"):
        Scene(blob(8)).render(quality="best")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="a volume of int"):
        Scene(3)
    assert Scene(blob(8)).render(camera=Orbit(10, 10, 2.0), size=(8, 8)).rgba.any()


@pytest.mark.sweep
def test_new_looks_find_nothing_of_the_values_again(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(blob())
    before = scene.render(POST, size=(40, 30)).rgba

    def refused(*_: object) -> None:
        raise AssertionError("it was found before")

    for name in ("spline_of", "_without_gaps"):
        monkeypatch.setattr(gathered, name, refused)
    other = Appearance("bone", classification=Classification.POST)
    assert scene.render(other, size=(40, 30)).rgba.any()
    np.testing.assert_array_equal(scene.render(POST, size=(40, 30)).rgba, before)
    with pytest.raises(AssertionError, match="found before"):
        Scene(blob()).render(POST, size=(40, 30))


@pytest.mark.sweep
def test_previews_have_the_size_and_view_of_final_pictures(record: Record) -> None:
    scene, eye = Scene(blob(64)), Camera.from_fov(30, 41, 57, look_at((-150, 20, 60), (31, 31, 31)))
    for camera in (eye, (30, 20, 1.5, 0.2, -0.1)):
        final, preview = (
            scene.render(POST, camera, size=(57, 41), quality=quality)
            for quality in ("final", "preview")
        )
        assert preview.rgba.shape == (41, 57, 4)
        assert preview.depth.shape == preview.coverage.shape == (41, 57)
        assert preview.rgba.flags.c_contiguous
        record.quality(
            f"preview from {type(camera).__name__}",
            psnr(preview.rgba[..., :3], final.rgba[..., :3]),
        )
        both = np.isfinite(preview.depth) & np.isfinite(final.depth)
        assert np.median(np.abs(preview.depth[both] - final.depth[both])) < 1.5


def test_a_pan_moves_the_picture(record: Record) -> None:
    scene = Scene(blob())
    for fov in (0.0, 40.0):
        here = scene.render(PRE, Orbit(30, 20, 0.4, fov), size=(80, 60)).rgba
        there = scene.render(PRE, Orbit(30, 20, 0.4, fov, pan=(0.2, 0.1)), size=(80, 60)).rgba
        moved = np.roll(here, (-6, 12), axis=(0, 1))
        record.quality(f"picture at {fov:g}°", psnr(there[..., :3], moved[..., :3]))


def test_choices_may_be_given_by_name() -> None:
    assert Appearance(classification="post") == Appearance(  # type: ignore[arg-type]
        classification=Classification.POST
    )
    with pytest.raises(ValueError, match="sideways"):
        Appearance(classification="sideways")  # type: ignore[arg-type]


@pytest.mark.some(1)
@pytest.mark.parametrize("side", [48, 45])
def test_previews_are_cut_where_pictures_are(side: int, record: Record) -> None:
    scene = Scene(blob(side))
    for look in (Appearance(LOOK, crop="4:24,20:,:"), Appearance(LOOK, clip=("1/1/-0.5/4",))):
        final, preview = (
            scene.render(look, (40, 25), size=(80, 80), quality=quality)
            for quality in ("final", "preview")
        )
        whole = scene.render(PRE, (40, 25), size=(80, 80))
        found = psnr(preview.rgba, final.rgba)
        record.quality(f"preview with crop {look.crop}", found)
        assert found > psnr(preview.rgba, whole.rgba) + 6


def test_previews_have_labels(record: Record) -> None:
    values = blob()
    labels = Labels((np.indices(values.shape)[2] > 24).astype(np.uint8), {1: Rule(opacity=0)})
    scene, look = Scene(values), Appearance(LOOK, labels=labels)
    final = scene.render(look, size=(80, 80))
    preview = scene.render(look, size=(80, 80), quality="preview")
    found = psnr(preview.rgba, final.rgba)
    record.quality("preview", found)
    assert found > psnr(preview.rgba, scene.render(PRE, size=(80, 80)).rgba) + 6
