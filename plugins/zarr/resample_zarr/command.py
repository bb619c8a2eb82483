"""`resample-volume convert`: volumes of any format as OME-Zarr."""

from pathlib import Path
from typing import Annotated, Literal

from resample.command import flags
from resample.console import progress_bar, say
from resample_volume.command.choices import ReadOptions
from resample_volume.command.inputs import held, note_assumed, opened, require_linear
from resample_volume.types import Recording
from resample_zarr.volumes import Single
from resample_zarr.writing import Layered, bricks_of, check_store, write_store

SOURCE = ReadOptions.usual()


def convert(
    volume: str,
    output: Path,
    /,
    *,
    chunk: flags.AppearanceFlag[int] = 64,
    shard: flags.AppearanceFlag[int | None] = None,
    compression: flags.AppearanceFlag[Literal["zstd", "blosc", "none"]] = "zstd",
    levels: flags.AppearanceFlag[bool] = True,
    source: Annotated[ReadOptions, flags.Flat] = SOURCE,
) -> None:
    """Write any volume as OME-Zarr 0.5, brick by brick, with coarser levels of exact means.

    For example:

        resample-volume convert sample:vessel-tree vessels.ome.zarr
        resample-volume convert sample:vessel-tree small.ome.zarr --chunk 32
        resample-volume convert checker-box box.ome.zarr --compression none

    Parameters
    ----------
    volume
        A file, a folder of slices, or checker-box, vessel-tree, marschner-lobb; by default with all
        times and channels.
    output
        Written to: a folder engine.ome.zarr, which appears once it is complete.
    chunk
        Voxels along each side of a chunk.
    shard
        Voxels along each side of a file that holds several chunks. [default: a file per chunk]
    compression
        Compression of chunks.
    levels
        Write coarser levels, too.
    """
    form = Layered(chunk, shard, compression, levels)
    check_store(output)
    recording = opened_recording(source, volume)
    if recording.note:
        say(recording.note)
    note_assumed(recording)
    with progress_bar("converting bricks", bricks_of(recording, form)) as progress:
        write_store(output, recording, form, progress)


def opened_recording(source: ReadOptions, name: str) -> Recording:
    """Open what `source` chooses of a name; values of chunked files stay in their file."""
    require_linear(source, "convert keeps values as they are")
    if source.time is not None or source.channel is not None:
        volume = opened(source, name, streamed=True)
        if volume.colors is None:
            values = Single(volume.values)
            found = Recording(values, *volume[1:6], note=volume.note, space=volume.space)
            return found._replace(length=volume.length)
    return held(source, name, streamed=True)
