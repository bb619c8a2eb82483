"""Find the converter of an object by its type's module, without importing its library."""

from typing import Any

from resample_volume.exchange.parts import Taker


def taker_of(given: Any) -> Taker | None:
    """Return the converter of an object, with values (Z, Y, X) or (Z, Y, X, C) of any type.

    None for objects of no known library.
    """
    from resample_volume.exchange.datasets import of_dataset
    from resample_volume.exchange.grids import of_grid
    from resample_volume.exchange.images import of_nibabel, of_simple_itk
    from resample_volume.exchange.labeled import of_labeled

    every = type(given).__mro__
    homes = {kind.__module__.partition(".")[0] for kind in every}
    if "vtkObjectBase" in {kind.__name__ for kind in every}:  # PyVista's, too
        return of_dataset
    if "SimpleITK" in homes:
        return of_simple_itk
    if "nibabel" in homes:
        return of_nibabel
    if hasattr(given, "dims") and hasattr(given, "coords"):
        return of_labeled
    if hasattr(given, "left_edge") and hasattr(given, "ActiveDimensions"):
        return of_grid
    return None
