"""Distances and angles between places: against formulas, and as pages tell them."""

import numpy as np
import pytest

from resample.view.views import Settings
from resample_volume import measure
from resample_volume.inputs import as_volume
from resample_volume.scenes import picked
from resample_volume.viewing import VolumePainter
from resample_volume.voxels.visible import lattice_of

VALUES = np.zeros((9, 17, 17), np.uint8)
VALUES[4, 4, 4] = VALUES[4, 12, 4] = VALUES[4, 12, 12] = 200
VOLUME = as_volume(VALUES)._replace(
    spacing=np.array([2.0, 3.0, 1.0]), origin=np.array([5.0, -7.0, 100.0]), space="lps"
)


@pytest.mark.parametrize("angle", [0.001, 30.0, 90.0, 150.0, 179.999, 180.0])
def test_an_angle_is_that_between_two_ways(angle):
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    one, two = (
        np.array([2.0, 0, 0]),
        5 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0]),
    )
    middle = np.array([1e3, -50, 7])
    found = measure(turn @ one + middle, middle, turn @ two + middle)
    assert found.angle == pytest.approx(angle, abs=1e-9)
    assert found.distance == pytest.approx(7, rel=1e-12)


def test_voxels_are_as_far_apart_as_their_spacing_says():
    one, two = (
        picked(VOLUME, int(np.ravel_multi_index(at, VALUES.shape)))
        for at in ((4, 4, 4), (4, 12, 12))
    )
    found = measure(one, two, volume=VOLUME)
    assert found.distance == pytest.approx(np.hypot(16, 24))
    assert found.unit == "mm"
    assert measure(one, two, volume=VOLUME._replace(space="")).unit == ""


@pytest.mark.parametrize(
    ("places", "said"),
    [
        ([(0, 0, 0)], "1 points; give two"),
        ([(0, 0, 0)] * 4, "4 points; give two"),
        ([(0, 0, 0), (1, 2)], "3 finite numbers"),
        ([(0, 0, 0), (1, 2, np.nan)], "3 finite numbers"),
        ([(0, 0, 0), (0, 0, 0), (1, 0, 0)], "no angle"),
    ],
)
def test_what_cannot_be_measured_is_refused(places, said):
    with pytest.raises(ValueError, match=said):
        measure(*places)


def test_a_page_tells_how_far_picks_are_apart():
    painter, size = VolumePainter(VOLUME), (90, 90)
    settings: Settings = {
        "camera": "top", "fov": 0.0, "fit": "volume", "transfer": "100..300", "classify": "pre"
    }  # fmt: skip
    camera, volume = painter._scene.placed_view(
        "100..300", painter.parsed(settings).choices.viewpoint(), size=size
    )
    view = camera.view()

    def clicked(y, x):
        place = volume.origin + lattice_of(volume) @ np.array([x, y, 4.0])
        at = (view.rotation @ place + view.translation)[:2] * view.focal + view.principal
        return painter.pick(settings, size, *at)

    assert "distance" not in clicked(4, 4)
    assert clicked(12, 4)["distance"] == "24 mm"
    third = clicked(12, 12)
    assert (third["distance"], third["angle"]) == ("16 mm", "90°")
    again = clicked(12, 12)
    assert again["distance"] == "0 mm"
    assert "angle" not in again
    assert painter.pick(settings, size, 0.5, 0.5) == {}
    assert "distance" not in clicked(4, 4)
