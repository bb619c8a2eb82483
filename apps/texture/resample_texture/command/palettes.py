"""Pictures with a palette, which stay so where their pixels are copied."""

from pathlib import Path

import numpy as np

from resample.console import say
from resample.files.facts.metadata import TIFF, WrittenPage, complete, upright
from resample.files.facts.origin import stated
from resample.files.facts.palettes import MOST, Palette, has_palette, read_indices, write_indices
from resample.files.formats import WriteOptions
from resample.files.pictures import Kind, Picture, header_of, with_gaps
from resample.files.stores.opening import Place
from resample.files.writing import replacing
from resample_texture.arguments import method_named
from resample_texture.command.choices import PictureWarping
from resample_texture.methods.labels import Majority, NearestTexel

WRITTEN = (".png", *TIFF)  # formats with palettes


def palette_picture(
    source: Place, output: Path, choice: PictureWarping, look: WriteOptions
) -> tuple[Picture, Palette] | None:
    """Return a picture's numbers and their palette; None if it has none or must become colors."""
    if not isinstance(source, Path) or not has_palette(source):
        return None
    method = method_named(
        choice.method,
        filter=choice.filter,
        interpolation=choice.interpolation,
        quality=choice.quality,
    )
    is_copied = isinstance(method, Majority | NearestTexel) and not choice.total
    is_kept = look.bits in (None, 8) and look.background is None
    is_kept = is_kept and look.quality is None and not look.in_srgb
    found = None
    if is_copied and is_kept and output.suffix.lower() in WRITTEN:
        found = read_indices(source)
    if found is None:
        return None
    index, palette = found
    header = header_of(source, as_data=True)
    about, kind = header.upright_about._replace(number="uint8"), Kind(("Y",), 32, is_encoded=False)
    number = upright(index, header.orientation)[..., np.newaxis]
    data = with_gaps(number.astype(np.float32), kind, about)
    return Picture(data, kind, about), palette


def write_palette_picture(path: Path, picture: Picture, palette: Palette) -> None:
    """Write numbers with their palette; what is missing becomes transparent, if there is room."""
    (data, _, about), is_png = picture, path.suffix.lower() == ".png"
    gaps = np.isnan(data[..., 0])
    missing = None if about.geo is None else about.geo.missing
    clear = palette.clear if missing is None else int(missing)
    if clear is None and gaps.any() and is_png and len(palette.colors) < MOST:
        clear, palette = len(palette.colors), palette.with_clear()
    if clear is None and gaps.any():
        say(f"{path.name} has no color to spare for what is not covered: that is of color 0")
    index = np.where(gaps, clear or 0, np.nan_to_num(data[..., 0])).astype(np.uint8)
    with replacing(path) as temporary:
        write_indices(temporary, index, palette, **stated())
        complete(temporary, [WrittenPage(about, (*index.shape, 1), "uint8")])
