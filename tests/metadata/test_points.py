"""What files of points and of 3D Gaussians say: types, scales, colors, places, axes."""

import gzip
import json
import re
import struct
from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from resample_points import read_cloud, read_gaussians
from resample_points.command.facts import facts_in
from tests.laser import las_of
from tests.metadata.corpus import Variant

RNG = np.random.default_rng(7)
COUNT = 6
PLACE = RNG.uniform(-4, 4, (COUNT, 3)).astype(np.float32).astype(np.float64)
LEVELS = RNG.integers(20, 250, (COUNT, 3)).astype(np.uint8)
LEVELS[0] = 250
NORMAL = np.array([[0, 0.6, 0.8], [1, 0, 0], [0, 1, 0], [0, 0, -1], [0.8, 0, 0.6], [-1, 0, 0]])
UTM = np.array([500_000.123, 4_649_776.5, 12.25])  # m


class Known(NamedTuple):
    """A file and its points."""

    path: Path
    place: NDArray[Any] = PLACE
    color: NDArray[Any] | None = None  # shares of sRGB
    normal: NDArray[Any] | None = None
    facts: dict[str, Any] = {}  # noqa: RUF012 - read only
    tolerance: float = 1e-6


SHARES = LEVELS / 255

# ------------------------------------------------------------------------------------------ PLY

LETTERS = {
    "float": "f4", "double": "f8", "uchar": "u1", "ushort": "u2", "short": "i2", "int": "i4",
    "float32": "f4", "uint8": "u1", "uint16": "u2",
}  # fmt: skip


def ply(
    path: Path, columns: dict[str, tuple[str, Any]], form: str = "binary_little_endian",
    lines: Sequence[str] = (),
) -> None:  # fmt: skip
    """Write a PLY file of columns by name: type and numbers."""
    order = ">" if "big" in form else "<"
    records = np.empty(
        len(next(iter(columns.values()))[1]),
        [(name, order + LETTERS[kind]) for name, (kind, _) in columns.items()],
    )
    for name, (_, numbers) in columns.items():
        records[name] = numbers
    named = "".join(f"property {kind} {name}\n" for name, (kind, _) in columns.items())
    head = f"ply\nformat {form} 1.0\n"
    head += (
        "".join(f"{line}\n" for line in lines)
        + f"element vertex {len(records)}\n{named}end_header\n"
    )
    rows = "\n".join(" ".join(map(repr, row)) for row in records.tolist()) + "\n"
    path.write_bytes(head.encode() + (rows.encode() if form == "ascii" else records.tobytes()))


def _columns(kind: str, names: str, values: NDArray[Any]) -> dict[str, tuple[str, Any]]:
    return {name: (kind, values[:, n]) for n, name in enumerate(names.split())}


XYZ = _columns("float", "x y z", PLACE)
RGB = _columns("uchar", "red green blue", LEVELS)


def _ply(
    columns: dict[str, tuple[str, Any]], folder: Path, known: Any = SHARES, **options: Any
) -> Known:
    ply(folder / "in.ply", columns, **options)
    return Known(folder / "in.ply", color=known)


def _moved(columns: dict[str, tuple[str, Any]]) -> dict[str, tuple[str, Any]]:
    return dict(sorted(columns.items(), key=lambda pair: pair[0][::-1]))


def _normals(folder: Path) -> Known:
    ply(folder / "in.ply", XYZ | _columns("float", "nx ny nz", NORMAL))
    return Known(folder / "in.ply", normal=NORMAL)


DARK = LEVELS // 128
PLYS = [
    *(
        Variant("PLY", field, case, outcome, write, says)
        for field, case, outcome, write, says in (
            ("format", "ascii", "obeyed", partial(_ply, XYZ | RGB, form="ascii"), ""),
            ("format", "little-endian", "obeyed", partial(_ply, XYZ | RGB), ""),
            ("format", "big-endian", "obeyed",
             partial(_ply, XYZ | RGB, form="binary_big_endian"), ""),
            ("property", "any order", "obeyed", partial(_ply, _moved(XYZ | RGB)), ""),
            ("property", "double", "obeyed",
             partial(_ply, _columns("double", "x y z", PLACE) | RGB), ""),
            ("property", "float32 and uint8", "obeyed",
             partial(_ply, _columns("float32", "x y z", PLACE)
                     | _columns("uint8", "red green blue", LEVELS)), ""),
            ("property", "whole numbers", "obeyed",
             partial(_ply, XYZ | _columns("int", "red green blue", LEVELS)), ""),
            ("property", "diffuse_red ...", "obeyed",
             partial(
                 _ply, XYZ | _columns("uchar", "diffuse_red diffuse_green diffuse_blue", LEVELS)
             ), ""),
            ("property", "r g b", "obeyed",
             partial(_ply, XYZ | _columns("uchar", "r g b", LEVELS)), ""),
            ("property", "nx ny nz", "obeyed", _normals, ""),
            ("range of colors", "floats from 0 to 1", "obeyed",
             partial(_ply, XYZ | _columns("float", "red green blue", SHARES)), ""),
            ("range of colors", "floats from 0 to 255", "obeyed",
             partial(_ply, XYZ | _columns("float", "red green blue", LEVELS)), ""),
            ("range of colors", "16 bits", "obeyed",
             partial(_ply, XYZ | _columns("ushort", "red green blue", 257 * LEVELS.astype(int))),
             ""),
            ("range of colors", "8 bits in 16", "obeyed",
             partial(_ply, XYZ | _columns("ushort", "red green blue", LEVELS)), ""),
            ("range of colors", "8 dark bits in 16", "obeyed",
             partial(_ply, XYZ | _columns("ushort", "red green blue", DARK), known=DARK / 255), ""),
            ("comment", "of a program", "obeyed",
             partial(_ply, XYZ | RGB, lines=["comment Created by hand"]), ""),
            ("comment", "scale", "told",
             partial(_ply, XYZ | RGB, lines=["comment scale 0.001"]),
             "'scale 0.001' is not applied"),
            ("comment", "units", "told",
             partial(_ply, XYZ | RGB, lines=["comment units: mm"]), "'units: mm' is not applied"),
            ("obj_info", "offset", "told",
             partial(_ply, XYZ | RGB, lines=["obj_info offset 500000 0 0"]), "offset"),
        )
    ),
]  # fmt: skip

# ------------------------------------------------------------------------------------------ PCD

PACKED = LEVELS.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)


def _pcd(letter: str, data: str, folder: Path, view: str = "0 0 0 1 0 0 0", size: int = 4) -> Known:
    colors = PACKED.astype("<u4")
    records = np.empty(COUNT, [*((name, f"<f{size}") for name in "xyz"), ("rgb", "<u4")])
    records["x"], records["y"], records["z"], records["rgb"] = *PLACE.T, colors
    head = (
        f"VERSION 0.7\nFIELDS x y z rgb\nSIZE {size} {size} {size} 4\nTYPE F F F {letter}\n"
        f"COUNT 1 1 1 1\nWIDTH {COUNT}\nHEIGHT 1\nVIEWPOINT {view}\nPOINTS {COUNT}\nDATA {data}\n"
    )
    told = colors.view("<f4") if letter == "F" else colors
    rows = "\n".join(
        f"{x!r} {y!r} {z!r} {c!s}" for (x, y, z), c in zip(PLACE.tolist(), told, strict=True)
    )
    content = rows.encode() if data == "ascii" else records.tobytes()
    (folder / "in.pcd").write_bytes(head.encode() + content)
    return Known(folder / "in.pcd", color=SHARES)


PCDS = [
    Variant("PCD", field, case, outcome, write, says)
    for field, case, outcome, write, says in (
        ("TYPE of rgb", "F, binary", "obeyed", partial(_pcd, "F", "binary"), ""),
        ("TYPE of rgb", "U, binary", "obeyed", partial(_pcd, "U", "binary"), ""),
        ("TYPE of rgb", "F, ascii", "obeyed", partial(_pcd, "F", "ascii"), ""),
        ("TYPE of rgb", "U, ascii", "obeyed", partial(_pcd, "U", "ascii"), ""),
        ("SIZE", "8", "obeyed", partial(_pcd, "U", "binary", size=8), ""),
        ("VIEWPOINT", "moved", "told", partial(_pcd, "U", "ascii", view="10 0 0 1 0 0 0"),
         r"VIEWPOINT \(10 0 0 1 0 0 0\) is not applied"),
        ("VIEWPOINT", "turned", "told", partial(_pcd, "U", "binary", view="0 0 0 0.6 0.8 0 0"),
         r"VIEWPOINT \(0 0 0 0.6 0.8 0 0\) is not applied"),
    )
]  # fmt: skip

# ----------------------------------------------------------------------------------------- text


def _text(name: str, text: str, folder: Path, **known: Any) -> Known:
    (folder / name).write_text(text)
    return Known(folder / name, **known)


def _table(separator: str, *columns: NDArray[Any], title: str = "", comma: bool = False) -> str:
    numbers = ([*chain(*(part.tolist() for part in row))] for row in zip(*columns, strict=True))
    rows = [separator.join(map(repr, row)) for row in numbers]
    rows = [row.replace(".", ",") for row in rows] if comma else rows
    return "\n".join([title, *rows] if title else rows) + "\n"


TEXTS = [
    Variant(name, field, case, "obeyed", write)
    for name, field, case, write in (
        ("XYZ", "columns", "x y z", partial(_text, "in.xyz", _table(" ", PLACE))),
        ("XYZ", "columns", "x y z r g b",
         partial(_text, "in.xyz", _table(" ", PLACE, LEVELS), color=SHARES)),
        ("XYZN", "columns", "x y z nx ny nz",
         partial(_text, "in.xyzn", _table(" ", PLACE, NORMAL), normal=NORMAL)),
        ("XYZ", "decimal comma", "between blanks",
         partial(_text, "in.xyz", _table(" ", PLACE, comma=True))),
        ("XYZ", "decimal comma", "between tabs",
         partial(_text, "in.xyz", _table("\t", PLACE, comma=True))),
        ("PTS", "count", "before the points",
         partial(_text, "in.pts", _table(" ", PLACE, title=f"{COUNT}"))),
        ("PTS", "decimal comma", "after a count",
         partial(_text, "in.pts", _table(" ", PLACE, title=f"{COUNT}", comma=True))),
        ("CSV", "separator", "comma", partial(_text, "in.csv", _table(",", PLACE))),
        ("CSV", "separator", "comma and blank", partial(_text, "in.csv", _table(", ", PLACE))),
        ("CSV", "separator", "semicolon", partial(_text, "in.csv", _table(";", PLACE))),
        ("CSV", "separator", "tab", partial(_text, "in.csv", _table("\t", PLACE))),
        ("CSV", "decimal comma", "between semicolons",
         partial(_text, "in.csv", _table(";", PLACE, comma=True))),
        ("CSV", "decimal comma", "with a title",
         partial(_text, "in.csv", _table(";", PLACE, title="x;y;z", comma=True))),
        ("CSV", "title", "X,Y,Z,R,G,B",
         partial(_text, "in.csv", _table(",", PLACE, LEVELS, title="X,Y,Z,R,G,B"), color=SHARES)),
        ("CSV", "title", "B,G,R,Z,Y,X",
         partial(_text, "in.csv", _table(",", LEVELS[:, ::-1], PLACE[:, ::-1], title="B,G,R,Z,Y,X"),
                 color=SHARES)),
        ("CSV", "title", "id first",
         partial(_text, "in.csv", _table(",", np.arange(COUNT)[:, None], PLACE, title="id,x,y,z"))),
        ("CSV", "title", "rf,gf,bf",
         partial(_text, "in.csv", _table(",", PLACE, SHARES, title="x,y,z,rf,gf,bf"),
                 color=SHARES)),
        ("CSV", "digits", "of UTM coordinates",
         partial(_text, "in.csv", _table(",", PLACE + UTM), place=PLACE + UTM)),
    )
]  # fmt: skip

# ------------------------------------------------------------------------------------------ LAS

EARTH = 'GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]]'
WKT = f'PROJCS["WGS 84 / UTM zone 33N",{EARTH},AUTHORITY["EPSG","32633"]]'
WKT_2 = 'PROJCRS["WGS 84 / UTM zone 33N",BASEGEOGCRS["WGS 84"],ID["EPSG",32633]]'
COMPOUND = f'COMPD_CS["UTM and height",{WKT},VERT_CS["NAVD88",AUTHORITY["EPSG","5703"]]]'


def _las(
    folder: Path, *, colors: NDArray[Any] | None = None, scale: float = 0.001, packed: bool = False,
    offset: NDArray[Any] = UTM, vlrs: Sequence[Any] = (), form: int = 3, crs: str | None = None,
) -> Known:  # fmt: skip
    header = laspy.LasHeader(point_format=form, version="1.4" if form > 5 else "1.2")
    header.scales, header.offsets = [scale] * 3, offset
    header.vlrs.extend(vlrs)
    points = laspy.LasData(header)
    place = np.rint((PLACE + UTM - offset) / scale) * scale + offset
    points.x, points.y, points.z = place.T
    if colors is not None:
        points.red, points.green, points.blue = colors.T
    path = folder / ("in.laz" if packed else "in.las")
    points.write(str(path))
    ends = [place.min(axis=0).round(6).tolist(), place.max(axis=0).round(6).tolist()]
    facts = {"bounds": ends, "crs": crs}
    return Known(path, place, None if colors is None else SHARES, None, facts, 1e-6)


def _keys(*pairs: tuple[int, int]) -> Any:
    entries = [(1, 1, 0, len(pairs)), *((key, 0, 1, value) for key, value in pairs)]
    return laspy.VLR("LASF_Projection", 34735, "", np.array(entries, "<u2").tobytes())


def _words(text: str) -> Any:
    return laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0")


NAME = "WGS 84 / UTM zone 33N (EPSG:32633)"
LASES = [
    Variant("LAS", field, case, "obeyed", write)
    for field, case, write in (
        ("scale, offset", "UTM coordinates", _las),
        ("scale, offset", "offset 0", partial(_las, offset=np.zeros(3), scale=0.01)),
        ("scale, offset", "0.01", partial(_las, scale=0.01)),
        ("scale, offset", "LAZ", partial(_las, packed=True)),
        ("scale, offset", "LAS 1.4", partial(_las, form=7)),
        ("range of colors", "16 bits", partial(_las, colors=LEVELS.astype(np.uint16) * 257)),
        ("range of colors", "8 bits in 16", partial(_las, colors=LEVELS.astype(np.uint16))),
        ("coordinate system", "none", _las),
        ("coordinate system", "WKT", partial(_las, vlrs=[_words(WKT)], crs=NAME, form=7)),
        ("coordinate system", "WKT 2", partial(_las, vlrs=[_words(WKT_2)], crs=NAME, form=7)),
        ("coordinate system", "WKT of two",
         partial(_las, vlrs=[_words(COMPOUND)], crs="UTM and height")),
        ("coordinate system", "GeoTIFF keys, projected",
         partial(_las, vlrs=[_keys((1024, 1), (3072, 32633))], crs="EPSG:32633")),
        ("coordinate system", "GeoTIFF keys, geographic",
         partial(_las, vlrs=[_keys((1024, 2), (2048, 4326))], crs="EPSG:4326")),
    )
]  # fmt: skip


def _withheld(folder: Path) -> Known:
    """The first point is marked as withheld."""
    columns = dict(zip("xyz", (PLACE + UTM).T, strict=True)) | {"withheld": np.arange(COUNT) == 0}
    (folder / "in.las").write_bytes(las_of(columns, offsets=UTM))
    return Known(folder / "in.las", (PLACE + UTM)[1:], tolerance=0.001)


def _numpy(kind: Any, folder: Path) -> Known:
    np.savez(folder / "in.npz", position=(PLACE + UTM).astype(kind))
    return Known(folder / "in.npz", (PLACE + UTM).astype(kind))


OTHERS = [
    Variant("LAS", "withheld", "a point", "obeyed", _withheld),
    Variant("NPZ", "type of positions", "float64", "obeyed", partial(_numpy, np.float64)),
    Variant("NPZ", "type of positions", "float32", "obeyed", partial(_numpy, np.float32)),
]
CLOUDS = [*PLYS, *PCDS, *TEXTS, *LASES, *OTHERS]

# ------------------------------------------------------------------------------------ Gaussians

TURN = Rotation.random(COUNT, random_state=np.random.default_rng(7))
WXYZ = TURN.as_quat()[:, [3, 0, 1, 2]]
LOGS = RNG.uniform(-3, -2, (COUNT, 3))
LOGIT = RNG.normal(size=COUNT)
COLOR = RNG.uniform(-1, 1, (COUNT, 3))  # coefficients of the constant harmonic
REST = RNG.uniform(-0.3, 0.3, (COUNT, 3, 15))
MATRIX = TURN.as_matrix()
SPREAD = MATRIX @ (np.eye(3) * np.exp(LOGS)[:, None, :] ** 2) @ MATRIX.transpose(0, 2, 1)
OPACITY = 1 / (1 + np.exp(-LOGIT))


class Splats(NamedTuple):
    """A file of Gaussians, and by how much its numbers are rounded."""

    path: Path
    spread: float = 1e-6  # of covariances
    opacity: float = 1e-6
    color: float = 1e-5
    rest: float = 0.01  # of harmonics, that are kept in steps
    degree: int = 3
    up: str | None = None
    place: float = 1e-6


def _trained(
    folder: Path, *, order: Callable[[Any], Any] = dict, degree: int = 3, length: float = 1,
    form: str = "binary_little_endian", lines: Sequence[str] = (), up: str | None = None,
) -> Splats:  # fmt: skip
    count = (degree + 1) ** 2 - 1
    rest = REST[:, :, :count].reshape(COUNT, -1)
    columns = XYZ | _columns("float", "nx ny nz", np.zeros((COUNT, 3)))
    columns |= _columns("float", "f_dc_0 f_dc_1 f_dc_2", COLOR)
    columns |= _columns("float", " ".join(f"f_rest_{n}" for n in range(3 * count)), rest)
    columns |= {"opacity": ("float", LOGIT)} | _columns("float", "scale_0 scale_1 scale_2", LOGS)
    columns |= _columns("float", "rot_0 rot_1 rot_2 rot_3", length * WXYZ)
    ply(folder / "in.ply", order(columns), form, lines)
    return Splats(folder / "in.ply", degree=degree, up=up)


def _splat(folder: Path) -> Splats:
    """The .splat of antimatter15: levels of sRGB, opacities, quaternions, w first."""
    color = np.clip(np.rint(255 * (0.5 + 0.28209479177387814 * COLOR)), 0, 255)
    levels = np.column_stack([color, np.rint(255 * OPACITY)]).astype(np.uint8)
    turned = np.clip(np.rint(128 * WXYZ + 128), 0, 255).astype(np.uint8)
    floats = np.column_stack([PLACE, np.exp(LOGS)]).astype("<f4")
    rows = zip(floats, levels, turned, strict=True)
    (folder / "in.splat").write_bytes(b"".join(part.tobytes() for row in rows for part in row))
    return Splats(folder / "in.splat", 3e-4, 0.003, 0.008, degree=0)


def _spz(version: int, folder: Path, bits: int = 12, degree: int = 1) -> Splats:
    """Niantic's .spz: positions of 24 bits, or floats of 16; axes are right, up, back."""
    whole = np.rint(PLACE * 2**bits).astype("<i4").reshape(-1, 1).view(np.uint8)[:, :3]
    position = PLACE.astype("<f2").tobytes() if version == 1 else whole.tobytes()
    count = (degree + 1) ** 2 - 1
    rest = np.rint(128 * REST[:, :, :count].transpose(0, 2, 1) + 128).astype(np.uint8)
    turned = np.rint(127.5 * WXYZ[:, 1:] * np.where(WXYZ[:, :1] < 0, -1, 1) + 127.5).astype(
        np.uint8
    )
    rotation = turned.tobytes() if version < 3 else _smallest_three()
    parts = [
        struct.pack("<4sIIBBBB", b"NGSP", version, COUNT, degree, bits, 0, 0), position,
        np.rint(255 * OPACITY).astype(np.uint8).tobytes(),
        np.clip(np.rint(255 * (0.15 * COLOR + 0.5)), 0, 255).astype(np.uint8).tobytes(),
        np.rint(16 * (LOGS + 10)).astype(np.uint8).tobytes(), rotation, rest.tobytes(),
    ]  # fmt: skip
    (folder / "in.spz").write_bytes(gzip.compress(b"".join(parts), mtime=0))
    return Splats(
        folder / "in.spz", 3e-3, 0.003, 0.02, 0.01, degree, "y", 0.004 if version == 1 else 2e-4
    )


def _smallest_three() -> bytes:
    """Rotations of version 3: number of the largest part of x, y, z, w; the others in 10 bits."""
    made = []
    for quaternion in TURN.as_quat():
        largest = int(np.argmax(np.abs(quaternion)))
        signed = quaternion * np.sign(quaternion[largest])
        number = largest
        for n in (n for n in range(4) if n != largest):
            size = round(511 * abs(signed[n]) / np.sqrt(0.5))
            number = number << 10 | int(signed[n] < 0) << 9 | size
        made.append(number)
    return np.array(made, "<u4").tobytes()


GAUSSIANS = [
    Variant(name, field, case, outcome, write, says)
    for name, field, case, outcome, write, says in (
        ("3DGS PLY", "format", "little-endian", "obeyed", _trained, ""),
        ("3DGS PLY", "format", "big-endian", "obeyed",
         partial(_trained, form="binary_big_endian"), ""),
        ("3DGS PLY", "format", "ascii", "obeyed", partial(_trained, form="ascii"), ""),
        ("3DGS PLY", "property", "any order", "obeyed", partial(_trained, order=_moved), ""),
        ("3DGS PLY", "rot", "not of length 1", "obeyed", partial(_trained, length=7.3), ""),
        *(("3DGS PLY", "f_rest", f"degree {n}", "obeyed", partial(_trained, degree=n), "")
          for n in (0, 1, 2)),
        ("3DGS PLY", "comment", "vertical axis", "obeyed",
         partial(_trained, lines=["comment Vertical axis: z"], up="z"), ""),
        ("3DGS PLY", "comment", "scale", "told", partial(_trained, lines=["comment scale 10"]),
         "'scale 10' is not applied"),
        (".splat", "bytes", "32 of each", "obeyed", _splat, ""),
        (".spz", "version", "1", "obeyed", partial(_spz, 1), ""),
        (".spz", "version", "2", "obeyed", partial(_spz, 2), ""),
        (".spz", "version", "3", "obeyed", partial(_spz, 3), ""),
        (".spz", "fractionalBits", "14", "obeyed", partial(_spz, 2, bits=14), ""),
        (".spz", "shDegree", "0", "obeyed", partial(_spz, 2, degree=0), ""),
        (".spz", "shDegree", "3", "obeyed", partial(_spz, 3, degree=3), ""),
    )
]  # fmt: skip
KSPLAT = Variant(
    ".ksplat", "suffix", "of GaussianSplats3D", "refused",
    lambda folder: _text("in.ksplat", "0" * 5000, folder), r"\.ksplat",
)  # fmt: skip
VARIANTS = [*CLOUDS, *GAUSSIANS, KSPLAT]


@pytest.mark.parametrize("one", CLOUDS, ids=str)
def test_points_are_where_their_file_says(one, tmp_path, capsys):
    known: Known = one.write(tmp_path)
    cloud = read_cloud(known.path)
    assert re.search(one.says, capsys.readouterr().err)
    np.testing.assert_allclose(cloud.position, known.place, atol=known.tolerance)
    if known.color is not None:
        light = np.where(
            known.color <= 0.04045, known.color / 12.92, ((known.color + 0.055) / 1.055) ** 2.4
        )
        np.testing.assert_allclose(cloud.color, light, atol=1e-6)
    if known.normal is not None:
        np.testing.assert_allclose(cloud.normal, known.normal, atol=1e-6)
    if known.facts:
        facts = facts_in(known.path)
        assert {name: facts[name] for name in known.facts} == known.facts
        assert json.dumps(facts)


@pytest.mark.parametrize("one", GAUSSIANS, ids=str)
def test_gaussians_are_as_their_file_says(one, tmp_path, capsys):
    splats: Splats = one.write(tmp_path)
    found = read_gaussians(splats.path)
    assert re.search(one.says, capsys.readouterr().err)
    matrix = Rotation.from_quat(found.rotation[:, [1, 2, 3, 0]]).as_matrix()
    spread = matrix @ (np.eye(3) * found.scale[:, None, :] ** 2) @ matrix.transpose(0, 2, 1)
    np.testing.assert_allclose(found.position, PLACE, atol=splats.place)
    np.testing.assert_allclose(spread, SPREAD, atol=splats.spread)
    np.testing.assert_allclose(found.opacity, OPACITY, atol=splats.opacity)
    np.testing.assert_allclose(found.color, COLOR, atol=splats.color)
    count = (splats.degree + 1) ** 2 - 1
    rest = np.asarray(found.harmonics, np.float64) * found.harmonic_step
    np.testing.assert_allclose(rest, REST[:, :, :count].transpose(0, 2, 1), atol=splats.rest)
    assert found.up == splats.up


def test_what_no_reader_knows_is_refused(tmp_path):
    with pytest.raises(ValueError, match=KSPLAT.says):
        read_cloud(KSPLAT.write(tmp_path).path)
