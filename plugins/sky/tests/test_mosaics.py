"""Reprojection, and coaddition with weights and variances."""

import numpy as np
import pytest

from resample_sky import coadd, reproject
from resample_sky.control import coarsely
from resample_sky.reprojection import reprojection
from resample_texture import BackwardMap, warp
from resample_texture.geometry.mappings import Homography

SHAPE = (70, 90)


class Gnomonic:
    """World coordinates of a plane that touches the sky: Calabretta and Greisen 2002, TAN."""

    def __init__(self, longitude, latitude, step, middle):
        self.center, self.step, self.middle = np.radians([longitude, latitude]), step, middle
        self.asked = 0

    def pixel_to_world_values(self, x, y):
        self.asked += np.size(x)
        right, up = ((p - m) * self.step for p, m in zip((x, y), self.middle, strict=True))
        a, d = self.center
        ahead, north = np.cos(d) - up * np.sin(d), np.sin(d) + up * np.cos(d)
        longitude = a + np.arctan2(right, ahead)
        return np.degrees(longitude), np.degrees(np.arctan2(north, np.hypot(right, ahead)))

    def world_to_pixel_values(self, longitude, latitude):
        a, d = np.radians(longitude) - self.center[0], np.radians(latitude)
        north = np.sin(self.center[1]), np.cos(self.center[1])
        depth = np.sin(d) * north[0] + np.cos(d) * north[1] * np.cos(a)
        right = np.cos(d) * np.sin(a) / depth
        up = (np.sin(d) * north[1] - np.cos(d) * north[0] * np.cos(a)) / depth
        return right / self.step + self.middle[0], up / self.step + self.middle[1]


OLD = Gnomonic(10.0, 40.0, 2e-3, (45.0, 35.0))
NEW = Gnomonic(12.0, 41.0, 1.7e-3, (40.0, 30.0))


def places_of(source, target):
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    u, v = source.world_to_pixel_values(*target.pixel_to_world_values(x, y))
    return u + 0.5, v + 0.5


def test_a_sky_in_other_coordinates_is_where_formulas_put_it(record):
    found, truth = reprojection(OLD, NEW, SHAPE), places_of(OLD, NEW)
    record.error("largest, px", np.hypot(found.x - truth[0], found.y - truth[1]).max())


def test_an_error_of_zero_transforms_all_pixels():
    found, truth = reprojection(OLD, NEW, SHAPE, error=0), places_of(OLD, NEW)
    np.testing.assert_allclose([found.x, found.y], truth, rtol=0, atol=1e-9)


def test_a_slow_transform_is_called_for_few_pixels():
    target = Gnomonic(12.0, 41.0, 1e-5, (200.0, 150.0))
    reprojection(OLD, target, (400, 400))
    assert target.asked < 0.1 * 400 * 400


class Behind(Gnomonic):
    """A sky whose other side has pixels, too: those of its near side."""

    def pixel_to_world_values(self, x, y):
        longitude, latitude = super().pixel_to_world_values(x, y)
        return np.where(x > 40.3, longitude + 180.0, longitude), latitude


def test_places_that_do_not_lead_back_are_not_a_number():
    found = reprojection(NEW, Behind(12.0, 41.0, 1.7e-3, (40.0, 30.0)), SHAPE)
    np.testing.assert_array_equal(np.isnan(found.x[5]), np.arange(90) > 40.3)


def test_pixels_without_a_world_are_not_a_number():
    def halved(x, y):
        return np.where(x > 40.3, np.nan, x + 1.0), y

    made = reproject(np.ones((70, 92)), np.eye(3), np.eye(3), SHAPE, transform=halved)
    np.testing.assert_array_equal(np.isnan(made.image[5]), np.arange(90) >= 40)


def test_two_affine_maps_make_a_homography():
    coarse, fine = [[30, 0, 5000], [0, -30, 9000]], [[10, 0, 5300], [0, -10, 8700]]
    found = reprojection(coarse, fine, SHAPE)
    assert isinstance(found, Homography)
    np.testing.assert_allclose(found.matrix, [[3, 0, -30], [0, 3, -30], [0, 0, 1]], atol=1e-9)


def test_affine_maps_of_rasterio_are_taken():
    class Affine(tuple):
        a, b, c, d, e, f = 30.0, 0.0, 5000.0, 0.0, -30.0, 9000.0

    found = reprojection(Affine((30.0, 0.0, 5000.0, 0.0, -30.0, 9000.0, 0, 0, 1)), np.eye(3), SHAPE)
    np.testing.assert_allclose(found.matrix, [[30, 0, 5000], [0, -30, 9000], [0, 0, 1]])


@pytest.mark.parametrize("is_object", [False, True])
def test_a_transform_leads_from_the_target_to_the_source(is_object, record):
    def mercator(x, y):  # degrees of latitude
        return x, np.degrees(2.0 * np.arctan(np.exp(np.radians(y))) - np.pi / 2.0)

    class Transformer:
        transform = staticmethod(mercator)

    target, source = [[0.9, 0, 0], [0, -0.9, 40.0]], [[1.1, 0, -2.0], [0, -1.1, 50.0]]
    transform = Transformer() if is_object else mercator
    found = reprojection(source, target, SHAPE, transform=transform)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    u, v = mercator(0.9 * x, 40.0 - 0.9 * y)
    record.error(
        "largest, px", np.hypot(found.x - (u + 2.0) / 1.1, found.y - (50.0 - v) / 1.1).max()
    )


def test_frames_of_astropy_are_transformed():
    wcs = pytest.importorskip("astropy.wcs")
    skies = [wcs.WCS(naxis=2), wcs.WCS(naxis=2)]
    skies[0].wcs.ctype, skies[0].wcs.crval = ["RA---TAN", "DEC--TAN"], [10.68, 41.27]
    skies[1].wcs.ctype, skies[1].wcs.crval = ["GLON-TAN", "GLAT-TAN"], [121.17, -21.57]
    for sky in skies:
        sky.wcs.crpix, sky.wcs.cdelt = [45, 35], [-1e-3, 1e-3]
    from astropy.wcs.utils import pixel_to_pixel

    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    truth = pixel_to_pixel(skies[1], skies[0], x, y)
    found = reprojection(*skies, SHAPE)
    assert np.hypot(found.x - truth[0] - 0.5, found.y - truth[1] - 0.5).max() < 0.01


def test_transformers_of_pyproj_are_taken():
    pyproj = pytest.importorskip("pyproj")
    there = pyproj.Transformer.from_crs(32633, 4326, always_xy=True)
    degrees, metres = [[1e-3, 0, 14.0], [0, -1e-3, 51.0]], [[100, 0, 430000], [0, -100, 5640000]]
    found = reprojection(degrees, metres, SHAPE, transform=there)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    u, v = there.transform(430000 + 100 * x, 5640000 - 100 * y)
    off = np.hypot(found.x - (u - 14.0) / 1e-3, found.y - (51.0 - v) / 1e-3)
    assert off.max() < 0.01


@pytest.mark.parametrize("scale", [1.0, 30.0, 300.0])
def test_maps_that_bend_much_are_exact_where_a_grid_is_not(scale, record):
    def bent(x, y):
        return x + scale * np.sin(x / 9.0) * np.cos(y / 11.0), np.where(x < y, y, y + scale)

    found, truth = coarsely(bent, SHAPE, 0.01), BackwardMap.from_function(bent, SHAPE)
    record.error("largest, px", np.hypot(found.x - truth.x, found.y - truth.y).max())


@pytest.mark.parametrize("wrong", [[1, 2, 3], "north", np.ones((3, 3)), None])
def test_coordinates_that_are_none_are_refused(wrong):
    with pytest.raises(ValueError, match="the source is an affine map"):
        reprojection(wrong, np.eye(3), SHAPE)


def test_a_transform_that_is_none_is_refused():
    with pytest.raises(ValueError, match="transform is a function"):
        reprojection(np.eye(3), np.eye(3), SHAPE, transform="EPSG:4326")


TURNED = [[0.83, -0.4, 8.0], [0.4, 0.83, 1.0]]
MOVED = [[1.0, 0.0, 0.4], [0.0, 1.0, 0.3]]
FRAME = (24, 26)


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def overlaps(size, move, factor=1.0):
    """Shares of each pixel that texels cover along an axis, (pixels, texels)."""
    edge = np.arange(size + 1) * factor + move
    low, high = np.maximum(edge[:-1], np.arange(size)[:, None]), edge[1:]
    return np.clip(np.minimum(high, np.arange(1, size + 1)[:, None]) - low, 0.0, None)


@pytest.mark.parametrize("factor", [1.0, 0.37, 1.8])
def test_sums_along_the_axes_are_those_of_overlaps(rng, factor):
    images, weights, noise = rng.random((3, 2, 20, 20))
    matrices = [np.diag([factor, factor, 1.0]) for _ in range(2)]
    matrices[1][:2, 2] = 0.4, 0.3
    total = top = below = 0.0
    for image, weight, variance, (x, y) in zip(
        images, weights, noise, [(0, 0), (0.4, 0.3)], strict=True
    ):
        across, down = overlaps(20, x, factor), overlaps(20, y, factor)
        total = total + down @ weight @ across.T
        top = top + down @ (weight * image) @ across.T
        below = below + down**2 @ (weight**2 * variance) @ (across**2).T
    made = coadd(images, matrices, (20, 20), weights=weights, variances=noise)
    np.testing.assert_allclose(made.weight, total, rtol=0, atol=2e-6)
    known = total > 1e-3
    mean, variance = top[known] / total[known], below[known] / total[known] ** 2
    np.testing.assert_allclose(made.mean[known], mean, rtol=2e-4)
    np.testing.assert_allclose(made.variance[known], variance, rtol=2e-3)


@pytest.mark.some(1)
@pytest.mark.parametrize("interpolation", ["nearest", "bilinear"])
@pytest.mark.parametrize("scale", [0.45, 1.0, 2.0])
def test_the_variance_is_that_of_noise(rng, interpolation, scale):
    matrix = np.array(TURNED) * scale
    sigma, weight = 0.5 + rng.random((2, 30, 30))
    noise = rng.normal(size=(30, 30, 200)) * sigma[..., None]
    options = {"weights": [weight], "interpolation": interpolation}
    found = coadd([np.ones((30, 30))], [matrix], FRAME, variances=[sigma**2], **options)
    drawn = coadd([noise], [matrix], FRAME, axis=-1, **options).mean.var(axis=2, ddof=1)
    full = found.weight > 0.2
    ratio = found.variance[full] / drawn[full]
    assert ratio.mean() == pytest.approx(1.0, abs=0.03)  # 200 draws tell it to 0.1 for each pixel
    assert ratio.std() < 0.14


def test_what_is_known_by_one_alone_is_its_value(rng):
    image = rng.random((24, 26))
    image[5:9, 6:12] = np.nan
    made = coadd([image, np.ma.masked_all((24, 26))], [np.eye(3)] * 2, FRAME, variances=[2.0, 3.0])
    np.testing.assert_allclose(made.mean, image, rtol=1e-6)
    np.testing.assert_array_equal(made.weight, np.isfinite(image))
    np.testing.assert_allclose(made.variance, np.where(np.isnan(image), np.nan, 2.0), rtol=1e-6)


def test_a_map_is_added_as_its_matrix(rng):
    images, matrix = rng.random((2, 24, 26)), Homography(np.vstack([TURNED, [0, 0, 1]]))
    inverse = matrix.inverse()
    bent = BackwardMap.from_function(
        lambda x, y: tuple(row[0] * x + row[1] * y + row[2] for row in inverse[:2]), FRAME
    )
    both = [coadd(images, [one] * 2, FRAME, variances=[1, 2]) for one in (matrix, bent)]
    for one, other in zip(*both, strict=True):
        np.testing.assert_allclose(one[4:-4, 4:-4], other[4:-4, 4:-4], rtol=0, atol=1e-3)


@pytest.mark.sweep
def test_channels_are_added_apart(rng):
    images = rng.random((2, 24, 26, 3))
    made = coadd(images, [TURNED, MOVED], FRAME, variances=[1.0, 4.0])
    for n in range(3):
        one = coadd(images[..., n], [TURNED, MOVED], FRAME, variances=[1.0, 4.0])
        for found, truth in zip(made, one, strict=True):
            np.testing.assert_allclose(found[..., n], truth, rtol=0, atol=1e-5)


def test_without_weights_the_mean_of_one_is_its_warp(rng):
    image = rng.random((24, 26))
    made = coadd([image], [TURNED], FRAME)
    plain = warp(image, TURNED, FRAME, interpolation="nearest")
    assert made.variance is None
    np.testing.assert_allclose(made.mean, plain.image, rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weights": [1.0]}, "2 pictures need as many"),
        ({"weights": [1.0, -1.0]}, "weights are finite and 0 or more"),
        ({"variances": [1.0, np.ones((3, 3))]}, r"variances of \(3, 3, 1\) do not fit"),
        ({"interpolation": "lanczos"}, "known: nearest, bilinear"),
    ],
)
def test_sums_that_cannot_be_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        coadd([np.ones((9, 9))] * 2, [np.eye(3)] * 2, (9, 9), **options)
