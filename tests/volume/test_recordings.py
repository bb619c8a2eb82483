"""Files and arrays that hold several times, channels or colors."""

import struct

import numpy as np
import pytest
import SimpleITK

from resample.cameras.viewpoints import Orbit
from resample.colors import from_srgb
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_comparisons.volume.painting import ImageSheets
from resample_volume.appearance import Appearance, Classification
from resample_volume.calls import render
from resample_volume.classification.transfer import from_points
from resample_volume.data.recordings import linear_colors, volume_at, with_times_first
from resample_volume.files.metaimage import MetaImage
from resample_volume.files.nifti import Nifti
from resample_volume.files.nrrd import Nrrd
from resample_volume.files.readers import Npy
from resample_volume.files.source import open_recording, open_volume, read_labels
from resample_volume.files.tiff import TiffStack
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from resample_volume.voxels.visible import classify
from tests.volume.of_voxels import of_voxels

SPACING, ORIGIN = (1.0, 2.0, 3.5), (5.0, 6.0, -7.0)
TURNED = ((0.8, -0.6, 0), (0.6, 0.8, 0), (0, 0, 1))
META_OF_TIMES = (
    b"ObjectType = Image\nNDims = 4\nDimSize = 2 2 2 %d\nElementType = MET_UCHAR\n"
    b"ElementDataFile = LOCAL\n"
)
FORMS = {"a.nrrd": Nrrd, "a.mha": MetaImage, "a.nii": Nifti, "a.nii.gz": Nifti}
ALL = from_points([(0, (1, 1, 1), 0.5)])
SHEETS = Resampler(order=ImageSheets())
SIZE = {"height": 24, "width": 24}
SQUARE = (24, 24)


@pytest.fixture
def films(rng):
    return rng.integers(0, 60000, (5, 10, 11, 12)).astype(np.uint16)


@pytest.fixture
def colors(rng):
    return rng.integers(0, 256, (10, 11, 12, 3)).astype(np.uint8)


def written(path, values, *, vector=False):
    image = SimpleITK.GetImageFromArray(values, isVector=vector)
    many = image.GetDimension() == 4
    image.SetSpacing(SPACING + (0.1,) * many)
    image.SetOrigin(ORIGIN + (0.0,) * many)
    direction = np.eye(4 if many else 3)
    direction[:3, :3] = TURNED
    image.SetDirection(direction.ravel().tolist())
    SimpleITK.WriteImage(image, str(path), path.suffix == ".gz")
    return path


def in_space(held):
    np.testing.assert_allclose(held.spacing, SPACING, rtol=1e-6)
    np.testing.assert_allclose(held.origin, ORIGIN, rtol=1e-6)
    np.testing.assert_allclose(held.direction, TURNED, atol=1e-6)


# Times


@pytest.mark.parametrize("name", FORMS)
def test_times_are_read_and_one_is_chosen(name, films, tmp_path):
    path = written(tmp_path / name, films)
    held = open_recording(path)
    assert held.values.shape == (5, 1, 10, 11, 12)
    in_space(held)
    one = volume_at(held, 3, None)
    in_space(one)
    assert np.array_equal(one.values, films[3])
    assert one.name == "a (time 3)"
    assert np.array_equal(volume_at(held, -1, None).values, films[4])
    for time, complaint in (
        (None, r"a has 5 times; a volume is one of them: choose one by time, 0 to 4 \(--time 0; "),
        (5, "a has 5 times, 0 to 4; there is no time 5"),
        (-6, "there is no time -6"),
    ):
        with pytest.raises(ValueError, match=complaint):
            volume_at(held, time, None)
    with pytest.raises(ValueError, match=r"4 dimensions, 12 x 11 x 10 x 5; a volume has 3"):
        open_volume(path)
    assert np.array_equal(open_volume(path, time=3).values, films[3])


def test_a_file_of_one_time_is_a_volume(films, tmp_path):
    volume = open_volume(written(tmp_path / "a.nii", films[:1]))
    assert np.array_equal(volume.values, films[0])
    assert volume.name == "a"


def test_numpy_arrays_have_times_or_channels_first(films, tmp_path):
    np.save(tmp_path / "a.npy", films)
    held = Npy().recorded(tmp_path / "a.npy")
    assert np.array_equal(volume_at(held, 2, None).values, films[2])
    assert np.array_equal(volume_at(held, None, 2).values, films[2])
    np.save(tmp_path / "b.npy", np.stack([films, films + 1], 1))
    both = Npy().recorded(tmp_path / "b.npy")
    assert np.array_equal(volume_at(both, 2, 1).values, films[2] + 1)
    with pytest.raises(ValueError, match=r"2 channels; .* by channel, 0 to 1"):
        volume_at(both, 2, None)
    with pytest.raises(ValueError, match=r"5 times; .* by time, 0 to 4"):
        volume_at(both, None, 1)
    for name in ("a.npy", "b.npy"):
        with pytest.raises(ValueError, match="has 4 dimensions"):
            open_volume(tmp_path / name)


@pytest.mark.parametrize("kind", ["list", "vector"])
def test_a_list_of_nrrd_is_of_times_or_channels(kind, films, tmp_path):
    path = written(tmp_path / "a.nrrd", np.moveaxis(films[:3], 0, -1).copy(), vector=True)
    path.write_bytes(path.read_bytes().replace(b"kinds: vector", f"kinds: {kind}".encode(), 1))
    held = open_recording(path)
    in_space(held)
    assert held.is_color == (kind == "vector")
    assert np.array_equal(volume_at(held, 1, None).values, films[1])
    assert np.array_equal(volume_at(held, None, 2).values, films[2])
    assert len(with_times_first(held).values) == (3 if kind == "list" else 1)
    if kind == "list":
        with pytest.raises(ValueError, match=r"3 numbers each; .* by channel, 0 to 2"):
            open_volume(path)


# Colors


@pytest.mark.parametrize("name", ["a.nrrd", "a.mha"])
@pytest.mark.parametrize("parts", [3, 4])
def test_vectors_of_3_or_4_are_colors(name, parts, rng, tmp_path):
    values = rng.integers(0, 65536, (10, 11, 12, parts)).astype(np.uint16)
    volume = open_volume(written(tmp_path / name, values, vector=True))
    in_space(volume)
    assert np.array_equal(volume.colors, values)
    light = from_srgb(values[..., :3] / 65535)
    np.testing.assert_allclose(linear_colors(volume.colors), light, atol=1e-6)
    if parts == 4:
        assert np.array_equal(volume.values, values[..., 3])
    else:
        assert np.array_equal(volume.values, values.max(axis=-1))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.nrrd", b"NRRD0004\ntype: uint8\ndimension: 4\nsizes: 2 2 2 0\nencoding: raw\n\n"),
        ("b.nrrd", b"NRRD0004\ntype: uint8\ndimension: 4\nsizes: 2 2 2 -2\nencoding: raw\n\n"),
        ("c.nrrd", b"NRRD0004\ntype: int8\ndimension: 4\nsizes: 2 2 2 0\nencoding: gzip\n\n"),
        ("a.mha", META_OF_TIMES % 0),
        ("b.mha", META_OF_TIMES % -1),
    ],
)
@pytest.mark.parametrize("read", [open_volume, open_recording])
def test_a_file_of_no_times_is_refused(read, name, content, tmp_path):
    (tmp_path / name).write_bytes(content + bytes(8))
    with pytest.raises(ValueError, match=r"is empty: (0|-[12]) times, 1 numbers at each voxel"):
        read(tmp_path / name)


@pytest.mark.parametrize("shape", [(0, 2, 2, 2), (0, 2, 2, 2, 2), (2, 0, 2, 2, 2)])
def test_arrays_of_no_times_or_channels_are_refused(shape, tmp_path):
    np.save(tmp_path / "a.npy", np.zeros(shape, np.uint8))
    with pytest.raises(ValueError, match=r"a is empty: . times, . numbers"):
        open_recording(tmp_path / "a.npy")


def test_rgb24_of_nifti_is_color(colors, tmp_path):
    path = written(tmp_path / "a.nii", colors[..., 0].copy())
    head = bytearray(path.read_bytes()[:352])
    struct.pack_into("<hh", head, 70, 128, 24)
    path.write_bytes(bytes(head) + colors.tobytes())
    volume = open_volume(path)
    in_space(volume)
    assert np.array_equal(volume.colors, colors)


@pytest.mark.parametrize("suffix", [".tif", ".png"])
@pytest.mark.parametrize("parts", [3, 4])
def test_color_slices_are_colors_not_multiplied_by_opacity(suffix, parts, rng, tmp_path):
    import OpenImageIO

    values = rng.integers(0, 256, (3, 5, 6, parts)).astype(np.uint8)
    spec = OpenImageIO.ImageSpec(6, 5, parts, "uint8")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    for n, page in enumerate(values):
        file = OpenImageIO.ImageOutput.create(str(tmp_path / f"{n}{suffix}"))
        file.open(str(tmp_path / f"{n}{suffix}"), spec)
        file.write_image(page)
        file.close()
    assert np.array_equal(open_volume(tmp_path).colors, values)


def test_colors_that_are_multiplied_by_opacity_are_divided_again(tmp_path):
    import OpenImageIO

    straight = np.tile(np.array([200, 100, 50, 128], np.uint8), (4, 5, 1))
    stored = straight.copy()
    stored[..., :3] = np.rint(straight[..., :3] * (128 / 255))
    for n in range(2):
        path = str(tmp_path / f"{n}.tif")
        file = OpenImageIO.ImageOutput.create(path)
        file.open(path, OpenImageIO.ImageSpec(5, 4, 4, "uint8"))
        file.write_image(stored)
        file.close()
    found = open_volume(tmp_path).colors
    assert np.abs(found.astype(int) - straight).max() <= 1


def test_arrays_of_colors_are_volumes(colors, tmp_path):
    volume = as_volume(colors)
    np.save(tmp_path / "a.npy", colors)
    for held in (volume, open_volume(tmp_path / "a.npy")):
        voxels = classify(held, ALL, gradient=None)
        x, y, z = (voxels.position[:, n].astype(int) for n in range(3))
        np.testing.assert_allclose(voxels.color, from_srgb(colors[z, y, x] / 255), atol=1e-6)
    floats = np.full((4, 4, 4, 3), 0.25, np.float32)
    assert as_volume(floats).values == pytest.approx(0.25)
    with pytest.raises(ValueError, match=r"below 0, which are not colors; .*--channel 0"):
        as_volume(floats - 1)


def test_opacities_of_colors_are_those_of_voxels():
    values = np.zeros((6, 6, 6, 4), np.uint8)
    values[2:4, 2:4, 2:4] = (200, 30, 60, 128)
    frame = render(values, Appearance(light=None), Orbit(fov=0), size=SQUARE)
    seen = frame.rgba[frame.rgba[..., 3] > 0.3]
    shown = seen[:, :3] / seen[:, 3:]
    np.testing.assert_allclose(
        shown, np.tile(linear_colors(values[2, 2, 2]), (len(seen), 1)), rtol=1e-3
    )
    voxels = Subject.of(as_volume(values), of_voxels(light=None)).voxels
    np.testing.assert_allclose(voxels.extinction, -np.log(1 - 128 / 255), rtol=1e-5)


@pytest.mark.some(1)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_opacities_of_colors_without_one_do_not_depend_on_hue(dtype):
    most = 1.0 if np.dtype(dtype).kind == "f" else np.iinfo(dtype).max
    z, y, x = np.indices((9, 9, 9)) - 4
    ball = (x**2 + y**2 + z**2 < 10)[..., np.newaxis]
    for light in (0, most // 2 if most > 1 else 0.5, most):
        hues = np.concatenate([np.eye(3), 1 - np.eye(3), np.ones((1, 3))])
        balls = [as_volume((ball * hue * light).astype(dtype)) for hue in hues]
        gray = (ball[..., 0] * light).astype(dtype)
        assert all(np.array_equal(found.values, gray) for found in balls)
    look = Appearance("gray", light=None)
    opacity = [render(found, look, Orbit(fov=0), size=SQUARE).rgba[..., 3] for found in balls[::3]]
    assert np.ptp(opacity, axis=0).max() == 0
    assert opacity[0].max() > 0.99


def test_a_color_whose_number_is_missing_is_not_there():
    values = np.full((4, 4, 4, 3), 0.25, np.float32)
    values[1, 1, 1, 0] = np.nan
    assert len(classify(as_volume(values), ALL, gradient=None).position) == 63


def test_what_colors_cannot_be_is_refused(colors, tmp_path):
    volume = as_volume(colors)
    with pytest.raises(ValueError, match="has colors, which need the projection composite"):
        Subject.of(
            volume,
            Appearance(classification=Classification.POST),
            Resampler(order=Rays(), projection=Projection.MAXIMUM),
        )
    np.save(tmp_path / "a.npy", colors)
    with pytest.raises(ValueError, match="labels are whole numbers, one for each voxel"):
        read_labels(str(tmp_path / "a.npy"), (), volume)
    for shape in ((4, 4, 4, 2), (4, 4, 4, 5)):
        with pytest.raises(ValueError, match=r"a volume is an array \(Z, Y, X\)"):
            as_volume(np.zeros(shape))


# Pages of pictures


def tiff(path, pages, description):
    import OpenImageIO

    spec = OpenImageIO.ImageSpec(pages.shape[2], pages.shape[1], 1, "uint16")
    spec.attribute("ImageDescription", description)
    file = OpenImageIO.ImageOutput.create(str(path))
    file.open(str(path), [spec] * len(pages))
    for n, page in enumerate(pages):
        if n:
            file.open(str(path), spec, "AppendSubimage")
        file.write_image(np.ascontiguousarray(page)[..., np.newaxis])
    file.close()
    return path


OME = (
    '<?xml version="1.0"?><OME><Image><Pixels DimensionOrder="{}" SizeX="12" SizeY="11" '
    'SizeZ="{}" SizeC="{}" SizeT="{}"/></Image></OME>'
)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("order", "axes"), [("XYZCT", (0, 1, 2)), ("XYCZT", (0, 2, 1)), ("XYTZC", (1, 2, 0))]
)
def test_pages_of_ome_are_times_channels_and_slices(order, axes, films, tmp_path):
    values = np.stack([films[:4], films[:4] + 1], 1)[:, :, :6]  # (T, C, Z, Y, X)
    pages = values.transpose(*axes, 3, 4).reshape(-1, 11, 12)
    path = tiff(tmp_path / "a.tif", pages, OME.format(order, 6, 2, 4))
    assert np.array_equal(TiffStack().recorded(path).values, values)
    assert np.array_equal(volume_at(open_recording(path), 3, 1).values, values[3, 1])
    with pytest.raises(ValueError, match="has 4 dimensions"):
        open_volume(path)


def test_pages_of_imagej_are_times_and_slices(films, tmp_path):
    told = "ImageJ=1.53t\nimages=50\nslices=10\nframes=5\nhyperstack=true\n"
    path = tiff(tmp_path / "a.tif", films.reshape(-1, 11, 12), told)
    assert np.array_equal(open_recording(path).values[:, 0], films)
    path = tiff(tmp_path / "b.tif", films[0], "ImageJ=1.53t\nimages=10\nslices=10\n")
    assert np.array_equal(open_volume(path).values, films[0])
    path = tiff(tmp_path / "c.tif", films[0], told)
    with pytest.raises(ValueError, match="has 10 pages and says that they are 5 times"):
        open_recording(path)
