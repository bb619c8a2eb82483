"""One scene of 3D Gaussians in all formats, encoded plainly by their public descriptions."""

import gzip
import io
import json
import struct
import zipfile
from itertools import pairwise
from typing import NamedTuple

import numpy as np

CONSTANT = 1 / (2 * np.sqrt(np.pi))  # of the harmonic of degree 0
DEGREES = {0: 0, 3: 1, 8: 2, 15: 3, 24: 4}  # by the coefficients per channel


class Splats(NamedTuple):
    """Gaussians with activated values in float64."""

    position: np.ndarray
    scale: np.ndarray
    rotation: np.ndarray  # unit quaternions w, x, y, z
    opacity: np.ndarray
    color: np.ndarray
    rest: np.ndarray  # (N, K, 3)


def scene(count=20, width=15, seed=5):
    """Return a random scene with K = `width` coefficients per channel."""
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 4))
    return Splats(
        position=rng.uniform(-3, 3, (count, 3)),
        scale=np.exp(rng.uniform(-5, -1, (count, 3))),
        rotation=rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
        opacity=rng.uniform(0.05, 0.95, count),
        color=rng.uniform(-1, 1, (count, 3)),
        rest=rng.uniform(-0.4, 0.4, (count, width, 3)),
    )


def logits(opacity):
    return np.log(opacity / (1 - opacity))


def trained_columns(splats):
    """Columns of a trainer's file by name, in its order."""
    width = splats.rest.shape[1]
    parts = [("x y z", splats.position), ("nx ny nz", 0 * splats.position)]
    parts += [("f_dc_0 f_dc_1 f_dc_2", splats.color)]
    by_channel = splats.rest.transpose(0, 2, 1).reshape(len(splats.rest), 3 * width)
    parts += [(" ".join(f"f_rest_{n}" for n in range(3 * width)), by_channel)]
    parts += [("opacity", logits(splats.opacity)[:, None])]
    parts += [("scale_0 scale_1 scale_2", np.log(splats.scale))]
    parts += [("rot_0 rot_1 rot_2 rot_3", splats.rotation)]
    return {name: values[:, n] for names, values in parts for n, name in enumerate(names.split())}


def ply_of(columns, encoding="binary_little_endian", comments=(), after=b""):
    """A PLY file of an element vertex with float columns."""
    count = len(next(iter(columns.values())))
    lines = ["ply", f"format {encoding} 1.0", *(f"comment {line}" for line in comments)]
    lines += [f"element vertex {count}", *(f"property float {name}" for name in columns)]
    head = ("\n".join([*lines, "end_header"]) + "\n").encode()
    table = np.stack(list(columns.values()), 1)
    if encoding == "ascii":
        return head + "".join(" ".join(map(repr, row)) + "\n" for row in table.tolist()).encode()
    return head + table.astype(">f4" if "big" in encoding else "<f4").tobytes() + after


def trained_of(splats, encoding="binary_little_endian", comments=()):
    return ply_of(trained_columns(splats), encoding, comments)


def levels(values, bits):
    return np.rint(np.clip(values, 0, 1) * (2**bits - 1)).astype(np.uint32)


def smallest_three(rotation):
    """The place of the largest component (N,), and the others (N, 3), its sign made positive."""
    place = np.abs(rotation).argmax(1)
    signed = rotation * np.sign(np.take_along_axis(rotation, place[:, None], 1))
    others = [[n for n in range(4) if n != k] for k in place]
    return place.astype(np.uint32), np.take_along_axis(signed, np.array(others), 1)


def compressed_of(splats, colors=True, comments=()):
    """A compressed PLY file of SuperSplat; without ranges of colors as its first version."""
    count, width = splats.rest.shape[:2]
    chunks = range(0, count, 256)
    shown = 0.5 + CONSTANT * splats.color
    names = ["x", "y", "z", "scale_x", "scale_y", "scale_z", *("rgb" if colors else "")]
    values = np.concatenate([splats.position, np.log(splats.scale), shown], 1)[:, : len(names)]
    low = np.stack([values[first : first + 256].min(0) for first in chunks])
    high = np.stack([values[first : first + 256].max(0) for first in chunks])
    order = [n for start in (0, 3, 6) for n in range(start, min(start + 3, len(names)))]
    ranges, properties = [], []
    for start in range(0, len(names), 3):
        for end, array in (("min", low), ("max", high)):
            ranges.append(array[:, order[start : start + 3]])
            properties += [f"property float {end}_{name}" for name in names[start : start + 3]]
    n = np.arange(count) // 256
    units = (values - low[n]) / np.where(high > low, high - low, 1)[n]
    place, three = smallest_three(splats.rotation)
    turns = levels(three * np.sqrt(0.5) + 0.5, 10)
    tints = levels(units[:, 6:] if colors else shown, 8)
    packed = np.stack(
        [
            eleven_ten_eleven(units[:, :3]),
            place << 30 | turns[:, 0] << 20 | turns[:, 1] << 10 | turns[:, 2],
            eleven_ten_eleven(units[:, 3:6]),
            tints[:, 0] << 24 | tints[:, 1] << 16 | tints[:, 2] << 8 | levels(splats.opacity, 8),
        ],
        1,
    )
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    lines += [f"element chunk {len(chunks)}", *properties, f"element vertex {count}"]
    lines += [f"property uint packed_{what}" for what in ("position", "rotation", "scale", "color")]
    data = np.concatenate(ranges, 1).astype("<f4").tobytes() + packed.astype("<u4").tobytes()
    if width:
        lines += [f"element sh {count}"]
        lines += [f"property uchar f_rest_{n}" for n in range(3 * width)]
        by_channel = splats.rest.transpose(0, 2, 1).reshape(count, -1)
        data += np.clip((by_channel / 8 + 0.5) * 256, 0, 255).astype(np.uint8).tobytes()
    return ("\n".join([*lines, "end_header"]) + "\n").encode() + data


def eleven_ten_eleven(units):
    parts = [levels(units[:, n], bits) for n, bits in enumerate((11, 10, 11))]
    return parts[0] << 21 | parts[1] << 11 | parts[2]


def splat_of(splats):
    """A `.splat` file, which has no harmonics."""
    shown = np.concatenate([0.5 + CONSTANT * splats.color, splats.opacity[:, None]], 1)
    turns = np.clip(np.rint(splats.rotation * 128 + 128), 0, 255).astype(np.uint8)
    return b"".join(
        np.concatenate([splats.position[n], splats.scale[n]]).astype("<f4").tobytes()
        + levels(shown[n], 8).astype(np.uint8).tobytes()
        + turns[n].tobytes()
        for n in range(len(splats.position))
    )


def spz_of(splats, version=3, flags=0, extensions=b"", packed=True):
    """An SPZ file; versions 1 to 3 are one stream, version 4 has one per array."""
    arrays = spz_arrays(splats, version)
    count, degree = len(splats.position), DEGREES[splats.rest.shape[1]]
    if version < 4:
        head = struct.pack("<4sIIBBBB", b"NGSP", version, count, degree, 12, flags, 0)
        whole = head + b"".join(arrays) + extensions
        return gzip.compress(whole, mtime=0) if packed else whole
    from numcodecs import Zstd

    streams = [(Zstd().encode(array), len(array)) for array in arrays if array]
    head = struct.pack(
        "<4sIIBBBBI12x", b"NGSP", 4, count, degree, 12, flags, len(streams), 32 + len(extensions)
    )
    table = b"".join(struct.pack("<QQ", len(stream), size) for stream, size in streams)
    return head + extensions + table + b"".join(stream for stream, _ in streams)


def spz_arrays(splats, version):
    whole = np.rint(splats.position * 4096).astype("<i4").reshape(-1, 1).view(np.uint8)
    position = whole[:, :3] if version > 1 else splats.position.astype("<f2")
    w, rest = splats.rotation[:, :1], splats.rotation[:, 1:]
    turned = np.clip(np.rint(rest * np.sign(w) * 127.5 + 127.5), 0, 255).astype(np.uint8)
    if version >= 3:
        place, three = smallest_three(np.roll(splats.rotation, -1, 1))  # x, y, z, w
        turned = place << 30
        for n in range(3):
            size = np.rint(np.abs(three[:, n]) * np.sqrt(2) * 511).astype(np.uint32)
            turned |= (size | (three[:, n] < 0).astype(np.uint32) << 9) << (20 - 10 * n)
        turned = turned.astype("<u4")
    scales = np.rint((np.log(splats.scale) + 10) * 16).astype(np.uint8)
    colors = np.clip(np.rint(255 * (0.15 * splats.color + 0.5)), 0, 255).astype(np.uint8)
    harmonics = np.clip(np.rint(splats.rest * 128) + 128, 0, 255).astype(np.uint8)
    opacity = levels(splats.opacity, 8).astype(np.uint8)
    arrays = (position, opacity, colors, scales, turned, harmonics)
    return [np.ascontiguousarray(array).tobytes() for array in arrays]


def webp_of(texels, width):
    """Lossless picture of texels (N, 4), with as many rows as needed."""
    from PIL import Image

    rows = -(-len(texels) // width)
    padded = np.zeros((rows * width, 4), np.uint8)
    padded[: len(texels)] = texels
    file = io.BytesIO()
    Image.fromarray(padded.reshape(rows, width, 4)).save(file, "webp", lossless=True, exact=True)
    return file.getvalue()


def sog_of(splats, version=2, **told):
    """Files of a SOG folder by their names, meta.json first; `told` is added to it."""
    count, width = splats.rest.shape[:2]
    across = int(np.ceil(np.sqrt(count)))
    logs = np.sign(splats.position) * np.log1p(np.abs(splats.position))
    low, high = logs.min(0), logs.max(0)
    whole = np.rint((logs - low) / (high - low) * 65535).astype(np.uint32)
    place, three = smallest_three(splats.rotation)
    turns = np.concatenate([levels(three * np.sqrt(0.5) + 0.5, 8), place[:, None] + 252], 1)
    pictures = {
        "means_l.webp": opaque(whole & 255),
        "means_u.webp": opaque(whole >> 8),
        "quats.webp": turns,
    }
    meta = {"means": {"mins": low.tolist(), "maxs": high.tolist()}, "quats": {}}
    if version == 2:
        meta = {"version": 2, "count": count, **meta}
        meta["scales"], scales = codebook_of(np.log(splats.scale))
        meta["sh0"], colors = codebook_of(splats.color)
        colors = np.concatenate([colors, levels(splats.opacity, 8)[:, None]], 1)
    else:
        meta["means"]["shape"] = [count, 3]
        meta["scales"], scales = ends_of(np.log(splats.scale))
        both = np.concatenate([splats.color, logits(splats.opacity)[:, None]], 1)
        meta["sh0"], colors = ends_of(both)
    pictures |= {"scales.webp": opaque(scales), "sh0.webp": colors}
    if width:  # each Gaussian has an entry of its own, 64 of them in a row
        described, entries = codebook_of(splats.rest)
        if version == 1:
            described = {"mins": float(splats.rest.min()), "maxs": float(splats.rest.max())}
        else:
            described |= {"count": count, "bands": DEGREES[width]}
        meta["shN"] = described
        label = np.arange(count)
        pictures["shN_centroids.webp"] = opaque(entries.reshape(-1, 3))
        pictures["shN_labels.webp"] = opaque(np.stack([label & 255, label >> 8, label], 1))
    for name in pictures:
        meta[name.partition("_")[0].removesuffix(".webp")].setdefault("files", []).append(name)
    files = {"meta.json": json.dumps(meta | told).encode()}
    for name, texels in pictures.items():
        files[name] = webp_of(texels, 64 * width if "centroids" in name else across)
    return files


def opaque(texels):
    return np.concatenate([texels, np.full((len(texels), 1), 255)], 1)


def codebook_of(values):
    """An even palette of 256 numbers, and the nearest entry of each value."""
    low, high = values.min(), values.max()
    entries = np.rint((values - low) / (high - low) * 255).astype(np.uint8)
    return {"codebook": np.linspace(low, high, 256).tolist()}, entries


def ends_of(values):
    """Ends per channel, and bytes between them."""
    low, high = values.min(0), values.max(0)
    entries = np.rint((values - low) / (high - low) * 255).astype(np.uint8)
    return {"mins": low.tolist(), "maxs": high.tolist()}, entries


def zipped(files, method=zipfile.ZIP_STORED):
    """A `.sog` file."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as target:
        for name, content in files.items():
            target.writestr(zipfile.ZipInfo(name), content, method)  # of 1980, always
    return packed.getvalue()


def ksplat_of(splats, precision, *, in_bucket=8, block=8.0):
    """A `.ksplat` file of one section, whose buckets have their middles anywhere."""
    count, width = splats.rest.shape[:2]
    ends = (0, 3, 8, 15)
    bands = [splats.rest[:, low:high] for low, high in pairwise(ends)]
    flat = np.concatenate([band.transpose(0, 2, 1).reshape(count, -1) for band in bands], axis=1)
    kinds = [("<f4", "<f4", "<f4"), ("<u2", "<f2", "<f2"), ("<u2", "<f2", "u1")][precision]
    full = count // in_bucket
    sizes = [in_bucket] * full + [count - full * in_bucket] * (count % in_bucket > 0)
    middle = np.arange(3 * len(sizes)).reshape(-1, 3) % 3 * 0.25 - 0.25
    position = splats.position
    if precision:
        away = (position - middle.repeat(sizes, axis=0)) / (block / 2)
        position = np.rint(away * 32767 + 32767)
    rest = np.rint((flat + 1.5) / 3 * 255) if precision == 2 else flat
    level = np.column_stack([splats.color * CONSTANT + 0.5, splats.opacity])
    columns = (position, splats.scale, splats.rotation, np.rint(level * 255), rest)
    records = np.zeros(count, [
        (str(n), kind, values.shape[1])
        for n, (kind, values) in enumerate(
            zip((kinds[0], kinds[1], kinds[1], "u1", kinds[2]), columns, strict=True)
        )
    ])  # fmt: skip
    for n, values in enumerate(columns):
        records[str(n)] = values
    head = struct.pack("<2B2x4IH2x12x2f", 0, 1, 1, 1, count, count, precision, -1.5, 1.5)
    part = struct.pack(
        "<IIIIfH2xI4xIIH", count, count, in_bucket, len(sizes), block, 12, 32767, full,
        len(sizes) - full, DEGREES[width],
    )  # fmt: skip
    whole = head.ljust(4096, b"\0") + part.ljust(1024, b"\0")
    whole += np.array(sizes[full:], "<u4").tobytes() + middle.astype("<f4").tobytes()
    return whole + records.tobytes()
