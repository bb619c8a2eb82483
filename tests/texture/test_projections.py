"""Projections of pictures: against a scene that is a formula of the direction."""

import numpy as np
import pytest

from resample import registry
from resample_texture import project
from resample_texture.geometry.projections import rotation

SIZES = {
    "equirectangular": (128, 256),
    "cubemap": (80, 480),
    "cubemap:layout=cross": (240, 320),
    "cubemap:layout=3x2": (160, 240),
    "fisheye:fov=360": (200, 200),
    "fisheye:fov=220,model=equisolid": (160, 170),
    "stereographic:fov=300": (160, 200),
    "cylindrical": (140, 300),
    "perspective:fov=80": (90, 110),
}


def scene(ray):
    """Smooth pattern over all directions, in three channels."""
    x, y, z = np.moveaxis(ray / np.linalg.norm(ray, axis=-1, keepdims=True), -1, 0)
    waves = np.sin(5 * x + 1), np.cos(4 * y - 2 * z), np.sin(3 * z * x + 4 * y)
    return 0.5 + 0.4 * np.stack(waves, axis=-1)


def picture(name, turn=(0, 0, 0)):
    """The scene in a projection: values at centers of pixels, not a number where there are none."""
    projection, shape = registry.build("projections", name), SIZES[name]
    image = np.full((*shape, 3), np.nan)
    for n, (left, top, width, height) in enumerate(projection.tiles(shape)):
        y, x = np.mgrid[top : top + height, left : left + width] + 0.5
        place = np.stack([x, y], axis=-1)
        values = scene(projection.rays(place, shape, n) @ rotation(turn).T)
        values[~projection.shows(place, shape)] = np.nan
        image[top : top + height, left : left + width] = values
    return image


@pytest.mark.parametrize("name", SIZES)
def test_places_and_directions_are_each_other_s_inverse(name):
    projection, shape = registry.build("projections", name), SIZES[name]
    for n, (left, top, width, height) in enumerate(projection.tiles(shape)):
        y, x = np.mgrid[top : top + height, left : left + width] + 0.5
        place = np.stack([x, y], axis=-1)
        ray = projection.rays(place, shape, n)
        is_there = projection.shows(place, shape)
        assert np.isfinite(ray[is_there]).all()
        assert is_there.mean() > 0.5
        back = projection.places(ray[is_there] * 3.0, shape, n)
        np.testing.assert_allclose(back, place[is_there], atol=1e-6)


@pytest.mark.some(2)
@pytest.mark.parametrize("target", SIZES)
@pytest.mark.parametrize("source", ["equirectangular", "cubemap", "cubemap:layout=cross"])
@pytest.mark.parametrize("turn", [(0, 0, 0), (140, -60, 25)])
def test_a_panorama_is_the_scene_in_any_projection(source, target, turn, record):
    found = project(picture(source), source, target, SIZES[target], turn)
    expected = picture(target, turn)
    is_there = np.isfinite(expected).all(axis=-1)
    assert (found.coverage[is_there] > 0.99).mean() > 0.999  # of a circle the rim is half covered
    error = np.abs(found.image - expected)[is_there & (found.coverage > 0.99)]
    record.error("rms", np.sqrt(np.square(error).mean()))
    record.error(
        "largest", error.max()
    )  # texels of padded faces are the nearest of their neighbours'


@pytest.mark.parametrize(
    "source", ["fisheye:fov=220,model=equisolid", "cylindrical", "perspective:fov=80"]
)
def test_what_a_picture_does_not_show_is_not_invented(source, record):
    found = project(np.nan_to_num(picture(source)), source, "equirectangular", (128, 256))
    expected = picture("equirectangular")
    inner = found.coverage == 1.0
    assert 0.05 < inner.mean() < 0.9
    assert np.isnan(found.image[found.coverage == 0.0]).all()
    error = np.abs(found.image - expected)[inner]
    record.error("rms", np.sqrt(np.square(error).mean()))


@pytest.mark.parametrize("model", ["equidistant", "equisolid", "stereographic", "orthographic"])
def test_a_fisheye_s_rim_lies_at_half_its_field_of_view(model):
    projection = registry.build("projections", f"fisheye:fov=150,model={model}")
    ray = projection.rays(np.array([[99.999999, 50.0], [50.0, 50.0]]), (100, 120), 0)
    assert np.isfinite(ray).all()
    right = projection.rays(np.array([109.999999, 50.0]), (100, 120), 0)
    np.testing.assert_allclose(np.degrees(np.arctan2(right[0], right[2])), 75.0, atol=1e-4)


def test_nothing_shows_at_a_panorama_s_seam_or_poles():
    image = picture("equirectangular")
    for turn in ((180, 0, 0), (0, 90, 0), (0, -90, 0)):
        found = project(image, "equirectangular", "perspective:fov=60", (90, 110), turn).image
        ray = registry.build("projections", "perspective:fov=60").rays(
            np.stack(np.meshgrid(np.arange(110) + 0.5, np.arange(90) + 0.5), axis=-1), (90, 110), 0
        )
        np.testing.assert_allclose(found, scene(ray @ rotation(turn).T), atol=0.006)


def test_levels_gray_and_masked_pictures_keep_their_kind():
    levels = (255 * picture("equirectangular")).astype(np.uint8)
    found = project(levels[..., 0], "equirectangular", "cubemap", (40, 240))
    assert (found.image.dtype, found.image.shape) == (np.uint8, (40, 240))
    masked = np.ma.MaskedArray(levels, np.zeros(levels.shape, np.bool_))
    masked.mask[:64] = True
    found = project(masked, "equirectangular", "cubemap:layout=cross", (120, 160)).image
    assert found.mask[:, :40].reshape(3, 40, 40, 3)[0].all()  # beside the cross
    assert found.mask[45:55, 42:75].all()  # above the horizon
    assert not found.mask[65:75, 2:38].any()


@pytest.mark.parametrize(
    ("source", "target", "shape", "message"),
    [
        ("equirectangular", "cubemap", (40, 250), r"is 6 x 1 square faces, not 250 x 40 px; give"),
        ("cubemap", "perspective", (40, 40), r"is 6 x 1 square faces, not 256 x 128 px; give"),
        (
            "equirectangular",
            "equirectangular",
            (40, 40),
            "is twice as wide as high, not 40 x 40 px",
        ),
        ("equirectangular", "fisheye:fov=400", (40, 40), "up to 360 degrees, not 400"),
        ("equirectangular", "fisheye:model=ball", (40, 40), "model 'ball'; known: equidistant"),
        ("equirectangular", "perspective:fov=180", (40, 40), "shows 0 to 180 degrees, not 180"),
        ("equirectangular", "cubemap:layout=net", (40, 40), "layout 'net'; known: row, column"),
    ],
)
def test_sizes_and_angles_that_do_not_fit_are_refused(source, target, shape, message):
    with pytest.raises(ValueError, match=message):
        project(np.zeros((128, 256)), source, target, shape)


def test_unknown_projections_are_named():
    with pytest.raises(LookupError, match="unknown projection 'mercator'"):
        project(np.zeros((128, 256)), "equirectangular", "mercator", (40, 40))
    with pytest.raises(ValueError, match="turn is three angles in degrees"):
        project(np.zeros((128, 256)), "equirectangular", "perspective", (4, 4), turn=(1, 2))
