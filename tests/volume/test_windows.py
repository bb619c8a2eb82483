"""Dense volumes in bricks, painted window by window, have the bits of volumes in memory."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from resample import Footprint, Primitive, Resampler
from resample.cameras.viewpoints import Orbit
from resample.command.settings import Sharing
from resample.command.workers import at_work
from resample.outofcore import samples
from resample.outofcore.boxes import PartBoxes
from resample.outofcore.bricks import bricks_in_memory, with_neighbours
from resample.outofcore.passes import PassContext
from resample.profiles.orders import ImageSheets
from resample_comparisons.volume.painting import AxisSheets
from resample_volume import windows
from resample_volume.classification.labels import Labels, Rule
from resample_volume.classification.materials import Windowed
from resample_volume.classification.regions import Region, RegionTransfer
from resample_volume.classification.transfer import visible_places
from resample_volume.data.bricks import Bricks
from resample_volume.data.recordings import volume_at
from resample_volume.files.source import open_streamed
from resample_volume.files.stores.chunks import Single
from resample_volume.files.stores.writing import Layered, write_store
from resample_volume.media.appearance import Appearance, Classification
from resample_volume.outofcore import windowed
from resample_volume.outofcore.steepness import Slopes, steepness_by_bricks
from resample_volume.rendering import Subject
from resample_volume.surfaces.meshes import scene_mesh
from resample_volume.types import Recording, Volume
from resample_volume.voxels import blocks
from resample_volume.voxels.blocks import Lattice, ends_of, lattice_for, passed
from resample_volume.voxels.framing import centered
from resample_volume.voxels.shading import DepthCue
from resample_volume.voxels.streaming import BYTES_PER_VOXEL
from resample_volume.voxels.visible import BYTES_PER_CANDIDATE, gradients_at, lattice_of, steepness
from resample_volume.windows import Budget
from tests.killing import Killing
from tests.volume.dense import EYE, LAYERS, SIZE, in_bricks, in_windows, smoke
from tests.volume.of_voxels import of_voxels

WALLS = RegionTransfer(
    (
        Region((0.2, 0.9), (1, 0.5, 0), 0.5, (0.3, 0.9), (0.1, 0.2)),
        Region((0.5, 1.0), (0, 0.5, 1), 0.2, (0.0, 0.4)),
    ),
    normalized=True,
)
STEPS = RegionTransfer((Region((10, 190), (1, 0.5, 0), 0.5, (15, 90), (0, 5)),))
RULES = {1: Rule((1, 0, 0)), 2: Rule(opacity=0.0), 3: Rule((0, 1, 1), 2.5)}
TISSUE = Labels(np.random.default_rng(3).integers(0, 5, (37, 26, 31)).astype(np.uint8), RULES)
CUT = {"crop": "2:29,:,:36", "clip": ("1/0.3/-0.5/-9",)}

LOOKS = [
    of_voxels("60..190"),
    of_voxels("60..190", light=None),
    of_voxels("60..190", cue=DepthCue(0.6), **CUT),
    of_voxels(WALLS, **CUT),
    of_voxels(STEPS, light=None, gradient="sobel"),
    of_voxels("60..190", gradient_opacity=(0.2, 0.8)),
    of_voxels("20..190", labels=TISSUE),
    of_voxels(WALLS, labels=TISSUE, **CUT),
]
BITS_ARE_KEPT = pytest.mark.sweep


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("memory", "number"),
    [
        (750_000, 7),
        (1 << 30, 2),
        *(pytest.param(750_000, number, marks=BITS_ARE_KEPT) for number in range(7)),
        *(pytest.param(1 << 30, number, marks=BITS_ARE_KEPT) for number in (0, 1, 3, 4, 5, 6, 7)),
    ],
)
def test_windows_have_the_bits_of_a_volume_in_memory(number, memory, rng):
    volume, look = smoke(rng), LOOKS[number]
    side = ((8, 8, 8), (5, 7, 9))[number % 2]
    subject = Subject.of(volume, look, around=volume)
    camera = subject.camera(EYE, *SIZE)
    by = {"height": SIZE[0], "width": SIZE[1], "clip": subject.clip}
    whole = Resampler()(subject.samples_for(camera), camera, **by)
    found, windows = in_windows(in_bricks(volume, side), look, EYE, SIZE, Budget(memory))
    assert (windows > 1) == (memory < 1 << 30)
    for name in ("rgba", "depth", "first_depth", "coverage"):
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("kind", "side"),
    [
        (np.uint8, (8, 8, 8)),
        *(
            pytest.param(*each, marks=pytest.mark.sweep)
            for each in [(np.uint8, (37, 3, 31)), (np.int32, (8, 8, 8)), (np.int32, (37, 3, 31))]
        ),
    ],
)
def test_labels_may_be_in_bricks_of_their_own(side, kind, rng):
    volume, label = smoke(rng), TISSUE.values.astype(kind)
    label[8:24, :8] = 1
    bricks = in_bricks(volume._replace(values=label), side).values
    whole = whole_of(volume, of_voxels("20..190", labels=Labels(label, RULES)))
    look = of_voxels("20..190", labels=Labels(bricks, RULES))
    for spent in (Budget(850_000), Budget(1 << 30)):
        found, _ = in_windows(in_bricks(volume, (8, 8, 8)), look, EYE, SIZE, spent)
        for name in LAYERS:
            assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name
    whole = Subject.of(in_bricks(volume, (8, 8, 8)), look, around=volume)
    other = Subject.of(volume, replace(look, labels=Labels(label, RULES)), around=volume)
    assert whole.facts() == other.facts()


def test_labels_that_do_not_fit_are_refused_before_bricks_are_read(rng):
    volume, read = counted(smoke(rng), (8, 8, 8))
    look = of_voxels("60..190", labels=Labels(TISSUE.values[1:], RULES))
    with pytest.raises(ValueError, match="labels of 31 x 26 x 36 voxels do not fit a volume of"):
        in_windows(volume, look, EYE, SIZE, Budget(1 << 30))
    assert not read


@pytest.mark.some(1)
@pytest.mark.parametrize("workers", [None, 2])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_the_slope_of_a_full_surface_is_found_brick_by_brick(kind, workers, rng):
    volume = smoke(rng)._replace(values=rng.normal(100, 40, (21, 17, 30)).astype(kind))
    transfer, every = Windowed(WALLS, (40.0, 150.0)), np.arange(volume.values.size)
    seen = visible_places(transfer, volume.values.reshape(-1), (0.0, 1.0))
    assert 0 < seen.size < every.size
    length = np.linalg.norm(gradients_at(volume, seen, "sobel"), axis=1)
    with ThreadPoolExecutor(workers or 1) as executor:
        looking = PassContext(executor if workers else None)
        slopes = Slopes(in_bricks(volume, (8, 7, 5)), transfer, "sobel")
        assert steepness_by_bricks(slopes, looking) == steepness(length)
        nothing = slopes._replace(transfer=Windowed(WALLS, (900.0, 990.0)))
        assert steepness_by_bricks(nothing, looking) == 0


def test_what_needs_all_voxels_or_too_much_memory_is_refused(rng):
    volume = in_bricks(smoke(rng), (16, 16, 16))
    look = of_voxels("60..190", meshes=(scene_mesh(np.eye(3), np.array([[0, 1, 2]])),))
    with pytest.raises(ValueError, match="a mesh needs rays through a field"):
        in_windows(volume, look, EYE, SIZE, Budget(1 << 30))
    look = Appearance("60..190", classification=Classification.POST)
    with pytest.raises(ValueError, match="classification post needs rays through a field"):
        in_windows(volume, look, EYE, SIZE, Budget(1 << 30))
    with pytest.raises(ValueError, match="fit in the allowed memory"):
        in_windows(volume, of_voxels("60..190"), EYE, SIZE, Budget(1000))


@pytest.mark.parametrize("eye", [EYE, Orbit(200, -40, 6.0), Orbit(10, 5, fov=0)])
@pytest.mark.parametrize("side", [8, 16])
def test_blocks_are_where_their_footprints_are(eye, side, rng):
    volume = smoke(rng)
    subject = Subject.of(volume, of_voxels("60..190"), around=volume)
    camera = subject.camera(eye, *SIZE)
    seen = subject.samples_for(camera)
    records = Resampler().footprints(seen, camera, height=SIZE[0], width=SIZE[1])
    moved = centered(volume)[0]
    back = np.linalg.inv(lattice_of(moved)).T
    z, y, x = np.rint((seen.position - moved.origin) @ back).astype(int).T[::-1]
    lattice = Lattice(volume.values.shape, side)
    every = np.arange(np.prod(lattice.blocks))
    boxes = PartBoxes(*ends_of(lattice, every), lattice_of(moved), moved.origin)
    bounds = boxes.on_screen(camera.view(), Resampler().reconstruction.radius)
    block = np.ravel_multi_index((z // side, y // side, x // side), lattice.blocks)
    is_seen = records["left"] <= records["right"]
    assert is_seen.sum() > 1000
    left, top, right, bottom = bounds[block[is_seen]].T
    known, margin = records[is_seen], 1.0  # of the pixel filter, and of rounding
    assert (known["left"] >= left - margin).all()
    assert (known["right"] <= right + margin).all()
    assert (known["top"] >= top - margin).all()
    assert (known["bottom"] <= bottom + margin).all()


def whole_of(volume, look):
    subject = Subject.of(volume, look, around=volume)
    camera = subject.camera(EYE, *SIZE)
    return Resampler()(subject.samples_for(camera), camera, height=SIZE[0], width=SIZE[1])


def stored(volume, path):
    """The same volume in a store, in chunks of 16 voxels per side."""
    recording = Recording(Single(volume.values), *volume[1:5])
    write_store(path, recording, Layered(chunk=16, is_layered=False))
    found = volume_at(open_streamed(path), None, None)
    return found._replace(values=replace(found.values, side=(8, 8, 8)))


@pytest.mark.sweep
@pytest.mark.parametrize(
    "workers",
    [
        3,
        pytest.param(1, marks=pytest.mark.sweep),
    ],
)
def test_any_number_of_workers_paints_the_same_bits(workers, rng, tmp_path):
    volume, look = smoke(rng), of_voxels("60..190")
    whole = whole_of(volume, look)
    with ThreadPoolExecutor(workers) as executor:
        spent = Budget(700_000, 1, tmp_path, executor)
        found, windows = in_windows(in_bricks(volume, (8, 8, 8)), look, EYE, SIZE, spent)
    assert len(list(tmp_path.iterdir())) == windows > 1
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name


@pytest.mark.sweep
@settings(max_examples=8)
@given(
    shape=st.tuples(*[st.integers(6, 34)] * 3),
    side=st.tuples(*[st.integers(3, 20)] * 3),
    memory=st.sampled_from([400_000, 800_000, 1 << 30]),
    workers=st.integers(1, 3),
    gradient=st.sampled_from(["central", "sobel"]),
)
@example((34, 20, 34), (8, 8, 8), 800_000, 2, "central")
def test_any_partition_gives_the_same_bits(shape, side, memory, workers, gradient):
    values = np.random.default_rng(sum(shape)).integers(0, 200, shape).astype(np.uint8)
    volume = Volume(values, np.array([1.0, 0.8, 1.2]), np.zeros(3), np.eye(3), "any")
    look = of_voxels("60..190", gradient=gradient)
    with ThreadPoolExecutor(workers) as executor:
        spent = Budget(memory, workers, executor=executor)
        try:
            found, _ = in_windows(in_bricks(volume, side), look, EYE, SIZE, spent)
        except ValueError as error:
            assert "fit in the allowed memory" in str(error)  # noqa: PT017  also right
            return
    whole = whole_of(volume, look)
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize(
    "at",
    [
        (1,),
        pytest.param(
            (0, 1),
            marks=pytest.mark.sweep,
        ),
    ],
)
def test_a_killed_worker_costs_a_picture_its_own_windows_alone(at, rng, tmp_path):
    volume, look = smoke(rng), of_voxels("60..190")
    whole, in_file = whole_of(volume, look), stored(volume, tmp_path / "smoke.zarr")
    for name in ("marks", "windows"):
        (tmp_path / name).mkdir()
    with at_work(Sharing(workers=2)) as crew:
        killing = Killing(crew.executor, tmp_path / "marks", 1, is_late=True, at=at)
        spent = Budget(700_000, 1, tmp_path / "windows", killing)
        found, windows = in_windows(in_file, look, EYE, SIZE, spent)
    assert windows > 2
    for number in at:
        assert killing.redone(number)
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name


FEW = (60, 75)  # px


def in_small_steps(monkeypatch):
    monkeypatch.setattr(samples, "LEAST", 1000)
    monkeypatch.setattr(blocks, "SIDE", 4)


@pytest.mark.sweep
@pytest.mark.parametrize(
    "workers",
    [
        None,
        pytest.param(2, marks=pytest.mark.sweep),
    ],
)
def test_bricks_that_are_on_a_shelf_are_read_once(workers, rng, monkeypatch):
    in_small_steps(monkeypatch)
    values = rng.integers(0, 200, (48, 48, 48)).astype(np.uint8)
    volume = Volume(values, np.ones(3), np.zeros(3), np.eye(3), "smoke")
    in_file, read = counted(volume, (8, 8, 8))
    look, whole = of_voxels("5..190"), whole_of(volume, of_voxels("5..190"))
    with ThreadPoolExecutor(workers or 1) as executor:
        spent = Budget(4_000_000, executor=executor if workers else None)
        found, _ = in_windows(in_file, look, EYE, SIZE, spent)
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name
    assert len(read) < 1.05 * 6**3  # two threads may ask for one at a time


def noted_steps(monkeypatch):
    """Samples of a step of each window that fits; 0 where all are loaded at once."""
    steps, fitting = [], samples.SampledPicture._fitting

    def noted(*given):
        task = fitting(*given)
        steps.append(0 if task is None else task.step)
        return task

    monkeypatch.setattr(samples.SampledPicture, "_fitting", noted)
    return steps


def counted(volume, side):
    """Volume in bricks, and those that are read of it."""
    read, values = [], volume.values

    def at(box):
        read.append(tuple(part.start for part in box))
        return np.ascontiguousarray(values[box])

    bricks = Bricks(at, values.shape, values.dtype, side)
    return volume._replace(values=bricks), read


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("workers", "eye"),
    [
        (None, EYE),
        *(
            pytest.param(
                *each,
                marks=pytest.mark.sweep,
            )
            for each in [
                (None, Orbit(30, 20, 0.45)),
                (None, Orbit(200, -40, fov=0)),
                (2, EYE),
                (2, Orbit(30, 20, 0.45)),
                (2, Orbit(200, -40, fov=0)),
            ]
        ),
    ],
)
def test_windows_are_painted_step_by_step_with_the_same_bits(eye, workers, rng, monkeypatch):
    in_small_steps(monkeypatch)
    steps, look = noted_steps(monkeypatch), of_voxels("5..190")
    values = rng.integers(0, 200, (48, 48, 48)).astype(np.uint8)
    volume = Volume(values, np.array([1.0, 0.8, 1.2]), np.zeros(3), np.eye(3), "smoke")
    subject = Subject.of(volume, look, around=volume)
    camera = subject.camera(eye, *FEW)
    whole = Resampler()(subject.samples_for(camera), camera, height=FEW[0], width=FEW[1])
    with ThreadPoolExecutor(workers or 1) as executor:
        spent = Budget(4_000_000, executor=executor if workers else None)
        found, _ = in_windows(in_bricks(volume, (8, 8, 8)), look, eye, FEW, spent)
    assert max(steps) > 0
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name


@pytest.mark.sweep
def test_bricks_that_others_hide_are_not_read(rng, monkeypatch):
    in_small_steps(monkeypatch)
    monkeypatch.setattr(windows, "SHARE", 1 << 40)  # nothing is on a shelf
    values = rng.integers(200, 255, (64, 64, 64)).astype(np.uint8)
    volume = Volume(values, np.ones(3), np.zeros(3), np.eye(3), "a solid cube")
    look, bricks = of_voxels("100/white/0,180/white/0.95", light=None), 8**3
    in_file, read = counted(volume, (8, 8, 8))
    surveyed, before = windowed.surveyed, []

    def then(*given):
        known = surveyed(*given)
        before.append(len(read))
        return known

    monkeypatch.setattr(windows, "surveyed", then)
    found, _ = in_windows(in_file, look, EYE, SIZE, Budget(9_000_000))
    painting = read[before[0] :]
    whole = whole_of(volume, look)
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name
    assert len(set(painting)) < 0.8 * bricks
    assert len(painting) < 1.2 * len(set(painting))


@pytest.mark.sweep
def test_further_pictures_ask_for_what_they_show_alone(rng, monkeypatch):
    in_small_steps(monkeypatch)
    values = rng.integers(200, 255, (48, 48, 48)).astype(np.uint8)
    volume = Volume(values, np.ones(3), np.zeros(3), np.eye(3), "a solid cube")
    look = of_voxels("100/white/0,180/white/0.95", light=None)
    in_file, read = counted(volume, (8, 8, 8))
    in_windows(in_file, look, EYE, SIZE, Budget(9_000_000))
    read.clear()
    other = Orbit(200, -30, 1.5)
    found, _ = in_windows(in_file, look, other, SIZE, Budget(9_000_000))
    again, _ = in_windows(counted(volume, (8, 8, 8))[0], look, other, SIZE, Budget(9_000_000))
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(again, name).tobytes(), name
    assert len(set(read)) < 0.9 * 6**3


STEPS_ARE_KEPT = pytest.mark.sweep
PAINTERS = [
    (Resampler(order=AxisSheets()), Orbit(4, 3, 1.3)),
    (Resampler(order=ImageSheets()), Orbit(4, -3, 0.45)),
    (Resampler(primitive=Primitive.POINTS), Orbit(4, 3, 0.2)),
    (Resampler(footprint=Footprint.AFFINE), Orbit(4, 3, 1.3)),
]


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize(
    "number",
    [2, *(pytest.param(number, marks=STEPS_ARE_KEPT) for number in (0, 1, 3))],
)
def test_whoever_paints_has_the_same_bits_step_by_step(number, rng, monkeypatch):
    in_small_steps(monkeypatch)
    steps = noted_steps(monkeypatch)
    values = rng.integers(0, 200, (36, 100, 36)).astype(np.uint8)
    volume = Volume(values, np.array([1.0, 0.8, 1.2]), np.zeros(3), np.eye(3), "smoke")
    look, (paint, eye) = of_voxels("5..190"), PAINTERS[number]
    subject = Subject.of(volume, look, around=volume)
    camera = subject.camera(eye, *FEW)
    whole = paint(subject.samples_for(camera), camera, height=FEW[0], width=FEW[1])
    spent = Budget(4_000_000)
    found, _ = in_windows(in_bricks(volume, (8, 8, 8)), look, eye, FEW, spent, paint)
    assert max(steps) > 0
    for name in LAYERS:
        assert getattr(found, name).tobytes() == getattr(whole, name).tobytes(), name


@pytest.mark.parametrize(("layers", "parts"), [(1, 1), (4, 2), (7, 3), (40, 8)])
def test_parts_that_processes_look_at_are_two_bricks_thick(layers, parts):
    values = np.zeros((8 * layers, 8, 8), np.uint8)
    bricks = Bricks(values.__getitem__, values.shape, values.dtype, (8, 8, 8))

    def asked(part):
        return np.flatnonzero(part.request.is_requested.any(axis=(1, 2)))

    with ThreadPoolExecutor(2) as executor:
        lattice = lattice_for(values.shape)
        found = passed(bricks, lattice, asked, PassContext(executor))
    assert len(found) == parts
    assert min(len(part) for part in found) * lattice.side >= 8 * min(layers, 2)
    np.testing.assert_array_equal(np.concatenate(found), np.arange(lattice.blocks[0]))


@pytest.mark.parametrize("sifts", [False, True])
def test_memory_of_blocks_is_that_of_bricks_voxels_and_candidates(monkeypatch, sifts):
    """Candidates may turn out to be transparent: all voxels of blocks that are scanned count."""
    side, sizes = 4, np.array([9, 5, 70])
    bricks = SimpleNamespace(
        shape=(16, 8, 8), side=(8, 8, 8), count=(2, 1, 1), pinned_bytes=100, bytes_each=1000
    )
    monkeypatch.setattr(windowed, "bricks_of", lambda _: bricks)
    source = SimpleNamespace(
        volume=None, blocks=SimpleNamespace(side=side, blocks=(4, 2, 2)), beside=30, threads=3,
        volumes=2, sifts=sifts,
    )  # fmt: skip
    held = windowed.VoxelBlocks.held
    assert held(source, np.zeros(0, int), sizes[:0]) == 130
    one = held(source, np.array([0, 1]), sizes[:2]) - 130  # in the first brick
    two = held(source, np.array([0, 1, 12]), sizes) - 130  # and in the second
    bricks_held = bricks_in_memory(with_neighbours(np.ones((2, 1, 1), bool)))
    each = [14 * BYTES_PER_VOXEL, 70 * BYTES_PER_VOXEL]
    if sifts:
        each = [max(bytes_, 2 * side**3 * BYTES_PER_CANDIDATE) for bytes_ in each]
    for found, voxels in ((one, each[0]), (two, each[1])):
        assert found == (bricks_held + 3) * 1000 + (3 + 1) * 2 * voxels
