"""Warp picture files one by one; all pictures of a file are warped alike."""

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.command.session import Session
from resample.command.settings import Written
from resample.console import Progress, progress_bar, say
from resample.files.formats import (
    WriteOptions,
    check_output,
    check_source,
    coverage_picture,
    holds_gaps,
    takes_alpha,
)
from resample.files.metadata.fields import TIFF, FileMetadata, WrittenPage, complete, upright
from resample.files.metadata.tags import PNG_START, Tag, read_tags, stated
from resample.files.pictures import Kind, Picture, form_of, header_of, picture_at, with_gaps
from resample.files.saving import tell_empty, tell_unchanged, write_picture, writing_rows
from resample.files.sequences import batch_of, check_frames, frames_of, is_batch, write_frames
from resample.files.stores import Address, Place
from resample.files.writing import check_targets, replacing, write_json
from resample.messages import one_line
from resample.reading.limits import check_unpacked
from resample.reading.pictures import decoding
from resample.types import Floats
from resample_texture.arguments import method_named
from resample_texture.command.choices import Aim, Outputs, PictureTarget, PictureWarping, region
from resample_texture.command.rendering import Large, check_memory, large_picture, warped
from resample_texture.geometry.mappings import Homography

NOTHING = np.zeros((0, 0, 0), np.float32)
REDUCED = 2.5  # px of a JPEG decoded at a reduced scale, per px of the target, at least
WRITTEN = (".png", *TIFF)  # formats with palettes

PNG_OF_PALETTE, TIFF_OF_PALETTE = 3, 3  # the formats' numbers for it
PHOTOMETRIC = 262  # a tag of TIFF
MOST = 256  # colors of a palette


Palette = tuple[NDArray[np.uint8], NDArray[np.uint8]]  # sRGB colors (N, 3) and opacities (N,)


def has_palette(path: Path) -> bool:
    """Whether a file is a picture with a palette; of GIF, one that may be an animation."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(26)
    if head[:8] == PNG_START:
        return head[25:26] == bytes([PNG_OF_PALETTE])
    if path.suffix.lower() in TIFF:
        tag = next((page.get(PHOTOMETRIC) for page in read_tags(path, (PHOTOMETRIC,), {})), None)
        return isinstance(tag, Tag) and int(tag.values[0]) == TIFF_OF_PALETTE
    return head[:4] == b"GIF8"


def _numbers(path: Path) -> tuple[NDArray[np.uint8], Palette] | None:
    """Read numbers (H, W) as stored, and their palette; None if Pillow finds none."""
    from PIL import Image

    with decoding(path), Image.open(path) as image:
        check_unpacked(str(path), path.stat().st_size, 2 * image.width * image.height)
        if image.mode != "P":
            return None
        index = np.array(image)
        colors = np.array(image.getpalette("RGB"), np.uint8).reshape(-1, 3)
        told: Any = image.info.get("transparency", b"")
    count = max(len(colors), int(index.max(initial=0)) + 1)
    colors = np.concatenate([colors, np.zeros((count - len(colors), 3), np.uint8)])
    opacity = np.full(count, 255, np.uint8)
    if isinstance(told, int):
        opacity[told : told + 1] = 0
    else:
        given = np.frombuffer(told[:count], np.uint8)
        opacity[: len(given)] = given
    return index, (colors, opacity)


@dataclass(frozen=True)
class Job:
    """Target, method and output format of a warp, for every picture."""

    aim: Aim
    warping: PictureWarping
    options: WriteOptions
    roi: tuple[int, int, int, int] | None = None
    told: set[str] = field(default_factory=set)  # names of messages already given

    def opened(self, source: Place | Picture) -> tuple[Picture, PictureTarget, tuple[int, ...]]:
        """Read a picture, a JPEG only as large as needed; return it, its target and its size."""
        if isinstance(source, Picture):
            size = source.data.shape
            return source, self.aim((size[0], size[1])), size
        reader = picture_at(source, encoding=self.warping.encoding)
        height, width = reader.shape[:2]
        target = self.aim((height, width))
        is_usual = self.warping.method == "hybrid" and not self.warping.total
        if is_usual and target.draws is None and isinstance(target.geometry, Homography):
            matrix = target.geometry.oriented((height, width))
            share = float(np.linalg.norm(matrix[:2, :2], 2) / matrix[2, 2] * REDUCED)
            is_small = not matrix[2, :2].any() and 2 * share <= 1
            is_small = is_small and reader.header.about.geo is None
            least = math.ceil(height * share), math.ceil(width * share)
            reduced = reader.reduced(*least) if is_small else None
            if reduced is not None:
                picture, larger = reduced
                target = PictureTarget(Homography(matrix @ larger), target.shape)
                return picture, target, reader.shape
        return reader.picture(), target, reader.shape

    def check_memory(self, source: Place | Picture, output: Path) -> None:
        """Reject a warp that does not fit into memory, before a file's pixels are read."""
        if isinstance(source, Picture):
            (height, width, count), kind = source.data.shape, source.kind
        else:
            (height, width, count), kind = form_of(source)
        shape = self.aim((height, width)).shape if self.roi is None else (self.roi[3], self.roi[2])
        form = height, width, count
        check_memory(form, shape, self.warping, output, has_alpha=kind.has_alpha)

    def warped(
        self,
        session: Session,
        picture: Picture,
        target: PictureTarget,
        output: Path,
        bar: str | None = "warping",
    ) -> tuple[Picture, Floats]:
        """Warp a picture for a file that can store it; also return the coverage of its pixels."""
        gaps = holds_gaps(output, picture, self.options)
        adds_alpha = takes_alpha(output, self.options)
        given = session, picture, target, self.warping, self.roi
        return warped(*given, keeps_gaps=gaps, adds_alpha=adds_alpha, bar=bar)

    def report(
        self, session: Session, source: tuple[int, ...], result: tuple[int, ...], kind: Kind
    ) -> dict[str, Any]:
        """Return sizes and times for `--stats`; shapes are (height, width, ...)."""
        return {
            "source": [source[1], source[0]],
            "size": [result[1], result[0]],
            "channels": list(kind.channels),
            "encoding": "sRGB" if kind.is_encoded else "linear",
            "method": self.warping.method,
            "seconds": session.times(),
        }


def warp_all(
    files: list[Place],
    output: Path | None,
    aim: Aim,
    *,
    warping: PictureWarping,
    written: Written,
    outputs: Outputs,
) -> None:
    """Warp a picture, a film or a batch; the last of the files is the output unless given."""
    images = files
    if output is None:
        if len(files) < 2:
            raise ValueError(f"give the output after {files[0]}, or by --output")
        *images, target = files
        if isinstance(target, Address):
            raise ValueError(f"{target} lies elsewhere; pictures are written to files and folders")
        output = target
    warping.check()
    # Pictures of the same size share a target, whose files are read once.
    look = written.options(output.suffix)
    job = Job(lru_cache(maxsize=1)(aim), warping, look, region(outputs.roi))
    coverage, stats = outputs.coverage, outputs.stats
    if coverage is not None:
        check_output(coverage, WriteOptions(is_light=False))
    if is_batch(images, output):
        if coverage is not None:
            raise ValueError("--coverage works with one picture only; leave it out")
        check_targets(stats)
        told = warp_batch(images, output, job)
    else:
        check_targets(output, coverage, stats)
        told = warp_file(Session(), images[0], output, job, coverage)
    if stats is not None:
        write_json(stats, told)


def warp_batch(images: Sequence[Place], output: Path, job: Job) -> dict[str, Any]:
    """Warp files into a folder; return the statistics. Report failures and go on."""
    pairs = batch_of(images, output)
    folder = pairs[0][1].parent
    folder.mkdir(exist_ok=True)
    told, session = [], Session()
    with progress_bar(f"warping {len(pairs)} files") as progress:
        for n, (source, target) in enumerate(pairs):
            try:
                done = warp_file(session, source, target, job, shows=False)
                told.append({"file": str(target), **done})
            except (KeyError, IndexError):  # bugs, see `resample.command.session.run`
                raise
            except (ValueError, LookupError, OSError, MemoryError) as error:
                say(f"{source.name} failed: {one_line(error)}")
            if progress is not None:
                progress((n + 1) / len(pairs))
    if len(told) < len(pairs):
        with suppress(OSError):  # the folder holds files
            folder.rmdir()
        raise ValueError(f"{len(pairs) - len(told)} of {len(pairs)} files could not be warped")
    return {"files": told, "seconds": session.times()}


def warp_file(
    session: Session,
    source: Place,
    output: Path,
    job: Job,
    coverage: Path | None = None,
    *,
    shows: bool = True,
) -> dict[str, Any]:
    """Warp the pictures of a file, with or without a progress bar; return the `--stats`."""
    frames = frames_of(source, job.warping.encoding)
    if frames is None:
        return _warp_picture(session, source, output, job, coverage, "warping" if shows else None)
    if coverage is not None:
        raise ValueError(f"{source} has several pictures; --coverage works with one picture only")
    check_frames(output, frames, job.options)
    check_targets(output)

    def pictures(progress: Progress | None) -> Iterator[Picture]:
        for n, picture in enumerate(frames.read()):
            if n == 0:
                job.check_memory(picture, output)
            result, _ = job.warped(session, *job.opened(picture)[:2], output, None)
            if n == 0:
                nans = bool(np.isnan(result.data).any())
                _say_lost(picture.about, result.about, output, has_nans=nans)
            if progress is not None:
                progress(min(1.0, (n + 1) / len(frames.seconds)))
            yield result

    with progress_bar("warping") if shows else nullcontext() as progress:
        write_frames(output, pictures(progress), frames, job.options)
    return {"frames": len(frames.seconds), "seconds": session.times()}


def _warp_picture(
    session: Session, source: Place, output: Path, job: Job, coverage: Path | None, bar: str | None
) -> dict[str, Any]:
    check_output(output, job.options)
    check_targets(output, coverage)
    with session.stage("read"):
        held = palette_picture(source, output, job.warping, job.options)
    if held is None:
        is_mixed = job.warping.method not in ("nearest", "majority")
        if is_mixed and not job.told and isinstance(source, Path) and has_palette(source):
            job.told.add("palette")
            say(
                f"{source.name} has a palette, which becomes colors; --method majority or nearest "
                "keeps it"
            )
        with session.stage("read"):
            written = output, job.options
            large = large_picture(source, job.aim, job.warping, job.roi, written)
        if large is not None:
            return _warp_large(session, large, output, job, coverage, bar)
    with session.stage("read"):
        given = source if held is None else held[0]
        job.check_memory(given, output)
        picture, target, size = job.opened(given)
    if held is None:
        check_source(output, picture, job.options)
        check_output(output, job.options)
    result, share = job.warped(session, picture, target, output, bar)
    has_nans = held is None and bool(np.isnan(result.data).any())
    _say_lost(picture.about, result.about, output, has_nans=has_nans)
    with session.stage("write"):
        if held is None:
            write_picture(output, result, job.options)
        else:
            write_palette_picture(output, result, held[1])
        if coverage is not None:
            write_picture(coverage, coverage_picture(share), WriteOptions(is_light=False))
    tell_empty(output, not share.any())
    tell_unchanged(output, result, picture, "nothing is moved, turned or scaled")
    told = job.report(session, size, result.data.shape, result.kind)
    return {**told, "channels": ["index"], "encoding": "palette"} if held else told


def _warp_large(
    session: Session, large: Large, output: Path, job: Job, coverage: Path | None, bar: str | None
) -> dict[str, Any]:
    """Warp a picture strip by strip; the output is the same but for rounding."""
    loaded = large.loaded
    check_source(output, Picture(NOTHING, loaded.kind, loaded.about), job.options)
    check_output(output, job.options)
    height, width = large.shape
    check_memory(large.form.shape, large.shape, job.warping, output, in_strips=large.in_strips)
    has_nans, is_empty = False, True
    with ExitStack() as files:
        put = files.enter_context(writing_rows(output, height, job.options))
        put_share = None
        if coverage is not None:
            look = WriteOptions(is_light=False)
            put_share = files.enter_context(writing_rows(coverage, height, look))
        progress = files.enter_context(session.stage("warp and write", bar=bar))
        for done, (strip, share) in large.strips():
            has_nans = has_nans or bool(np.isnan(strip.data).any())
            put(strip)
            is_empty = is_empty and not share.any()
            if put_share is not None:
                put_share(coverage_picture(share))
            if progress is not None:
                progress((done + strip.data.shape[0]) / height)
    _say_lost(loaded.about, large.about, output, has_nans=has_nans)
    tell_empty(output, is_empty)
    return job.report(session, large.form.shape, (height, width), large.kind)


def _say_lost(about: FileMetadata, made: FileMetadata, output: Path, *, has_nans: bool) -> None:
    """Report metadata of a picture that its warp loses."""
    before, after = about.geo, made.geo
    if before is not None and before.has_place and not (after is not None and after.has_place):
        say("georeference dropped: the warp is not affine")
    has_word = output.suffix.lower() == ".exr" or (after is not None and after.missing is not None)
    if made.number and not has_word and has_nans:
        say(f"{output.name} cannot mark missing values: pixels that are not covered are 0")


def palette_picture(
    source: Place, output: Path, choice: PictureWarping, look: WriteOptions
) -> tuple[Picture, Palette] | None:
    """Return a picture's numbers and palette; None without one, or if it must become colors."""
    if not isinstance(source, Path) or not has_palette(source):
        return None
    method = method_named(choice.method, **choice.sampling)
    is_copied = hasattr(method, "picks") and not choice.total
    is_kept = look.bits in (None, 8) and look.background is None
    is_kept = is_kept and look.quality is None and not look.in_srgb
    found = None
    if is_copied and is_kept and output.suffix.lower() in WRITTEN:
        found = _numbers(source)
    if found is None:
        return None
    index, palette = found
    header = header_of(source, as_data=True)
    about, kind = header.upright_about._replace(number="uint8"), Kind(("Y",), 32, is_encoded=False)
    number = upright(index, header.orientation)[..., np.newaxis]
    data = with_gaps(number.astype(np.float32), kind, about)
    return Picture(data, kind, about), palette


def write_palette_picture(path: Path, picture: Picture, palette: Palette) -> None:
    """Write numbers with their palette; missing ones become transparent, if an entry is free."""
    from PIL import Image, PngImagePlugin

    (data, _, about), is_png = picture, path.suffix.lower() == ".png"
    colors, opacity = palette
    gaps = np.isnan(data[..., 0])
    missing = None if about.geo is None else about.geo.missing
    # Missing numbers become the first transparent color, or one that is added.
    transparent = np.flatnonzero(opacity == 0).tolist()
    clear = next(iter(transparent), None) if missing is None else int(missing)
    if clear is None and gaps.any() and is_png and len(colors) < MOST:
        clear, opacity = len(colors), np.append(opacity, np.uint8(0))
        colors = np.concatenate([colors, np.zeros((1, 3), np.uint8)])
    if clear is None and gaps.any():
        say(f"{path.name} has no free palette entry; uncovered pixels get color 0")
    index = np.where(gaps, clear or 0, np.nan_to_num(data[..., 0])).astype(np.uint8)
    image = Image.frombytes("P", index.shape[::-1], np.ascontiguousarray(index).tobytes())
    image.putpalette(colors.tobytes())
    choices: dict[str, Any] = {"compression": "tiff_adobe_deflate"}
    if path.suffix.lower() not in TIFF:
        words = PngImagePlugin.PngInfo()
        for key, text in stated().items():
            words.add_text(key, text)
        is_opaque = bool((opacity == 255).all())
        choices = {"pnginfo": words} | ({} if is_opaque else {"transparency": opacity.tobytes()})
    with replacing(path) as temporary:
        image.save(temporary, **choices)
        complete(temporary, [WrittenPage(about, (*index.shape, 1), "uint8")])
