"""Write pictures, films and folders of them for two eyes, and photographs as MPO and JPS."""

import io
import shutil
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from resample.command.session import Session
from resample.command.settings import Written
from resample.console import progress_bar, say
from resample.files.films import UNMARKED
from resample.files.formats import (
    FORMATS,
    QUALITY,
    SUFFIXES,
    WriteOptions,
    as_srgb,
    check_output,
    flattened,
    levels,
)
from resample.files.pictures import Picture, form_of, read_picture
from resample.files.saving import tell_empty, write_picture
from resample.files.sequences import FILMS, READ
from resample.files.writing import check_targets, replacing
from resample.messages import one_line
from resample_warp3d.command.choices import Batch, Extras, FilmFormat, FilmInput
from resample_warp3d.command.depths import names_folder
from resample_warp3d.command.films import FilmTarget, stereo_film
from resample_warp3d.command.footage import (
    WHOLE,
    DepthModel,
    EstimatedSeries,
    Footage,
    files_in,
    footage_of,
)
from resample_warp3d.command.inputs import (
    DepthReader,
    check_order,
    inputs_of,
    read_views,
    rectified_of,
)
from resample_warp3d.command.parallax import PairDepth, Parallax, StereoWarping
from resample_warp3d.command.rendering import check_memory, mention_holes, prepared
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.command.stereo import StereoRendering, marks_of
from resample_warp3d.command.writing import check_extras, write_extras
from resample_warp3d.depth.files import read_depth

FAILURES = (ValueError, LookupError, OSError, MemoryError)  # of one photo among others
PAIRS = (".mpo", ".jps")
# Stereoscopic descriptor: side by side, full width and height, right picture first; no separation.
CROSSED = struct.pack(">HI", 4, 0x00000201)
DISPARITY = 0x020002  # type of a further picture of an MPO: multi-view, by disparity
SHOWN = 0x20000000  # of the picture that players without two eyes show


def write_pair(path: Path, left: Picture, right: Picture, look: WriteOptions) -> None:
    """Write the pictures of both eyes: MPO holds two JPEGs, JPS one, with the right one first."""
    from PIL import Image

    both = []
    for picture in (left, right):  # as screens show them, opaque
        shown = as_srgb(picture)
        if shown.kind.has_alpha:
            shown = flattened(shown, look.background or (0.0, 0.0, 0.0))
        if len(shown.kind.channels) not in (1, 3) or shown.about.number:
            raise ValueError(f"{path}: neither gray nor RGB; .tif holds other channels and numbers")
        shades = levels(shown.data, "uint8", has_alpha=False, is_light=look.is_light)
        gray = shades[..., 0] if shades.shape[2] == 1 else shades
        both.append(Image.fromarray(np.asarray(gray, np.uint8)))
    quality = {"quality": look.quality or QUALITY[".jpg"], "subsampling": 0}
    with replacing(path) as temporary:
        if path.suffix.lower() == ".mpo":
            first, second = both
            first.save(temporary, "MPO", save_all=True, append_images=[second], **quality)
            temporary.write_bytes(_typed(temporary.read_bytes()))
            return
        whole = Image.fromarray(np.hstack([np.asarray(each) for each in both[::-1]]))
        made = io.BytesIO()
        whole.save(made, "JPEG", **quality)
        body = b"_JPSJPS_" + CROSSED + struct.pack(">H", 0)
        marker = b"\xff\xe3" + struct.pack(">H", 2 + len(body)) + body
        data = made.getvalue()
        after = 4 + int.from_bytes(data[4:6], "big")  # JFIF's segment comes first
        temporary.write_bytes(data[:after] + marker + data[after:])


def _typed(data: bytes) -> bytes:
    """Return an MPO whose pictures are marked as those of two eyes, as Pillow does not."""
    place = data.index(b"MPF\0") + 4
    order = "<" if data[place : place + 2] == b"II" else ">"
    (table,) = struct.unpack_from(f"{order}I", data, place + 4)
    (count,) = struct.unpack_from(f"{order}H", data, place + table)
    made = bytearray(data)
    for n in range(count):
        tag, _, _, value = struct.unpack_from(f"{order}HHII", data, place + table + 2 + 12 * n)
        if tag == 0xB002:  # entries of 16 bytes, which begin with their types
            for each, kind in enumerate((SHOWN | DISPARITY, DISPARITY)):
                struct.pack_into(f"{order}I", made, place + value + 16 * each, kind)
    return bytes(made)


@dataclass(frozen=True, eq=False)
class StereoJob:
    """Options of pictures for two eyes."""

    eye: SourceCamera
    meaning: PairDepth
    parallax: Parallax
    fraction: float
    filming: FilmInput
    film: FilmFormat
    warping: StereoWarping
    written: Written
    extras: Extras
    disparity_scale: float | None
    model: DepthModel | None
    is_quiet: bool = False  # no progress bars, as within that of a batch

    def write(self, picture: str, depth: str | None, output: Path) -> None:
        """Write one picture or film."""
        if depth is None and self.model is None:
            raise ValueError(
                f"{picture}: depth is missing; give its file, or a network that estimates it, "
                "--depth-model FILE.onnx"
            )
        if depth is not None:
            check_order(picture, depth)
        if depth is not None and self.model is not None:
            raise ValueError("--depth-model is in place of a depth file; give one of them")
        if output.suffix.lower() == ".jps" and self.parallax.layout not in (None, "cross-eyed"):
            raise ValueError(f"{output}: .jps holds the layout cross-eyed; leave out --layout")
        times = self.film.times()
        self.film.coding(UNMARKED)
        footage = footage_of(picture, depth, self.filming.fps, times=times, model=self.model)
        if footage is not None and self.model is not None:
            footage = footage.estimated_beside(output)
        if footage is None and output.suffix.lower() in FORMATS and not Path(picture).exists():
            raise FileNotFoundError(2, "No such file", picture)
        around = self.parallax.is_around(self.eye)
        meaning = self.meaning
        if meaning.depth_kind == "auto" and depth is None:
            meaning = meaning.model_copy(update={"depth_kind": "relative"})
        elif meaning.depth_kind == "auto":
            raw = read_depth(str(depth)) if footage is None else footage.depths[0]
            of_pair = self.disparity_scale is not None
            meaning = self.parallax.recognised(
                meaning, raw, str(depth), is_around=around, of_pair=of_pair
            )
        is_pair = meaning.depth_kind == "pair"
        reader = None if is_pair else DepthReader.checked(self.eye.guessed(), meaning)
        chosen = self.parallax if footage is None else self.parallax.for_film(is_pair=is_pair)
        chosen.check(meaning, self.eye)
        output = self.named(output, chosen)
        stereo = StereoRendering(chosen, self.fraction, self.warping, around)
        if footage is None:
            if times != WHOLE:
                raise ValueError("--start and --end are for films, not for pictures")
            self._write_picture((picture, depth), output, stereo, reader)
            return
        self._write_film(footage, output, stereo, reader)
        if isinstance(footage.depths, EstimatedSeries):
            shutil.rmtree(footage.depths.folder, ignore_errors=True)

    def named(self, output: Path, chosen: Parallax) -> Path:
        """Return the target's name, with its layout if requested."""
        if not self.film.name_layout or names_folder(output):
            return output
        is_panorama = self.eye.source_projection == "equirectangular"
        name = marks_of(chosen.layout, is_panorama=is_panorama).name
        if chosen.layout == "quilt":
            name = f"_qs{chosen.quilt}"
        return output.with_stem(output.stem + name)

    def _write_film(
        self, footage: Footage, output: Path, stereo: StereoRendering, reader: DepthReader | None
    ) -> None:
        for name in ("holes", "coverage"):
            if getattr(self.extras, name) is not None:
                raise ValueError(f"--{name} is for pictures, not for films")
        is_panorama = self.eye.source_projection == "equirectangular"
        marks = marks_of(stereo.parallax.layout, is_panorama=is_panorama)
        target = FilmTarget(
            output, footage, self.written.options(), self.film.coding(marks), marks,
            self.film.resume,
        )  # fmt: skip
        job: dict[str, Any] = {"film": footage.fingerprint, "fraction": self.fraction}
        for part in (self.eye, self.meaning, stereo.parallax, self.filming, self.written):
            job |= part.model_dump(mode="json")
        job |= self.warping.model_dump(mode="json", exclude={"threads"})
        job |= {"disparity_scale": self.disparity_scale, "start": footage.frames.first}
        if self.model is not None:
            job["model"] = self.model.fingerprint
        session = Session(is_quiet=self.is_quiet)
        stereo_film(session, target, self.filming, reader, stereo, self.disparity_scale, job)

    def _write_picture(
        self, names: tuple[str, str | None], output: Path, stereo: StereoRendering,
        reader: DepthReader | None,
    ) -> None:  # fmt: skip
        extras, suffix = self.extras, output.suffix.lower()
        look = self.written.options(suffix)
        check_extras(extras)
        if suffix not in PAIRS:
            check_output(output, look)
        check_targets(output, extras.holes, extras.coverage)
        session = Session(is_quiet=self.is_quiet)
        color, depth = names
        if depth is None:
            assert self.model is not None
            assert reader is not None
            picture = read_picture(color)
            (raw,) = self.model.estimate([picture])
            taken = inputs_of(reader, picture, raw, (color, str(self.model.path)))
        elif reader is None:
            raw = read_depth(depth)
            taken = rectified_of(read_picture(color), raw, (color, depth), self.disparity_scale)
        else:
            taken = read_views(reader, color, depth)
        eyes = stereo.eyes([taken], is_pair=reader is None)
        check_memory(taken.views, stereo.shape(taken), output)
        if suffix in PAIRS:
            chosen = stereo.parallax.model_copy(update={"layout": "side-by-side"})
            stereo = replace(stereo, parallax=chosen)
        taken = stereo.staged(taken, eyes)
        sources = prepared(session, taken.views, self.warping)
        whole, both, warped = stereo.render(session, taken, eyes, sources)
        if warped is not None and not self.warping.fill:
            mention_holes(warped)
        if suffix in PAIRS:
            write_pair(output, both[0], both[1], look)
        else:
            write_picture(output, whole, look)
        if warped is not None:
            tell_empty(output, not warped.coverage.any())
            write_extras(extras, warped, None)


def write_stereo(
    job: StereoJob, picture: str, depth: str | None, output: Path, batch: Batch
) -> None:
    """Write a picture or film for two eyes, or each of several."""
    files = None if Path(picture).is_file() else files_in(picture, _is_source)
    if batch.recursive and Path(picture).is_dir():
        found = Path(picture).rglob("*")
        files = sorted(file for file in found if file.is_file() and _is_source(file))
    if files is None or not (batch.batch or batch.recursive or batch.skip_errors):
        # Files are no film if there are films among them, or pictures of several sizes.
        try:
            differ = files is not None and (
                any(file.suffix.lower() in FILMS for file in files)
                or len({form_of(file)[0][:2] for file in files}) > 1
            )
        except FAILURES as error:
            raise ValueError(f"{one_line(error)}; --batch --skip-errors leaves it out") from None
        if not differ:
            job.write(picture, depth, output)
            return
        say(f"{picture}: pictures have several sizes and are made one by one (--batch)")
    if job.extras.holes is not None or job.extras.coverage is not None:
        raise ValueError("--holes and --coverage are for one picture, not for several")
    if not files:
        raise ValueError(f"{picture} has no pictures and films; give a folder or a pattern")
    if not names_folder(output) and "*" not in output.name:
        raise ValueError(f"{output}: several pictures are written to a folder, or to a name with *")
    if depth is not None and not Path(depth).is_dir():
        raise ValueError(f"{depth}: several pictures need a folder with depth files of their names")
    kept, failed = 0, list[str]()
    job = replace(job, is_quiet=True)
    with progress_bar("photos", count=len(files)) as progress:
        for n, (file, below, target) in enumerate(_targets(files, picture, output)):
            try:
                looks = (job.parallax, job.parallax.for_film(is_pair=False))
                if job.film.resume and any(job.named(target, look).is_file() for look in looks):
                    kept += 1
                    continue
                target.parent.mkdir(parents=True, exist_ok=True)
                own = depth  # that of its name in the folder of depths
                if depth is not None:
                    alike = sorted((Path(depth) / below.parent).glob(f"{below.stem}.*"))
                    alike = [each for each in alike if each.is_file()]
                    if not alike:
                        raise ValueError(f"{depth} has no depth named {below.with_suffix('.*')}")
                    own = str(alike[0])
                job.write(str(file), own, target)
            except FAILURES as error:
                if not batch.skip_errors:
                    raise
                failed.append(f"{file}: {one_line(error)}")
                say(failed[-1])
            if progress is not None:
                progress((n + 1) / len(files))
    written = len(files) - kept - len(failed)
    say(f"{written} written, {kept} were there, {len(failed)} failed")
    if failed and not written:
        raise ValueError(f"all of {len(failed)} pictures failed; the first: {failed[0]}")


def _is_source(file: Path) -> bool:
    return file.suffix.lower() in READ and not file.name.startswith(".")


def _targets(files: Sequence[Path], given: str, output: Path) -> Iterator[tuple[Path, Path, Path]]:
    """Sources, their paths below the given folder, and their targets."""
    taken: dict[Path, Path] = {}
    is_folder = names_folder(output)
    for file in files:
        below = file.relative_to(given) if Path(given).is_dir() else Path(file.name)
        suffix = below.suffix.lower()
        is_film = suffix in FILMS
        kept = suffix if suffix in (FORMATS if is_film else SUFFIXES) else None
        name = below.with_suffix(kept or (".mp4" if is_film else ".png"))
        target = output / name
        if not is_folder:
            target = output.parent / below.parent / output.name.replace("*", below.stem)
        if target.resolve() == file.resolve():
            raise ValueError(f"{file} would be replaced; give another folder")
        if target in taken:
            raise ValueError(f"{taken[target]} and {file} would both become {target}")
        taken[target] = file
        if is_folder and output.resolve() in file.resolve().parents:
            continue  # results of an earlier run
        yield file, below, target
