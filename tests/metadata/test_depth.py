"""What depth files and poses say: turns, windows, scales, units and conventions."""

import json
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from resample.cameras.files import read_pose, read_shot
from resample.cameras.models import Camera
from resample.files.images import read_channels
from resample.files.pictures import read_picture
from resample_warp3d.command.inputs import read_names
from resample_warp3d.depth.encodings import (
    DepthEncoding,
    Disparity,
    InverseDepth,
    PlanarDepth,
    RayLength,
)
from resample_warp3d.depth.files import read_depth
from tests.metadata.corpus import Outcome, Variant
from tests.metadata.files import GRAY, LEVELS, exr, png, turned

NEAREST, FARTHEST = 1.0, 3.0  # m
DEPTH = (NEAREST + (FARTHEST - NEAREST) * GRAY / 255.0).astype(np.float32)
MILLIMETERS = np.rint(1000 * DEPTH).astype(np.uint16)


class Known(NamedTuple):
    """A file of depth and its numbers, upright."""

    path: Path | str
    numbers: NDArray[Any]


# ---------------------------------------------------------------------------------------- turns


# What Exif's numbers say of the first row and column: where they are seen.
UPRIGHT: dict[int, Callable[[NDArray[Any]], NDArray[Any]]] = {
    1: np.asarray,  # top, left
    2: np.fliplr,  # top, right
    3: lambda values: np.rot90(values, 2),  # bottom, right
    4: np.flipud,  # bottom, left
    5: np.transpose,  # left, top
    6: lambda values: np.rot90(values, -1),  # right, top
    7: lambda values: np.rot90(values, 2).T,  # right, bottom
    8: np.rot90,  # left, bottom
}


def _turned(suffix: str, values: NDArray[Any], orientation: int, folder: Path) -> Known:
    turned(folder / f"in{suffix}", values, orientation)
    return Known(folder / f"in{suffix}", UPRIGHT[orientation](values))


TURNS = [
    Variant(name, "orientation of depth", f"{n}, {kind}", "obeyed",
            partial(_turned, suffix, values, n))
    for name, suffix, kind, values in (
        ("TIFF", ".tif", "floats", DEPTH), ("TIFF", ".tif", "16 bits", MILLIMETERS),
        ("PNG", ".png", "16 bits", MILLIMETERS), ("PNG", ".png", "8 bits", GRAY),
    )
    for n in ((2, 3, 4, 5, 6, 7, 8) if values is MILLIMETERS else (1, 6, 8))
]  # fmt: skip

# -------------------------------------------------------------------------------------- windows


def _window(at: tuple[int, int], whole: tuple[int, int, int, int], folder: Path) -> Known:
    """Depth whose corner is at `at`, in a display window (x, y, width, height)."""
    left, top, width, height = whole
    exr(
        folder / "in.exr", DEPTH[..., None], ("Z",), x=at[0], y=at[1], full_x=left, full_y=top,
        full_width=width, full_height=height,
    )  # fmt: skip
    far = np.full((30, 30), np.nan, np.float32)
    far[10 + at[1] :, 10 + at[0] :][: DEPTH.shape[0], : DEPTH.shape[1]] = DEPTH
    return Known(
        folder / "in.exr", far[10 + top : 10 + top + height, 10 + left : 10 + left + width]
    )


def _channels(names: tuple[str, ...], wanted: str, folder: Path) -> Known:
    planes = np.stack([DEPTH + n for n in range(len(names))], axis=2)
    exr(folder / "in.exr", planes, names)
    path = folder / "in.exr"
    name = wanted.rpartition(":")[2]
    return Known(f"{path}:{name}" if ":" in wanted else path, DEPTH + names.index(name))


WINDOWS = [
    *(
        Variant("EXR", "windows of depth", case, "obeyed", partial(_window, at, whole))
        for case, at, whole in (
            ("data in a larger display", (2, 1), (0, 0, 12, 10)),
            ("overscan", (-2, -1), (0, 0, 3, 2)),
            ("both", (-1, 2), (0, 0, 9, 5)),
            ("display not at 0, 0", (3, 4), (3, 4, 6, 4)),
        )
    ),
    *(
        Variant("EXR", "channels of depth", case, "obeyed", partial(_channels, names, wanted))
        for case, names, wanted in (
            ("Z", ("Z",), "Z"), ("R, G, B and Z", ("R", "G", "B", "Z"), "Z"),
            ("depth.Z", ("R", "G", "B", "depth.Z"), "depth.Z"),
            ("one named", ("near", "far"), ":far"),
        )
    ),
]  # fmt: skip

# ------------------------------------------------------------------------------ types and scales


def _pfm(scale: str, folder: Path) -> Known:
    stored = DEPTH[::-1].astype("<f4" if scale.startswith("-") else ">f4")
    (folder / "in.pfm").write_bytes(f"Pf\n6 4\n{scale}\n".encode() + stored.tobytes())
    return Known(folder / "in.pfm", DEPTH)


def _array(change: Callable[[NDArray[Any]], NDArray[Any]], folder: Path) -> Known:
    np.save(folder / "in.npy", change(DEPTH))
    return Known(folder / "in.npy", DEPTH)


def _tiff(values: NDArray[Any], folder: Path, **options: Any) -> Known:
    tifffile.imwrite(folder / "in.tif", values, metadata=None, **options)
    return Known(folder / "in.tif", values)


def _picture(values: NDArray[Any], wanted: NDArray[Any], folder: Path) -> Known:
    png(folder / "in.png", values)
    return Known(folder / "in.png", wanted)


def _colmap(folder: Path) -> Known:
    (folder / "in.bin").write_bytes(b"6&4&1&" + DEPTH.astype("<f4").tobytes())
    return Known(folder / "in.bin", DEPTH)


def _differing(folder: Path) -> Known:
    png(folder / "in.png", LEVELS)
    return Known(folder / "in.png", GRAY)


KINDS: list[tuple[str, str, str, Outcome, Callable[[Path], Known], str]] = [
    ("PFM", "scale of depth", "-1", "obeyed", partial(_pfm, "-1"), ""),
    ("PFM", "scale of depth", "1.0, big-endian", "obeyed", partial(_pfm, "1.0"), ""),
    ("PFM", "scale of depth", "-0.003922, Middlebury's", "told", partial(_pfm, "-0.003922"),
     "scale 0.003922 in its header is not applied"),
    ("NPY", "byte order", "big-endian", "obeyed", partial(_array, lambda a: a.astype(">f4")), ""),
    ("NPY", "fortran_order", "true", "obeyed", partial(_array, np.asfortranarray), ""),
    ("NPY", "shape", "(1, H, W)", "obeyed", partial(_array, lambda a: a[None]), ""),
    ("NPY", "shape", "(H, W, 1)", "obeyed", partial(_array, lambda a: a[..., None]), ""),
    ("COLMAP", "header", "width, height, 1", "obeyed", _colmap, ""),
    ("TIFF", "depth", "floats, big-endian", "obeyed", partial(_tiff, DEPTH, byteorder=">"), ""),
    ("TIFF", "depth", "32-bit integers", "obeyed",
     partial(_tiff, MILLIMETERS.astype(np.uint32)), ""),
    ("TIFF", "depth", "MinIsWhite, 16 bits", "refused",
     partial(_tiff, MILLIMETERS, photometric="miniswhite"), "MinIsWhite"),
    ("TIFF", "depth", "MinIsWhite, 8 bits", "refused",
     partial(_tiff, GRAY, photometric="miniswhite"), "MinIsWhite"),
    ("TIFF", "depth", "MinIsWhite, floats", "refused",
     partial(_tiff, DEPTH, photometric="miniswhite"), "MinIsWhite"),
    ("PNG", "depth", "16 bits", "obeyed", partial(_picture, MILLIMETERS, MILLIMETERS), ""),
    ("PNG", "depth", "three alike", "obeyed",
     partial(_picture, np.repeat(MILLIMETERS[..., None], 3, 2), MILLIMETERS), ""),
    ("PNG", "depth", "with opacity", "obeyed",
     partial(_picture, np.stack([MILLIMETERS] * 2, 2), MILLIMETERS), ""),
    ("PNG", "depth", "colors", "refused", _differing, "give the picture first, then its depth"),
]  # fmt: skip
FILES = [Variant(*one) for one in KINDS]

# ------------------------------------------------------------------------ what the numbers mean

CAMERA = Camera(np.array([[100.0, 0, 3.0], [0, 100.0, 2.0], [0, 0, 1]]), np.eye(4))
ROW, COLUMN = np.mgrid[: DEPTH.shape[0], : DEPTH.shape[1]] + 0.5
RAY = np.sqrt(1 + ((COLUMN - 3.0) / 100) ** 2 + ((ROW - 2.0) / 100) ** 2)


class Coded(NamedTuple):
    """Numbers of a file and how they are meant."""

    path: Path
    encoding: DepthEncoding


def _coded(values: NDArray[Any], encoding: DepthEncoding, folder: Path) -> Coded:
    if values.dtype.kind == "f":
        np.save(folder / "in.npy", values.astype(np.float32))
        return Coded(folder / "in.npy", encoding)
    png(folder / "in.png", values)
    return Coded(folder / "in.png", encoding)


SHARE = (1 / DEPTH.astype(np.float64) - 1 / 10) / (1 / 0.5 - 1 / 10)
MEANINGS = [
    Variant("depth", "--depth-kind", case, outcome, partial(_coded, values, encoding), says)
    for case, outcome, values, encoding, says in (
        ("z in m", "obeyed", DEPTH, PlanarDepth(), ""),
        ("z in mm", "obeyed", MILLIMETERS, PlanarDepth(1000), ""),
        ("z by TUM's 5000", "obeyed", np.rint(5000 * DEPTH).astype(np.uint16),
         PlanarDepth(5000), ""),
        ("integers without a scale", "refused", MILLIMETERS, PlanarDepth(), "scale"),
        ("length of the ray", "obeyed", DEPTH * RAY, RayLength(CAMERA), ""),
        ("1 / z", "obeyed", 1 / DEPTH, InverseDepth(), ""),
        ("1 / z from near to far", "obeyed", np.rint(65535 * SHARE).astype(np.uint16),
         InverseDepth(65535, 0.5, 10.0), ""),
        ("disparity", "obeyed", 100 * 0.1 / DEPTH, Disparity(100, 0.1), ""),
        ("disparity by KITTI's 256", "obeyed", np.rint(256 * 1000 * 0.1 / DEPTH).astype(np.uint16),
         Disparity(1000, 0.1, 256), ""),
        ("disparity with doffs", "obeyed", 100 * 0.1 / DEPTH - 2, Disparity(100, 0.1, doffs=2), ""),
    )
]  # fmt: skip

# ---------------------------------------------------------------------------------------- poses

TURN = Rotation.from_rotvec([0.2, -0.3, 0.1])
PLACE = np.array([0.5, -0.25, 2.0])  # of the camera in the world
TO_WORLD = np.eye(4)
TO_WORLD[:3, :3], TO_WORLD[:3, 3] = TURN.as_matrix(), PLACE
TO_CAMERA = np.linalg.inv(TO_WORLD)
OPENGL = TO_WORLD @ np.diag([1.0, -1, -1, 1])  # x right, y up, the view along -z


def _text(name: str, text: str, folder: Path) -> Path:
    (folder / name).write_text(text)
    return folder / name


def _rows(matrix: NDArray[Any]) -> str:
    return "\n".join(" ".join(map(repr, row)) for row in matrix.tolist())


def _matrix(folder: Path) -> Path:
    np.save(folder / "pose.npy", TO_CAMERA)
    return folder / "pose.npy"


X, Y, Z, W = TURN.as_quat().tolist()
NERF = {"frames": [{"file_path": "a", "transform_matrix": OPENGL.tolist()}]}
INTRINSICS = {"fl_x": 90.0, "fl_y": 91.0, "cx": 3.25, "cy": 2.5, "w": 6, "h": 4}
OPEN3D = {
    "class_name": "PinholeCameraParameters",
    "extrinsic": TO_CAMERA.T.ravel().tolist(),  # by columns
    "intrinsic": {
        "width": 6, "height": 4,
        "intrinsic_matrix": [90.0, 0.0, 0.0, 0.0, 91.0, 0.0, 3.25, 2.5, 1.0],
    },
}  # fmt: skip
PLACED = " ".join(map(repr, PLACE.tolist()))
POSES = [
    Variant(name, "pose", case, "obeyed", write)
    for name, case, write in (
        ("matrices", "4 x 4 of NPY, world to camera", _matrix),
        ("matrices", "4 x 4 of text, world to camera", partial(_text, "p.txt", _rows(TO_CAMERA))),
        ("matrices", "3 x 4 of text, world to camera",
         partial(_text, "p.txt", _rows(TO_CAMERA[:3]))),
        ("TUM", "t x y z qx qy qz qw, camera to world",
         partial(_text, "p.txt", f"0.0 {PLACED} {X} {Y} {Z} {W}\n")),
        ("TUM", "negative quaternion",
         partial(_text, "p.txt", f"0.0 {PLACED} {-X} {-Y} {-Z} {-W}\n")),
        ("ICL-NUIM", "x y z qx qy qz qw, camera to world",
         partial(_text, "p.txt", f"{PLACED} {X} {Y} {Z} {W}\n")),
        ("Open3D", ".log, camera to world", partial(_text, "p.log", "0 0 1\n" + _rows(TO_WORLD))),
        ("Open3D", ".json, by columns", partial(_text, "p.json", json.dumps(OPEN3D))),
        ("NeRF", "camera to world in OpenGL's axes", partial(_text, "t.json", json.dumps(NERF))),
    )
]  # fmt: skip
ODD_POSES = [
    Variant(name, "pose", case, "refused", partial(_text, "p.txt", text), says)
    for name, case, text, says in (
        ("TUM", "quaternion of length 2", f"0.0 {PLACED} {2 * X} {2 * Y} {2 * Z} {2 * W}\n",
         "quaternion"),
        ("matrices", "scaled axes", _rows(TO_CAMERA @ np.diag([2.0, 2, 2, 1])), "rotation"),
        ("matrices", "mirrored axes", _rows(TO_CAMERA @ np.diag([-1.0, 1, 1, 1])), "rotation"),
    )
]  # fmt: skip
FOCALS = [
    Variant(name, "intrinsics", case, "obeyed", partial(_text, "t.json", json.dumps(content)))
    for name, case, content in (
        ("NeRF", "fl_x, fl_y, cx, cy", NERF | INTRINSICS),
        ("NeRF", "camera_angle_x", NERF | {
            "camera_angle_x": 2 * np.arctan(3 / 90.0), "fl_y": 91.0, "cx": 3.25, "cy": 2.5,
            "w": 6, "h": 4,
        }),
        ("Open3D", "of centers at whole numbers", OPEN3D),
    )
]  # fmt: skip

# -------------------------------------------------------------- other pictures that hold numbers


def _numbers(suffix: str, folder: Path) -> Known:
    turned(folder / f"in{suffix}", GRAY, 6)
    return Known(folder / f"in{suffix}", np.rot90(GRAY, -1))


LABELS = [
    Variant(name, "orientation of labels and masks", "6", "obeyed", partial(_numbers, suffix))
    for name, suffix in (("PNG", ".png"), ("TIFF", ".tif"))
]
VARIANTS = [*TURNS, *WINDOWS, *FILES, *MEANINGS, *POSES, *ODD_POSES, *FOCALS, *LABELS]


@pytest.mark.parametrize("one", [*TURNS, *WINDOWS, *FILES], ids=str)
def test_depth_is_read_as_its_file_says(one, tmp_path, capsys):
    known: Known = one.write(tmp_path)
    if one.outcome == "refused":
        with pytest.raises(ValueError, match=one.says):
            read_depth(known.path)
        return
    np.testing.assert_array_equal(read_depth(known.path), known.numbers)
    assert re.search(one.says, capsys.readouterr().err)


@pytest.mark.parametrize("one", MEANINGS, ids=str)
def test_numbers_of_depth_mean_what_is_said(one, tmp_path):
    coded: Coded = one.write(tmp_path)
    raw = read_depth(coded.path)
    if one.outcome == "refused":
        with pytest.raises(ValueError, match=one.says):
            coded.encoding.nearness(raw)
        return
    np.testing.assert_allclose(1 / coded.encoding.nearness(raw), DEPTH, rtol=0.001)


@pytest.mark.parametrize("one", POSES, ids=str)
def test_a_pose_maps_world_to_camera(one, tmp_path):
    np.testing.assert_allclose(read_pose(str(one.write(tmp_path))), TO_CAMERA, atol=1e-6)


@pytest.mark.parametrize("one", ODD_POSES, ids=str)
def test_what_is_no_pose_is_refused(one, tmp_path):
    with pytest.raises(ValueError, match=one.says):
        read_pose(str(one.write(tmp_path)))


@pytest.mark.parametrize("one", FOCALS, ids=str)
def test_intrinsics_are_for_pixels_whose_corners_are_whole_numbers(one, tmp_path):
    shift = 0.5 if one.format == "Open3D" else 0.0
    wanted = [[90.0, 0.0, 3.25 + shift], [0.0, 91.0, 2.5 + shift], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(read_shot(str(one.write(tmp_path))).camera.matrix, wanted, rtol=1e-6)


@pytest.mark.parametrize("one", LABELS, ids=str)
def test_numbers_of_labels_are_turned_as_their_picture(one, tmp_path):
    known: Known = one.write(tmp_path)
    shares = known.numbers / np.float32(255)
    np.testing.assert_allclose(read_names(str(known.path)).data[..., 0], shares, atol=1e-6)
    np.testing.assert_allclose(read_channels(known.path)["Y"], shares, atol=1e-6)
    assert read_picture(known.path).data.shape[:2] == shares.shape
