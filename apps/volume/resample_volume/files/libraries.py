"""Formats that other libraries read: FITS, OpenVDB, microscopes', MGH, MINC and Analyze."""

import re
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from resample.messages import one_line
from resample.reading.arrays import SIGNATURE, dataset_in, group_in
from resample.reading.limits import check_items, check_unpacked
from resample.reading.native import damage, lacking, plain
from resample_volume.data.values import require_memory
from resample_volume.files.hdf5 import contents
from resample_volume.files.headers import (
    SPACE,
    Check,
    LabelledAxis,
    OneOfAll,
    check_shape,
    existing_file,
    header,
    lattice_of,
    recording,
    recording_along,
    stem,
    volume,
)
from resample_volume.files.nifti import TO_LPS
from resample_volume.types import VOXEL, ChannelLook, Recording, Volume

CELESTIAL = re.compile("RA|DEC|[GESH]L(ON|AT)|..L[NT]")  # names of axes in degrees
TYPES = {8: "u1", 16: "i2", 32: "i4", 64: "i8", -32: "f4", -64: "f8"}  # by BITPIX
BLOCK, MOST_AXES = 2880, 999  # bytes of a header's block (NAXIS is in the first); axes
AXES = re.compile(rb"NAXIS +=\s+([+-]?\d+)")
FITS_PACKED = (".gz", ".fz", ".bz2")


@dataclass(frozen=True)
class Fits(OneOfAll):
    """An image of a FITS file with three axes or more: the first, or one that is chosen.

    Celestial axes keep the proportion of their pixels; a channel of velocity or frequency is as
    deep as a pixel is wide, unless all axes are lengths of one unit. Blank values are missing.
    """

    hdu: str = ""  # name or number of the image; empty: the first with three axes

    suffixes: ClassVar[tuple[str, ...]] = (".fits", ".fit", ".fts", ".fits.gz", ".fits.fz")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        try:
            from astropy.io import fits
        except ImportError as error:
            raise lacking(path.name, "astropy", error, "fits") from None
        _check_axes(path)
        with path.open("rb") as raw:
            with damage(path):
                held = fits.open(raw, memmap=False)
                count = len(held)
            check_items(path.name, count, "tables and images")
            image = _image_of(held, self.hdu, path.name)
            axes, is_scaled = _axes_of(image.header), "BSCALE" in image.header
            kind, bits = np.dtype(np.float32), image.header.get("BITPIX")
            if not is_scaled and "BLANK" not in image.header:  # blank values are missing
                if bits not in TYPES:
                    listed = ", ".join(map(str, TYPES))
                    raise ValueError(f"has values of {bits} bits; FITS has {listed}")
                kind = np.dtype(TYPES[bits])
            known = lattice_of(axes, kind, name)
            check(known)
            packed = path.name.lower().endswith(FITS_PACKED) or "ZIMAGE" in image._header
            given = path.stat().st_size
            if packed:
                check_unpacked(path.name, given, known.size)
            elif given < known.size:
                raise ValueError(f"{path.name} is cut off: {given} of {known.size} bytes are there")
            require_memory(known.size, name)
            unit = str(image.header.get("BUNIT", "")).strip()
            with damage(path):
                values = np.asarray(image.data)
            values = values.reshape([axis.size for axis in axes][::-1])
            if "BLANK" in image.header and values.dtype.kind in "iu":
                blank = values == image.header["BLANK"]
                values = np.where(blank, np.float32(np.nan), values.astype(np.float32))
            told = [f"values are in {unit}"] if unit else []
            known = known._replace(note="; ".join([*told, known.note]).strip("; "))
            return recording_along(values.astype(values.dtype.newbyteorder("=")), axes, known)


def _check_axes(path: Path) -> None:
    """Reject absurd numbers of axes: astropy would look for each."""
    count = path.stat().st_size // BLOCK
    if not count:
        return
    blocks = np.memmap(path, np.uint8, "r", shape=(count, BLOCK))
    marks = np.frombuffer(b"XTENSION", np.uint8)
    for n in (0, *np.flatnonzero((blocks[:, : marks.size] == marks).all(axis=1))):
        for digits in AXES.findall(blocks[n].tobytes()):
            if len(digits) > 5 or abs(int(digits)) > MOST_AXES:
                axes = digits[:20].decode()
                raise ValueError(f"{path.name} has {axes} axes; FITS has {MOST_AXES} at most")


def _image_of(held: Any, chosen: str, name: str) -> Any:
    """Return the image that is chosen by name or number, or the first of three axes."""
    shapes = [_shape_of(hdu) for hdu in held]
    if chosen:
        images = [hdu for n, hdu in enumerate(held) if shapes[n] and chosen in (str(n), hdu.name)]
    else:
        images = [
            hdu
            for hdu, shape in zip(held, shapes, strict=True)
            if sum(size > 1 for size in shape) >= SPACE
        ]
    if not images:
        known = ", ".join(f"{n} {hdu.name} {shapes[n] or ''}".strip() for n, hdu in enumerate(held))
        raise ValueError(
            f"{name} holds no image of three axes{f' called {chosen}' if chosen else ''}: {known}"
        )
    return images[0]


def _shape_of(hdu: Any) -> tuple[int, ...]:
    """Return the shape of an image; () for a table or a damaged header."""
    shape: Any = getattr(hdu, "shape", None) if hdu.is_image else None
    is_known = isinstance(shape, tuple) and all(isinstance(size, int) for size in shape)
    return shape if is_known else ()


def _axes_of(header: Any) -> list[LabelledAxis]:
    """Return the axes of more than one pixel, x first."""
    axes = []
    for n in range(1, header["NAXIS"] + 1):
        name, unit = (str(header.get(f"{key}{n}", "")).strip() for key in ("CTYPE", "CUNIT"))
        step = header.get(f"CDELT{n}", header.get(f"CD{n}_{n}"))
        axes.append(
            LabelledAxis(
                name or f"axis {n}",
                int(header[f"NAXIS{n}"]),
                # Skies are shown with the right ascension to the left, as they are stored.
                abs(float(step)) if isinstance(step, int | float) and step else None,
                unit or ("deg" if CELESTIAL.match(name) else ""),
            )
        )
    kept = [axis for axis in axes if axis.size > 1]
    return kept if len(kept) >= SPACE else axes[:SPACE]


FLOATS = "Tree_float"  # prefix of supported types
USUAL = "density"  # default grid if there are several
LEVEL_SET = "level set"
DENSE = "write it as .npy or .nrrd from OpenVDB's Python (grid.copyToArray) or from Houdini"


@dataclass(frozen=True)
class Vdb:
    """A float grid of an OpenVDB file, dense over the box of its active voxels.

    Inactive voxels have the background; those of a level set are missing.
    """

    part: str = ""  # name of the grid; empty: the only one of floats, or density

    suffixes: ClassVar[tuple[str, ...]] = (".vdb",)

    def __call__(self, path: Path) -> Volume:
        name = stem(existing_file(path), self.suffixes)
        try:
            library: Any = import_module("tinyvdb")
        except ImportError:
            raise ValueError(
                f"{path.name}: .vdb is read by tinyvdb; pip install 'hybrid-resample[vdb]', or "
                f"{DENSE}"
            ) from None
        try:
            with library.open(plain(path)) as file:
                check_items(path.name, file.grid_count, "grids")
                file.read_grids()
                # Find the grid by its name.
                grids = [file.grid(n) for n in range(file.grid_count)]
                floats = [grid for grid in grids if grid.type_name.startswith(FLOATS)]
                found = [grid for grid in floats if grid.name == (self.part or USUAL)]
                if not self.part and len(floats) == 1:
                    found = floats
                if not found:
                    known = ", ".join(
                        f"{grid.name} ({grid.type_name.split('_')[1:2][0]})" for grid in grids
                    )
                    raise ValueError(
                        f"{path.name}: choose a grid of floats, --reader vdb:part=NAME "
                        f"({self.part or 'none'} given): {known or 'there is none'}"
                    )
                return _volume(found[0], path, name)
        except (library.VDBError, MemoryError, SystemError, UnicodeDecodeError) as error:
            raise ValueError(
                f"{path.name} is damaged or no OpenVDB file: {one_line(error) or 'cut off'}"
            ) from None


def _volume(grid: Any, path: Path, name: str) -> Volume:
    """Make a dense volume of a grid."""
    told = grid.metadata
    sparse = grid.to_sparse()
    place = np.frombuffer(sparse["coords"], np.int32).reshape(-1, 3).astype(np.int64)
    value = np.frombuffer(sparse["values"], np.float32)
    active = told.get("file_voxel_count", len(value))
    if isinstance(active, int) and active > len(value):
        raise ValueError(
            f"{path.name}: {grid.name} has {active} active voxels, of which "
            f"{active - len(value)} lie in tiles, which tinyvdb does not read; {DENSE}"
        )
    if not len(value):
        raise ValueError(f"{path.name} is empty: {grid.name} has no active voxels")
    low, high = place.min(axis=0), place.max(axis=0)
    shape = tuple((high - low + 1).tolist())
    check_shape(shape, name)
    check_unpacked(path.name, path.stat().st_size, 4 * int(np.prod(shape, dtype=object)))
    # The header by a grid's transform from indices to world space
    kind = grid.transform["type"]
    if kind == "affine":  # row vectors
        matrix = np.array(grid.transform["matrix"], np.float64)
        steps, start = matrix[:3, :3].T, matrix[3, :3]
    elif kind in ("uniform_scale", "uniform_scale_translate", "scale", "scale_translate"):
        steps = np.diag(np.array(grid.transform["scale"], np.float64))
        start = np.array(grid.transform["translation"], np.float64)
    elif kind == "translation":
        steps, start = np.eye(3), np.array(grid.transform["translation"], np.float64)
    else:
        raise ValueError(
            f"{path.name} has a map {kind!r:.40} of space, which is not known; {DENSE}"
        )
    with np.errstate(all="ignore"):  # absurd numbers are rejected, without warnings
        origin = steps @ low + start
    known = header(shape, np.float32, path.name, origin=origin, direction=steps)
    require_memory(known.size, name)
    is_level_set = told.get("class", "") == LEVEL_SET
    beside = np.nan if is_level_set else grid.float_background()
    values = np.full(shape[::-1], beside, np.float32)
    x, y, z = (place - low).T
    values[z, y, x] = value
    share = 100 * len(value) / values.size
    rest = "have no value" if is_level_set else f"are its background, {beside:.4g}"
    note = f"{grid.name}: {share:.3g} % of the voxels are active, others {rest}"
    return volume(values, known._replace(name=name))._replace(note=note)


@dataclass(frozen=True)
class BioIo(OneOfAll):
    """CZI, LIF, ND2 and others that a plugin of bioio reads: times and channels of one scene."""

    scene: str = ""  # its name; empty: the first

    suffixes: ClassVar[tuple[str, ...]] = (".czi", ".lif", ".nd2", ".lsm", ".oib", ".oif", ".dv")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        kind = path.suffix.lower()[1:]
        try:
            from bioio import BioImage
        except ImportError:
            raise ValueError(
                f"{path.name} is read by bioio: pip install bioio bioio-{kind}, or save it as "
                "OME-TIFF"
            ) from None
        with damage(path):
            image: Any = BioImage(plain(path))
            scenes = [str(scene) for scene in image.scenes]
        if self.scene and self.scene not in scenes:
            raise ValueError(
                f"{path.name} has no scene {self.scene!r:.80}; it has {', '.join(scenes):.200}"
            )
        with damage(path):
            image.set_scene(self.scene or scenes[0])
            times, parts, z, y, x = (int(size) for size in image.shape[-5:])
            sizes = [getattr(image.physical_pixel_sizes, axis) for axis in "XYZ"]
            labels, dtype = [str(one) for one in image.channel_names], np.dtype(image.dtype)
        is_told = all(sizes)
        known = header((x, y, z), dtype, name, spacing=sizes if is_told else (1, 1, 1))
        known = known._replace(times=times, parts=parts, length="µm" if is_told else VOXEL)
        check(known)
        require_memory(known.size, name)
        with damage(path):
            values = np.asarray(image.get_image_data("TCZYX"))
        looks = tuple(ChannelLook(label[:80]) for label in labels)
        return recording(values, known, channels_first=True)._replace(looks=looks)


PACKED = (".mgz", ".gz")
OF_MINC = ("minc-2.0", "image", "0")


@dataclass(frozen=True)
class Neuro(OneOfAll):
    """MGH and MGZ of FreeSurfer, MINC, Analyze 7.5 and pairs of NIfTI; in LPS, mm."""

    space: ClassVar[str] = "lps"
    suffixes: ClassVar[tuple[str, ...]] = (".mgh", ".mgz", ".mnc", ".hdr", ".img")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        try:
            import nibabel
        except ImportError as error:
            raise lacking(path.name, "nibabel", error, "neuro") from None
        is_minc = path.suffix.lower() == ".mnc"
        if is_minc:
            _check_minc(path)
        with damage(path):
            image: Any
            if path.suffix.lower() == ".mgh":  # nibabel would leave the file open
                image = nibabel.MGHImage.from_bytes(path.read_bytes())
            else:
                image = nibabel.load(plain(path), **({} if is_minc else {"mmap": False}))
            shape, matrix = tuple(map(int, image.shape)), np.asarray(image.affine, np.float64)
            kind = np.dtype(image.get_data_dtype())
            slope = getattr(image.dataobj, "slope", 1.0), getattr(image.dataobj, "inter", 0.0)
        if is_minc:  # its axes are z, y, x
            shape, matrix = shape[::-1], matrix[:, [2, 1, 0, 3]]
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        is_scaled = is_minc or slope not in ((1.0, 0.0), (None, None))
        if is_scaled:
            kind = np.dtype(np.float32 if kind.itemsize <= 2 else np.float64)
        known = header(
            shape[:3],
            kind,
            name,
            origin=TO_LPS @ matrix[:3, 3],
            direction=TO_LPS @ matrix[:3, :3],
        )._replace(times=shape[3] if len(shape) > 3 else 1, length="mm")
        check(known)
        require_memory(known.size, name)
        if path.name.lower().endswith(PACKED):
            check_unpacked(path.name, path.stat().st_size, known.size)
        with damage(path):
            values = np.asarray(image.dataobj)
            values = (values.T if is_minc else values).reshape(*shape[:3], known.times)
        values = values.astype(kind.newbyteorder("="), copy=False)
        return recording(np.ascontiguousarray(values.T), known._replace(dtype=values.dtype))


def _check_minc(path: Path) -> None:
    """Reject MINC-2 files with the image in another file."""
    with path.open("rb") as raw:
        if raw.read(len(SIGNATURE)) != SIGNATURE:
            return
    with contents(path) as file:
        group = file
        for name in OF_MINC:
            group = group and group_in(path, group, name)
        if not group or dataset_in(path, group, "image") is None:
            raise ValueError("is no MINC file: it has no minc-2.0/image/0/image")
