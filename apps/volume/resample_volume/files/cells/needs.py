"""What reading a grid of cells needs to have installed."""

from importlib.util import find_spec


def require_vtk(name: str) -> None:
    """Refuse a file where VTK is not installed.

    Raises
    ------
    ValueError
        It is not.
    """
    if find_spec("vtkmodules") is None:
        raise ValueError(
            f"{name} holds a grid of cells, which VTK resamples; pip install 'hybrid-resample[vtk]'"
        )
