"""Points of splats' small texels, as the engine's batches."""

from resample.engine.cells.batch import Batch, Places
from resample.engine.cells.taps import add_points
from resample.engine.jit import inner_kernel
from resample.types import Floats


@inner_kernel
def add_points_gray(
    sums: Floats, start: int, width: int, values: Floats, pixel: Places,
    along_x: Floats, along_y: Floats, mass: Floats, profile: Floats,
) -> None:  # fmt: skip
    """Add points of one or three channels to the taps × taps pixels around each."""
    batch = Batch(pixel, along_x, along_y, mass, values)
    add_points(sums, start, width, batch, mass.size, profile)


add_points_color = add_points_gray
