import io
import json
import struct
import zipfile

import numpy as np
import pytest
from PIL import Image

from conftest import real
from resample.cameras.files import read_shot
from resample.cameras.models import Camera
from resample.cameras.pixels import directions, pixel_centers, undistorted_places
from resample_warp3d.depth.encodings import (
    BareDisparity,
    Disparity,
    InverseDepth,
    PlanarDepth,
    RayLength,
    check_scale,
)
from resample_warp3d.depth.equation import of_rectified, places, warp_places
from resample_warp3d.depth.files import confident, read_depth
from resample_warp3d.types import DepthImage

SHAPE = (48, 64)
CAMERA = Camera.from_fov(60, *SHAPE)
FOCAL, BASELINE, DOFFS = 500.0, 0.2, 12.0
NEAR, FAR = 1.0, 8.0


def plane_and_sphere(camera):
    """Nearness of a slanted plane with a sphere before it; a corner is unknown."""
    lens = undistorted_places(camera, pixel_centers(SHAPE))
    place = lens if lens.size else pixel_centers(SHAPE)
    x, y = np.moveaxis(directions(camera, place), 2, 0)
    nearness = (1.0 + 0.3 * x + 0.2 * y) / 4.0  # z + 0.3 x + 0.2 y = 4
    # The sphere of radius 0.6 around (0.2, 0, 2.5): smaller root of |z (x, y, 1) − center|² = r².
    a, b, c = x * x + y * y + 1, 0.2 * x + 2.5, 0.2**2 + 2.5**2 - 0.6**2
    inside = b * b - a * c
    z = (b - np.sqrt(np.maximum(inside, 0))) / a
    nearness = np.where(inside > 0, 1 / z, nearness)
    nearness[:5, :7] = 0
    return nearness


TRUTH = plane_and_sphere(CAMERA)
KNOWN = TRUTH > 0
Z = np.where(KNOWN, 1 / np.where(KNOWN, TRUTH, 1), 0)
RAY = Z * np.sqrt(1 + (directions(CAMERA, pixel_centers(SHAPE)) ** 2).sum(axis=2))
DISPARITY = np.where(KNOWN, TRUTH * FOCAL * BASELINE - DOFFS, 0)
BETWEEN = np.where(KNOWN, (TRUTH - 1 / FAR) / (1 / NEAR - 1 / FAR), np.nan)

# The raw numbers, what they mean, and the largest error of nearness that they may have.
ROUNDED_Z = 0.5 / 5000 * TRUTH.max() ** 2 * 1.01  # of half a level of z, as of 1 / z
ENCODED = {
    "z, m": (Z, PlanarDepth(), 0),
    "z, mm": (np.round(Z * 1000).astype(np.uint16), PlanarDepth(scale=1000), 5 * ROUNDED_Z),
    "z, x 5000": (np.round(Z * 5000).astype(np.uint16), PlanarDepth(scale=5000), ROUNDED_Z),
    "ray": (RAY, RayLength(CAMERA), 0),
    "ray, x 5000": (np.round(RAY * 5000).astype(np.uint16), RayLength(CAMERA, 5000), ROUNDED_Z),
    "inverse": (TRUTH, InverseDepth(), 0),
    "inverse, 16 bits": (
        np.round(TRUTH * 60000).astype(np.uint16),
        InverseDepth(scale=60000),
        0.5 / 60000,
    ),
    "between near and far": (BETWEEN, InverseDepth(near=NEAR, far=FAR), 0),
    "disparity": (DISPARITY, Disparity(FOCAL, BASELINE, doffs=DOFFS), 0),
    "disparity, x 256": (
        np.round(DISPARITY * 256).astype(np.uint16),
        Disparity(FOCAL, BASELINE, 256, DOFFS),
        0.5 / 256 / (FOCAL * BASELINE),
    ),
    "bare disparity": (TRUTH, BareDisparity(), 0),
}


@pytest.fixture(params=ENCODED)
def encoded(request):
    return ENCODED[request.param]


def test_every_encoding_gives_the_same_nearness(encoded):
    raw, encoding, error = encoded
    atol = error + 1e-7  # of float32
    np.testing.assert_allclose(encoding.nearness(raw), np.where(KNOWN, TRUTH, 0), atol=atol)


def test_nearness_is_unknown_where_the_numbers_are(encoded):
    raw, encoding, _ = encoded
    np.testing.assert_array_equal(encoding.nearness(raw) > 0, KNOWN)


def test_a_quantum_is_the_step_between_levels(encoded):
    raw, encoding, error = encoded
    quantum = encoding.quantum(raw)
    if isinstance(encoding, PlanarDepth | RayLength) or raw.dtype.kind == "f":
        assert quantum is None
    else:
        assert quantum == pytest.approx(2 * error)


def test_eight_bits_between_near_and_far_are_mpeg_s():
    levels = np.array([[0, 51, 255]], np.uint8)
    nearness = InverseDepth(scale=255, near=2, far=10).nearness(levels)
    np.testing.assert_allclose(nearness, [[0.1, 0.2 * 0.4 + 0.1, 0.5]], rtol=1e-6)


def test_level_0_is_unknown_where_far_is_infinite():
    levels = np.array([[0, 255]], np.uint8)
    nearness = InverseDepth(scale=255, near=2, far=np.inf).nearness(levels)
    np.testing.assert_array_equal(nearness, [[0, 0.5]])


def test_the_quantum_of_stretched_levels_is_their_distance():
    raw = np.array([[0, 257, 514, 1285]], np.uint16)  # 8 bits in 16
    assert BareDisparity(scale=65535).quantum(raw) == pytest.approx(1 / 255)


def test_ray_lengths_follow_the_lens():
    camera = Camera(CAMERA.matrix, distortion=np.array([-0.2, 0.05, 1e-3, 0]))
    truth = plane_and_sphere(camera)
    x, y = np.moveaxis(directions(camera, undistorted_places(camera, pixel_centers(SHAPE))), 2, 0)
    with np.errstate(divide="ignore"):
        ray = np.sqrt(1 + x * x + y * y) / truth
    np.testing.assert_allclose(RayLength(camera).nearness(ray), truth, rtol=2e-7)


def test_floats_with_infinite_numbers_have_no_quantum():
    assert Disparity(FOCAL, BASELINE, 1.0).quantum(np.array([[np.inf, 2.0]])) is None


def test_numbers_that_are_all_unknown_have_no_quantum():
    assert BareDisparity(4).quantum(np.zeros((2, 2), np.uint8)) is None


@pytest.mark.parametrize("encoding", [PlanarDepth, InverseDepth, BareDisparity])
def test_zero_nan_inf_and_negative_numbers_are_unknown(encoding):
    raw = np.array([[0.0, np.nan, np.inf, -np.inf, -1.0, 1.0]])
    np.testing.assert_array_equal(encoding().nearness(raw), [[0, 0, 0, 0, 0, 1]])


def test_unknown_disparities_stay_unknown_whatever_doffs_is():
    raw = np.array([[0.0, np.inf, np.nan, -1.0]])
    assert not Disparity(FOCAL, BASELINE, doffs=31.0).nearness(raw).any()


def test_disparities_at_infinity_are_unknown():
    assert not Disparity(FOCAL, BASELINE, doffs=-5.0).nearness(np.array([[5.0, 4.0]])).any()


def test_depth_beyond_float32_is_unknown():
    np.testing.assert_array_equal(
        PlanarDepth().nearness(np.array([[1e-300, 1e300, 2.0]])) > 0, [[0, 0, 1]]
    )


@pytest.mark.parametrize("encoding", [PlanarDepth(), RayLength(CAMERA), BareDisparity()])
def test_whole_numbers_without_a_scale_are_refused_with_what_to_give(encoding):
    with pytest.raises(ValueError, match="1000 for mm, 5000 for TUM"):
        encoding.nearness(np.ones(SHAPE, np.uint16))


def test_normalised_values_above_1_are_refused_with_the_scale_to_give():
    with pytest.raises(ValueError, match="up to 200 instead of 1; give its scale"):
        InverseDepth(near=1, far=2).nearness(np.array([[200.0, 3.0]]))


@pytest.mark.parametrize(
    ("build", "complaint"),
    [
        (lambda: PlanarDepth(scale=0), "scale 0 is not finite and above 0"),
        (lambda: Disparity(-1.0, 0.1), "focal -1.0"),
        (lambda: Disparity(1.0, np.nan), "baseline nan"),
        (lambda: Disparity(1.0, 0.1, doffs=np.inf), "doffs inf"),
        (lambda: InverseDepth(near=1.0), "near and far"),
        (lambda: InverseDepth(near=2.0, far=1.0), "near 2 is not below far 1"),
        (lambda: BareDisparity(scale=-4), "scale -4"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(build, complaint):
    with pytest.raises(ValueError, match=complaint):
        build()


@pytest.mark.parametrize("factor", [1e-4, 1e4])
def test_a_doubtful_scale_warns(factor):
    assert "check the depth's scale" in check_scale(np.float32(TRUTH) * np.float32(factor))


def test_ordinary_depth_does_not_warn():
    assert check_scale(np.float32(TRUTH)) is None


def test_depth_that_is_missing_does_not_warn():
    assert check_scale(np.zeros(SHAPE, np.float32)) is None


# Files.


def write(path, data, names=("Y",)):
    """A picture by OpenImageIO, without any conversion."""
    import OpenImageIO

    data = data.reshape(*data.shape[:2], -1)
    spec = OpenImageIO.ImageSpec(
        data.shape[1],
        data.shape[0],
        data.shape[2],
        str(data.dtype).replace("32", "").replace("64", ""),
    )
    spec.channelnames = names
    target = OpenImageIO.ImageOutput.create(str(path))
    assert target.open(str(path), spec)
    assert target.write_image(np.ascontiguousarray(data))
    target.close()


def write_pfm(path, data, kind="<f4", scale=1.0, letters="Pf"):
    """A PFM by hand: rows from the bottom up, little-endian where the scale is negative."""
    signed = -scale if kind[0] == "<" else scale
    header = f"{letters}\n{data.shape[1]} {data.shape[0]}\n{signed}\n".encode()
    path.write_bytes(header + data[::-1].astype(kind).tobytes())


LEVELS = np.round(Z * 5000).astype(np.uint16)
SINGLE = Z.astype(np.float32)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("data", [LEVELS, (LEVELS >> 8).astype(np.uint8)], ids=["16", "8"])
def test_whole_numbers_come_back_as_they_are(tmp_path, suffix, data):
    path = tmp_path / f"depth{suffix}"
    write(path, data)
    found = read_depth(path)
    np.testing.assert_array_equal(found, data)
    assert found.dtype == data.dtype


@pytest.mark.parametrize("suffix", [".exr", ".tif"])
def test_floats_come_back_as_they_are(tmp_path, suffix):
    path = tmp_path / f"depth{suffix}"
    write(path, SINGLE)
    np.testing.assert_array_equal(read_depth(path), SINGLE)


def test_an_exr_gives_its_z(tmp_path):
    path = tmp_path / "all.exr"
    write(path, np.dstack([SINGLE * 0, SINGLE * 2, SINGLE]), ("R", "mask", "Z"))
    np.testing.assert_array_equal(read_depth(path), SINGLE)


def test_an_exr_s_channel_can_be_picked(tmp_path):
    path = tmp_path / "all.exr"
    write(path, np.dstack([SINGLE * 0, SINGLE * 2, SINGLE]), ("R", "far.Z", "near.Z"))
    np.testing.assert_array_equal(read_depth(f"{path}:far.Z"), SINGLE * 2)


def test_several_channels_are_refused_by_name(tmp_path):
    path = tmp_path / "color.png"
    write(path, np.arange(60, dtype=np.uint8).reshape(4, 5, 3), ("R", "G", "B"))
    with pytest.raises(
        ValueError, match=r"a picture in color; give the picture first, .*color\.png:R"
    ):
        read_depth(path)


@pytest.mark.parametrize("name", ["a.png", "a.tif", "b.png"])
def test_gray_depth_saved_in_colors_is_one_channel(tmp_path, name):
    more = [np.full_like(LEVELS, 65535)] if name[0] == "b" else []
    names = "RGBA" if more else "RGB"
    write(tmp_path / name, np.stack([LEVELS, LEVELS, LEVELS, *more], axis=2), tuple(names))
    np.testing.assert_array_equal(read_depth(tmp_path / name), LEVELS)


def test_equal_channels_of_floats_are_one_also_where_unknown(tmp_path):
    depth = (LEVELS / 1000).astype(np.float32)
    depth[0, :2] = np.nan, np.inf
    colors = np.repeat(depth[..., None], 3, axis=2)
    write(tmp_path / "a.exr", colors, tuple("RGB"))
    write_pfm(tmp_path / "a.pfm", colors, letters="PF")
    np.save(tmp_path / "a.npy", colors)
    for name in ("a.exr", "a.pfm", "a.npy"):
        np.testing.assert_array_equal(read_depth(tmp_path / name), depth)


def test_a_pfm_in_colors_that_differ_is_refused(tmp_path):
    write_pfm(tmp_path / "a.pfm", np.dstack([LEVELS, LEVELS, LEVELS + 1]), letters="PF")
    with pytest.raises(ValueError, match="3 channels that differ"):
        read_depth(tmp_path / "a.pfm")


def test_a_folder_is_called_one_and_not_missing(tmp_path):
    with pytest.raises(OSError, match=f"is a folder.*{tmp_path.name}"):
        read_depth(tmp_path)


def test_a_channel_that_is_missing_names_those_that_are_there(tmp_path):
    path = tmp_path / "depth.exr"
    write(path, SINGLE)
    with pytest.raises(ValueError, match="has no 'W'; it has the channels Y"):
        read_depth(f"{path}:W")


@pytest.mark.parametrize("kind", ["<f4", ">f4"])
def test_a_pfm_of_either_byte_order_stands_upright(tmp_path, kind):
    write_pfm(tmp_path / "depth.pfm", SINGLE, kind, scale=1 / 255)
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.pfm"), SINGLE)


def test_a_pfm_reads_as_opencv_reads_it(tmp_path):
    cv2 = pytest.importorskip("cv2")
    assert cv2.imwrite(str(tmp_path / "depth.pfm"), SINGLE)
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.pfm"), SINGLE)


@pytest.mark.parametrize("shape", [SHAPE, (*SHAPE, 1), (1, *SHAPE)])
def test_an_npy_may_have_an_axis_of_one(tmp_path, shape):
    np.save(tmp_path / "depth.npy", Z.reshape(shape).astype(">f8"))
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.npy"), Z)


def test_an_npz_gives_its_only_array(tmp_path):
    np.savez(tmp_path / "depth.npz", SINGLE)
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.npz"), SINGLE)


def test_an_npz_s_array_can_be_picked(tmp_path):
    np.savez(tmp_path / "both.npz", depth=SINGLE, mask=SINGLE > 0)
    np.testing.assert_array_equal(read_depth(f"{tmp_path}/both.npz:depth"), SINGLE)


def test_several_arrays_are_refused_by_name(tmp_path):
    np.savez(tmp_path / "both.npz", depth=SINGLE, mask=SINGLE > 0)
    with pytest.raises(ValueError, match=r"arrays depth, mask; pick one"):
        read_depth(tmp_path / "both.npz")


def test_a_file_with_a_colon_in_its_name_is_read(tmp_path):
    np.save(tmp_path / "at 12:30.npy", SINGLE)
    np.testing.assert_array_equal(read_depth(tmp_path / "at 12:30.npy"), SINGLE)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".exr", ".pfm", ".npy", ".npz"])
def test_a_truncated_file_is_an_error_of_one_line(tmp_path, suffix):
    path = tmp_path / f"depth{suffix}"
    noise = np.random.default_rng(7).uniform(1, 2, (200, 300)).astype(np.float32)
    if suffix == ".pfm":
        write_pfm(path, noise)
    elif suffix in (".npy", ".npz"):
        (np.save if suffix == ".npy" else np.savez)(path, noise)
    else:
        write(path, (noise * 1e4).astype(np.uint16) if suffix == ".png" else noise)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises((OSError, ValueError), match="depth") as caught:
        read_depth(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".png", ".exr", ".pfm", ".npy", ".npz", ".bin", ".txt"])
def test_a_file_of_something_else_is_an_error_of_one_line(tmp_path, suffix):
    path = tmp_path / f"depth{suffix}"
    path.write_text("no depth at all\n" * 20)
    with pytest.raises((OSError, ValueError), match="depth") as caught:
        read_depth(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named():
    with pytest.raises(FileNotFoundError, match="nowhere"):
        read_depth("nowhere.png")


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".bin"])
def test_nothing_can_be_picked_where_there_is_one_array(tmp_path, suffix):
    path = tmp_path / f"depth{suffix}"
    path.touch()
    with pytest.raises(ValueError, match="'Z' cannot be selected"):
        read_depth(f"{path}:Z")


def test_a_pfm_whose_scale_is_no_number_is_refused(tmp_path):
    (tmp_path / "depth.pfm").write_bytes(b"Pf\n2 2\none\n" + bytes(16))
    with pytest.raises(ValueError, match="its scale is b'one'"):
        read_depth(tmp_path / "depth.pfm")


@pytest.mark.parametrize(
    "given", [np.zeros((2, 3, 4)), np.zeros(5), np.zeros((0, 4)), np.zeros((2, 2), bool)]
)
def test_arrays_that_are_no_depth_are_refused(tmp_path, given):
    np.savez(tmp_path / "depth.npz", given)
    with pytest.raises(ValueError, match=r"depth is numbers \(H, W\)"):
        read_depth(tmp_path / "depth.npz")


def test_pickled_objects_are_not_loaded(tmp_path):
    np.save(tmp_path / "depth.npy", np.array([{}], object), allow_pickle=True)
    with pytest.raises(OSError, match="contains Python objects"):
        read_depth(tmp_path / "depth.npy")


# COLMAP's dense depth maps.


def colmap_bytes(planes):
    """`width&height&channels&` and the planes, of which rows follow each other (its Mat::Write)."""
    height, width = planes[0].shape
    content = b"%d&%d&%d&" % (width, height, len(planes))
    for plane in planes:
        for row in range(height):
            content += b"".join(struct.pack("<f", plane[row, n]) for n in range(width))
    return content


@pytest.mark.parametrize("kind", ["geometric", "photometric"])
def test_a_dense_map_of_colmap_is_read(tmp_path, kind):
    path = tmp_path / f"view.jpg.{kind}.bin"
    path.write_bytes(colmap_bytes([SINGLE]))
    assert SINGLE.shape[0] != SINGLE.shape[1]
    np.testing.assert_array_equal(read_depth(path), SINGLE)


def test_nothing_of_a_dense_map_is_unknown(tmp_path):
    path = tmp_path / "view.jpg.geometric.bin"
    path.write_bytes(colmap_bytes([np.array([[0, 2], [-1, 4]], np.float32)]))
    np.testing.assert_array_equal(PlanarDepth().nearness(read_depth(path)), [[0, 0.5], [0, 0.25]])


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (colmap_bytes([SINGLE] * 3), "3 channels; depth has one, as in stereo/depth_maps"),
        (b"4&3", "not a depth map of COLMAP: it does not begin with"),
        (b"4&three&1&" + bytes(48), "not a depth map of COLMAP"),
        (b"4&-3&1&" + bytes(48), "not a depth map of COLMAP"),
        (b"999999999&999999999&1&" + bytes(48), "is cut off or damaged"),
        (b"4&3&1&" + bytes(44), "4 × 3 floats are 48 bytes, it has 44"),
        (b"4&3&1&" + bytes(52), "4 × 3 floats are 48 bytes, it has 52"),
        (b"0&3&1&", r"depth is numbers \(H, W\)"),
    ],
)
def test_a_dense_map_that_is_none_is_an_error_of_one_line(tmp_path, content, complaint):
    path = tmp_path / "view.jpg.geometric.bin"
    path.write_bytes(content)
    with pytest.raises((OSError, ValueError), match=complaint) as caught:
        read_depth(path)
    assert "\n" not in str(caught.value)


# Real files.


@pytest.fixture
def middlebury():
    return real("depth")


@pytest.mark.sweep
def test_disparities_of_a_real_pair_meet_each_other(middlebury):
    left, right = (
        BareDisparity(scale=4).nearness(read_depth(middlebury / "middlebury2003_cones" / name))
        for name in ("disp2.png", "disp6.png")
    )
    image = DepthImage(np.zeros((*SHAPE, 1), np.float32), left)
    known = left > 0
    place, disparity = warp_places(of_rectified(1), places(image)[known], left[known].astype(float))
    inside = (place[:, 0] >= 0) & (place[:, 0] < left.shape[1])
    column, row = place[inside].astype(int).T
    seen, expected = right[row, column], disparity[inside]
    agree = np.abs(seen - expected)[seen > 0] <= 0.5
    assert agree.mean() > 0.9  # measured 0.945; the rest is hidden from the right eye


def test_infinite_disparities_of_a_real_file_are_unknown(middlebury):
    raw = read_depth(middlebury / "middlebury2014_motorcycle_quarter" / "motorcycle_disp.npz")
    nearness = Disparity(focal=994.978, baseline=0.193001, doffs=31.086).nearness(raw)
    np.testing.assert_array_equal(nearness == 0, np.isinf(raw))


def recording(path, packed=bytes, frames=2):
    """A recording of Record3D: 48 x 36 px of color, 24 x 18 of depth, the second frame aside."""
    turned = [0, np.sin(0.1), 0, np.cos(0.1), 0.2, 0.1, 0]
    facts = {"K": [60, 0, 0, 0, 60, 0, 18, 24, 1], "w": 36, "h": 48, "dw": 18, "dh": 24,
             "poses": [[0, 0, 0, 1, 0, 0, 0], turned][:frames]}  # fmt: skip
    z = np.linspace(1, 2, 24 * 18, dtype="<f4").reshape(24, 18)
    sure = np.full((24, 18), 2, np.uint8)
    sure[:2] = 0
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("metadata", json.dumps(facts))
        for n in range(frames):
            picture = io.BytesIO()
            Image.fromarray(np.full((48, 36, 3), 90 + n, np.uint8)).save(picture, "JPEG")
            made.writestr(f"rgbd/{n}.jpg", picture.getvalue())
            made.writestr(f"rgbd/{n}.depth", packed(z.tobytes()))
            made.writestr(f"rgbd/{n}.conf", packed(sure.tobytes()))
    return z


def test_a_recording_of_record3d_has_depth_and_cameras(tmp_path):
    lzfse = pytest.importorskip("liblzfse")
    z = recording(tmp_path / "scan.r3d", lzfse.compress)
    raw = read_depth(tmp_path / "scan.r3d")
    assert np.isnan(raw[:2]).all()
    np.testing.assert_array_equal(raw[2:], z[2:])
    np.testing.assert_array_equal(read_depth(f"{tmp_path}/scan.r3d:1")[2:], z[2:])
    shot = read_shot(f"{tmp_path}/scan.r3d:1")
    assert shot.shape == (48, 36)
    np.testing.assert_array_equal(shot.camera.matrix, [[60, 0, 18], [0, 60, 24], [0, 0, 1]])
    # Camera to world in OpenGL's axes: y up, view along -z.
    x, y, z = np.linalg.inv(shot.pose)[:3, :3].T
    np.testing.assert_allclose(z, [-np.sin(0.2), 0, -np.cos(0.2)], atol=1e-12)
    np.testing.assert_allclose([x, y], [[np.cos(0.2), 0, -np.sin(0.2)], [0, -1, 0]], atol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(shot.pose)[:3, 3], [0.2, 0.1, 0], atol=1e-12)


def test_bare_floats_have_the_size_of_a_sensor(tmp_path):
    z = np.linspace(1, 2, 256 * 192, dtype="<f4").reshape(256, 192)
    (tmp_path / "0.depth").write_bytes(z.tobytes())
    np.testing.assert_array_equal(read_depth(tmp_path / "0.depth"), z)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (bytes(100), "0.depth holds 100 bytes, not 4 for each pixel of a sensor"),
        (b"bvx2" + b"\xff" * 60, "unpack|ratio|damaged"),
        (b"bvx-" + b"\x04\0\0\0" + b"abcd", "damaged|bytes"),
    ],
)
def test_damaged_floats_are_refused(tmp_path, data, message):
    pytest.importorskip("liblzfse")
    (tmp_path / "0.depth").write_bytes(data)
    with pytest.raises((ValueError, OSError), match=message):
        read_depth(tmp_path / "0.depth")


def test_damaged_recordings_are_refused(tmp_path):
    recording(tmp_path / "scan.r3d")
    with pytest.raises(LookupError, match=r"has no rgbd/7.depth; it may have fewer frames"):
        read_depth(f"{tmp_path}/scan.r3d:7")
    (tmp_path / "cut.r3d").write_bytes((tmp_path / "scan.r3d").read_bytes()[:300])
    with pytest.raises(OSError, match="not a Record3D recording, or is damaged"):
        read_depth(tmp_path / "cut.r3d")


@pytest.mark.parametrize("form", ["array", "numbers", "picture"])
def test_depth_of_low_confidence_is_unknown(tmp_path, form):
    sure = np.zeros((12, 16), np.uint8)
    sure[:, 8:] = 200
    given = sure
    if form != "array":
        given = tmp_path / ("sure.npy" if form == "numbers" else "sure.png")
        np.save(given, sure) if form == "numbers" else Image.fromarray(sure).save(given)
    found = confident(np.full((24, 32), 0.5, np.float32), given)
    np.testing.assert_array_equal(found, np.where(np.arange(32) >= 16, 0.5, 0) * np.ones((24, 1)))
    assert not confident(np.full((24, 32), 0.5, np.float32), given, 201).any()
    with pytest.raises(ValueError, match="confidence of 16 x 12 px does not fit depth of 30 x 30"):
        confident(np.ones((30, 30), np.float32), given)
