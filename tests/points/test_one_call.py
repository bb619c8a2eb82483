"""`resample_points.render` takes what people have: files, arrays, clouds, 3D Gaussians."""

from types import SimpleNamespace

import numpy as np
import pytest

import resample
from resample.colors import from_srgb
from resample_points import (
    Cloud,
    CloudScene,
    CloudStyle,
    GaussianStyle,
    framed,
    gaussian_camera,
    prepare_cloud,
    read_gaussians,
    render,
    render_cloud,
    render_gaussians,
)

RNG = np.random.default_rng(1)
PLACE = RNG.normal(size=(1500, 3))
PLACE /= np.linalg.norm(PLACE, axis=1)[:, None]
SIZE = (48, 36)
GAUSSIANS = resample.sample_path("sample:knot-gaussians")


@pytest.mark.parametrize(
    "scene",
    [PLACE, PLACE.tolist(), Cloud(PLACE), SimpleNamespace(points=PLACE), CloudScene(Cloud(PLACE))],
    ids=["array", "list", "cloud", "points", "scene"],
)
def test_positions_are_drawn_like_a_cloud(scene):
    cloud = prepare_cloud(Cloud(PLACE))
    camera = framed(cloud, size=SIZE, azimuth=30, elevation=20)
    expected = render_cloud(cloud, camera, size=SIZE)
    np.testing.assert_array_equal(render(scene, (30, 20), size=SIZE).rgba, expected.rgba)


def test_colors_are_levels_or_numbers():
    levels = RNG.integers(0, 256, (1500, 3), np.uint8)
    expected = render(Cloud(PLACE, color=from_srgb(levels / np.float32(255))), size=SIZE)
    for colors in (levels, levels.astype(int), levels / 255):
        np.testing.assert_allclose(
            render(PLACE, colors=colors, size=SIZE).rgba, expected.rgba, atol=1e-6
        )
    by_height = render(PLACE, colors=PLACE[:, 2], colormap="gray", size=SIZE)
    again = render(Cloud(PLACE), colors="z", colormap="gray", size=SIZE)
    np.testing.assert_array_equal(by_height.rgba, again.rgba)
    gray = by_height.rgba[..., 0]
    assert gray[: SIZE[1] // 4].max() > 0.7  # the pole is white


def test_gaussians_are_framed_with_their_own_axis_up():
    scene = read_gaussians(GAUSSIANS)
    camera = gaussian_camera(scene, size=SIZE, azimuth=30, elevation=20, up=scene.up or "-y")
    expected = render_gaussians(scene, camera, size=SIZE, style=GaussianStyle("bare"))
    found = render(GAUSSIANS, (30, 20), size=SIZE, style=GaussianStyle("bare"))
    np.testing.assert_array_equal(found.rgba, expected.rgba)


@pytest.mark.parametrize(
    ("words", "choices"),
    [
        ("give a path, positions", {"scene": 3}),
        ("give a path, positions", {"scene": PLACE[:, :2]}),
        ("there is no such file", {"scene": "missing.ply"}),
        ("give (1500, 3) of levels", {"scene": PLACE, "colors": np.zeros(4)}),
        ("0 to 1 is all", {"scene": PLACE, "colors": PLACE}),
        ("there is no column 'time'", {"scene": PLACE, "colors": "time"}),
        ("colors are for a Cloud", {"scene": CloudScene(Cloud(PLACE)), "colors": "z"}),
        ("leave these out", {"scene": GAUSSIANS, "colors": "z"}),
        ("leave these out", {"scene": GAUSSIANS, "style": CloudStyle()}),
        ("give a CloudStyle", {"scene": PLACE, "style": GaussianStyle()}),
    ],
)
def test_wrong_calls_say_what_to_give(words, choices):
    with pytest.raises((TypeError, ValueError, OSError)) as caught:
        render(size=SIZE, **choices)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
