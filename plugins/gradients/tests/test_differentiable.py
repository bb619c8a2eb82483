import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from resample import registry
from resample.profiles.interpolation import AreaSpline, InterpolatingCatmullRom, Nearest, Spline
from resample_gradients import LinearWarp, MapPlaces, MatrixPlaces
from resample_gradients.interpolation import pieces
from resample_texture import BackwardMap, warp
from tests.bits import assert_threads_change_nothing

EDGES = ("transparent", "clamp", "wrap", "mirror", "reflect-101")
LINEAR = ("area-spline:limit=none", "spline", "catmull-rom", "bilinear", "lanczos", "gaussian")
SOURCE, FRAME = (10, 12), (14, 16)
MAGNIFIED = np.array([[2.3, 0.4, -1.0], [-0.3, 1.9, 2.0], [0.002, 0.003, 1.0]])
MINIFIED = np.array([[0.33, 0.04, 3.0], [-0.03, 0.29, 2.0], [0.002, 0.003, 1.0]])
MIRRORED = np.array([[-1.1, 0.2, 14.0], [0.3, 1.2, -1.0], [0.01, -0.02, -1.0]])
MATRICES = (MAGNIFIED, MINIFIED, MIRRORED)


def matrix_places(matrix, **said):
    return MatrixPlaces(matrix, FRAME, SOURCE, **said)


def map_places(x=0.0, y=0.0, seed=7):
    """A map with bends, whose pixels look beyond the source too; and a hole."""
    row, column = np.mgrid[: FRAME[0], : FRAME[1]] + 0.5
    jitter = np.random.default_rng(seed).uniform(-0.2, 0.2, (2, *FRAME))
    u = 0.8 * column + 0.2 * row - 1.5 + jitter[0] + x
    v = 0.8 * row - 0.1 * column + np.sin(column / 3) + jitter[1] + y
    u[3, 4] = np.nan
    return MapPlaces(u, v)


def torn_places():
    """A map whose right half looks far away from its left half, seen by a lone row too."""
    places = map_places()
    x = places.x.copy()
    x[:, 8:] -= 40.0
    return MapPlaces(x, places.y)


def pictures(channels=2):
    rng = np.random.default_rng(7)
    return rng.standard_normal((*SOURCE, channels)), rng.standard_normal((*FRAME, channels))


def slope(function, at, direction):
    """Derivative of a function in a direction, by differences."""
    step = 1e-6
    return (function(at + step * direction) - function(at - step * direction)) / (2 * step)


def check_adjoint(chosen, places, source_shape=SOURCE):
    rng = np.random.default_rng(7)
    seen = places.places().shape[:2]
    source, gradient = rng.standard_normal((*source_shape, 2)), rng.standard_normal((*seen, 2))
    image = chosen(source, places)
    texels = chosen.by_image(gradient, places, source_shape)
    size = np.linalg.norm(image) * np.linalg.norm(gradient)
    assert abs(np.vdot(image, gradient) - np.vdot(source, texels)) <= 1e-12 * size + 1e-300


@pytest.mark.some(2)
@pytest.mark.parametrize("interpolation", LINEAR)
@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("matrix", range(len(MATRICES)))
def test_the_adjoint_is_the_transpose(matrix, edge, interpolation):
    check_adjoint(LinearWarp(interpolation, edge), matrix_places(MATRICES[matrix]))


@pytest.mark.parametrize("places", [map_places(), map_places(30.0, -40.0), torn_places()])
@pytest.mark.parametrize("edge", EDGES)
def test_the_adjoint_of_a_map_is_its_transpose(edge, places):
    check_adjoint(LinearWarp(edge=edge), places)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (40, 3)])
@pytest.mark.parametrize("edge", EDGES)
def test_sources_of_any_shape_have_their_transpose(shape, edge):
    check_adjoint(LinearWarp(edge=edge), MatrixPlaces(MAGNIFIED, FRAME, shape), shape)


number = st.floats(-3, 3, allow_subnormal=False)
tilt = st.floats(-0.05, 0.05, allow_subnormal=False)


@pytest.mark.sweep
@settings(max_examples=25, deadline=None)
@given(
    numbers=st.tuples(
        number, number, st.floats(-9, 9), number, number, st.floats(-9, 9), tilt, tilt
    ),
    scale=st.sampled_from([0.1, 1.0]),
    edge=st.sampled_from(EDGES),
)
def test_any_homography_has_its_transpose(numbers, scale, edge):
    matrix = np.array([*numbers, 1.0]).reshape(3, 3)
    matrix[:, :2] *= scale
    assume(np.linalg.cond(matrix) < 1e4)
    check_adjoint(LinearWarp(edge=edge), matrix_places(matrix))


SMOOTH = ("area-spline:limit=none", "spline:degree=3", "catmull-rom")


@pytest.mark.each_value
@pytest.mark.parametrize("interpolation", SMOOTH)
@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("matrix", range(len(MATRICES)))
@pytest.mark.parametrize("said", [{}, {"inverse": True}, {"convention": "opencv"}])
def test_the_gradient_by_a_matrix_is_that_of_finite_differences(matrix, edge, interpolation, said):
    chosen, (source, gradient) = LinearWarp(interpolation, edge), pictures()
    at = MATRICES[matrix]
    at = np.linalg.inv(at) if said.get("inverse") else at
    # A matrix times a number is the same map: that direction must give 0 without being asked for.
    direction = np.random.default_rng(3).standard_normal((3, 3)) * abs(at) * 0.02

    def loss(matrix):
        return np.vdot(chosen(source, matrix_places(matrix, **said)), gradient)

    by_matrix = chosen.by_places(gradient, source, matrix_places(at, **said))
    expected = slope(loss, at, direction)
    size = np.linalg.norm(by_matrix * direction)
    assert np.vdot(by_matrix, direction) == pytest.approx(expected, abs=1e-6 * size)
    assert np.vdot(by_matrix, at) == pytest.approx(0, abs=1e-9 * np.linalg.norm(by_matrix * at))


def test_an_affine_matrix_has_a_gradient_of_its_shape():
    chosen, (source, gradient) = LinearWarp(edge="clamp"), pictures()
    affine = MAGNIFIED[:2] / MAGNIFIED[2, 2]
    full = np.vstack([affine, [0, 0, 1]])
    by_affine = chosen.by_places(gradient, source, matrix_places(affine))
    by_full = chosen.by_places(gradient, source, matrix_places(full))
    np.testing.assert_array_equal(by_affine, by_full[:2])


@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("kind", ["whole", "far", "torn", "row", "column", "pixel"])
def test_the_gradient_by_a_map_is_that_of_finite_differences(edge, kind):
    made = {"far": map_places(30.0, -40.0), "torn": torn_places()}.get(kind, map_places())
    part = {"row": np.s_[5:6], "column": np.s_[:, 5:6], "pixel": np.s_[5:6, 5:6]}.get(
        kind, np.s_[:]
    )
    at = np.stack([made.x[part], made.y[part]], axis=2)
    rng = np.random.default_rng(3)
    source, gradient = pictures()[0], rng.standard_normal((*at.shape[:2], 2))
    chosen = LinearWarp(edge=edge)

    def loss(places):
        picture = chosen(source, MapPlaces(places[..., 0], places[..., 1]))
        return np.vdot(picture, gradient)

    by_map = chosen.by_places(gradient, source, MapPlaces(at[..., 0], at[..., 1]))
    assert by_map.shape == at.shape
    direction = 0.1 * rng.standard_normal(at.shape)
    size = max(np.linalg.norm(by_map * direction), 0.02)  # far beyond a clamped edge it is 0
    expected = slope(loss, at, direction)
    assert np.vdot(by_map, direction) == pytest.approx(expected, abs=1e-6 * size)


def test_pixels_that_look_away_change_with_nothing():
    places = map_places(1000.0)
    source, gradient = pictures()
    chosen = LinearWarp()
    assert not chosen(source, places).any()
    assert not chosen.by_image(gradient, places, SOURCE).any()
    assert not chosen.by_places(gradient, source, places).any()


def turned(scale, angle, shape):
    """Matrix that scales and turns a source about its middle, and its target's shape."""
    target = round(shape[0] * scale), round(shape[1] * scale)
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    middle = np.array([target[1] / 2 + 0.2, target[0] / 2 - 0.3])
    matrix = np.eye(3)
    matrix[:2, :2] = turn
    matrix[:2, 2] = middle - turn @ (shape[1] / 2, shape[0] / 2)
    return matrix, target


@pytest.mark.each_value
@pytest.mark.parametrize("scale", [1 / 3, 0.5, 1, 2, 4])
@pytest.mark.parametrize("angle", [0.0, 0.5])
@pytest.mark.parametrize("edge", EDGES)
def test_the_picture_is_that_of_warp(scale, angle, edge, record):
    source = np.random.default_rng(7).random((42, 48))
    matrix, target = turned(scale, angle, source.shape)
    ours = LinearWarp(edge=edge)(source, MatrixPlaces(matrix, target, source.shape))
    given = warp(
        source,
        matrix,
        target,
        interpolation="area-spline:limit=none",
        edge=edge,
        quality=4,
        fill="premultiplied",
    )
    x, y = np.meshgrid(np.arange(target[1]) + 0.5, np.arange(target[0]) + 0.5)
    back = np.linalg.inv(matrix) @ np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
    mapped = LinearWarp(edge=edge)(source, MapPlaces(*back[:2].reshape(2, *target)))
    np.testing.assert_allclose(mapped, ours, atol=1e-12)
    whole = given.coverage == 1.0  # where an edge runs through, `warp` looks at 4 × 4 places
    error = ours - given.image
    record.error("rms inside", np.sqrt(np.mean(error[whole] ** 2)))
    record.error("largest", np.abs(error).max())
    ones = LinearWarp(edge=edge)(np.ones(source.shape), MatrixPlaces(matrix, target, source.shape))
    np.testing.assert_allclose(ones, given.coverage, atol=6e-3)
    np.testing.assert_allclose(ones[whole], 1.0, atol=1e-6)


def test_a_torn_map_is_seen_as_warp_sees_it(record):
    places, source = torn_places(), pictures()[0]
    choices = {"interpolation": "area-spline:limit=none", "edge": "mirror", "quality": 8}
    choices["fill"] = "premultiplied"
    given = warp(source, BackwardMap(places.x, places.y), FRAME, **choices).image
    ours = LinearWarp(edge="mirror")(source, places)
    # The map's jitter leans pixels, which `warp` takes for boxes.
    record.error("rms", np.sqrt(np.mean((ours - given) ** 2)))


@pytest.mark.sweep
def test_more_points_come_closer():
    source, places = pictures()[0], matrix_places(MINIFIED)
    best = LinearWarp(edge="clamp", quality=16)(source, places)
    errors = [
        np.abs(LinearWarp(edge="clamp", quality=quality)(source, places) - best).max()
        for quality in (1, 2, 4)
    ]
    assert errors[0] > 4 * errors[1] > 16 * errors[2]


@pytest.mark.parametrize("name", LINEAR)
def test_polynomials_are_the_kernel(name):
    interpolation = registry.build("interpolations", name)
    polynomials, _, shift = pieces(interpolation)
    taps = polynomials.shape[1]
    places = np.random.default_rng(7).uniform(0, 1, 200)
    powers = (places - 0.5) ** np.arange(len(polynomials))[:, None]
    centers = np.arange(taps) - (taps - 1) // 2 + 0.5
    distance = np.abs(places + shift - centers[:, None])
    expected = interpolation(distance) * (distance <= interpolation.radius)
    np.testing.assert_allclose(polynomials.T @ powers, expected / expected.sum(axis=0), atol=1e-6)


def test_threads_change_no_bit():
    rng = np.random.default_rng(7)
    source, gradient = rng.standard_normal((90, 80, 3)), rng.standard_normal((60, 70, 3))
    places = MatrixPlaces(MAGNIFIED, (60, 70), (90, 80))
    chosen = LinearWarp(edge="wrap")
    assert_threads_change_nothing(
        lambda: [
            chosen(source, places),
            chosen.by_image(gradient, places, (90, 80)),
            chosen.by_places(gradient, source, places),
        ]
    )


def test_pictures_without_channels_stay_so():
    source, gradient = (a[..., 0] for a in pictures())
    places, chosen = matrix_places(MAGNIFIED), LinearWarp()
    assert chosen(source.astype(np.float32), places).shape == FRAME
    assert chosen.by_image(gradient, places, SOURCE).shape == SOURCE
    assert chosen.by_places(gradient, source, places).shape == (3, 3)


@pytest.mark.parametrize("interpolation", [AreaSpline(), Spline(limit="range"), "area-spline"])
def test_an_interpolation_with_limits_is_refused(interpolation):
    with pytest.raises(ValueError, match="limit=none"):
        LinearWarp(interpolation)


def test_an_interpolation_without_a_slope_is_refused():
    with pytest.raises(ValueError, match="no slope; give bilinear"):
        LinearWarp(Nearest())


def test_an_interpolation_with_kinks_is_refused():
    class Kinked:
        radius = 1.0

        def __call__(self, distance):
            return np.maximum(1.0 - np.abs(distance - 0.25), 0.1)

    with pytest.raises(ValueError, match="kinks"):
        LinearWarp(Kinked())


def test_choices_and_shapes_that_cannot_be_are_refused():
    source, gradient = pictures()
    places, chosen = matrix_places(MAGNIFIED), LinearWarp(InterpolatingCatmullRom())
    with pytest.raises(ValueError, match="quality lies between 1 and 16"):
        LinearWarp(quality=0.5)
    with pytest.raises(ValueError, match="known: transparent"):
        LinearWarp(edge="torus")
    with pytest.raises(ValueError, match=r"a picture has numbers .* \(3,\)"):
        chosen(np.ones(3), places)
    with pytest.raises(ValueError, match=r"places for a source of \(10, 12\)"):
        chosen(source[1:], places)
    with pytest.raises(ValueError, match="does not fit places"):
        chosen.by_image(gradient[1:], places, SOURCE)
    with pytest.raises(ValueError, match="a gradient of 1 channels, of 2"):
        chosen.by_places(gradient[..., :1], source, places)
    with pytest.raises(ValueError, match="no inverse"):
        matrix_places(np.zeros((3, 3)))


@pytest.mark.parametrize("method", ["by_image", "by_places"])
def test_what_does_not_fit_the_places_is_refused_by_both_adjoints(method):
    picture, gradient = pictures()
    warping, places = LinearWarp(), matrix_places(MAGNIFIED)
    source = SOURCE if method == "by_image" else picture

    def adjoint(of=gradient, by=places, source=source):
        return (
            warping.by_image(of, by, source)
            if method == "by_image"
            else warping.by_places(of, source, by)
        )

    adjoint()
    with pytest.raises(
        ValueError, match=r"a gradient of \(13, 16\) px does not fit places of \(14, 16\)"
    ):
        adjoint(gradient[1:])
    smaller = (9, 12) if method == "by_image" else picture[1:]
    with pytest.raises(
        ValueError, match=r"places for a source of \(10, 12\), which is of \(9, 12\)"
    ):
        adjoint(source=smaller)
    for wrong in (gradient[0, 0], gradient.astype(complex), np.empty((0, 4))):
        with pytest.raises(ValueError, match="a gradient has numbers of the shape"):
            adjoint(wrong)


@pytest.mark.parametrize("threads", [0, -1])
def test_a_linear_warp_has_one_thread_or_more(threads):
    with pytest.raises(ValueError, match="threads"):
        LinearWarp(threads=threads)


@pytest.mark.parametrize("quality", [0.99, 16.01, np.nan])
def test_the_quality_of_a_linear_warp_is_within_its_limits(quality):
    with pytest.raises(ValueError, match="quality lies between 1 and 16"):
        LinearWarp(quality=quality)
    assert [LinearWarp(quality=q).quality for q in (1, 16)] == [1, 16]
