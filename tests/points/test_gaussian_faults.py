"""Files of Gaussians that are cut off, damaged or hostile are refused in one line."""

import json
import struct
import zipfile

import numpy as np
import pytest

from resample.reading.limits import raised
from resample_points.files.gaussians.formats import read_gaussians
from tests import splats as made
from tests.fuzz.files import put

SCENE = made.scene(width=3)
HEAD = "ply\nformat binary_little_endian 1.0\n"
FORMATS = {
    "a.ply": made.trained_of(SCENE),
    "ascii.ply": made.trained_of(SCENE, "ascii"),
    "packed.ply": made.compressed_of(SCENE),
    "a.splat": made.splat_of(SCENE)[:-1],
    **{f"{n}.ksplat": made.ksplat_of(SCENE, n) for n in (0, 1, 2)},
    "raw.spz": made.spz_of(SCENE, 2, packed=False),
    **{f"{version}.spz": made.spz_of(SCENE, version) for version in (1, 2, 3, 4)},
    "a.sog": made.zipped(made.sog_of(SCENE)),
}


def refusal(path):
    with pytest.raises((ValueError, OSError)) as caught:
        read_gaussians(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def refused(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    return refusal(path)


def text_of(given):
    """Name of a case: no bytes, which would differ between workers."""
    return given if isinstance(given, str) else ""


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.97])
def test_files_that_are_cut_off_are_refused(tmp_path, name, share):
    content = FORMATS[name]
    refused(tmp_path, name, content[: int(share * len(content)) | 1])


@pytest.mark.parametrize(
    ("name", "content"),
    ids=text_of,
    argvalues=[
        ("a.ply", FORMATS["a.ply"].replace(b"vertex 20", b"vertex 99999999999999")),
        ("ascii.ply", FORMATS["ascii.ply"].replace(b"vertex 20", b"vertex 99999999999999")),
        ("b.ply", FORMATS["packed.ply"].replace(b"chunk 1", b"chunk 99999999999999")),
        ("c.ply", FORMATS["packed.ply"].replace(b"vertex 20", b"vertex 99999999999999")),
        ("d.ply", FORMATS["packed.ply"].replace(b"sh 20", b"sh 99999999999999")),
        ("2.spz", struct.pack("<4sIIBBBB", b"NGSP", 2, 2**32 - 1, 3, 12, 0, 0)),
        ("4.spz", struct.pack("<4sIIBBBBI12x", b"NGSP", 4, 2**32 - 1, 3, 12, 0, 6, 32) + bytes(96)),
        ("a.sog", made.zipped(made.sog_of(SCENE, count=2**40))),
    ],
)
def test_counts_beyond_the_file_are_refused_before_memory_is_taken(tmp_path, name, content):
    refused(tmp_path, name, content)


def test_packed_streams_of_zeros_are_refused_before_they_are_unpacked(tmp_path):
    import zlib

    head = struct.pack("<4sIIBBBB", b"NGSP", 3, 200_000, 3, 12, 0, 0)
    packer = zlib.compressobj(wbits=31)
    bomb = packer.compress(head) + packer.compress(bytes(1 << 24)) + packer.flush()
    with raised("unpacked=1MiB"):
        assert "over the limit" in refused(tmp_path, "a.spz", bomb)


def test_members_of_archives_that_unpack_to_much_are_refused(tmp_path):
    files = made.sog_of(SCENE)
    files["sh0.webp"] = bytes(1 << 21)
    content = made.zipped(files, zipfile.ZIP_DEFLATED)
    with raised("unpacked=1MiB,ratio=10"):
        assert "over the limit" in refused(tmp_path, "a.sog", content)
    files["meta.json"] += b" " * (1 << 20)
    with raised("tree=64KiB"):
        assert "over the limit" in refused(tmp_path, "a.sog", made.zipped(files))


def test_archives_packed_otherwise_are_refused(tmp_path):
    content = made.zipped(made.sog_of(SCENE), zipfile.ZIP_BZIP2)
    assert "pack it by deflate" in refused(tmp_path, "a.sog", content)


def with_meta(change, version=2):
    """Files of a SOG folder whose description a function changes."""
    files = made.sog_of(SCENE, version)
    meta = json.loads(files["meta.json"])
    change(meta)
    return files | {"meta.json": json.dumps(meta).encode()}


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda meta: meta["scales"].update(codebook=[0.0] * 200), "codebook, which has 200"),
        (lambda meta: meta["sh0"].update(codebook=[]), "codebook, which has 0"),
        (lambda meta: meta["sh0"].update(codebook=[None] * 256), "not finite numbers"),
        (lambda meta: meta["sh0"].update(codebook="a"), "not finite numbers"),
        (lambda meta: meta["shN"].update(bands=2), "texels wide"),
        (lambda meta: meta["shN"].update(bands="1"), "texels wide"),
        (lambda meta: meta["shN"].update(bands=[1]), "texels wide"),
        (lambda meta: meta["shN"].update(files=["means_l.webp", "shN_labels.webp"]), "texels wide"),
        (lambda meta: meta["means"].update(mins=[0, 0]), "not 3 numbers"),
        (lambda meta: meta["means"].update(mins=[0, 0, float("nan")]), "not 3 numbers"),
        (lambda meta: meta["means"].update(files=["means_l.webp"]), "no picture 2 of means"),
        (lambda meta: meta["means"].update(files=3), "no picture 1 of means"),
        (lambda meta: meta["quats"].update(files=["shN_centroids.webp"]), None),
        (lambda meta: meta["quats"].update(files=["../a.webp"]), "leads outside"),
        (lambda meta: meta["quats"].update(files=["/etc/passwd"]), "absolute path"),
        (lambda meta: meta["quats"].update(files=["https://example.org/a.webp"]), "an address"),
        (lambda meta: meta["quats"].update(files=["missing.webp"]), "no such file"),
        (lambda meta: meta.update(version=3), "SOG version 3"),
        (lambda meta: meta.update(version=[2]), "SOG version"),
        (lambda meta: meta.update(count="20"), "'20' Gaussians"),
        (lambda meta: meta.update(count=True), "True Gaussians"),
        (lambda meta: meta.update(count=0), "no Gaussians"),
        (lambda meta: meta.update(count=-1), "no Gaussians"),
        (lambda meta: meta.update(count=26), "26 Gaussians, and 20 texels"),
        (lambda meta: meta.update(shN=[]), "shN that are not described"),
        (lambda meta: meta.pop("quats"), "not of SOG"),
    ],
)
def test_descriptions_that_do_not_fit_the_pictures_are_refused(tmp_path, change, match):
    put(tmp_path, with_meta(change))
    if match is None:
        assert len(read_gaussians(tmp_path).position) <= 20
    else:
        assert match in refusal(tmp_path)


def test_members_outside_an_archive_are_refused(tmp_path):
    files = with_meta(lambda meta: meta["quats"].update(files=["../quats.webp"]))
    assert "is not in the file" in refused(tmp_path, "a.sog", made.zipped(files))


def test_labels_beyond_the_palette_are_refused(tmp_path):
    files = made.sog_of(SCENE)
    label = np.full((20, 2), 255)
    files["shN_labels.webp"] = made.webp_of(
        made.opaque(np.concatenate([label, label], 1)[:, :3]), 5
    )
    put(tmp_path, files)
    assert "of a palette of 64" in refusal(tmp_path)


def test_palettes_whose_first_entry_is_left_out_go_on_evenly(tmp_path):
    files = with_meta(lambda meta: meta["sh0"]["codebook"].__setitem__(0, None))
    put(tmp_path, files)
    step = (SCENE.color.max() - SCENE.color.min()) / 255
    found = read_gaussians(tmp_path).color
    assert np.abs(found - SCENE.color).max() < 1.1 * step


@pytest.mark.parametrize(
    ("name", "content", "match"),
    ids=text_of,
    argvalues=[
        (
            "a.ply",
            HEAD.encode() + b"element vertex 1\nproperty list uchar int x\nend_header\n",
            "f_dc_0",
        ),
        ("b.ply", b"ply\nformat middle 1.0\nelement vertex 1\nend_header\n", "'middle'"),
        ("c.ply", HEAD.encode() + b"element vertex -1\nend_header\n", "whole number"),
        ("d.ply", HEAD.encode() + b"element vertex 1\n", "no end"),
        ("e.ply", HEAD.encode() + b"a\n" * 2000, "no end"),
        ("f.ply", b"plywood", "does not begin with ply"),
        ("g.ply", made.ply_of({"x": np.ones(2)}), "no property f_dc_0"),
        (
            "h.ply",
            FORMATS["a.ply"].replace(b"float f_rest_8", b"float f_rest_9"),
            "numbered from 0",
        ),
        (
            "i.ply",
            FORMATS["a.ply"].replace(b"float f_rest_8", b"float g_rest_8"),
            "harmonics f_rest",
        ),
        ("j.ply", FORMATS["a.ply"].replace(b"float nx", b"float x"), "twice"),
        ("aa.ply", FORMATS["packed.ply"].replace(b"element chunk 1", b"element vertex 1"), "twice"),
        ("k.ply", FORMATS["a.ply"].replace(b"float nx", b"quad nx"), "neither a number"),
        ("l.ply", FORMATS["ascii.ply"].replace(b"e", b"a", 99), "header"),
        ("m.ply", FORMATS["packed.ply"].replace(b"float max_g", b"float max_h"), "no max_g"),
        (
            "n.ply",
            FORMATS["packed.ply"].replace(b"float min_scale_x", b"float a"),
            "no min_scale_x",
        ),
        (
            "o.ply",
            FORMATS["packed.ply"].replace(b"uint packed_p", b"float packed_p"),
            "must be uint",
        ),
        ("p.ply", FORMATS["packed.ply"].replace(b"chunk 1", b"chunk 0"), "0 chunks"),
        ("q.ply", FORMATS["packed.ply"].replace(b"uchar f_rest_8", b"uchar f_rest_9"), "harmonics"),
        ("r.spz", struct.pack("<4sIIBBBB", b"NGSP", 9, 1, 0, 12, 0, 0) + bytes(99), "version 9"),
        ("s.spz", struct.pack("<4sIIBBBB", b"NGSP", 3, 1, 5, 12, 0, 0) + bytes(99), "degree 5"),
        ("t.spz", struct.pack("<4sIIBBBB", b"NGSP", 3, 0, 0, 12, 0, 0), "no Gaussians"),
        ("u.spz", b"\x1f\x8bnothing", "damaged"),
        ("v.sog", made.zipped({"a": b""}), "without meta.json"),
        ("w.sog", b"PK\3\4nothing", "damaged"),
        ("x.splat", bytes(33), "not a multiple"),
        ("y.splat", b"", "no Gaussians"),
        ("z.bin", b"nothing", "known are PLY"),
        ("a.json", b"[", "a.json"),
        ("b.json", b"\xff\xfe", "not a text"),
    ],
)
def test_files_that_break_the_rules_say_which(tmp_path, name, content, match):
    assert match in refused(tmp_path, name, content)


def test_streams_that_unpack_to_other_sizes_are_refused(tmp_path):
    content = bytearray(made.spz_of(SCENE, 4))
    content[40:48] = struct.pack("<Q", 181)
    assert "stream of 181 bytes" in refused(tmp_path, "a.spz", bytes(content))
    content = bytearray(made.spz_of(SCENE, 4))
    content[128 + 8] ^= 255
    assert "a.spz" in refused(tmp_path, "a.spz", bytes(content))


def test_folders_without_a_description_are_refused(tmp_path):
    assert "a folder without meta.json" in refusal(tmp_path)
    assert "there is no such file" in refusal(tmp_path / "a.ply")


def test_gaussians_with_invalid_numbers_are_left_out(tmp_path, caplog):
    columns = made.trained_columns(made.scene())
    for n, (name, value) in enumerate(
        {
            "x": np.nan,
            "y": np.inf,
            "scale_0": np.nan,
            "scale_1": np.inf,
            "scale_2": -np.inf,
            "opacity": np.nan,
            "f_dc_0": np.inf,
            "f_rest_7": np.nan,
        }.items()
    ):
        columns[name][n] = value
    for n in range(4):
        columns[f"rot_{n}"][8] = 0
    path = tmp_path / "a.ply"
    path.write_bytes(made.ply_of(columns))
    found = read_gaussians(path)
    assert np.array_equal(found.position, made.scene().position[9:].astype(np.float32))
    assert "a.ply: 9 of 20 Gaussians are left out" in caplog.text


def test_huge_harmonics_of_one_gaussian_leave_those_of_others_fine(tmp_path):
    columns = made.trained_columns(made.scene())
    columns["f_rest_3"][0] = 1e30
    path = tmp_path / "a.ply"
    path.write_bytes(made.ply_of(columns))
    found = read_gaussians(path)
    rest = found.harmonics * found.harmonic_step
    assert np.abs(rest[1:] - made.scene().rest[1:]).max() <= 16 / 32767 + 1e-6
    assert rest.max() == pytest.approx(32)


def test_logits_of_infinity_are_opacities_of_0_and_1(tmp_path):
    columns = made.trained_columns(SCENE)
    columns["opacity"][:2] = np.inf, -np.inf
    path = tmp_path / "a.ply"
    path.write_bytes(made.ply_of(columns))
    assert read_gaussians(path).opacity[:2].tolist() == [1, 0]


# Numbers beyond float32, which NumPy would warn of


def test_huge_ends_of_ranges_are_refused(tmp_path):
    for version, part in ((1, "scales"), (1, "sh0"), (1, "shN"), (2, "means")):
        files = made.sog_of(SCENE, version)
        meta = json.loads(files["meta.json"])
        ends = meta[part]["maxs"]
        meta[part]["maxs"] = [1e308] * len(ends) if isinstance(ends, list) else 1e308
        files["meta.json"] = json.dumps(meta).encode()
        put(tmp_path, files)
        assert f"maxs of {part}" in refusal(tmp_path)


def test_a_coefficient_near_the_end_of_float32_is_clipped(tmp_path):
    columns = made.trained_columns(made.scene())
    columns["f_rest_3"][0] = 3e38
    path = tmp_path / "a.ply"
    path.write_bytes(made.ply_of(columns))
    assert read_gaussians(path).harmonics.max() == 32767


def test_numbers_of_64_bits_beyond_32_are_left_out(tmp_path):
    columns = made.trained_columns(SCENE)
    content = made.ply_of(columns)
    start = content.index(b"end_header\n")
    columns["x"][0], columns["scale_0"][1], columns["f_rest_2"][2] = 1e300, 1e300, -1e300
    path = tmp_path / "a.ply"
    table = np.stack(list(columns.values()), 1).astype("<f8").tobytes()
    path.write_bytes(content[:start].replace(b"float", b"double") + b"end_header\n" + table)
    found = read_gaussians(path)
    assert np.array_equal(found.position, SCENE.position[3:].astype(np.float32))


def test_a_text_of_blank_lines_is_cut_off(tmp_path):
    content = FORMATS["ascii.ply"]
    start = content.index(b"end_header\n") + 11
    assert "cut off" in refused(tmp_path, "a.ply", content[:start] + b"\n" * 20)
