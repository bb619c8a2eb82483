"""Open volumes and labels of voxels from files, samples and addresses, and write volumes."""

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from resample import registry
from resample.files.stores import STORE, Address, is_address, is_store
from resample.files.writing import replacing, save_array
from resample.messages import reader_of
from resample_volume.classification.labels import Labels, check_known, parse_rules
from resample_volume.classification.scales import LINEAR, value_at
from resample_volume.classification.value_statistics import findings, label_count, survey
from resample_volume.data.recordings import assumed, unit_of_space, volume_at
from resample_volume.data.scanning import otsu
from resample_volume.data.values import as_array, bricks_of, is_streamed, values_of
from resample_volume.files.generated import GENERATED
from resample_volume.files.headers import KEPT
from resample_volume.files.readers import Reader, Recorder, Streamer
from resample_volume.types import Recording, Volume

LISTED = ", ".join(GENERATED)
SUFFIXES = (".nrrd", ".mha", ".nii", ".nii.gz", ".npy")
OF_LABELS = 4  # ratio of the memory limits of a volume and its labels
OWN = {  # suffixes of readers that are imported only for such files
    "bioio": (".czi", ".lif", ".nd2", ".lsm", ".oib", ".oif", ".dv"),
    "cube": (".cube", ".cub"),
    "dicom": (".dcm",),
    "fits": (".fits", ".fit", ".fts", ".fits.gz", ".fits.fz"),
    "hdf5": (".h5", ".hdf5", ".hdf"),
    "imaris": (".ims",),
    "metaimage": (".mha", ".mhd"),
    "mrc": (".mrc", ".map", ".ccp4", ".mrcs", ".mrc.gz", ".map.gz", ".ccp4.gz", ".mrcs.gz"),
    "netcdf": (".nc", ".nc4", ".cdf"),
    "neuro": (".mgh", ".mgz", ".mnc", ".hdr", ".img"),
    "nifti": (".nii", ".nii.gz"),
    "nrrd": (".nrrd", ".nhdr"),
    "tiff-stack": (".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp"),
    "vdb": (".vdb",),
    "vti": (".vti",),
    "vtk": (".vtk",),
    "vtm": (".vtm", ".vthb"),
    "vtr": (".vtr",),
    "vts": (".vts",),
    "vtu": (".vtu",),
    "zarr": (".ome.zarr", ".zarr", ".ome.zarr.zip", ".zarr.zip", ".ozx", ".zip"),
}
HINTS = {  # what to do with files of other kinds
    (".mat",): "save its array as .npy: scipy.io.loadmat and h5py read it",
    (".xdmf", ".xmf", ".pvd", ".exo", ".case", ".foam"): "save it as .vti or .vtu in ParaView",
    (".vsi", ".svs", ".scn", ".ndpi"): "save it as OME-TIFF: bioformats2raw and QuPath do",
    (".par", ".rec", ".img.gz", ".hdr.gz"): "save it as .nii.gz: nibabel reads it",
}


def open_volume(
    name: str | Path,
    reader: Reader | None = None,
    *,
    time: int | None = None,
    channel: int | None = None,
) -> Volume:
    """Open a volume by name.

    Parameters
    ----------
    name
        A file, a folder of slices, the address of a store of zarr (`https://...`, `s3://...`), or a
        generated volume with its parameters: `vessel-tree`, `checker-box:size=64,block=8`,
        `sample:vessel-tree`.
    reader
        Reader of the file or folder; None: found among all installed.
    time, channel
        Index among several, from 0; negative from the end.

    Returns
    -------
    The volume; its values may be a read-only view of the file.

    Raises
    ------
    OSError
        There is no such file, it is not readable, or a server does not answer.
    ValueError
        No reader knows it, or it holds no volume, or several and none was chosen.

    Examples
    --------
    >>> from resample_volume import open_volume
    >>> open_volume("checker-box:size=16,block=4").values.shape
    (16, 16, 16)
    """
    if time is not None or channel is not None:
        return volume_at(open_recording(name, reader), time, channel)
    place, found = _located(name, reader)
    if found is not None:
        volume: Volume = found(place)
        return volume._replace(space=getattr(found, "space", volume.space))
    if str(place).partition(":")[0] in GENERATED:
        return generate(str(place))
    known = "" if _suffix(place.name, _readers()[0]) else f"; generated volumes are {LISTED}"
    raise FileNotFoundError(f"{place}: there is no such file{known}")


def open_recording(name: str | Path, reader: Reader | None = None) -> Recording:
    """Open all times and channels by name."""
    place, found = _located(name, reader)
    if isinstance(found, Recorder):
        recording = found.recorded(place)
        return recording._replace(space=getattr(found, "space", recording.space))
    volume = open_volume(name, reader)
    values, colors = volume.values[np.newaxis], volume.colors
    if colors is not None:
        values = np.moveaxis(colors, -1, 0)
    facts = (colors is not None, volume.note, volume.space)
    return Recording(values[np.newaxis], *volume[1:6], *facts, length=volume.length)


def open_streamed(name: str | Path, reader: Reader | None = None) -> Recording | None:
    """Open a recording and leave its values in the file; None if the format cannot."""
    place, found = _located(name, reader)
    return found.streamed(place) if isinstance(found, Streamer) else None


def levels_of(name: str | Path, reader: Reader | None = None) -> list[dict[str, Any]]:
    """Return the levels of a multiscale file, see `Streamer.levels`; empty for a single one."""
    place, found = _located(name, reader)
    return found.levels(place) if isinstance(found, Streamer) else []


def _located(name: str | Path, reader: Reader | None) -> tuple[Any, Any]:
    """Return a path or address, and its reader; None if there is no such file."""
    if is_address(name):
        return Address(str(name)), _distant(reader)
    text = str(name)
    if text.startswith("sample:"):
        from resample.samples.finding import PREFIX, sample_path

        spec = text.removeprefix(PREFIX)
        name = spec if spec.partition(":")[0] in GENERATED else sample_path(text)
    path = Path(name)
    if reader is None and path.exists():
        reader = find_reader(path)
        if path.is_file() and path.stat().st_size == 0:
            raise ValueError(f"{path} is empty")
    return path, reader


def _distant(reader: Reader | None) -> Reader:
    """Return the reader of an address."""
    if reader is None:
        try:
            found: Reader = registry.build("readers", "zarr")
        except LookupError as error:
            raise ValueError(f"only zarr stores are read from addresses; {error}") from None
        return found
    if STORE not in reader.suffixes:
        raise ValueError("only zarr stores are read from addresses; download other files")
    return reader


def find_reader(path: str | Path) -> Reader:
    """Find the reader for a file's longest known suffix, or for a folder or an address."""
    if is_address(path):
        return _distant(None)
    path = Path(path)
    readers, broken = _readers()
    if path.is_dir():
        suffix = STORE if is_store(path) else _folder_suffix(path, readers)
        suffix = suffix if suffix in readers else ""
    else:
        suffix = _suffix(path.name, readers)
    if not suffix:
        name = STORE if path.is_dir() and is_store(path) else path.name.lower()
        elsewhere = {ends: registry.missing("readers", reader) for reader, ends in OWN.items()}
        hints = {ends: told for ends, told in elsewhere.items() if told} | HINTS
        hint = next((hint for ends, hint in hints.items() if name.endswith(ends)), "")
        why = f"{path} is read by none of the readers; {hint}"
        if path.is_dir() and not hint:
            why = f"{path} holds no slices; give a folder of .dcm, .tif, .png or .jpg files, or a "
            why += "file"
        elif not hint and (found := reader_of(path)):
            why = f"{path} holds no volume: {found}"
        elif not hint:
            known = " ".join(sorted(readers))
            why = f"{path} has no known suffix; known are {known}; rename it or choose a reader "
            why += "(--reader NAME)"
        raise ValueError("; ".join([why, *broken]))
    if len(readers[suffix]) > 1:
        raise ValueError(
            f"{path}: choose a reader; {' and '.join(readers[suffix])} read {suffix} "
            f"(--reader {readers[suffix][0]})"
        )
    built: Reader = registry.build("readers", readers[suffix][0])
    return built


def generate(spec: str) -> Volume:
    """Generate a volume by name and parameters, `checker-box:size=64`."""
    name, _, text = spec.partition(":")
    if name not in GENERATED:
        raise ValueError(f"unknown volume {name!r}; generated are {LISTED}")
    known = registry.parameters(GENERATED[name])
    chosen: dict[str, Any] = {}
    for part in text.split(",") if text else ():
        key, _, value = (piece.strip() for piece in part.partition("="))
        try:
            chosen[key] = type(known[key])(value)
        except (KeyError, ValueError):
            takes = registry.described(GENERATED[name])
            raise ValueError(f"{spec}: {part!r} is no parameter; {name} takes {takes}") from None
    return GENERATED[name](**chosen)


def describe(volume: Volume, bins: int = 32) -> dict[str, Any]:
    """Describe a volume, in plain Python values.

    Result: `name`, `shape` (x, y, z), `dtype`, `spacing`, `origin`, `direction` (3 rows),
    `length_unit` (mm, µm, Å; empty: unknown), `range` (lowest and highest finite value, or None),
    `scale` (on which bins are even), `nan` and `infinite` (counts), `units` (words), `robust_range`
    (without padding and strays, or None), `padding` (its values), `padded` and `stray` (counts),
    `thresholds` (between `2` and between `3` classes), `findings` (lines), and `histogram` (counts
    over the robust range).
    """
    if bins < 1:
        raise ValueError(f"a histogram has at least 1 bin, not {bins}")
    known, nan = survey(volume), 0
    if volume.values.dtype.kind == "f":
        nan = sum(int(np.isnan(part).sum()) for part in values_of(volume.values).parts())
    any_known, at = bool(known.levels.value.size), partial(value_at, scale=volume.scale)
    labels = label_count(volume)
    seeming = f"{labels} whole numbers in regions: are they labels? (--labels)" if labels else ""
    turned = "" if volume.space else "no orientation is stated: z points up (or --up -z, y, -y ...)"
    counts = np.zeros(bins, np.int64)
    for part in values_of(volume.values).parts() if any_known else ():
        counts += np.histogram(part[np.isfinite(part)], bins, known.span)[0]
    is_whole = volume.values.dtype.kind in "iu"
    spans = [at(np.array(span)).tolist() for span in (known.whole, known.span)]
    ends = [(int(a), int(b)) if is_whole else (a, b) for a, b in spans]
    return {
        "name": volume.name,
        "shape": volume.values.shape[::-1],
        "dtype": volume.values.dtype.name,
        "spacing": volume.spacing.tolist(),
        "origin": volume.origin.tolist(),
        "direction": volume.direction.tolist(),
        "length_unit": unit_of_space(volume),
        "range": ends[0] if any_known else None,
        "nan": nan,
        "infinite": known.infinite,
        "scale": volume.scale or LINEAR,
        "units": known.units.name + (" (assumed)" if known.units.is_assumed else ""),
        "robust_range": ends[1] if any_known else None,
        "padding": list(known.padding),
        "padded": known.padded,
        "stray": known.stray,
        "thresholds": {str(n): at(np.array(otsu(known.levels, n))).tolist() for n in (2, 3)},
        "findings": [line for line in (volume.note, assumed(volume), turned, seeming) if line]
        + findings(known),
        "histogram": counts.tolist(),
    }


def _readers() -> tuple[dict[str, list[str]], list[str]]:
    """Return readers' names by suffix, and hints about those that cannot be imported."""
    found: dict[str, list[str]] = {}
    broken = []
    for name in registry.names("readers"):
        try:
            suffixes = OWN.get(name) or registry.load("readers", name).suffixes
        except LookupError as error:  # only matters if that one is needed
            broken.append(str(error))
            continue
        for suffix in suffixes:
            found.setdefault(suffix, []).append(name)
    return found, broken


def _suffix(name: str, known: Iterable[str]) -> str:
    """Return the longest known suffix of a file name, or nothing."""
    fitting = (suffix for suffix in known if name.lower().endswith(suffix))
    return max(fitting, key=len, default="")


def _folder_suffix(folder: Path, readers: dict[str, list[str]]) -> str:
    """Return the suffix of a folder's files; DICOM is recognised without one."""
    files = [file for file in folder.iterdir() if file.is_file() and file.name[0] != "."]
    from resample_volume.files.dicom import is_dicom

    found = {".dcm" if is_dicom(file) else _suffix(file.name, readers) for file in files} - {""}
    if len({tuple(readers[suffix]) for suffix in found}) > 1:
        raise ValueError(
            f"{folder} holds files of {' and '.join(sorted(found))}; give one of them, or a "
            "folder with files of one kind"
        )
    return min(found, default="")


def read_labels(path: str, rules: Sequence[str], volume: Volume) -> Labels:
    """Read the labels of a volume's voxels from a file.

    `rules`: each such as `1:color=tomato,opacity=0.5` or `2:hidden`, one for a label.
    """
    chosen = parse_rules(rules)
    try:
        held = open_streamed(path) if is_streamed(volume) else None
        if held is None:
            found = open_volume(path)
        else:
            found, allowed = volume_at(held, None, None), bricks_of(volume).memory
            bricks_of(found).memory = None if allowed is None else allowed // OF_LABELS
            found = as_array(found)
        if found.colors is not None:
            raise ValueError("labels are whole numbers, one for each voxel, not colors")
        labels = Labels(found.values, chosen)
        labels.check(volume)
        check_known(labels)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return labels


def write_volume(path: Path, volume: Volume) -> None:
    """Write a volume with its spacing, origin and direction (.npy: values only)."""
    suffix = check_suffix(path)
    with replacing(path) as temporary:
        if suffix == ".npy":
            save_array(temporary, volume.values)
            return
        if volume.values.ndim != 3 or volume.values.dtype.name not in KEPT:
            raise OSError(f"{path}: {volume.values.dtype} {volume.values.shape} is no volume")
        if suffix == ".nrrd":
            from resample_volume.files.nrrd import write_nrrd

            write_nrrd(temporary, volume)
        elif suffix == ".mha":
            from resample_volume.files.metaimage import write_metaimage

            write_metaimage(temporary, volume)
        else:
            from resample_volume.files.nifti import write_nifti

            write_nifti(temporary, volume, is_packed=suffix == ".nii.gz")


def check_suffix(path: Path) -> str:
    """Return a file's suffix; reject one that `write_volume` cannot write, before any work."""
    suffix = next((known for known in SUFFIXES if path.name.lower().endswith(known)), "")
    if not suffix:
        raise ValueError(f"{path}: volumes are written as {', '.join(SUFFIXES)}")
    return suffix
