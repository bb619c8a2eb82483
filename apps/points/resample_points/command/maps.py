"""Maps of clouds seen from above, as GeoTIFF, for the command line."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from resample.command.flags import OptionTopic, Several
from resample.command.settings import Choices, Threads
from resample_points.command.choices import CloudOptions, Crop, Only

if TYPE_CHECKING:
    from resample.command.session import Session
    from resample.files.metadata.fields import FileMetadata
    from resample.files.pictures import Picture
    from resample.types import Floats
    from resample_points.files.las import CoordinateSystem
    from resample_points.painting.rasters import Raster

SUFFIXES = (".tif", ".tiff")
MISSING, NO_CLASS = "-9999", "255"  # values of cells without a surface
METERS_PER_DEGREE = 111_320.0


class MapOptions(Choices):
    """Contents of a map."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    resolution: Annotated[
        float | None,
        Field(
            gt=0,
            description="Side of a cell, scene units: 0.5. [default: the usual distance of the "
            "points, as 1, 2 or 5 times a power of ten]",
        ),
    ] = None
    what: Annotated[
        str,
        Field(
            description="Values: z, color, class, intensity, density (points per square unit), or "
            "another column."
        ),
    ] = "z"
    also: Annotated[
        tuple[str, ...],
        OptionTopic.SOURCE,
        Several,
        Field(description="Another tile of the same coordinate system: b.laz or another."),
    ] = ()
    only: Only = ()
    crop: Crop = None
    threads: Threads = None

    def check(self, output: Path) -> None:
        """Reject invalid options before any work is done."""
        if output.suffix.lower() not in SUFFIXES:
            raise ValueError(f"{output}: maps are written as {' or '.join(SUFFIXES)}")
        CloudOptions(only=self.only, crop=self.crop).check(output, 1)


def write_map(session: "Session", files: Sequence[Path], output: Path, options: MapOptions) -> None:
    """Map the clouds of files, and write the map as its rows are made."""
    from resample.console import say
    from resample.files.formats import WriteOptions
    from resample.files.saving import writing_rows
    from resample.messages import naming
    from resample.progress import told
    from resample_points.data.columns import SCANNED, join_clouds, select_points
    from resample_points.files.readers import read_cloud
    from resample_points.painting.rasters import raster_of, rasterized, usual_resolution

    column = {"intensity": SCANNED[0], "class": SCANNED[1]}.get(options.what, options.what)
    look = CloudOptions(only=options.only, crop=options.crop)
    needed = [*(wanted.column for wanted in look.conditions()), column]
    columns = [name for name in dict.fromkeys(needed) if name not in ("z", "color", "density")]
    system = common_system(files)
    name = files[0].name if len(files) == 1 else f"{len(files)} clouds"
    with session.stage("read", bar="reading") as progress, told(progress), naming(name):
        cloud = join_clouds([read_cloud(each, columns=columns) for each in files])
        cloud = select_points(cloud, options.only, options.crop)
        raster = raster_of(cloud, options.resolution or usual_resolution(cloud))
    about = facts_of(raster, options.what, system)
    unit = METERS_PER_DEGREE if system is not None and system.is_geographic else 1.0
    bands = rasterized(cloud, raster, options.what, height_unit=unit, threads=options.threads)
    with (
        session.stage("paint", bar="mapping") as progress,
        told(progress),
        naming(name),
        writing_rows(output, raster.height, WriteOptions()) as put,
    ):
        for _, values in bands:
            put(picture_of(values, options.what, about))
    cells = f"{raster.width} × {raster.height} cells of {raster.resolution:g}"
    place = "without a coordinate system" if system is None else system.name
    say(f"{output.name}: {cells} from {raster.left:.15g}, {raster.top:.15g} on, {place}")


def common_system(files: Sequence[Path]) -> "CoordinateSystem | None":
    """Return the coordinate system of files; reject files of several."""
    from resample.console import say
    from resample_points.files.las import coordinate_system_of
    from resample_points.files.readers import LASER

    systems = {
        file.name: coordinate_system_of(file) for file in files if file.suffix.lower() in LASER
    }
    names = {system.name: name for name, system in systems.items() if system is not None}
    if len(names) > 1:
        told = ", ".join(f"{name} in {system}" for system, name in names.items())
        raise ValueError(f"tiles of one coordinate system make a map; these are {told}")
    system = next((system for system in systems.values() if system is not None), None)
    if system is not None and not system.tags:
        say(f"{system.name} has no code of EPSG, so the map does not name it")
    return system


def facts_of(raster: "Raster", what: str, system: "CoordinateSystem | None") -> "FileMetadata":
    """Return a map's metadata for its file: position, coordinate system, missing value."""
    import numpy as np

    from resample.files.metadata.fields import FileMetadata
    from resample.files.metadata.tags import Geo

    matrix = np.diag([raster.resolution, -raster.resolution, 1.0, 1.0])
    matrix[:2, 3] = raster.left, raster.top
    nodata = {"color": "", "density": "", "class": NO_CLASS}.get(what, MISSING)
    geo = Geo(matrix, None, {} if system is None else system.tags, nodata, is_point=False)
    return FileMetadata(geo=geo, number="uint8" if what == "class" else "")


def picture_of(values: "Floats", what: str, about: "FileMetadata") -> "Picture":
    """Return rows of a map as they are written: colors with their opacity, or numbers."""
    import numpy as np

    from resample.files.pictures import Kind, Picture

    if what != "color":
        bits = 8 if what == "class" else 32
        return Picture(values, Kind(("Y",), bits, is_encoded=False), about)
    is_known = np.isfinite(values[..., :1])
    rgba = np.concatenate([np.where(is_known, values, 0), is_known], axis=2, dtype=np.float32)
    return Picture(rgba, Kind(("R", "G", "B", "A"), 8, is_encoded=True), about)
