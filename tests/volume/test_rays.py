"""Volumes gathered along rays: what must not change a picture, and values that formulas know."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.scores.volume_truth import wall_area
from resample.cameras.models import AnyCamera, Orthographic
from resample.cameras.viewpoints import Orbit, Spot
from resample.painting import rays as painting
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample.types import Doubles, Frame
from resample_volume.appearance import Appearance, Classification
from resample_volume.classification.transfer import from_points
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from resample_volume.types import Volume
from resample_volume.voxels.thin import with_true_thickness
from tests.record import Record

LOOK = from_points(
    [(40.0, (0.1, 0.2, 0.9), 0.0), (90.0, (0.2, 0.9, 0.2), 0.3), (200.0, (0.9, 0.3, 0.1), 0.9)]
)
SIZE = (40, 48)
PROJECTIONS = [
    Projection.COMPOSITE,
    Projection.MAXIMUM,
    Projection.MINIMUM,
    Projection.AVERAGE,
    Projection.ADDITIVE,
    Projection.FIRST_HIT,
    Projection.ATTENUATED,
]


def blobs(shape: tuple[int, int, int] = (20, 26, 23)) -> NDArray[np.uint8]:
    """Smooth bumps on a dark ground, with much that is empty."""
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(np.random.default_rng(3).normal(size=shape), 2.0)
    return np.clip(noise / noise.std() * 80, 0, 255).astype(np.uint8)


def for_look(values: NDArray[np.uint8], projection: Projection) -> NDArray[np.generic]:
    """Bytes to composite, floats for other looks: of either all of a painter is compiled anew."""
    return values if projection is Projection.COMPOSITE else values.astype(np.float32)


def along_rays(projection: Projection = Projection.COMPOSITE, **choices: object) -> Resampler:
    iso = 80.0 if projection is Projection.FIRST_HIT else None
    made = Resampler(order=Rays(), projection=projection, iso=iso)
    return replace(made, **choices)  # type: ignore[arg-type]


def seen(
    volume: Volume | NDArray[np.generic],
    resampler: Resampler,
    camera: AnyCamera | None = None,
    size: tuple[int, int] = SIZE,
    threads: int | None = None,
    **appearance: object,
) -> Frame:
    given = volume if isinstance(volume, Volume) else as_volume(volume)
    look = Appearance(LOOK, classification=Classification.POST, **appearance)  # type: ignore[arg-type]
    subject = Subject.of(given, look, resampler)
    eye = subject.camera(Orbit(30, 20, 1.2) if camera is None else camera, *size)
    height, width = size
    return resampler(
        subject.samples_for(eye),
        eye,
        height=height,
        width=width,
        threads=threads,
        clip=subject.clip,
    )


def ahead(volume: NDArray[np.generic], per_voxel: float) -> tuple[Orthographic, tuple[int, int]]:
    """Parallel camera that looks along z at the middle of a volume."""
    depth, height, width = volume.shape
    shape = round(height * per_voxel), round(width * per_voxel)
    pose = np.eye(4)
    pose[:3, 3] = (-(width - 1) / 2, -(height - 1) / 2, depth)
    return Orthographic(per_voxel, per_voxel, shape[1] / 2, shape[0] / 2, pose), shape


@pytest.mark.some(2)
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_threads_do_not_change_a_bit(projection: Projection) -> None:
    values = for_look(blobs(), projection)
    one, two, three = (seen(values, along_rays(projection), threads=n) for n in (1, 2, 3))
    for other in (two, three):
        np.testing.assert_array_equal(one.rgba, other.rgba)
        np.testing.assert_array_equal(one.depth, other.depth)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_bricks_that_are_passed_over_hold_nothing(
    projection: Projection, monkeypatch: pytest.MonkeyPatch
) -> None:
    values, resampler = for_look(blobs(), projection), along_rays(projection, subpixels=1)
    quick = seen(values, resampler)
    own = painting._bricks

    def nothing_known(*given: object) -> object:
        known = own(*given)  # type: ignore[arg-type]
        return known._replace(
            empty=np.zeros_like(known.empty),
            cells=np.zeros(0, np.uint64),
            least=np.full_like(known.least, -1e9),
            greatest=np.full_like(known.greatest, 1e9),
        )

    monkeypatch.setattr(painting, "_bricks", nothing_known)
    slow = seen(values, resampler)
    # Of light, a step is left out if its middle is in a cell that shows nothing.
    is_composite = projection is Projection.COMPOSITE
    np.testing.assert_allclose(quick.rgba, slow.rgba, atol=1e-4 if is_composite else 2e-6)
    assert quick.rgba.max() > 0.1


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 20, 20), (20, 1, 9), (2, 2, 2)])
def test_thin_volumes_are_seen(projection: Projection, shape: tuple[int, int, int]) -> None:
    values = np.full(shape, 120, np.uint8)
    if projection is Projection.FIRST_HIT:
        if values.size == 1:
            pytest.skip("one value has no surface")
        values[0, 0, 0] = 10
    frame = seen(for_look(values, projection), along_rays(projection))
    assert np.isfinite(frame.rgba).all()
    assert frame.rgba[..., 3].max() > 0.05


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_missing_voxels_show_nothing(projection: Projection) -> None:
    values = np.full((12, 12, 12), 120.0, np.float32)
    camera, size = ahead(values, 3.0)
    values[:, :, :6] = np.nan
    values[0, 0, -1] = 10.0
    frame = seen(values, along_rays(projection, subpixels=1), camera, size)
    assert frame.rgba[:, : 3 * 6 - 1, :3].max() == 0
    assert frame.rgba[3:, 3 * 6 + 1 : -3, :3].max(axis=2).min() > 0.1


def test_nothing_at_all_is_a_picture_of_nothing() -> None:
    empty = seen(np.full((5, 5, 5), np.nan, np.float32), along_rays())
    dark = seen(np.zeros((5, 5, 5), np.uint8), along_rays())
    assert not empty.rgba.any()
    assert not dark.rgba.any()


@pytest.mark.sweep
def test_automatic_sub_pixels_come_to_what_many_show(record: Record) -> None:
    for size in ((12, 12), (40, 48), (160, 160)):
        few = seen(blobs(), along_rays(), Orbit(30, 20, 1.4), size)
        many = seen(blobs(), along_rays(subpixels=16), Orbit(30, 20, 1.4), size)
        record.error(f"rms of {size[0]} px", np.sqrt(np.mean((few.rgba - many.rgba) ** 2)))


@pytest.mark.some(1)
@pytest.mark.parametrize("projection", [Projection.COMPOSITE, Projection.AVERAGE])
@pytest.mark.parametrize("per_voxel", [3.0, 9.0])  # every second ray is cast, or every fourth
def test_sub_pixels_that_are_spared_are_as_rays_would_see_them(
    projection: Projection, per_voxel: float, record: Record
) -> None:
    values = for_look(blobs((8, 14, 14)), projection)
    camera, size = ahead(values, per_voxel)
    spared = seen(values, along_rays(projection), camera, size)
    every = seen(values, along_rays(projection, subpixels=2), camera, size)
    error = np.abs(spared.rgba - every.rgba)
    assert error.max() > 0
    record.error("largest", error.max())
    record.error("rms", np.sqrt(np.mean(error**2)))


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("quality", "side", "rays"),  # px, per side of a pixel
    [
        ("usual", 6, 4),
        ("usual", 12, 3),
        ("usual", 24, 2),
        ("usual", 120, 1),
        ("fast", 24, 1),
        ("fast", 60, 1),
    ],
)
def test_fewer_rays_come_close_to_many(quality: str, side: int, rays: int, record: Record) -> None:
    camera, size = Orbit(30, 20, 1.2 * side / (side - 2)), (side, side)
    few = seen(blobs(), along_rays(order=Rays(quality=quality)), camera, size)
    many = seen(blobs(), along_rays(subpixels=16), camera, size)
    assert few.statistics.subpixels == rays
    error = np.sqrt(np.mean((few.rgba - many.rgba) ** 2))
    record.quality("picture", -20 * np.log10(error))


@pytest.mark.sweep
def test_one_ray_is_filtered_to_the_mean_of_a_pixel() -> None:
    camera, size = ahead(blobs((8, 14, 14)), 1.5)
    middle, mean, many = (
        seen(blobs((8, 14, 14)), along_rays(**choice), camera, size).rgba
        for choice in ({"subpixels": 1}, {"order": Rays(quality="fast")}, {"subpixels": 16})
    )
    errors = [np.sqrt(np.mean((few - many) ** 2)) for few in (middle, mean)]
    assert errors[1] < 0.8 * errors[0]


@pytest.mark.parametrize("quality", ["best", "usual"])
def test_a_camera_that_looks_away_sees_nothing(quality: str) -> None:
    away = Spot((0.0, -50.0, 0.0), (0.0, -100.0, 0.0)).sized(*SIZE)
    frame = seen(blobs(), along_rays(order=Rays(quality=quality)), away)
    assert not frame.rgba.any()


def test_rays_have_a_quality_that_is_known() -> None:
    with pytest.raises(ValueError, match="rays of quality 'good'; best, usual, fast are known"):
        Rays(quality="good")


@pytest.mark.sweep
def test_thick_slices_are_antialiased_as_thin_ones_are(record: Record) -> None:
    for step in (1, 5):
        values = blobs((40, 40, 40))[::step]
        volume = as_volume(values)._replace(spacing=np.array([1.0, 1.0, float(step)]))
        few = seen(volume, along_rays(), size=(10, 10))
        many = seen(volume, along_rays(subpixels=32), size=(10, 10))
        record.error(f"rms at a step of {step}", np.sqrt(np.mean((few.rgba - many.rgba) ** 2)))


@pytest.mark.sweep
def test_steps_and_sub_pixels_come_closer_to_each_other(record: Record) -> None:
    exact = seen(blobs(), along_rays(order=Rays(0.05), subpixels=1))
    coarse = [seen(blobs(), along_rays(order=Rays(step), subpixels=1)) for step in (2.0, 1.0, 0.5)]
    errors = [np.sqrt(np.mean((frame.rgba - exact.rgba) ** 2)) for frame in coarse]
    assert errors[0] > errors[1] > errors[2]
    record.error("rms at a step of 1", errors[1])


def ringed_ball(count: int = 40) -> NDArray[np.float32]:
    """A smooth ball with faint rings 2.5 voxels apart."""
    axis = np.arange(count) - (count - 1) / 2
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    within = np.clip((0.4 * count - np.sqrt(x * x + y * y + z * z)) / 6 + 0.5, 0, 1)
    return np.asarray(255 * within * (0.8 + 0.2 * np.cos(2 * np.pi * z / 2.5)), np.float32)


@pytest.mark.sweep
@pytest.mark.parametrize("values", [ringed_ball(), blobs()], ids=["rings", "blobs"])
def test_what_is_spared_is_what_rays_see(values: NDArray[np.generic], record: Record) -> None:
    usual = Rays(quality="usual")
    spared = seen(values, along_rays(order=usual), size=(160, 160))
    all_of_it = seen(values, along_rays(order=usual, subpixels=1), size=(160, 160))
    record.quality("picture", -10 * np.log10(np.mean((spared.rgba - all_of_it.rgba) ** 2)))


def test_a_picture_moves_with_its_volume() -> None:
    here = as_volume(blobs())
    there = here._replace(origin=np.array([1e5, -2e5, 3e5]))
    np.testing.assert_allclose(
        seen(here, along_rays()).rgba, seen(there, along_rays()).rgba, atol=1e-6
    )


def test_a_wire_keeps_its_value_in_a_maximum() -> None:
    """A stent's wire of a voxel's width, 2000 over 0, oblique."""
    z, y, x = np.indices((30, 30, 30)) - 14.5
    way = np.array([0.7, 0.55, 0.46]) / np.linalg.norm([0.7, 0.55, 0.46])
    along = x * way[0] + y * way[1] + z * way[2]
    away = np.sqrt(np.maximum(x * x + y * y + z * z - along * along, 0.0))
    values = np.rint(2000 * np.exp(-((away / 0.8) ** 2))).astype(np.int16)
    own = np.array([values[k].max() for k in range(6, 24)], float)
    camera, size = ahead(values, 1.0)
    frame = seen(values, along_rays(Projection.MAXIMUM, subpixels=1), camera, size)
    assert frame.value is not None
    rows = frame.value.max(axis=1)[6:24]
    assert rows.mean() >= 0.97 * own.mean()


@pytest.fixture(scope="module")
def ball() -> NDArray[np.float32]:
    """Values that fall evenly from 250 in the middle to 0 at 15 voxels."""
    z, y, x = np.indices((41, 41, 41)) - 20.0
    return np.asarray(250 * np.clip(1 - np.sqrt(x * x + y * y + z * z) / 15, 0, None), np.float32)


def offsets(size: tuple[int, int], per_voxel: float) -> NDArray[np.float64]:
    """How far pixels' rays pass the middle, voxels."""
    row, column = np.indices(size) + 0.5
    return np.asarray(np.hypot(row - size[0] / 2, column - size[1] / 2) / per_voxel)


def test_maxima_of_a_ball_are_those_of_its_formula(
    ball: NDArray[np.float32], record: Record
) -> None:
    camera, size = ahead(ball, 2.0)
    away = offsets(size, 2.0)
    frame = seen(ball, along_rays(Projection.MAXIMUM, subpixels=1), camera, size)
    inside = (away > 2) & (away < 13)
    expected = 250 * (1 - away[inside] / 15)
    record.error("largest", np.abs(frame.value[inside] - expected).max())  # type: ignore[index]


@pytest.mark.parametrize("attenuation", [0.0, 0.05, 0.5])
def test_values_in_front_of_an_attenuated_maximum_dim_it(
    ball: NDArray[np.float32], attenuation: float, record: Record
) -> None:
    camera, size = ahead(ball, 2.0)
    away = offsets(size, 2.0)
    chosen = along_rays(Projection.ATTENUATED, subpixels=1, attenuation=attenuation)
    frame = seen(ball, chosen, camera, size)
    inside = (away > 2) & (away < 13)
    # Values of the ball along each ray, as fractions of the table's range, every 0.01 voxels.
    places = np.hypot(away[inside][:, None], np.arange(-15, 15, 0.01))
    value = np.clip(1 - places / 15, 0, None)
    before = np.cumsum(value, axis=1) - value
    expected = 250 * (value * np.exp(-attenuation * 0.01 * before)).max(axis=1)
    error = np.abs(frame.value[inside] - expected).max()  # type: ignore[index]
    record.error(f"largest, {attenuation:g}", error)


@pytest.mark.sweep
def test_sums_of_a_ball_are_those_of_its_formula(ball: NDArray[np.float32], record: Record) -> None:
    camera, size = ahead(ball, 2.0)
    away = offsets(size, 2.0)
    frame = seen(ball, along_rays(Projection.ADDITIVE, subpixels=1), camera, size)
    inside = away < 13
    half = np.sqrt(225 - away[inside] ** 2)
    way = np.linspace(-1, 1, 4001)
    place = np.hypot(away[inside][:, None], half[:, None] * way)
    expected = (250 * np.clip(1 - place / 15, 0, None)).mean(axis=1) * 2 * half
    found = frame.value[inside]  # type: ignore[index]
    record.error("largest", np.abs(found - expected).max())
    mean = seen(ball, along_rays(Projection.AVERAGE, subpixels=1), camera, size)
    np.testing.assert_allclose(mean.value[inside] * 41, found, rtol=1e-4)  # type: ignore[index]


def test_the_surface_of_a_ball_is_where_its_formula_says(
    ball: NDArray[np.float32], record: Record
) -> None:
    camera, size = ahead(ball, 2.0)
    away = offsets(size, 2.0)
    frame = seen(ball, along_rays(Projection.FIRST_HIT, subpixels=1), camera, size)
    radius = 15 * (1 - 80 / 250)
    inside = away < radius - 0.5
    expected = 41 + 20 - np.sqrt(radius**2 - away[inside] ** 2)
    record.error("largest depth", np.abs(frame.depth[inside] - expected).max())
    assert not frame.rgba[away > radius + 0.5].any()


@pytest.mark.parametrize("away", [1e6, 1e14, 1e30])
def test_from_anywhere_there_is_a_picture(away: float) -> None:
    values = blobs()
    pose = np.eye(4)
    pose[2, 3] = away
    size = (9, 9)
    eye = Orthographic(0.5, 0.5, 4.5, 4.5, pose)
    far = seen(values, along_rays(subpixels=1), eye, size)
    assert np.isfinite(far.rgba).all()
    assert far.rgba.any() == (away < 1e15)


@pytest.mark.parametrize("projection", [Projection.MAXIMUM, Projection.MINIMUM])
@pytest.mark.parametrize("is_behind", [False, True])
def test_extremes_are_not_taken_from_gaps(projection: Projection, is_behind: bool) -> None:
    # What is known rises or falls towards the gap, and would go on within it.
    depth = np.arange(24.0)[:, None, None]
    rising = depth if is_behind else 23 - depth
    sign = 1 if projection is Projection.MAXIMUM else -1
    values = np.broadcast_to(100 + sign * 3 * rising, (24, 12, 12)).astype(np.float32)
    camera, size = ahead(values, 2.0)
    known = values[:13] if is_behind else values[11:]
    values = np.where((depth < 13) if is_behind else (depth > 10), values, np.float32(np.nan))
    frame = seen(values, along_rays(projection, subpixels=1), camera, size)
    # A known voxel stands for half a voxel around it, whose values lie up to 1½ beyond its own.
    end = known.max() if projection is Projection.MAXIMUM else known.min()
    assert frame.value is not None
    assert np.abs(frame.value[4:-4, 4:-4] - end).max() <= 1.5 + 0.1


@pytest.mark.sweep
def test_peaks_lie_between_samples_only_where_that_is_asked_for() -> None:
    values = np.zeros((24, 24, 24), np.float32)
    values[:, 11:13, 11:13] = 100.0
    camera, size = ahead(values, 3.0)
    for interpolation, low, high in (("monotone", 0, 100), ("spline", -30, 140)):
        order = Rays(interpolation=interpolation)
        for projection in (Projection.MINIMUM, Projection.MAXIMUM):
            found = seen(values, Resampler(order=order, projection=projection), camera, size).value
            assert found is not None
            least, most = found[6:-6, 6:-6].min(), found.max()
            assert low - 1e-4 <= least <= most <= high + 1e-4
        assert (most > 101) == (interpolation == "spline")


WALLS = 20 + 29 * np.arange(8)  # of one voxel, so far apart that they meet pixels at other places


def areas_of_walls(kind: str, per_voxel: float, tilt: float, quality: str = "usual") -> Doubles:
    """Areas of walls that are 20 voxels high and deep, voxels²; turned by `tilt` degrees."""
    values = np.zeros((40, 40, 244), kind)
    values[10:30, 10:30, WALLS] = 100
    turn, size = np.radians(tilt), (int(60 * per_voxel) + 4, int(260 * per_voxel) + 4)
    pose = np.eye(4)
    pose[:3, :3] = [
        [np.cos(turn), -np.sin(turn), 0.0],
        [0.0, 0.0, -1.0],
        [np.sin(turn), np.cos(turn), 0.0],
    ]
    pose[:3, 3] = (0.0, 0.0, 300.0) - pose[:3, :3] @ (121.5, 19.5, 19.5)
    camera = Orthographic(per_voxel, per_voxel, size[1] / 2, size[0] / 2, pose)
    look = Appearance(from_points([(50, (1, 1, 1), 0.0), (51, (1, 1, 1), 1.0)]), light=None)
    how = Resampler(order=Rays(quality=quality))
    subject = Subject.of(as_volume(values), look, how)
    eye = subject.camera(camera, *size)
    frame = how(subject.samples_for(eye), eye, height=size[0], width=size[1])
    columns, left = frame.rgba[..., 3].sum(axis=0, dtype=np.float64), np.arange(size[1])
    reach, areas = 14 * per_voxel, []
    for x in size[1] / 2 + per_voxel * np.cos(turn) * (WALLS - 121.5):
        inside = np.minimum(left + 1, x + reach) - np.maximum(left, x - reach)
        areas.append((columns * np.maximum(inside, 0.0)).sum())
    return np.array(areas) / per_voxel**2


@pytest.mark.parametrize("per_voxel", [0.5, 0.25, 0.125])
@pytest.mark.parametrize("tilt", [0, 4, 30])
@pytest.mark.parametrize("kind", ["u1", "f4"])
def test_walls_of_a_voxel_from_afar_have_their_area_wherever_they_meet_pixels(
    per_voxel: float, tilt: float, kind: str
) -> None:
    areas = areas_of_walls(kind, per_voxel, tilt)
    assert np.abs(areas / wall_area(tilt) - 1).max() < 0.05


@pytest.mark.parametrize("opacity", [1.0, 0.3])
@pytest.mark.parametrize("what", ["specks", "pores", "slits"])
def test_what_may_hide_between_first_rays_has_its_area(
    what: str, opacity: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng, values = np.random.default_rng(2), np.zeros((60, 60, 60), np.uint8)
    if what == "specks":
        values[rng.random(values.shape) < 5e-4] = 100
    else:
        values[24:28, 6:54, 6:54] = 100
        where = (rng.integers(0, 60, 30), rng.integers(0, 60, 30))
        values[:, where[0] if what == "pores" else slice(None), where[1]] = 0
    camera, size = ahead(values, 0.125)
    look = Appearance(from_points([(50, (1, 1, 1), 0.0), (51, (1, 1, 1), opacity)]), light=None)
    how = Resampler(order=Rays(quality="usual"))
    subject = Subject.of(as_volume(values), look, how)
    eye, areas = subject.camera(camera, *size), []
    for first in (painting.FIRST_RAYS, 99):
        monkeypatch.setattr(painting, "FIRST_RAYS", first)
        frame = how(subject.samples_for(eye), eye, height=size[0], width=size[1])
        areas.append(frame.rgba[..., 3].sum(dtype=np.float64))
    assert areas[0] == pytest.approx(areas[1], rel=0.02)
    assert areas[1] > 0.3


@pytest.mark.parametrize("kind", ["u1", "f4"])
def test_a_wall_of_a_voxel_is_as_wide_from_close_by(kind: str) -> None:
    assert np.abs(areas_of_walls(kind, 3.0, 0, "best") / 20 - 1).max() < 0.05


@pytest.mark.parametrize("along", [1, 2, 3])
@pytest.mark.parametrize("is_hole", [False, True])
def test_what_is_thin_is_as_large_as_its_voxels(along: int, is_hole: bool) -> None:
    """A wall, a line and a point, and such holes: of their voxels, in parts of 1/8."""
    from scipy.ndimage import map_coordinates

    values = np.zeros((9, 9, 9), np.uint8)
    values[tuple([4] * along + [slice(None)] * (3 - along))] = 1
    count, values = values.sum(), values ^ np.uint8(is_hole)
    level, zero, scale = with_true_thickness(values, np.array([0.0, 1.0]))
    field = zero + scale * level.astype(np.float64)
    part = np.stack(np.meshgrid(*[(np.arange(72) + 0.5) / 8 - 0.5] * 3, indexing="ij"))
    is_high = map_coordinates(field, part, order=3, mode="reflect") > 0.5
    assert (is_high != is_hole).sum() / 8**3 / count == pytest.approx(1.0, abs=0.12)
